#include "toothprep/tools/calibrate/fit.h"

#include <cmath>

#include "toothprep/tools/calibrate/fit_diagnostics.h"
#include "toothprep/tools/calibrate/fit_estimates.h"
#include "toothprep/tools/calibrate/fit_modes.h"
#include "toothprep/tools/calibrate/fit_solver.h"
#include "toothprep/tools/calibrate/fit_start.h"

namespace toothprep {
namespace {

// What is known of the recordings before anything is fitted.
FitResult result_of(const FitStart& start, const FitModes& modes) {
  FitResult result;
  const auto& recordings = start.data.recordings;
  result.rotation_rate = recordings.front().basis->rotation_rate;
  for (const ComparedRecording& r : recordings)
    result.speed_recorded = result.speed_recorded || r.basis->speed_recorded;
  for (int k = 0; k < kTissueCount; ++k) {
    result.tissue[k].touched = start.touched[k];
    result.tissue[k].removed = start.removed[k];
    result.tissue[k].why_not = modes.why_not[k];
  }
  result.weight_why_not = start.weight_why_not;
  if (!start.weight_why_not.empty())
    result.warnings.push_back("handpiece weight not identifiable: " + start.weight_why_not);
  result.singular_values = modes.singular_values;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    RecordingFit own;
    own.name = recordings[r].name;
    own.samples = recordings[r].time.size();
    own.stalled = recordings[r].stalled;
    own.quiet_noise = start.quiet_noise[r];
    result.recordings.push_back(own);
  }
  return result;
}

}  // namespace

PerTissue<GrindingProperties> modelled_tissue(const FitResult& fit) {
  PerTissue<GrindingProperties> tissue;
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueMode mode = fit.state.mode[k];
    tissue[k] = {0, 1};
    if (mode == TissueMode::kOff) continue;
    const double w = std::exp(fit.state.shared[2 * k + 1]);
    const double u =
        mode == TissueMode::kTied ? fit.state.tied_ratio[k] * w : std::exp(fit.state.shared[2 * k]);
    tissue[k] = {u, u / w};
  }
  return tissue;
}

FitResult fit(const std::vector<ComparedRecording>& recordings, const FitOptions& options) {
  FitStart start = start_of(recordings, options);
  const FitModes modes = choose_modes(start, options);
  FitResult result = result_of(start, modes);
  const Asked asked = start.asked;

  Solution solution = solve(std::move(start.data), modes.state, asked, options);
  result.start_spread = solution.start_spread;
  for (std::size_t r = 0; r < result.recordings.size(); ++r)
    result.recordings[r].noise = solution.data.recordings[r].sigma;

  Blocks blocks = blocks_of(solution, options);
  result.correlation_time = blocks.correlation_time;
  result.block = blocks.length;
  result.blocks = blocks.chunks.size();
  solution.data.chunks = blocks.chunks;
  const BlockDraws draws = draw_blocks(solution, asked, options);
  describe_sensor(solution, draws, asked, result);
  describe_shapes(solution, draws, blocks, result);
  describe_tissues(solution, draws, blocks, result);

  measure_residuals(solution, result);
  if (options.diagnose) {
    validate(solution, asked, options, result);
    look_for_causes(solution, asked, options, result);
    check_adequacy(solution, result);
  }
  result.lowpass.value = solution.data.lowpass + solution.state.shared[kLowpass];
  solution.state.shared[kLowpass] = 0;
  result.state = solution.state;
  return result;
}

}  // namespace toothprep
