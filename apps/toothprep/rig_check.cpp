// toothprep rig-check: a recorded live session judged line by line.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

#include "command.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/rig_check/rig_report.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string session, tooth, limits, output, report;
  bool json = false, force = false, strict = false, no_plots = false;
};

Measured<std::vector<StepRecord>> replay_of(const SessionRecording& recording, const Options& o,
                                            const Common& common) {
  using Rows = Measured<std::vector<StepRecord>>;
  if (o.tooth.empty()) return Rows::no("no tooth was given (--tooth)");
  if (const std::string reason = unreplayable(recording); !reason.empty()) return Rows::no(reason);
  if (!recording.header.protocol.empty()) return Rows::no("an active check renders no tooth");
  const Trace& trace = recording.header.trace;
  LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  if (tooth_sha256(tooth) != trace.tooth_sha256)
    throw InputError(o.tooth, "", "is not the tooth that the session was recorded with",
                     "give that one, or leave --tooth out");
  const Parameters parameters = parse_parameters(trace.parameters_toml, o.session + ": parameters");
  const Bur bur = make_bur(trace.bur, data_folder() + "/burs");
  std::vector<HandleSample> path;
  path.reserve(trace.rows.size());
  for (const StepRecord& row : trace.rows) path.push_back(row.handle);
  Workpiece workpiece(tooth);
  const bool terminal = !common.quiet && isatty(2);
  const Drive drive = drive_named(trace.drive).value_or(Drive::kCoupled);
  const auto progress = [&](double done) {
    if (terminal) std::fprintf(stderr, "\rreplay %3d %%", static_cast<int>(done * 100));
  };
  ReplayResult result = replay(bur, workpiece, parameters, drive, path, progress,
                               interventions_of(trace.events, bur, o.session));
  if (terminal) std::fprintf(stderr, "\r            \r");
  const SessionTotals& t = result.totals;
  const Audit audit = judge_audit(t.torque_work, result.removed_energy, result.ground, parameters);
  warn_or_refuse(
      o.session,
      judge_run(judge_parameters(parameters), audit, t.peak_device_force, t.largest_lag, drive),
      o.strict);
  return std::move(result.rows);
}

void print_lines(const RigReport& report, const Common& common) {
  for (const RigLine& line : report.lines) {
    if (!line.limit) continue;
    const std::string limit = "limit" +
                              (line.limit->min ? fmt::format(" >= {:.4g}", *line.limit->min) : "") +
                              (line.limit->max ? fmt::format(" <= {:.4g}", *line.limit->max) : "");
    say(common, fmt::format("{:<12} {:<32} {:>10}  {}", name_of(line.verdict), line.figure->key,
                            line.value ? fmt::format("{:.4g}", *line.value) : "-",
                            line.value ? limit : line.why_not));
  }
}

void run(const Options& o, const Common& common) {
  const std::string limits_file = o.limits.empty() ? data_folder() + "/rig/limits.toml" : o.limits;
  Outputs outputs(o.force);
  outputs.reads({o.session, o.tooth, limits_file});
  const std::string output = outputs.optional_file(o.output, {".json"});
  const std::string folder = outputs.optional_folder(o.report);
  outputs.begin();
  const std::string script = "plot-rig-check";
  if (!folder.empty() && !o.no_plots && !run_script(script, {"--check"}))
    throw Error(script +
                " cannot run; install python3-numpy and python3-matplotlib, or give --no-plots");

  const RigLimits limits = read_rig_limits(limits_file);
  const SessionRecording recording = read_session(o.session);
  if (!recording.complete) warn(unfinished_text(o.session));
  RigReport report;
  try {
    check_recording(recording);
    report = check_rig(recording, limits, replay_of(recording, o, common));
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {
    throw InputError(o.session, "", e.what());
  }

  const std::string json =
      report_json(report, recording, std::filesystem::path(o.session).filename().string(), kVersion,
                  build_text());
  if (!output.empty()) write_file(output, json);
  if (!folder.empty()) {
    write_file(folder + "/report.json", json);
    write_plot_data(report, recording, folder);
    if (!o.no_plots && !run_script(script, {folder})) throw Error(script + " failed");
  }
  outputs.publish();
  if (o.json) std::cout << json;

  print_lines(report, common);
  say(common, fmt::format("{}: {} limits kept, {} not, {} not measured", name_of(report.overall),
                          report.passed, report.failed, report.not_measured));
  if (o.strict && report.failed > 0)
    throw Error(o.session + ": " + std::to_string(report.failed) + " of " +
                std::to_string(report.passed + report.failed) + " limits are not kept (--strict)");
}

}  // namespace

void add_rig_check(CLI::App& app, const Common& common) {
  auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "rig-check",
      "Judges a rig by a session that `toothprep live` recorded on it: timing, encoders, forces,\n"
      "energy, stability, heat, replay, each figure against a limit. A failed limit is no failure\n"
      "of the command, but with --strict");
  sub->add_option("session", o->session, "Recording of a live session (.h5)")->required();
  sub->add_option("--tooth", o->tooth,
                  "Tooth (.vdb) of the session: also replays it and compares the forces");
  sub->add_option("--limits", o->limits,
                  "Limits and table of devices (default: data/rig/limits.toml; copy and change; "
                  "data/rig/FORMATS.md)");
  sub->add_option("-o,--output", o->output, "Report to write (.json)");
  sub->add_option("--report", o->report, "Folder to make: report.json, tables, page.png, page.pdf");
  sub->add_flag("--no-plots", o->no_plots, "No page, only report.json and the tables");
  sub->add_flag(
      "--strict", o->strict,
      "Exit 1 if a figure is beyond its limit, or the tooth or the replay can't be right");
  sub->add_flag("--json", o->json, "The report on stdout");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer("Example: toothprep rig-check session.h5 --tooth molar.vdb --report rig");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
