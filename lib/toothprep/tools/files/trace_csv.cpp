#include <array>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/body_columns.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trace_columns.h"
#include "toothprep/tools/io/csv_writer.h"

namespace toothprep {
void write_trace_csv(const Trace& trace, const std::string& path) {
  const bool measured = !trace.measured_force.empty();
  if (measured && trace.measured_force.size() != trace.rows.size())
    throw Error(path + ": the trace has not as many measured forces as rows");
  CsvWriter out(path);
  for (const TraceColumn& column : trace_columns())
    for (const std::string& name : column.csv) out.text(name);
  if (measured)
    for (const char* axis : {"x", "y", "z"}) out.text(std::string("force_measured_") + axis + "_N");
  const bool loaded = trace.drive == name_of(Drive::kLoad);
  if (loaded)
    for (const char* axis : {"x", "y", "z"}) out.text(std::string("force_applied_") + axis + "_N");
  for (const Body& body : trace.bodies) out.text("contact_body_" + body.name + "_mm2");
  out.end_row();
  std::array<double, 4> values{};
  std::vector<double> areas(trace.bodies.size());
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    for (const TraceColumn& column : trace_columns()) {
      column.get(trace.rows[i], values.data());
      for (int c = 0; c < column.width; ++c) out.number(values[static_cast<std::size_t>(c)]);
    }
    if (measured)
      for (int c = 0; c < 3; ++c) out.number(trace.measured_force[i][c]);
    if (loaded)
      for (int c = 0; c < 3; ++c) out.number(trace.rows[i].handle.load[c]);
    get_body_areas(trace.rows[i], trace.bodies, areas.data());
    for (const double area : areas) out.number(area);
    out.end_row();
  }
  out.close();
}

}  // namespace toothprep
