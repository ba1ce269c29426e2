// toothprep view: a tooth, a mesh or a recorded session in the user's browser.
#include <fmt/format.h>

#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>

#include "command.h"
#include "drawn.h"
#include "opened_page.h"
#include "strictness.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trajectory_file.h"
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

ViewLayer read_layer(const std::string& path, bool strict) {
  ViewLayer layer;
  layer.name = std::filesystem::path(path).filename().string();
  Drawn drawn = read_drawn(path, strict);
  if (drawn.tooth)
    layer.tooth = std::move(drawn.tooth);
  else
    layer.mesh = std::move(drawn.part.mesh);
  return layer;
}

Drive drive_named(const std::string& name) {
  return name == name_of(Drive::kDirect) ? Drive::kDirect : Drive::kCoupled;
}

// The recording, checked against the tooth that is to be seen with it.
std::unique_ptr<Recording> read_recording(const Options& o, const std::string& path,
                                          const LayeredTooth& tooth) {
  Trace trace = read_trace(path);
  if (trace.unfinished) warn(unfinished_text(path));
  if (!trace.tooth_sha256.empty() && trace.tooth_sha256 != tooth_sha256(tooth))
    throw InputError(path, "tooth_sha256", "it was recorded on another tooth",
                     "give the tooth as it was before the session");
  const Parameters parameters = parse_parameters(trace.parameters_toml, path);
  Recording r{make_bur(o.bur.empty() ? trace.bur : o.bur, data_folder() + "/burs"),
              parameters,
              drive_named(trace.drive),
              resample(read_trajectory(path), parameters.time_step, false, path),
              std::move(trace.rows),
              {},
              {},
              {}};
  if (r.path.size() != r.rows.size())
    throw InputError(
        path, "/time",
        fmt::format("its steps are not those of its time step, {:g} s", parameters.time_step));
  if (is_session_file(path)) {
    SessionRecording session = read_session(path);
    r.flags = std::move(session.flags);
    r.faults = std::move(session.fault);
    r.missed = std::move(session.missed);
    if (r.flags.size() != r.rows.size())  // it grows
      throw InputError(path, "/servo/flags", "it was written to while it was read", "try again");
  }
  return std::make_unique<Recording>(std::move(r));
}

std::unique_ptr<PageSource> read_scene(const Options& o) {
  std::vector<ViewLayer> layers;
  std::string recording;
  for (const std::string& file : o.files) {
    if (!is_recording(file)) {
      layers.push_back(read_layer(file, o.strict));
    } else if (recording.empty()) {
      recording = file;
    } else {
      throw InputError(file, "FILE", "two recordings can't be seen at once");
    }
  }
  if (!o.tooth.empty()) {
    if (recording.empty()) throw Error("--tooth goes with a recording (.h5)");
    layers.push_back(read_layer(o.tooth, o.strict));
  }
  if (recording.empty()) return file_scene(std::move(layers), nullptr, kVersion);
  if (layers.empty() || !layers.back().tooth)
    throw InputError(recording, "--tooth", "a recording is seen on its tooth",
                     "give the tooth that was cut (.vdb)");
  auto read = read_recording(o, recording, *layers.back().tooth);
  return file_scene(std::move(layers), std::move(read), kVersion);
}

void run(const Options& o, const Common& common) {
  const std::unique_ptr<PageSource> scene = read_scene(o);
  PageServerSettings settings;
  settings.bind = o.bind;
  settings.port = static_cast<unsigned short>(o.port);
  PageServer server(settings, *scene);
  if (o.bind != "127.0.0.1" && o.bind != "::1" && o.bind != "localhost")
    warn("whoever on the network reads along sees address and page: they are not encrypted");
  std::cout << server.address() << std::endl;
  say(common, "this address is for you alone: who has it sees the page; Ctrl-C ends it");
  std::optional<OpenedPage> opened;
  if (!o.no_open) opened.emplace(server.address());
  server.run_until_signal();
}

}  // namespace

void add_view(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand(
      "view", "A tooth, a mesh or a recorded session in the browser, turned and replayed");
  const auto o = std::make_shared<Options>();
  sub->add_option("files", o->files,
                  "Tooth (.vdb) or mesh (.ply, .stl, .obj, .off); two of them: before and after; a "
                  "trace or a live session (.h5) with its tooth")
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
      "  toothprep view before.vdb after.ply");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
