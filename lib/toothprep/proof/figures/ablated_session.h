// The step with a part of the paper's method taken out, to see what that part does. It calls the
// same stages (step/session/stages.h) and engines as a Session, and with nothing taken out gives
// the same rows.
//
//   layers      removal without the second layer of bur voxels (one_layer_engine.h)
//   equal_area  the same area for every boundary voxel (equal_area_engine.h)
//   integrator  of the bur on its spring: backward Euler (the paper's), or with the forces of the
//               step's start: v+ = v + h/m (F_VC + F_G(v)), and P+ = P + h v (explicit) or
//               P + h v+ (semi-implicit)
//   filter_hz   direct drive: the handle's velocity through a first-order low-pass, its cutoff
//
// No stall, no split of fast steps; the handle must not turn.
#pragma once

#include <memory>

#include "toothprep/proof/figures/ablation.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/step_state.h"

namespace toothprep::figures {

// v+ of both explicit schemes, mm/s, in the frame of the arguments: as implicit_velocity(), but
// with the forces at the step's start.
Vec3 explicit_velocity(const Coupling& coupling, double time_step, const CouplingState& state,
                       const Mat3& resistance, const Vec3& f0) noexcept;

class AblatedSession {
 public:
  // Keeps references to bur and workpiece. Throws Error as make_engine() does.
  AblatedSession(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                 const Ablation& ablation, const HandleSample& first);

  // One step that ends with the handle at `next`. Once it has diverged it stays where it is.
  StepRecord step(const HandleSample& next) noexcept;

  // Whether the bur went further from the handle than any spring of interest holds it, or to no
  // number.
  bool diverged() const { return diverged_; }
  double torque_work() const { return torque_work_; }                      // N·mm
  const PerTissue<double>& removed() const { return engine_->removed(); }  // mm³

 private:
  void explicit_trial(StepPart& part) noexcept;

  StepModel model_;
  Ablation ablation_;
  std::unique_ptr<GrindingEngine> engine_;
  BurState state_;
  Vec3 filtered_ = Vec3::Zero();  // mm/s, W
  double torque_work_ = 0;
  bool diverged_ = false;
};

}  // namespace toothprep::figures
