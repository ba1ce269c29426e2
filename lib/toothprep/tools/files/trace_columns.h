// The one table of what a row of a trace holds: dataset, unit, width, column names of the CSV
// export and the place in a StepRecord. Writer, reader and export all follow it.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/step_record.h"

namespace toothprep {

enum class Storage { kDouble, kUint32, kUint8, kInt32, kInt64 };

struct TraceColumn {
  const char* dataset;
  const char* unit;  // of the file (ASCII)
  int width;         // values per row
  Storage storage;
  bool required;    // to read a trace
  bool per_tissue;  // the dataset names its columns in the attribute `tissues`
  std::vector<std::string> csv;
  void (*get)(const StepRecord& row, double* values);  // in the file's unit
  void (*set)(StepRecord& row, const double* values);
};

// In the order of the CSV export. /force/measured is not among them: it is no part of a step.
const std::vector<TraceColumn>& trace_columns();

}  // namespace toothprep
