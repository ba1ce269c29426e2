// toothprep place: a path that was made elsewhere, put on this tooth.
#include <fmt/format.h>

#include <iostream>
#include <memory>

#include "frame_json.h"
#include "placing.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/files/framed_trajectory_file.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/recordings/import_recording.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, trajectory, bur, output, picture;
  PlacingOptions placing;
  bool json = false, force = false, strict = false;
};

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads(
      {o.tooth, o.trajectory, o.bur, o.placing.from, o.placing.at, o.placing.registration});
  const std::string output = outputs.optional_file(o.output, {".h5", ".hdf5"});
  const std::string picture = outputs.optional_file(o.picture, {".png"});
  outputs.begin();
  const Bur bur = make_bur(o.bur, data_folder() + "/burs");
  PathFrame frame = PathFrame::kFile;
  Trajectory path = read_trajectory(o.trajectory, frame);
  if (path.rows_every > 1) warn_or_refuse({sparse_text(o.trajectory, path.rows_every)}, o.strict);
  const LayeredTooth whole = load_tooth(o.tooth, o.strict);
  const LayeredTooth tooth = with_others_as_other(whole);
  PlacedPath result = place_path(without_rejected(path), frame, o.trajectory, o.placing, tooth);
  const ToothFrame own = frame_of(tooth, o.placing);
  if (!own.occlusal.known())
    warn(o.tooth + ": the occlusal direction is not known; depths are along z of the file");
  const PathCheck check = check_path(
      whole, own.occlusal.known() ? upright_frame(own, tooth) : Pose(), bur, result.path.samples);
  std::vector<std::string> warnings = result.notes;
  for (const std::string& text : path_warnings(check, whole))
    warnings.push_back(o.trajectory + ": " + text);
  warn_or_refuse(warnings, o.strict);
  if (!picture.empty()) write_path_picture(tooth, own, bur, result.path, check, picture);
  if (!output.empty()) {
    ImportedRecording recording;
    recording.motion = std::move(result.path);
    write_imported(recording, {o.trajectory, sha256_of_file(o.trajectory), kVersion}, output);
  }
  outputs.publish();
  say(common, o.trajectory + ": " + result.how);
  for (const std::string& line : path_lines(check, whole)) say(common, line);
  if (!o.json) return;
  nlohmann::ordered_json j = {{"schema", "toothprep-place"},
                              {"schema_version", 1},
                              {"toothprep_version", kVersion},
                              {"build", build_text()},
                              {"trajectory", o.trajectory},
                              {"tooth_sha256", tooth_sha256(whole)},
                              {"bur", o.bur},
                              {"how", result.how}};
  put_frame(j, "tooth_", own);
  j.update(path_json(check, whole));
  j["warnings"] = warnings;
  std::cout << json_text(j);
}

}  // namespace

void add_place(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("place", "A path put on a tooth, and what it would do there");
  const auto o = std::make_shared<Options>();
  sub->add_option("--tooth", o->tooth, "Layered tooth (.vdb)")->required();
  sub->add_option("--trajectory", o->trajectory, "Script, table or recording (.toml, .csv, .h5)")
      ->required();
  sub->add_option("--bur", o->bur, "Shorthand, a name of the library, or a profile file")
      ->required();
  add_placing_options(*sub, o->placing, "--from");
  sub->add_option("-o,--output", o->output, "The path in the frame of the tooth's file (.h5)");
  sub->add_option("--picture", o->picture, "The path in the tooth (.png)");
  sub->add_flag("--json", o->json, "Figures along the path on stdout as JSON");
  add_strict(*sub, o->strict, "anything warned of");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Says how deep the bur would go below the surface and the dentin's border, how near to the\n"
      "pulp, and whether its shank would meet the tooth: by geometry, nothing is cut.\n"
      "Example: toothprep place --tooth tooth.vdb --trajectory path.toml --bur 57 --from tooth \\\n"
      "           --picture path.png -o placed.h5");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
