// What the spindle recorded beside the force: its torque, as a check, and its speed, as a model.
//
// Droop. A turbine slows down under its torque, T = tau_s (1 - (N/N0)^k). The torque that the fitted
// u implies at the bur is T = c / N with c(t) = sum of u_k times the basis' torque at 1 rev/s, so
// that N(t) follows from N0, tau_s and k: for k = 1
//
//   N = N0/2 (1 + sqrt(1 - 4 c / (N0 tau_s)))
//
//   symbol   here                     unit
//   N        SpindleRecord::rate      rev/s
//   c        u_k tissue[k].torque N   N·mm·rev/s
//
// which has the recorded speed on its left side only: put into T = c/N, its noise would be on both
// and make the slope too flat. With a rotor's inertia J
//
//   2 pi J dN/dt = T_drive(N) - c / N
//
// is integrated step by step as in the session (step/session/spindle.h), from the recorded speed at
// the start of each recording; with the motor off the speed falls linearly. Least squares with
// Huber's loss in the logarithms of the parameters; uncertainties by a block bootstrap of the
// residuals together with the fit's draws of u (tau_s is proportional to u). The exponent is
// selected from 0.5, 1, ... 8. Valid below the greatest power, where an imposed feed collapses.
#pragma once

#include "toothprep/tools/calibrate/fit.h"

namespace toothprep {

struct DroopOptions {
  bool exponent = false;  // fit the droop's exponent
  bool rotor = false;     // fit the inertia and, if the recordings have a run-down, its time
  Handpiece handpiece;    // values of what is not fitted
  std::uint64_t seed = 1;
};

// `motions` and their `bases` as they were fitted, with recorded speeds. Not identifiable, with a
// reason, if no recording has a speed, if it doesn't fall with the torque, if tau_s isn't known to
// 25 %, or if most of the torque comes from tissue whose u isn't known. An inertia with a relative
// standard deviation above 50 % is omitted, with the reason.
DroopFit fit_droop(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit, const DroopOptions& options);

// Fills the recording's torque_factor and torque_rms from the recorded torque and u's; nothing
// without a recorded torque. `basis` of an imposed motion.
void check_torque(const MeasuredRecording& recording, const ForceBasis& basis, const FitResult& fit,
                  RecordingFit& result);

}  // namespace toothprep
