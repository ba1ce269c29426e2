// The stages of a step, in the order in which Session::step() calls them (the paper's section 5.2).
//
//   sense      the handle's motion as the bur sees it; where the bur will go
//   contact    which elements of the bur's surface are in tissue on the way there
//   trial      velocity, torque and rotation rate that agree with each other (Eqs 8, 9, 12-18)
//   stall      whether the handpiece has the torque for it (Eqs 10, 11)
//   integrate  pose and velocity at the end
//   remove     tissue on the way (Eqs 19, 20)
//   record     the row of the trace
//
// The drives differ in `trial` (direct: the handle's velocity is imposed; coupled: backward Euler
// through the virtual coupling; load: the velocity at which the grinding force balances a given
// load), in `integrate` and in the force of `record`. The force law is in grinding/contact_set.h,
// the coupling in implicit_step.h, the load in load_step.h, handpieces and the rule of the stall in
// handpiece.h.
//
// Frames: W world, B the bur at the start of the part. Units: mm, s, N.
#pragma once

#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/step_state.h"

namespace toothprep {

constexpr double kCatchUpRate = 1.5707963267948966;  // rad/s (90°/s): turning back after a stall

StepPart sense(const StepModel& model, const BurState& state, const HandleSample& handle,
               double h) noexcept;

void find_contact(const StepModel& model, GrindingEngine& engine, const StepPart& part) noexcept;

void find_trial(const StepModel& model, GrindingEngine& engine, StepPart& part) noexcept;

// A bur that turns back to the handle after a stall, and has no torque for that, is tried again
// without turning.
void judge_stall(const StepModel& model, const BurState& state, GrindingEngine& engine,
                 StepPart& part) noexcept;

void integrate(const StepModel& model, StepPart& part, BurState& state) noexcept;

// Marks the way that is cut, or left out. The engine carves it once a step, after the last part.
void remove_tissue(const StepModel& model, const StepPart& part, const BurState& state,
                   GrindingEngine& engine) noexcept;

// All but the removed volume and the shank's contact.
StepRecord record(const StepModel& model, const StepPart& part, const BurState& state,
                  const GrindingEngine& engine) noexcept;

}  // namespace toothprep
