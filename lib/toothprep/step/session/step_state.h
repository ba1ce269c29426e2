// What a step works on: the model, which is constant, the state between two steps, and the part of
// a step under way. The stages (stages.h) take these and nothing else.
#pragma once

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/session/implicit_step.h"
#include "toothprep/step/session/spindle.h"

namespace toothprep {

// Constant during a session.
struct StepModel {
  Parameters parameters;
  Drive drive = Drive::kCoupled;
  SurfaceElements shank;  // where contact is reported only
  SurfaceElements head;   // coarse: whether the bur is clear of the tooth
};

// Between two steps. A copy of it is the whole state but for the tissue.
struct BurState {
  Pose pose;                            // of the bur, W
  Vec3 velocity = Vec3::Zero();         // mm/s, W
  Vec3 judged_velocity = Vec3::Zero();  // mm/s, W: of the last trial while stalled
  bool stalled = false;
  double last_torque = 0;    // N·mm, that the last step ended with
  double rotation_rate = 0;  // rev/s, likewise
  bool catching_up = false;  // orientation held by a stall and not yet the handle's again
  HandleSample handle;
};

// The motion that a step would make if the handpiece had the torque for it.
struct Trial {
  Vec3 velocity = Vec3::Zero();  // mm/s, B
  GrindingResponse response;     // for N = 1 rev/s
  double torque = 0;             // N·mm, at the velocity
  double rotation_rate = 0;      // rev/s
  // A drooping handpiece may have no rotation rate at which it gives the torque that it needs.
  bool operating_point = true;
  bool settled = true;  // whether velocity and a law that isn't linear came to agree
};

// A step, or a part of one, as far as the stages have come.
struct StepPart {
  double h = 0;  // s

  // sense
  HandleSample handle;                  // at the end
  Pose before;                          // of the bur
  Spindle spindle;                      // torque against rotation rate
  bool turns = false;                   // the bur: the motor is on, or the rotor has not run down
  Vec3 handle_velocity = Vec3::Zero();  // mm/s, W
  Quat turned;                          // the bur's orientation at the end, if it turns
  Vec3 omega = Vec3::Zero();            // rad/s, B: the handle's rotation as the contact feels it
  CouplingState coupling;               // in B, relative to the bur's tip; coupled drive
  Vec3 load = Vec3::Zero();             // N, B; drive `load`
  Vec3 rail = Vec3::Zero();             // unit vector, B, or zero; drive `load`
  Vec3 guess = Vec3::Zero();            // mm/s, B: where the motion will go
  bool moves = false;                   // guess or omega is not zero

  // trial
  Trial trial;

  // stall
  double judged_torque = 0;  // N·mm, what Eq. 11 was judged on
  bool stalls = false;
  bool rests = false;  // the bur doesn't turn and an element in contact would advance

  // integrate
  bool attached = false;  // put where the handle is (coupling.attached_without_contact)

  bool holds() const { return stalls || rests; }
};

}  // namespace toothprep
