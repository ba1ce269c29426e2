#include "toothprep/step/grinding/body_contact.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact_frame.h"

namespace toothprep {
namespace {

constexpr double kBodyElement = 0.1;  // mm
constexpr float kBodyReach = 0.1f;    // as the engine's

}  // namespace

BodyContact::BodyContact(const Bur& bur)
    : elements_(bur.elements(kBodyElement)),
      middle_(0, 0, bur.head_length() / 2),
      radius_(std::hypot(bur.head_length() / 2, bur.max_radius())) {}

BodyContact::Areas BodyContact::areas(const Workpiece& workpiece, const Pose& pose, const Vec3& v,
                                      const Vec3& omega, double total) const noexcept {
  Areas found{};
  const WorkpieceBodies* bodies = workpiece.bodies();
  if (!bodies || !(total > 0)) return found;
  const Vec3 middle =
      workpiece.lattice().to_index(pose.position + pose.orientation * middle_).array().round();
  // A brick that is n bricks away is at least 8 (n - 1) voxels away.
  const int away = bodies->bricks_to_others(middle.cast<int>());
  if (kBrickEdge * (away - 1) > radius_ / workpiece.voxel() + 2) return found;

  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  const Eigen::Vector3f velocity = (pose.orientation.conjugate() * v).cast<float>(),
                        turning = (pose.orientation.conjugate() * omega).cast<float>();
  std::array<double, kMostBodies> area{};
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    const SurfaceElements& e = elements_;
    const Eigen::Vector3f x(e.x[i], e.y[i], e.z[i]), n(e.nx[i], e.ny[i], e.nz[i]);
    const Eigen::Vector3f u = velocity + turning.cross(x);
    const float speed = u.norm();
    if (!(u.dot(n) > 0)) continue;
    const Eigen::Vector3f at =
        Eigen::Vector3f(f.fx, f.fy, f.fz) + f.turned(x.x(), x.y(), x.z()) +
        kBodyReach / speed * static_cast<float>(workpiece.voxel()) * f.turned(u.x(), u.y(), u.z());
    const Index3 voxel =
        f.base + Index3(cell_of(at.x() + 0.5f), cell_of(at.y() + 0.5f), cell_of(at.z() + 0.5f));
    const std::int64_t brick = bodies->of().brick_index(voxel.x(), voxel.y(), voxel.z());
    if (brick < 0 || !bodies->holds_others(static_cast<std::size_t>(brick))) continue;
    const std::uint8_t body = bodies->of().brick(
        static_cast<std::size_t>(brick))[brick_offset(voxel.x() & 7, voxel.y() & 7, voxel.z() & 7)];
    if (body == 0 || body == bodies->worked() + 1) continue;
    // A brick deep inside tells for its voxels, and for the cells beside them.
    const auto inside = [&](const LevelSet& field) {
      const auto b = static_cast<std::size_t>(brick);
      return (field.is_uniform(b) && field.uniform_value(b) < 0) ||
             field_at(field, f.base, at).value < 0;
    };
    if (inside(workpiece.cut()) && inside(workpiece.solid())) area[body - 1u] += e.area[i];
  }
  double sum = 0;
  for (std::size_t b = 0; b < bodies->count(); ++b) {
    sum += area[b];
    if (!(area[b] > found.back().area)) continue;
    found.back() = {static_cast<std::uint8_t>(b + 1), area[b]};
    for (std::size_t k = found.size() - 1; k > 0 && found[k].area > found[k - 1].area; --k)
      std::swap(found[k], found[k - 1]);
  }
  if (sum > total)
    for (BodyArea& a : found) a.area *= total / sum;
  return found;
}

std::uint64_t BodyContact::touched_by(const SurfaceElements& elements, const Workpiece& workpiece,
                                      const Pose& pose) noexcept {
  const WorkpieceBodies* bodies = workpiece.bodies();
  std::uint64_t touched = 0;
  if (!bodies) return touched;
  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const Eigen::Vector3f at =
        Eigen::Vector3f(f.fx, f.fy, f.fz) + f.turned(elements.x[i], elements.y[i], elements.z[i]);
    const Index3 v =
        f.base + Index3(cell_of(at.x() + 0.5f), cell_of(at.y() + 0.5f), cell_of(at.z() + 0.5f));
    const std::uint8_t body = bodies->of().value(v.x(), v.y(), v.z());
    if (body != 0 && workpiece.solid().value(v.x(), v.y(), v.z()) < 0 &&
        workpiece.cut().value(v.x(), v.y(), v.z()) < 0)
      touched |= std::uint64_t{1} << (body - 1u);
  }
  return touched;
}

}  // namespace toothprep
