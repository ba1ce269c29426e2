// What one step of a session takes and gives: a row of a trace.
#pragma once

#include <array>
#include <cstdint>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/tissue.h"

namespace toothprep {

constexpr std::uint32_t kPedalButton = 1u;  // bit 0: motor on

// A sample of the commanded motion: the handle's pose (of the bur's tip, W frame) at a time.
struct HandleSample {
  double time = 0;                       // s
  Pose pose;                             // of the handle, W
  std::uint32_t buttons = kPedalButton;  // bits
  bool rejected = false;                 // can't be believed: no step is made, the bur stays
  Vec3 load = Vec3::Zero();              // N, W: pushes the bur in the drive `load`
};

// Contact with a body that isn't the tooth that is prepared (tooth/tooth_bodies.h).
struct BodyArea {
  std::uint8_t body = 0;  // 1 + its place in the tooth's list; 0: none
  double area = 0;        // mm², advancing
};
constexpr std::size_t kMostTouched = 3;  // such bodies in a step that are recorded

// The state after the step that ends at handle.time. Forces in N on the bur, W frame.
struct StepRecord {
  HandleSample handle;                 // what was commanded
  Pose bur;                            // of the virtual bur, W
  Vec3 bur_velocity = Vec3::Zero();    // mm/s
  Vec3 grinding_force = Vec3::Zero();  // N, Eq. 8
  Vec3 device_force = Vec3::Zero();    // N, what the operator feels
  double torque = 0;                   // N·mm, Eq. 9
  double torque_trial = 0;             // N·mm, what the stall was judged on
  double power = 0;                    // N·mm/s, 2 pi N T_z
  double rotation_rate = 0;            // rev/s
  bool stalled = false;                // in any part of the step
  double stalled_fraction = 0;         // of the step's time: between 0 and 1 if the step was split
  PerTissue<double> contact_area{};    // mm², advancing
  // The part of it in other bodies, the largest first.
  std::array<BodyArea, kMostTouched> other_bodies{};
  PerTissue<double> removed_volume{};  // mm³, cumulative
  double shank_contact_area = 0;       // mm², reported only: the shank does not grind
};

}  // namespace toothprep
