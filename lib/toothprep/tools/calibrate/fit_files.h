// A fit as files: JSON for programs, parameters for replays, tables for the plots.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/calibrate/law_fit.h"

namespace toothprep {

// What a fit was made from.
struct FitSources {
  std::string toothprep_version, tooth, tooth_sha256, bur;  // as in a trace
  std::vector<std::string> recording_sha256;                // per recording
  std::string build;                                        // of the program
};

// Schema toothprep-fit; keys carry their units, and what isn't identifiable is null beside its
// reason. With `laws` also these, side by side.
[[nodiscard]] std::string fit_json(const FitResult& fit, const FitSources& sources,
                                   const LawComparison* laws = nullptr);

// `base` with the identified u and alpha in it, as a parameter file, with comments on where each
// number comes from.
[[nodiscard]] std::string fitted_parameters_toml(const FitResult& fit, const Parameters& base,
                                                 const FitSources& sources);

// The same by the best of the laws.
[[nodiscard]] std::string fitted_parameters_toml(const LawComparison& laws, const Parameters& base,
                                                 const FitSources& sources);

// What scripts/plot-calibration draws, beside fit.json: force-N.csv per recording (thinned: at most
// 4000 rows of means), draws.csv, adequacy.csv.
void write_plot_tables(const FitResult& fit, const std::vector<ComparedRecording>& recordings,
                       const std::string& folder);

}  // namespace toothprep
