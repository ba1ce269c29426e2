// What a trace file is made of, for files that are a trace and more.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/files/h5_reader.h"
#include "toothprep/tools/files/h5_writer.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {

// The root attributes, audit among them, and the groups of trace_columns.h.
void write_trace_head(h5::Writer& out, const Trace& trace);

// The group /events and its attribute, and their names; see session_file.h.
struct EventColumn {
  const char* dataset;
  const char* unit;
  int width;
  Storage storage;
};
inline constexpr EventColumn kEventColumns[] = {
    {"/events/time", "s", 1, Storage::kDouble},
    {"/events/kind", "1", 1, Storage::kUint32},
    {"/events/arguments", "1", kEventArguments, Storage::kDouble}};
constexpr int kSchemaVersionWithEvents = 2;
// A column's values of an event.
const double* event_values(const SessionEvent& event, std::size_t column, double& kind);
std::string joined(const std::vector<std::string>& lines);  // by line ends

// The names of the columns of /contact/area and /removed/volume.
std::vector<std::string> tissue_columns();

// All of a trace but for what a file that grows doesn't have yet. Cuts it to the shortest dataset.
Trace parse_trace(h5::Reader& in);

}  // namespace toothprep
