// toothprep export: a trace as a table that any program reads.
#include <fmt/format.h>

#include <memory>

#include "command.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/outputs.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string trace, output;
  bool force = false;
};

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.trace});
  const std::string table = outputs.file(o.output, {".csv"});
  outputs.begin();
  const Trace trace = read_trace(o.trace);
  if (trace.unfinished) warn(unfinished_text(o.trace));
  if (trace.rows_every > 1) warn(sparse_text(o.trace, trace.rows_every));
  if (!trace.events.events.empty())
    say(common, fmt::format("{}: its {} events (pause, undo, ...) are not in the table", o.trace,
                            trace.events.events.size()));
  write_trace_csv(trace, table);
  outputs.publish();
  say(common, o.output + ": " + std::to_string(trace.rows.size()) + " rows");
}

}  // namespace

void add_export(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("export", "A trace as CSV");
  const auto o = std::make_shared<Options>();
  sub->add_option("trace", o->trace, "Trace file (.h5)")->required();
  sub->add_option("-o,--output", o->output, "Table to write (.csv)")->required();
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "One row per step, one column per component, the unit in the column's name: time_s,\n"
      "handle_x_mm, bur_x_mm, bur_velocity_x_mm_s, force_grinding_x_N, force_device_x_N, "
      "torque_mNm,\n"
      "power_W, rotation_rate_rev_s, stalled, contact_enamel_mm2, removed_enamel_mm3 and so on.\n"
      "Numbers read back as the very same doubles.\n"
      "Example: toothprep export trace.h5 -o trace.csv");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
