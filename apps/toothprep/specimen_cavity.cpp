// toothprep specimen cavity: test preparations that are known exactly.
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "command.h"
#include "toothprep/build_info.h"
#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

struct Options {
  std::string kind = "box", original, prepared, target, truth;
  bool force = false;
  std::vector<double> size = {12, 8, 12}, pulp_size = {3, 2, 2}, axis = {0, 1, 0},
                      position = {0, 0, 0};
  std::optional<double> pulp_depth, neighbour_gap, stump_corner, convergence;
  std::optional<double> taper;
  double spin = 0;
  CavityOptions cavity;
};

Vec3 three(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

CavityOptions cavity_of(const Options& o) {
  CavityOptions c = o.cavity;
  c.kind = o.kind == "box"      ? CavityKind::kBox
           : o.kind == "class2" ? CavityKind::kClass2
                                : CavityKind::kStump;
  c.size = three(o.size);
  c.pulp_size = three(o.pulp_size);
  c.pulp_depth = o.pulp_depth;
  c.neighbour_gap = o.neighbour_gap;
  c.stump_corner = o.stump_corner;
  if (o.convergence) c.convergence_u = c.convergence_v = *o.convergence;
  if (o.taper)
    for (double* wall : {&c.taper_u_plus, &c.taper_u_minus, &c.taper_v_plus, &c.taper_v_minus})
      *wall = *o.taper;
  const Vec3 axis = three(o.axis);
  if (!axis.allFinite() || !(axis.norm() > 1e-9) || !std::isfinite(o.spin))
    throw Error("--axis must be a finite direction other than zero, --spin-deg finite");
  c.pose.position = three(o.position);
  c.pose.orientation = (Quat::FromTwoVectors(Vec3::UnitY(), axis.normalized()) *
                        Quat(Eigen::AngleAxisd(units::from_degree(o.spin), Vec3::UnitY())))
                           .normalized();
  return c;
}

// A dotted key becomes a member of an object.
Json truth_json(const CavityOptions& cavity, const CavityTruth& truth) {
  Json json = {{"schema", "toothprep-cavity-truth"}, {"schema_version", 1},
               {"toothprep_version", kVersion},      {"build", build_text()},
               {"voxel_mm", cavity.voxel},           {"offset_mm", cavity.offset}};
  for (const TruthFigure& figure : truth) {
    const auto dot = figure.key.find('.');
    Json& place = dot == std::string::npos
                      ? json[figure.key]
                      : json[figure.key.substr(0, dot)][figure.key.substr(dot + 1)];
    if (figure.key == "pulp_exposed" || figure.key == "undercut_draws")
      place = figure.value != 0;
    else
      place = figure.value;
  }
  return json;
}

void run(const Options& o, const Common& common) {
  const CavityOptions cavity = cavity_of(o);
  check_cavity(cavity);
  Outputs outputs(o.force);
  const std::string prepared = outputs.file(o.prepared, {".vdb"});
  const std::string original = outputs.optional_file(o.original, {".vdb"});
  const std::string target = outputs.optional_file(o.target, {".vdb"});
  const std::string truth = outputs.optional_file(o.truth, {".json"});
  outputs.begin();

  const CavitySpecimen specimen = make_cavity(cavity);
  write_tooth(specimen.prepared, prepared);
  if (!original.empty()) write_tooth(specimen.original, original);
  if (!target.empty()) {
    CavityOptions nominal = cavity;
    nominal.offset = 0;
    write_tooth(make_cavity(nominal).prepared, target);
  }
  const CavityTruth figures = cavity_truth(cavity);
  if (!truth.empty()) write_file(truth, json_text(truth_json(cavity, figures)));
  outputs.publish();
  const auto volume = truth_value(figures, "removed_mm3.total");
  say(common,
      o.prepared + ": " + o.kind + (volume ? fmt::format(", {:g} mm^3 removed", *volume) : ""));
}

}  // namespace

void add_cavity(CLI::App& specimen, const Common& common) {
  auto* sub = specimen.add_subcommand(
      "cavity", "A tooth before and after a preparation whose every figure is known");
  const auto o = std::make_shared<Options>();
  CavityOptions& c = o->cavity;
  sub->add_option("--kind", o->kind, "box, class2 or stump")
      ->check(CLI::IsMember({"box", "class2", "stump"}))
      ->capture_default_str();
  sub->add_option("-o,--output", o->prepared, "Prepared tooth to write (.vdb)")->required();
  sub->add_option("--original", o->original, "Tooth before the preparation, to write (.vdb)");
  sub->add_option("--target", o->target,
                  "The same preparation without --offset-mm, to write (.vdb)");
  sub->add_option("--truth", o->truth, "True figures, to write (.json)");
  sub->add_flag("--force", o->force, "Replace existing outputs");

  const auto number = [](CLI::App* app, const char* name, double& value, const char* what) {
    app->add_option(name, value, what)->capture_default_str();
  };
  auto* tooth = sub->add_option_group("Tooth");
  tooth->add_option("--size-mm", o->size, "Size X,Y,Z; the top face lies at y = 0")
      ->delimiter(',')
      ->expected(3)
      ->default_str("12,8,12");
  number(tooth, "--corner-mm", c.corner,
         "Radius of its vertical edges (half the side: a cylinder)");
  number(tooth, "--enamel-mm", c.enamel, "Enamel below the top face");
  number(tooth, "--voxel-mm", c.voxel, "Voxel size");
  tooth->add_option("--pulp-depth-mm", o->pulp_depth, "A pulp: from the top face to its roof");
  tooth->add_option("--pulp-size-mm", o->pulp_size, "Its length, height, width")
      ->delimiter(',')
      ->expected(3)
      ->default_str("3,2,2");
  tooth->add_option("--neighbour-gap-mm", o->neighbour_gap, "A neighbour beside +u: its gap");
  tooth->add_option("--axis", o->axis, "Direction of the opening in the world, X,Y,Z")
      ->delimiter(',')
      ->expected(3)
      ->default_str("0,1,0");
  number(tooth, "--spin-deg", o->spin, "Turn about that axis");
  tooth->add_option("--position-mm", o->position, "Where the top face's middle lies, X,Y,Z")
      ->delimiter(',')
      ->expected(3)
      ->default_str("0,0,0");

  auto* box = sub->add_option_group("Box and class II");
  number(box, "--length-mm", c.length, "Length (u) at the floor's centre");
  number(box, "--width-mm", c.width, "Width (v) there; of class II, the isthmus");
  number(box, "--depth-mm", c.depth, "Depth of the floor's centre");
  auto* all = box->add_option("--taper-deg", o->taper,
                              "All four walls; positive opens, negative is undercut");
  for (const auto& [name, value, what] :
       {std::tuple{"--taper-mesial-deg", &c.taper_u_plus, "Wall at +u"},
        {"--taper-distal-deg", &c.taper_u_minus, "Wall at -u"},
        {"--taper-buccal-deg", &c.taper_v_plus, "Wall at +v"},
        {"--taper-lingual-deg", &c.taper_v_minus, "Wall at -v"}})
    box->add_option(name, *value, what)->capture_default_str()->excludes(all);
  number(box, "--floor-tilt-u-deg", c.floor_tilt_u, "The floor rises towards +u");
  number(box, "--floor-tilt-v-deg", c.floor_tilt_v, "The floor rises towards +v");
  number(box, "--bow-mm", c.bow, "Sagitta of a floor deepest in its middle (negative: a hump)");

  auto* class2 = sub->add_option_group("Class II");
  number(class2, "--proximal-width-mm", c.proximal_width, "Width of the box at its floor");
  number(class2, "--gingival-depth-mm", c.gingival_depth, "Depth of the gingival floor");
  number(class2, "--axial-depth-mm", c.axial_depth, "From the tooth's side to the axial wall");
  number(class2, "--axial-taper-deg", c.axial_taper, "Axial wall; positive opens");
  number(class2, "--proximal-taper-deg", c.proximal_taper, "Both side walls of the box");
  number(class2, "--neighbour-damage-mm", c.neighbour_damage,
         "How deep the box cuts the neighbour");

  auto* stump = sub->add_option_group("Stump");
  number(stump, "--occlusal-reduction-mm", c.occlusal_reduction, "From the top face to its top");
  number(stump, "--shoulder-level-mm", c.shoulder_level, "From the top face to the shoulder");
  number(stump, "--shoulder-width-mm", c.shoulder_width, "Width of the shoulder");
  auto* both = stump->add_option("--convergence-deg", o->convergence,
                                 "Total convergence of opposite walls; negative is undercut");
  stump->add_option("--convergence-u-deg", c.convergence_u, "Of the walls at +-u")
      ->capture_default_str()
      ->excludes(both);
  stump->add_option("--convergence-v-deg", c.convergence_v, "Of the walls at +-v")
      ->capture_default_str()
      ->excludes(both);
  stump->add_option("--stump-corner-mm", o->stump_corner,
                    "Radius of its vertical edges (default: the tooth's less the shoulder)");
  number(stump, "--occlusal-radius-mm", c.occlusal_radius, "Rounding of the edge of its top");
  number(stump, "--shoulder-radius-mm", c.shoulder_radius,
         "Rounding between walls and shoulder: a chamfer");
  number(stump, "--shoulder-slope-deg", c.shoulder_slope, "The shoulder falls outwards: a bevel");

  number(sub, "--offset-mm", c.offset, "Grow the cavity by this on all sides");
  sub->footer(
      "u is mesial (+x before turning), v buccal (-z), the opening occlusal (+y).\n"
      "The truth has the keys of score.json; lib/toothprep/proof/specimen/cavity.h defines every "
      "shape.\n"
      "Example: toothprep specimen cavity --kind box --taper-deg 6 --original original.vdb\n"
      "         -o prepared.vdb --truth truth.json");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
