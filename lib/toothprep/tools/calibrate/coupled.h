// u and alpha from recordings of the *handle*: the bur follows it through the virtual coupling, so
// where the bur goes depends on the parameters, and the force is not linear in them.
//
// With a force law much stiffer than the coupling the force is that of the spring, k (P_H - P), and
// says little at once about u: what u changes is how fast the bur gives way. "Motion from the
// present parameters, parameters from the forces of that motion" then contracts slowly or not at
// all. So the whole replay is the model: with theta the logarithms of all u_k and w_k =
// u_k/alpha_k,
//
//   F(t; theta + d) = F(t; theta) + sum over j of J_j(t) d_j
//
// F(t; theta) from one replay of each recording and J_j from two more (central differences), all in
// parallel. Written as u_k T_k + w_k N_k + F_0 with T_k = J_(u_k) / u_k, N_k = J_(w_k) / w_k, it is
// a basis like that of an imposed motion, and everything that fit.h knows about sensors,
// identifiability and uncertainty holds for it. It is made anew at what the fit says until that
// stays (Gauss and Newton); a step that makes the misfit larger is halved.
//
// The replay stalls where the physics says; a stalled bur's force is the spring's. Where the
// *recording* says it stalled, its samples are left out, as for imposed motion.
//
// Valid for the coupling, the rotation rate and the stall torque of the parameters: these must be
// the rig's own.
#pragma once

#include <deque>

#include "toothprep/tools/calibrate/fit.h"

namespace toothprep {

struct CoupledOptions {      // of the iteration
  int most_iterations = 25;  // then it counts as not converging
  double tolerance = 1e-4;   // relative change of u and alpha that counts as none
  double difference = 0.02;  // of the logarithms, for the derivatives
};

// u and alpha that an iteration began with.
struct CoupledIteration {
  PerTissue<GrindingProperties> tissue;  // u in N/mm²
  double misfit = 0;                     // N, mean size of the residuals
  double change = 0;                     // relative, that the fit then asked for
};

// To be moved, not copied: the recordings refer to the bases.
struct CoupledFit {
  CoupledFit() = default;
  CoupledFit(CoupledFit&&) = default;             // bases keep their place
  CoupledFit& operator=(CoupledFit&&) = default;  // the same

  FitResult fit;                             // of the last iteration
  std::vector<CoupledIteration> iterations;  // all of them
  std::deque<ForceBasis> bases;  // linearised at the result; the recordings refer to them
  std::vector<ComparedRecording> recordings;  // one per file
  std::vector<RecordedMotion> bur;            // where the bur went
  double stalled = 0;                         // s, of the replays at the result
};

// The handle's motions (samples at parameters.time_step) beside their recordings. `progress` is
// called at each iteration. Throws Error as fit() does, and if it doesn't converge.
CoupledFit fit_coupled(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                       const std::vector<MeasuredRecording>& recordings,
                       const std::vector<RecordedMotion>& handles, const FitOptions& options,
                       const CoupledOptions& coupled = {},
                       const std::function<void(const CoupledIteration&)>& progress = {});

// Where the bur must have been if the measured force is the spring's, P = P_H + F/k: smoothed over
// 0.1 s, the sensor's bias taken from the first 0.1 s. Good for a first guess only.
[[nodiscard]] std::vector<HandleSample> bur_by_force(const MeasuredRecording& recording,
                                                     const RecordedMotion& handle,
                                                     const Parameters& parameters,
                                                     const FitOptions& options);

}  // namespace toothprep
