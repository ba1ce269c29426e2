// toothprep prepare: the path of a preparation, made for this tooth.
#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <iostream>
#include <memory>

#include "placing.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/preparation_paths/cavity_plan.h"
#include "toothprep/tools/preparation_paths/crown_plan.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

constexpr double kCell = 0.1;  // mm, of the grid that paths are planned on

struct Options {
  SessionOptions session;
  std::string type, side, output, picture;
  std::optional<double> depth, width, into_dentin;
  CavityShape cavity;
  CrownShape crown;
  double keep = 0.5, clear = 0.1;
  bool allow_contact = false;
  bool json = false, force = false, strict = false;
};

// With x to the side of the box, if there is one.
Pose planning_frame(const Options& o, const ToothFrame& frame, const LayeredTooth& tooth) {
  if (!frame.occlusal.known())
    throw InputError(o.session.tooth, "", "the occlusal direction is not known",
                     "give it by toothprep orient --occlusal");
  Pose pose = upright_frame(frame, tooth);
  if (o.type != "class2") return pose;
  if (!frame.mesial.known())
    throw InputError(o.session.tooth, "",
                     "the mesial direction is not known, so the box has no side",
                     "give it by toothprep orient --mesial");
  if (o.side.empty())
    throw InputError("--side", "", "is needed for class2", "give mesial or distal");
  if (o.side == "distal")
    pose.orientation = pose.orientation * Quat(Eigen::AngleAxisd(M_PI, Vec3::UnitZ()));
  return pose;
}

Plan planned(const Options& o, const LayeredTooth& whole, const ToothFrame& frame,
             const ToothGrid& grid, const Bur& bur) {
  if (o.type == "crown") return plan_crown(grid, bur, o.crown);
  CavityShape shape = o.cavity;
  if (o.depth) shape.depth = *o.depth;
  if (o.width) shape.width = *o.width;
  shape.into_dentin = o.into_dentin;
  CavityGround ground;
  ground.others = surface_of_others(grid, whole);
  ground.clear = o.clear;
  if (frame.fossa) ground.fossa = grid.frame().to_local(*frame.fossa).head<2>();
  if (frame.mesial.known())
    ground.along = (grid.frame().orientation.conjugate() * frame.mesial.direction).head<2>();
  return o.type == "class1" ? plan_class1(grid, bur, shape, ground)
                            : plan_class2(grid, bur, shape, ground);
}

// What must not happen is refused, with the place and by how much.
void refuse_harm(const Options& o, const PathCheck& check) {
  if (check.least_to_pulp && *check.least_to_pulp < o.keep) {
    const Vec3& at = check.least_to_pulp_at;
    const std::string place = fmt::format("at {:.2f} {:.2f} {:.2f} mm", at.x(), at.y(), at.z());
    throw InputError(
        o.session.tooth, "",
        *check.least_to_pulp <= 0
            ? fmt::format("this preparation would open the pulp {}, by {:.2f} mm", place,
                          -*check.least_to_pulp)
            : fmt::format("this preparation would leave {:.2f} mm of dentin over the pulp {}",
                          *check.least_to_pulp, place),
        fmt::format(
            "it must keep {:g} mm (--keep-mm): take {:.2f} mm less depth or reduction there",
            o.keep, o.keep - *check.least_to_pulp));
  }
  if (check.shank_overlap > 0.02)
    throw InputError("--bur", o.session.bur,
                     fmt::format("is too short: its shank would run into the tooth ({:.2f} mm3)",
                                 check.shank_overlap),
                     "take a bur with a longer head or a thinner neck, or a shallower cavity");
}

// The gum and other teeth. A crown's rounds pass beside the tooth, by more than a contact leaves.
void refuse_contact(const Options& o, const LayeredTooth& whole, const PathCheck& check) {
  if (!check.least_to_other || *check.least_to_other > 0) return;
  const Vec3& at = check.least_to_other_at;
  const std::string what =
      fmt::format("this preparation would cut {} at {:.2f} {:.2f} {:.2f} mm, by {:.2f} mm",
                  body_at(whole, at), at.x(), at.y(), at.z(), -*check.least_to_other);
  if (!o.allow_contact)
    throw InputError(o.session.tooth, "", what,
                     "take a thinner bur or a smaller preparation, or --allow-contact");
  warn(o.session.tooth + ": " + what);
}

std::string command_of(const Options& o) {
  return fmt::format(
      "A {} preparation for {}, made by toothprep prepare {}; bur: {}; preset {}, {} "
      "drive.",
      o.type, o.session.tooth, kVersion, o.session.bur,
      o.session.preset.empty() ? "paper" : o.session.preset, o.session.drive);
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.session.tooth, o.session.bur, o.session.params});
  const std::string output = outputs.file(o.output, {".toml"});
  const std::string picture = outputs.optional_file(o.picture, {".png"});
  outputs.begin();
  const Parameters parameters = load_parameters(o.session);
  const Bur bur = make_bur(o.session.bur, data_folder() + "/burs");
  const LayeredTooth whole = load_tooth(o.session.tooth, o.strict);
  const LayeredTooth tooth = with_others_as_other(whole);
  const ToothFrame frame = frame_of(tooth);
  const Pose pose = planning_frame(o, frame, tooth);
  const ToothGrid grid(tooth, pose, kCell);
  Plan plan = planned(o, whole, frame, grid, bur);
  choose_feeds(plan, grid, bur, parameters, drive_of(o.session));
  plan.facts.push_back(fmt::format("takes     {:.0f} s", duration(plan)));
  const std::string script = script_of(plan, pose, command_of(o));
  const Trajectory path = parse_script(script, o.output);
  const PathCheck check = check_path(whole, pose, bur, path.samples);
  refuse_harm(o, check);
  refuse_contact(o, whole, check);
  std::ofstream(output) << script;
  if (!picture.empty()) write_path_picture(tooth, frame, bur, path, check, picture);
  outputs.publish();
  if (!check.least_to_pulp)
    warn_or_refuse(
        {o.session.tooth + ": no pulp is labelled, so nothing says how near the path comes "
                           "to it"},
        false);
  say(common, o.output + ": " + o.type);
  for (const std::string& fact : plan.facts) say(common, "  " + fact);
  for (const std::string& line : path_lines(check, whole)) say(common, line);
  if (!o.json) return;
  nlohmann::ordered_json j = {{"schema", "toothprep-prepare"},
                              {"schema_version", 1},
                              {"toothprep_version", kVersion},
                              {"build", build_text()},
                              {"type", o.type},
                              {"tooth_sha256", tooth_sha256(whole)},
                              {"bur", o.session.bur},
                              {"duration_s", duration(plan)},
                              {"facts", plan.facts}};
  j.update(path_json(check, whole));
  std::cout << json_text(j);
}

void add_shape(CLI::App& sub, Options& o) {
  sub.add_option("--depth-mm", o.depth,
                 "Cavity: floor below the surface, in the median over the floor; mm (1.8)")
      ->check(CLI::Range(0.2, 6.0));
  sub.add_option("--into-dentin-mm", o.into_dentin,
                 "Cavity, in place of --depth-mm: floor below the enamel's border, everywhere")
      ->check(CLI::Range(0.0, 4.0))
      ->excludes("--depth-mm");
  sub.add_option("--width-mm", o.width, "Cavity: buccolingual width along the fissure; mm (1.4)")
      ->check(CLI::Range(0.3, 6.0));
  sub.add_option("--ridge-mm", o.cavity.ridge, "Cavity: of the marginal ridges so much stays")
      ->check(CLI::Range(0.0, 5.0))
      ->capture_default_str();
  sub.add_option("--longest-mm", o.cavity.longest, "Cavity: so much of the fissure at most")
      ->check(CLI::Range(1.5, 12.0))
      ->capture_default_str();
  sub.add_option("--side", o.side, "Class II: the side of the box")
      ->check(CLI::IsMember({"mesial", "distal"}));
  sub.add_option("--box-width-mm", o.cavity.box_width, "Class II: buccolingual width of the box")
      ->check(CLI::Range(0.3, 8.0))
      ->capture_default_str();
  sub.add_option("--axial-depth-mm", o.cavity.axial_depth,
                 "Class II: from the proximal surface to the axial wall")
      ->check(CLI::Range(0.3, 4.0))
      ->capture_default_str();
  sub.add_option(
         "--gingival-below-mm", o.cavity.gingival_below,
         "Class II: gingival floor below the pulpal one (absent: 1 mm below the contact, but\n"
         "0.8 mm above the neck)")
      ->check(CLI::Range(0.4, 5.0));
  sub.add_option("--reduction-mm", o.crown.reduction, "Crown: so much off the occlusal surface")
      ->check(CLI::Range(0.3, 4.0))
      ->capture_default_str();
  sub.add_option("--margin-width-mm", o.crown.margin_width, "Crown: width of the margin")
      ->check(CLI::Range(0.2, 2.5))
      ->capture_default_str();
  sub.add_option("--margin-mm", o.crown.above_neck, "Crown: margin above the enamel's lower border")
      ->check(CLI::Range(0.0, 4.0))
      ->capture_default_str();
  sub.add_option("--taper-deg", o.crown.taper, "Crown: taper of each wall")
      ->check(CLI::Range(0.0, 20.0))
      ->capture_default_str();
}

}  // namespace

void add_prepare(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("prepare", "The path of a preparation, made for this tooth");
  const auto o = std::make_shared<Options>();
  add_session_options(*sub, o->session);
  sub->add_option("--type", o->type, "What to prepare")
      ->check(CLI::IsMember({"class1", "class2", "crown"}))
      ->required();
  add_shape(*sub, *o);
  sub->add_option("--keep-mm", o->keep,
                  "Refuse what would leave less over the pulp; what opens it always is")
      ->check(CLI::Range(0.0, 5.0))
      ->capture_default_str();
  sub->add_option(
         "--clear-mm", o->clear,
         "Class II: the box keeps so far from a neighbour and from the gum, if the tooth's\n"
         "file has them")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  sub->add_flag("--allow-contact", o->allow_contact,
                "What would cut a neighbour or the gum is warned of in place of refused");
  sub->add_option("-o,--output", o->output, "Script to write (.toml), for replay")->required();
  sub->add_option("--picture", o->picture, "The path in the tooth (.png)");
  sub->add_flag("--json", o->json, "Figures along the path on stdout as JSON");
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "The feeds suit --drive and the parameters: replay with the same ones.\n"
      "Example: toothprep prepare --type class1 --tooth tooth.vdb --bur 57 -o class1.toml\n"
      "         toothprep replay --tooth tooth.vdb --bur 57 --trajectory class1.toml -o trace.h5 "
      "\\\n"
      "           --prepared prepared.vdb");
  sub->callback([o, &common] {
    if (o->session.bur == "list") return print_bur_library();
    if (o->session.bur.empty()) o->session.bur = o->type == "crown" ? "847KR-018" : "57";
    if (o->session.tooth.empty()) throw CLI::RequiredError("--tooth");
    run(*o, common);
  });
}

}  // namespace toothprep::app
