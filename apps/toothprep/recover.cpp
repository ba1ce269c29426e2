// toothprep recover: a recording of a session that was killed, as a file that every program opens.
#include <fmt/format.h>

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "command.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_recovery.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/path_lock.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string session, output;
  bool force = false, json = false;
};

std::string report_json(const Options& o, const std::optional<Recovery>& recovery) {
  nlohmann::ordered_json j;
  j["schema"] = "toothprep-recover";
  j["schema_version"] = 1;
  j["toothprep_version"] = kVersion;
  j["build"] = build_text();
  j["session"] = o.session;
  j["recovered"] = recovery.has_value();
  if (recovery) {
    j["rows"] = recovery->rows;
    j["duration_s"] = recovery->duration;
    j["lost"] = recovery->lost;
  }
  return json_text(j);
}

void run(const Options& o, const Common& common) {
  refuse_if_locked(o.session, o.session);
  const bool in_place = o.output.empty();
  const std::string name = in_place ? o.session : o.output;
  Outputs outputs(in_place || o.force);
  if (!in_place) outputs.reads({o.session});
  const std::string part = outputs.file(name, {".h5", ".hdf5"});
  outputs.begin();
  const std::optional<Recovery> recovery = recover_session(o.session, part);
  if (!recovery) {
    const std::string condition = "is complete and whole: there is nothing to recover";
    if (!in_place) throw InputError(o.session, "", condition, "use it as it is");
    say(common, o.session + ": " + condition);
  } else {
    if (in_place && recovery->gives_up)
      throw InputError(o.session, "", "is damaged: " + recovery->lost.back(),
                       "give -o, so that the damaged file stays");
    outputs.publish();
    for (const std::string& line : recovery->lost) warn(o.session + ": lost: " + line);
    say(common, fmt::format("{}: {} rows, {:.3f} s; opens in every HDF5 program", name,
                            recovery->rows, recovery->duration));
  }
  if (o.json) std::cout << report_json(o, recovery);
}

}  // namespace

void add_recover(CLI::App& app, const Common& common) {
  auto* sub =
      app.add_subcommand("recover",
                         "Makes the recording of a killed session a file that every HDF5 program "
                         "opens, and says what\n"
                         "is lost. The old file is replaced only once the new one was read back");
  const auto o = std::make_shared<Options>();
  sub->add_option("session", o->session, "Recording of a live session (.h5)")->required();
  sub->add_option(
      "-o,--output", o->output,
      "Where to write it (.h5); absent: in place of the old one, unless that is damaged "
      "besides");
  sub->add_flag("--json", o->json, "What was recovered and what is lost, as JSON on stdout");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "Of a file that was cut off or is damaged, the rows up to the first damage in any dataset "
      "are\n"
      "kept. All commands read a recording that was not closed without this; h5py and MATLAB "
      "don't.\n"
      "Example: toothprep recover session.h5");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
