// What a figure comes out as: claims with their numbers, the runs behind them, and the plots to
// draw. Written as figures.json (for programs) and figures.md (for people); scripts/plot-figures
// draws what the JSON describes and knows no experiment by itself.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep::figures {

// One statement that can be wrong: what should come out, where that is from, what came out.
struct Claim {
  std::string claim;     // in words
  std::string engine;    // "levelset", "voxel", or empty where none is involved
  std::string quantity;  // what the numbers are
  std::string unit;      // of both
  std::string from;      // "closed form", "exact integral", "the paper", ...
  double expected = 0;
  double measured = 0;
  double error = 0;  // of `error_unit`
  std::string error_unit = "%";
  double tolerance = 0;  // of `error_unit`
  bool holds = false;
};

// |measured - expected| in percent of `scale` (of |expected| if 0) must not exceed `tolerance`.
Claim near(const std::string& claim, const std::string& engine, const std::string& quantity,
           const std::string& unit, const std::string& from, double expected, double measured,
           double tolerance_percent, double scale = 0);
// measured <= expected, or >= with `at_least`; the error is how far it is beyond.
Claim bound(const std::string& claim, const std::string& engine, const std::string& quantity,
            const std::string& unit, const std::string& from, double expected, double measured,
            bool at_least = false);

// One replay.
struct RunReport {
  std::string run, engine, drive;
  double voxel_mm = 0;
  std::string trace;      // file, relative to the output folder; empty: not kept
  std::string exact;      // the same for the exact answer
  bool compared = false;  // the four below
  double force_rms_percent = 0, force_max_percent = 0;
  double torque_rms_percent = 0, torque_max_percent = 0;
  bool has_plateau = false;  // the two below, the worse of the tissues
  double voxel_effect_percent = 0, voxel_effect_above_2_hz_percent = 0;
  double energy_ratio = 0;   // NaN: nothing removed
  std::string energy_audit;  // "within", "outside", "not judged"
  std::vector<std::string>
      findings;  // what can't be right about the run (step/session/plausibility.h)
  double peak_force_n = 0, largest_lag_mm = 0;
  long stalled_steps = 0, stall_onsets = 0, shank_contact_steps = 0;
  double seconds_simulated = 0;
  std::vector<double> removed_mm3;  // per tissue
};

// A curve of a plot: a column of a trace (.h5, named as in its CSV export) or of a .csv.
struct Curve {
  std::string label, file, column;
  std::string style = "run";  // "run", "second", "exact", "thin"
  double scale = 1;
};
struct Panel {
  std::string label;  // of the axis
  std::vector<Curve> curves;
};
struct Plot {
  std::string file;  // without extension, relative
  std::string title;
  std::vector<Panel> panels;
  std::string tissues;  // .csv with enamel_mm2 and dentin_mm2, to shade; may be empty
  std::string stalled;  // .h5 trace whose stalls are shaded; may be empty
  double from_s = -1e300, to_s = 1e300;  // what of it is drawn
};

// A value and a verdict over two parameters; values[row][column], rows go with y.
struct MapPlot {
  std::string file, title, x_label, y_label, value_label;
  std::vector<double> x, y;
  std::vector<std::vector<double>> values;  // drawn as colour, from `least` to `most`
  double least = 1e-3, most = 10;
  bool logarithmic = true;
  // "stable", "vibrates", "unstable", or "all", "all but one", "fewer"
  std::vector<std::vector<std::string>> verdicts;
  struct Line {
    std::string label;
    std::vector<double> x, y;
  };
  std::vector<Line> lines;
};

// A picture of surfaces, as `toothprep render` draws them with its options --before, --view and
// --occlusal.
struct Picture {
  std::string file;           // .png
  std::string title;          // what it shows
  std::string mesh, compare;  // .ply or .vdb; `compare` (may be empty) stands to the left
  std::string view = "oblique", occlusal = "0,0,1";
};

// The same for the block, whose top face is y = 0.
inline Picture block_picture(const std::string& file, const std::string& title,
                             const std::string& mesh) {
  return {file, title, mesh, "", "-0.51,0.47,0.72", "0,1,0"};
}

// What a file that pictures show holds; a tooth if it is one (.vdb).
struct Surface {
  TriangleMesh mesh;
  std::optional<LayeredTooth> tooth;
};

// A published measurement beside what parameters predict of it. Not a claim: what the model misses
// is a finding about the model.
struct Comparison {
  std::string test, title, rows;  // rows of measurements.csv
  std::string parameters;         // "paper", "physical", or "given"
  std::string quantity, unit, confidence;
  double measured_low = 0, measured_high = 0;    // the upper end may be infinite
  double predicted_low = 0, predicted_high = 0;  // NaN: no prediction
  double ratio = 0;     // middle of the predicted over that of the measured (geometric), NaN: none
  std::string verdict;  // "inside", "partly", "below", "above", "stalls", "no prediction"
  std::vector<std::string> assumes;
};

// How a quantity was seen to change from one condition to another, and how it changes in the model.
struct Trend {
  std::string test, title, rows, parameters, quantity;
  std::string observed, predicted;  // "rises", "falls", "level"; predicted also "no prediction"
  double factor = 0;                // predicted; NaN: none
  bool agrees = false;
  std::vector<std::string> assumes;
};

// Figures of several runs side by side; NaN: none.
struct MetricTable {
  std::string title;
  std::vector<std::string> columns;  // with their units
  struct Row {
    std::string run, title;
    std::vector<double> values;
  };
  std::vector<Row> rows;
};

struct FigureReport {
  std::string name, title;
  std::vector<Claim> claims;
  std::vector<RunReport> runs;
  std::vector<Plot> plots;
  std::vector<MapPlot> maps;
  std::vector<Picture> pictures;
  std::map<std::string, Surface> surfaces;  // of the pictures, by file
  std::vector<Comparison> comparisons;
  std::vector<Trend> trends;
  std::vector<MetricTable> tables;
};

struct ReportHeader {
  std::string version, build, parameters_toml;
  double voxel_mm = 0;
  std::string engines;
};

// figures.json and figures.md in `folder`.
void write_report(const ReportHeader& header, const std::vector<FigureReport>& figures,
                  const std::string& folder);

}  // namespace toothprep::figures
