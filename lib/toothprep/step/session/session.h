// One session: a bur, a tooth, the parameters, and the step that turns a commanded pose into forces
// and removal. Replay and live drive the same step.
#pragma once

#include <memory>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/step/session/implicit_step.h"

namespace toothprep {

// Largest size of the bur's surface elements, mm: the force errs by (size/R)²/24, 0.3 % for the
// paper's burs, and the step's cost goes with 1/size².
constexpr double kElementSize = 0.15;
constexpr double kCatchUpRate =
    1.5707963267948966;  // rad/s (90°/s): turning back to the handle after a stall

// The energy audit and what else a session counts.
struct SessionTotals {
  double torque_work = 0;       // N·mm = mJ: integral of 2 pi N T_z over the steps that turn
  PerTissue<double> removed{};  // mm³
  PerTissue<double> initial_overlap{};  // mm³, inside the bur at the first sample; not in `removed`
  long stalled_steps = 0;
  long stall_onsets = 0;
  long contact_steps = 0;
  long shank_contact_steps = 0;
  double largest_lag = 0;        // mm, bur behind the handle
  double peak_device_force = 0;  // N
};

class Session {
 public:
  // Keeps references to bur and workpiece. `parameters` must be valid (step/core/parameters.h); throws
  // Error as make_engine() does. Tissue inside the bur at `first` is removed.
  Session(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
          const HandleSample& first, double element_size = kElementSize);

  // Row 0: the initial state with zero forces.
  const StepRecord& initial() const { return record_; }

  // One step of parameters.time_step that ends with the handle at `next`. Allocates nothing.
  StepRecord step(const HandleSample& next) noexcept;

  // Removes what is still due and brings the volumes of the last record up to date.
  void finish(StepRecord& last) noexcept;

  const SessionTotals& totals() const { return totals_; }

 private:
  // The motion that this step would make, in B.
  struct Trial {
    Vec3 velocity = Vec3::Zero();
    GrindingResponse response;
    double torque = 0;         // at the velocity, N·mm
    double rotation_rate = 0;  // rev/s
    bool stalls = false;
  };

  int parts_of_step() const noexcept;
  void turn_to(const Quat& handle) noexcept;
  void step_direct(const HandleSample& next) noexcept;
  void step_coupled(const HandleSample& next) noexcept;
  Trial coupled_trial(const CouplingState& state, const Vec3& first_guess,
                      const Vec3& omega) noexcept;
  Trial converge(const CouplingState& state, Vec3 guess, const Vec3& omega,
                 double rotation_rate) const noexcept;
  double judged_torque(double trial) const noexcept;
  const ContactSet& contact() const noexcept { return engine_->contact(); }
  void record_work(double torque, double rotation_rate) noexcept;

  const Bur& bur_;
  Workpiece& workpiece_;
  Parameters parameters_;
  Drive drive_;
  std::unique_ptr<GrindingEngine> engine_;
  SurfaceElements shank_;

  // State.
  Pose pose_;                            // the bur
  Vec3 velocity_ = Vec3::Zero();         // mm/s, W
  Vec3 judged_velocity_ = Vec3::Zero();  // mm/s, W: of the last trial while stalled
  bool stalled_ = false;
  double last_torque_ = 0;    // N·mm, that the last step ended with
  bool catching_up_ = false;  // orientation held by a stall and not yet the handle's again
  HandleSample handle_;

  // Of the step, or part of it, under way.
  double h_ = 0;                   // s
  Quat turned_;                    // the bur's orientation after the step, if it turns
  Vec3 turn_rate_ = Vec3::Zero();  // rad/s, B
  StepRecord record_;
  SessionTotals totals_;
};

}  // namespace toothprep
