// toothprep orient: where occlusal, mesial and buccal are on a tooth.
#include <fmt/format.h>

#include <iostream>
#include <memory>

#include "command.h"
#include "frame_json.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/orientation/landmarks.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/renderer.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string input, output, picture, landmarks;
  std::vector<double> occlusal, mesial, buccal;
  int tooth_number = 0;
  bool anew = false, json = false, force = false, strict = false;
};

// Flags before landmarks before what the file holds already.
KnownAxes known_of(const Options& o, const LayeredTooth& tooth) {
  KnownAxes given;
  const auto flag = [&](const std::vector<double>& v, FrameAxis& axis) {
    if (!v.empty()) axis = {Vec3(v[0], v[1], v[2]), 0, AxisSource::kGiven};
  };
  flag(o.occlusal, given.occlusal);
  flag(o.mesial, given.mesial);
  flag(o.buccal, given.buccal);
  if (o.tooth_number > 0) given.tooth_number = o.tooth_number;
  KnownAxes known;
  if (!o.anew) known = known_axes(recorded_frame(tooth.provenance));
  if (!o.landmarks.empty()) known = both(read_landmarks(o.landmarks), std::move(known));
  return both(given, std::move(known));
}

// The tooth's directions as arrows out of the crown's middle, and its places.
void draw_frame(Picture& picture, const Camera& camera, const ToothFrame& frame, const Vec3& middle,
                double length) {
  const auto arrow = [&](const FrameAxis& axis, double way, const char* letter) {
    if (!axis.known()) return;
    const Vec3 out = way * axis.direction;
    if (std::abs(out.dot(camera.forward)) > 0.9) return;  // seen end-on
    draw_arrow(picture, camera, middle + 0.6 * length * out, middle + length * out, letter);
  };
  arrow(frame.mesial, 1, "M");
  arrow(frame.mesial, -1, "D");
  arrow(frame.buccal, 1, "B");
  arrow(frame.buccal, -1, "L");
  for (const Vec3& tip : frame.cusps) draw_place(picture, camera, tip);
  const bool from_above = frame.occlusal.direction.dot(camera.forward) < -0.5;
  if (frame.fossa && from_above) draw_place(picture, camera, *frame.fossa);
  for (const Vec3& x : frame.cervical_line)
    if ((x - middle).dot(camera.forward) < 0) draw_place(picture, camera, x);
}

// From the occlusal and from two sides.
void write_picture(const LayeredTooth& tooth, const ToothFrame& frame, const std::string& path) {
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  const ToothAxes axes = axes_of_frame(frame);
  const Box box = bounds_of_solid(tooth);
  Vec3 middle = 0.5 * (box.min + box.max);
  if (frame.occlusal_plane && frame.cervical)
    middle = 0.5 * (frame.occlusal_plane->point + frame.cervical->point);
  Fit fit;
  fit.width = 480;
  fit.height = 640;
  fit.margin = 0.14;
  RenderOptions options;
  options.samples = 2;
  options.ambient_rays = 48;
  std::vector<Picture> pictures;
  double scale = 0;
  for (const char* name : {"occlusal", "buccal", "mesial"})
    scale = std::max(scale, fit_camera(view_of(name, axes), renderer.meshes(), fit).mm_per_pixel);
  fit.mm_per_pixel = scale;
  for (const char* name : {"occlusal", "buccal", "mesial"}) {
    const Camera camera = fit_camera(view_of(name, axes), renderer.meshes(), fit);
    Picture picture = picture_of(renderer.render(camera, options));
    draw_frame(picture, camera, frame, middle, 0.4 * fit.width * scale);
    draw_triad(picture, camera, axes);
    if (pictures.empty()) draw_scale_bar(picture, scale);
    pictures.push_back(std::move(picture));
  }
  write_png(side_by_side(pictures), path);
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.input, o.landmarks});
  const std::string output = outputs.optional_file(o.output, {".vdb"});
  const std::string picture = outputs.optional_file(o.picture, {".png"});
  outputs.begin();
  LayeredTooth tooth = load_tooth(o.input, o.strict);
  const ToothFrame frame = estimate_frame(tooth, known_of(o, tooth));
  record_frame(frame, tooth.provenance);
  if (!output.empty()) write_tooth(tooth, output);
  if (!picture.empty()) write_picture(tooth, frame, picture);
  outputs.publish();
  for (const std::string& note : frame.notes) warn(o.input + ": " + note);
  if (o.json) {
    nlohmann::ordered_json json = {{"schema", "toothprep-frame"},
                                   {"schema_version", 1},
                                   {"toothprep_version", kVersion},
                                   {"build", build_text()},
                                   {"file", o.input},
                                   {"tooth_sha256", tooth_sha256(tooth)}};
    put_frame(json, "", frame);
    json["notes"] = frame.notes;
    std::cout << json_text(json);
  } else {
    std::cout << frame_text(frame) << '\n'
              << fmt::format("form {}, {} cusps, central fossa {}, cervical line {}\n",
                             name_of(frame.form), frame.cusps.size(),
                             frame.fossa_picked ? "picked"
                             : frame.fossa      ? "found"
                                                : "not found",
                             frame.cervical ? "found" : "not found");
  }
  if (!o.output.empty()) say(common, o.output + ": with its frame");
}

}  // namespace

void add_orient(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("orient", "Occlusal, mesial and buccal directions of a tooth");
  const auto o = std::make_shared<Options>();
  sub->add_option("tooth", o->input, "Tooth file (.vdb)")->required();
  sub->add_option("-o,--output", o->output, "The tooth with its frame to write (.vdb)");
  sub->add_option("--picture", o->picture,
                  "Picture to check it by (.png): from the occlusal and two sides, with M, D, B, L "
                  "and O, cusp tips, fossa and neck");
  const auto vector = [&](const char* name, std::vector<double>& value, const char* text) {
    sub->add_option(name, value, text)->delimiter(',')->expected(3);
  };
  vector("--occlusal", o->occlusal, "Occlusal direction X,Y,Z, in place of the estimate");
  vector("--mesial", o->mesial, "Mesial direction X,Y,Z: form doesn't say which side it is");
  vector("--buccal", o->buccal, "Buccal (labial) direction X,Y,Z");
  sub->add_option("--tooth-number", o->tooth_number,
                  "FDI number, 11 to 48 or 51 to 85: of --mesial and --buccal one is enough then")
      ->check(CLI::Range(11, 85));
  sub->add_option("--landmarks", o->landmarks,
                  "Places picked on the tooth (.toml; data/scans/README.md)");
  sub->add_flag("--anew", o->anew, "Forget what the file holds of earlier corrections");
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->add_flag("--json", o->json, "The frame on stdout as JSON");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Enamel, roots, neck and cusps give the occlusal direction with an uncertainty (95 %), or\n"
      "'not known'. voxelize keeps the estimate in its file; score, render and info use it.\n"
      "Example: toothprep orient tooth.vdb --mesial 0,-1,0 --tooth-number 36 -o oriented.vdb \\\n"
      "           --picture frame.png");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
