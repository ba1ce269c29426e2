// How well the model at the solution explains the recordings, and what it leaves unexplained.
#pragma once

#include "toothprep/tools/calibrate/fit_estimates.h"

namespace toothprep {

// Each fills in its part of the result.
void measure_residuals(const Solution& solution, FitResult& result);
// Each recording, or each part of the time of a single one, predicted from the others: the fit
// without it by one step of Gauss and Newton.
void validate(const Solution& solution, const Asked& asked, const FitOptions& options,
              FitResult& result);
// Warnings of what wasn't asked for but shows in the residuals: a rotated sensor, a delay, and
// whatever else makes the fit doubtful.
void look_for_causes(const Solution& solution, const Asked& asked, const FitOptions& options,
                     FitResult& result);
// Force per modelled force in parts of the samples: by removal rate, contact area, direction of
// feed and time.
void check_adequacy(const Solution& solution, FitResult& result);

}  // namespace toothprep
