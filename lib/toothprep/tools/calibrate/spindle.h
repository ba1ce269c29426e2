// What the spindle recorded beside the force: its torque, as a check, and its speed, as a model.
//
// Droop. A turbine slows down in proportion to its torque, N = N0 (1 - T / tau_s). The torque that
// the fitted u implies at the bur is T = c / N with c(t) = sum of u_k times the basis' torque at
// 1 rev/s, so that
//
//   N = N0/2 (1 + sqrt(1 - 4 c / (N0 tau_s)))
//
//   symbol   here                     unit
//   N        SpindleRecord::rate      rev/s
//   c        u_k tissue[k].torque N   N·mm·rev/s
//
// which has the recorded speed on its left side only: put into T = c/N, its noise would be on both
// and make the slope too flat. Least squares with Huber's loss; the uncertainty from blocks of the
// residuals drawn anew, together with the fit's draws of u (tau_s goes with u). Valid while the
// spindle's inertia plays no part (torque changing slowly against its run-up time), and below
// tau_s / 2, where an imposed feed collapses.
#pragma once

#include "toothprep/tools/calibrate/fit.h"

namespace toothprep {

// `motions` and their `bases` as they were fitted, with recorded speeds. Not identifiable, with a
// reason, if no recording has a speed, if it doesn't fall with the torque, if tau_s isn't known to
// 25 %, or if most of the torque comes from tissue whose u isn't known.
DroopFit fit_droop(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit, std::uint64_t seed);

// Fills the recording's torque_factor and torque_rms from the recorded torque and u's; nothing
// without a recorded torque. `basis` of an imposed motion.
void check_torque(const MeasuredRecording& recording, const ForceBasis& basis, const FitResult& fit,
                  RecordingFit& result);

}  // namespace toothprep
