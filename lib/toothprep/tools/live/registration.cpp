#include "toothprep/tools/live/registration.h"

#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"

namespace toothprep {
namespace {

std::optional<Quat> quaternion(StrictTable& table, const std::string& key) {
  const auto values = table.numbers(key);
  if (!values) return {};
  if (values->size() != 4) table.refuse(key, "must be four numbers [x, y, z, w]");
  const Quat q((*values)[3], (*values)[0], (*values)[1], (*values)[2]);
  if (!(std::abs(q.norm() - 1) <= 1e-3)) table.refuse(key, "must be of length 1");
  return q.normalized();
}

std::optional<Vec3> finite(StrictTable& table, const std::string& key) {
  auto value = table.vector(key);
  if (value && !value->allFinite()) table.refuse(key, "must be finite numbers");
  return value;
}

}  // namespace

Registration read_registration(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  StrictTable table(root, path);
  Registration r;
  if (const auto q = quaternion(table, "rotation_xyzw")) r.rotation = *q;
  if (const auto q = quaternion(table, "stylus_to_bur_xyzw")) r.stylus_to_bur = *q;
  r.translation = finite(table, "translation_mm");
  if (const auto axis = finite(table, "fixed_axis")) {
    if (!(axis->norm() > 1e-9)) table.refuse("fixed_axis", "must not be zero");
    r.fixed_orientation = orientation_of_axis(*axis);
  }
  table.done();
  return r;
}

HandleFrame::HandleFrame(const Registration& registration, const Vec3& device_start,
                         const Vec3& at_start)
    : rotation_(registration.rotation),
      stylus_to_bur_(registration.stylus_to_bur),
      fixed_(registration.fixed_orientation),
      translation_(registration.translation ? *registration.translation
                                            : Vec3(at_start - rotation_ * device_start)) {}

Quat HandleFrame::turned(const Quat& device_orientation) const noexcept {
  if (fixed_) return *fixed_;
  const Quat q = rotation_ * device_orientation * stylus_to_bur_;
  // Before the clutch was used: the very bits.
  return (since_held_.w() == 1 ? q : since_held_ * q).normalized();
}

Pose HandleFrame::to_world(const Vec3& position, const Quat& orientation) const noexcept {
  if (held_) return held_at_;
  return {rotation_ * position + translation_, turned(orientation)};
}

Vec3 HandleFrame::force_to_device(const Vec3& force) const noexcept {
  return rotation_.conjugate() * force;
}

Vec3 HandleFrame::to_device(const Vec3& world) const noexcept {
  return rotation_.conjugate() * (world - translation_);
}

void HandleFrame::move(const Vec3& shift, const Quat& turn, const Vec3& about) noexcept {
  const auto moved = [&](const Vec3& x) -> Vec3 { return turn * (x - about) + about + shift; };
  translation_ = moved(translation_);
  rotation_ = (turn * rotation_).normalized();
  // T C R = (T C T^-1) (T R); the very identity stays so.
  if (since_held_.w() != 1) since_held_ = (turn * since_held_ * turn.conjugate()).normalized();
  held_at_.position = moved(held_at_.position);
  if (!fixed_) held_at_.orientation = (turn * held_at_.orientation).normalized();
}

void HandleFrame::hold(const Vec3& device_position, const Quat& device_orientation) noexcept {
  if (held_) return;
  held_at_ = to_world(device_position, device_orientation);
  held_ = true;
}

void HandleFrame::release(const Vec3& device_position, const Quat& device_orientation) noexcept {
  if (!held_) return;
  held_ = false;
  translation_ = held_at_.position - rotation_ * device_position;
  if (!fixed_)
    since_held_ =
        (held_at_.orientation * turned(device_orientation).conjugate() * since_held_).normalized();
}

}  // namespace toothprep
