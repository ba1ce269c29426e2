// toothprep view: a tooth, a mesh or a recorded session in the user's browser.
#include <fmt/format.h>

#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "command.h"
#include "drawn.h"
#include "opened_page.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trajectory_file.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/score/assess.h"
#include "toothprep/tools/score/score_file.h"
#include "toothprep/tools/view/file_scene.h"
#include "toothprep/tools/view/page_server.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::vector<std::string> files;
  std::string tooth, bur, bind = "127.0.0.1";
  int port = 0;
  bool no_open = false, strict = false;
};

bool is_recording(const std::string& path) {
  return has_extension(path, ".h5") || has_extension(path, ".hdf5");
}

std::string file_name(const std::string& path) {
  return std::filesystem::path(path).filename().string();
}

// A tooth without its surface: the page's comes from the voxels, in blocks.
ViewLayer layer_of(const std::string& path, LayeredTooth tooth) {
  if (!(volume_mm3(tooth.solid, tooth.lattice.voxel) > 0))
    throw InputError(path, "grid 'solid'", "nothing remains, so there is nothing to draw");
  ViewLayer layer;
  layer.name = file_name(path);
  layer.tooth = std::make_unique<LayeredTooth>(std::move(tooth));
  return layer;
}

ViewLayer read_layer(const std::string& path, bool strict) {
  if (has_extension(path, ".vdb")) return layer_of(path, load_tooth(path, strict));
  ViewLayer layer;
  layer.name = file_name(path);
  layer.mesh = read_drawn(path).part.mesh;
  layer.deviation =
      vertex_property(path, layer.mesh, "deviation_mm").value_or(std::vector<float>());
  return layer;
}

// The surface that `score --report` wrote into its folder, with its deviations if there was a target.
std::string surface_of_report(const std::string& folder) {
  namespace fs = std::filesystem;
  for (const char* name : {"deviation.ply", "prepared.ply"})
    if (const fs::path file = fs::path(folder) / name; fs::exists(file)) return file.string();
  throw InputError(folder, "", "holds neither deviation.ply nor prepared.ply",
                   "give the folder that `score --report` wrote");
}

// Both teeth of a score; with a target the prepared one on the original, with its deviations.
void add_scored_teeth(const std::string& path, bool strict, std::vector<ViewLayer>& layers) {
  const ScoredInputs inputs = read_scored_inputs(path);
  for (const std::string& file : inputs.changed)
    warn_or_refuse({file + ": has been changed since it was scored"}, strict);
  if (inputs.target.empty()) {
    for (const std::string& file : {inputs.original, inputs.prepared})
      layers.push_back(read_layer(file, strict));
    return;
  }
  AssessmentOptions options;
  options.original = inputs.original;
  options.prepared = inputs.prepared;
  options.target = inputs.target;
  options.register_teeth = inputs.registered;
  options.mm_per_unit = inputs.mm_per_unit;
  options.voxel = inputs.voxel_mm.value_or(options.voxel);
  Assessment compared = compare_teeth(options);
  warn_or_refuse(compared.sheet.warnings, strict);
  layers.push_back(compared.original.layered
                       ? layer_of(inputs.original, std::move(compared.original.tooth))
                       : read_layer(inputs.original, strict));
  ViewLayer prepared;
  prepared.name = file_name(inputs.prepared);
  prepared.tooth = std::make_unique<LayeredTooth>(std::move(compared.prepared.tooth));
  prepared.mesh = std::move(compared.prepared.surface);
  prepared.deviation = std::move(compared.deviation->per_vertex);
  layers.push_back(std::move(prepared));
}

// The recording, checked against the tooth that is to be seen with it.
std::unique_ptr<Recording> read_recording(const Options& o, const std::string& path,
                                          const LayeredTooth& tooth) {
  Trace trace = read_trace(path);
  if (trace.unfinished) warn(unfinished_text(path));
  if (trace.rows_every > 1)
    throw InputError(path, "rows_every",
                     "it holds every " + std::to_string(trace.rows_every) +
                         "th step only, and the tooth can't be cut again from that",
                     "replay its trajectory without --trace-every");
  if (!trace.tooth_sha256.empty() && trace.tooth_sha256 != tooth_sha256(tooth))
    throw InputError(path, "tooth_sha256", "it was recorded on another tooth",
                     "give the tooth as it was before the session");
  const Parameters parameters = parse_parameters(trace.parameters_toml, path);
  Recording r{make_bur(o.bur.empty() ? trace.bur : o.bur, data_folder() + "/burs"),
              parameters,
              drive_named(trace.drive).value_or(Drive::kCoupled),
              resample(read_trajectory(path), parameters.time_step, false, path),
              {},
              std::move(trace.rows),
              {},
              {},
              {},
              {}};
  r.interventions = interventions_of(trace.events, r.bur, path);
  if (r.path.size() != r.rows.size())
    throw InputError(
        path, "/time",
        fmt::format("its steps are not those of its time step, {:g} s", parameters.time_step));
  if (is_session_file(path)) {
    SessionRecording session = read_session(path);
    r.flags = std::move(session.flags);
    r.faults = std::move(session.fault);
    r.missed = std::move(session.missed);
    for (std::size_t i = 0; i < session.mirror_position.size(); ++i)
      r.mirror.push_back({session.mirror_position[i], session.mirror_orientation[i]});
    if (r.flags.size() != r.rows.size())  // it grows
      throw InputError(path, "/servo/flags", "it was written to while it was read", "try again");
  }
  return std::make_unique<Recording>(std::move(r));
}

std::unique_ptr<PageSource> read_scene(const Options& o) {
  std::vector<ViewLayer> layers;
  std::string recording, other;
  for (const std::string& file : o.files) {
    if (std::filesystem::is_directory(file)) {
      layers.push_back(read_layer(surface_of_report(file), o.strict));
    } else if (has_extension(file, ".json")) {
      add_scored_teeth(file, o.strict, layers);
    } else if (!is_recording(file)) {
      layers.push_back(read_layer(file, o.strict));
    } else if (recording.empty()) {
      recording = file;
    } else if (other.empty()) {
      other = file;
    } else {
      throw InputError(file, "FILE", "three recordings can't be seen at once");
    }
  }
  if (!o.tooth.empty()) {
    if (recording.empty()) throw Error("--tooth goes with a recording (.h5)");
    layers.push_back(read_layer(o.tooth, o.strict));
  }
  if (recording.empty()) return file_scene(std::move(layers), nullptr, nullptr, kVersion);
  if (layers.empty() || !layers.back().tooth)
    throw InputError(recording, "--tooth", "a recording is seen on its tooth",
                     "give the tooth that was cut (.vdb)");
  const LayeredTooth& tooth = *layers.back().tooth;
  auto seen = read_recording(o, recording, tooth);
  auto over = other.empty() ? nullptr : read_recording(o, other, tooth);
  return file_scene(std::move(layers), std::move(seen), std::move(over), kVersion);
}

void run(const Options& o, const Common& common) {
  const std::unique_ptr<PageSource> scene = read_scene(o);
  PageServerSettings settings;
  settings.bind = o.bind;
  settings.port = static_cast<unsigned short>(o.port);
  PageServer server(settings, *scene);
  if (o.bind != "127.0.0.1" && o.bind != "::1" && o.bind != "localhost")
    warn("whoever on the network reads along sees address and page: they are not encrypted");
  std::optional<OpenedPage> opened;
  server.run_until_signal([&] {
    std::cout << server.address() << std::endl;
    say(common, "this address is for you alone: who has it sees the page; Ctrl-C ends it");
    if (!o.no_open) opened.emplace(server.address());
  });
}

}  // namespace

void add_view(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand(
      "view", "A tooth, a mesh or a recorded session in the browser, turned and replayed");
  const auto o = std::make_shared<Options>();
  sub->add_option("files", o->files,
                  "Tooth (.vdb) or mesh (.ply, .stl, .obj, .off); two of them: before and after; a "
                  "trace or a live session (.h5) with its tooth, or two of them over each other; "
                  "what score wrote: its folder or .json")
      ->required();
  sub->add_option("--tooth", o->tooth, "The tooth on which the recording was made (.vdb)");
  sub->add_option("--bur", o->bur,
                  "In place of the recording's, if its file lies elsewhere (see replay --bur)");
  sub->add_option("--port", o->port, "Of the page's address; 0: any that is free")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  sub->add_option("--bind", o->bind,
                  "Listen on this address of the machine; others than its own are reached by the "
                  "network")
      ->capture_default_str();
  sub->add_flag("--no-open", o->no_open, "Only print the address, without opening a browser");
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->footer(
      "The address is printed on stdout, and has a random token: keep it to yourself.\n"
      "Examples:\n"
      "  toothprep view tooth.vdb\n"
      "  toothprep view trace.h5 --tooth tooth.vdb\n"
      "  toothprep view before.vdb after.ply\n"
      "  toothprep view first.h5 second.h5 --tooth tooth.vdb\n"
      "  toothprep view score-report\n"
      "  toothprep view score.json");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
