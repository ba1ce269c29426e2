// The plots of a score's page as inline SVG: deviation from the target, and the course of the work.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/tools/score/process.h"

namespace toothprep {

// Shares of a surface by its signed deviation (mm; positive: material left, negative: too much
// taken).
struct DeviationHistogram {
  double low = 0, bin = 0;      // mm: bin i covers low + i*bin .. low + (i+1)*bin
  std::vector<double> share;    // of the whole surface, by area
  double below = 0, above = 0;  // shares beyond the bins
};

// Bins symmetric about 0 over the central 99 % of the surface, at least +-0.3 mm and at most
// +-2 mm; 60 of them. `area`: one per deviation, or empty for equal ones. What is not finite is
// left out. Throws Error if nothing is left, or sizes differ.
DeviationHistogram deviation_histogram(const std::vector<double>& deviation_mm,
                                       const std::vector<double>& area = {});
// From a finer histogram: equal bins from `low` on (mm), symmetric about 0, with the area in each.
// Cut to the central 99 %, at least +-0.3 mm. Throws Error if it holds no area or isn't symmetric.
DeviationHistogram deviation_histogram(double low, double bin, const std::vector<double>& area);
std::string deviation_svg(const DeviationHistogram& histogram);

// The course of forces and power, in columns of equal time: least and most of each, so that no peak
// is lost.
struct TracePlot {
  struct Column {
    double force_least = 0, force_most = 0;  // N, |grinding force|
    double felt_least = 0, felt_most = 0;    // N, |device force|
    double power_most = 0;                   // W
    bool any = false;                        // a row falls into it
  };
  double begin = 0, end = 0;  // s
  std::vector<Column> columns;
  std::vector<ProcessEvent> events;
  double force_limit = 0, power_limit = 0;  // N, W
};

// Throws Error as process_figures() does for fewer than two rows.
TracePlot trace_plot(const std::vector<StepRecord>& rows, const std::vector<ProcessEvent>& events,
                     const ProcessOptions& options, std::size_t columns = 800);
std::string trace_svg(const TracePlot& plot);

}  // namespace toothprep
