// Where the device's handle stands in the tooth's frame: a rigid registration, and a clutch that
// lets the hand move without the handle.
//
//   x_W = R x_D + t          position of the bur's tip, mm
//   q_W = C R q_D S          orientation; S: how the bur sits in the stylus; C: what the stylus was
//                            turned while the clutch was held, the identity before
//
// R, t and S come from a registration file: data/rig/FORMATS.md.
#pragma once

#include <optional>
#include <string>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

struct Registration {                     // R, t and S of the equations above
  Quat rotation = Quat::Identity();       // R
  std::optional<Vec3> translation;        // t, mm; empty: laid at the start
  Quat stylus_to_bur = Quat::Identity();  // S
  std::optional<Quat> fixed_orientation;  // W
};

// Throws InputError for anything that isn't such a file: unknown keys, quaternions not of unit
// length (to 1e-3; they are normalised), zero axes, what isn't finite.
[[nodiscard]] Registration read_registration(const std::string& path);

// The running registration. Plain values: a tick may use it.
class HandleFrame {
 public:
  // `at_start`: where the bur's tip is to be when the hand is at `device_start` (used if the
  // registration has no translation).
  HandleFrame(const Registration& registration, const Vec3& device_start, const Vec3& at_start);

  [[nodiscard]] Pose to_world(const Vec3& position,
                              const Quat& orientation) const noexcept;   // mm, D
  [[nodiscard]] Vec3 force_to_device(const Vec3& force) const noexcept;  // W to D
  [[nodiscard]] Vec3 to_device(const Vec3& world) const noexcept;        // mm

  // While held, the handle stays where it is, and as it is turned; on release it goes on from
  // there: its later motions and turns are the hand's.
  void hold(const Vec3& device_position, const Quat& device_orientation) noexcept;
  void release(const Vec3& device_position, const Quat& device_orientation) noexcept;

  // From now on the handle is turned by `turn` about the place `about`, then shifted (mm; all W)
  // against where it would be: the tooth moves the other way.
  void move(const Vec3& shift, const Quat& turn, const Vec3& about) noexcept;

  Pose device_to_world() const noexcept { return {translation_, rotation_}; }  // x_W = t + R x_D

 private:
  Quat turned(const Quat& device_orientation) const noexcept;

  Quat rotation_, stylus_to_bur_;
  Quat since_held_ = Quat::Identity();  // W: of the handle against the stylus, by the clutch
  std::optional<Quat> fixed_;
  Vec3 translation_;
  bool held_ = false;
  Pose held_at_;  // W
};

}  // namespace toothprep
