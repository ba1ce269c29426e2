#include "toothprep/step/session/load_step.h"

#include <Eigen/LU>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kNoDrag = 1e-10;  // of the drag in free air: keeps the system solvable
constexpr int kHalvings = 40;      // of the drag's interval
constexpr int kDoublings = 8;      // of its upper end, for a resistance that drives (one-sided)

// The rail's resistance and push are numbers, and so is the bound on their quotient.
Vec3 along_rail(double max_speed, const Vec3& rail, double push, double resistance) noexcept {
  if (resistance * max_speed > std::abs(push)) return rail * (push / resistance);
  return push == 0 ? Vec3(Vec3::Zero()) : Vec3(rail * std::copysign(max_speed, push));
}

Vec3 bounded(const Vec3& v, double max_speed) noexcept {
  const double speed = v.norm();
  return speed > max_speed ? Vec3(v * (max_speed / speed)) : v;
}

}  // namespace

Vec3 load_velocity(double max_speed, const Vec3& rail, const Vec3& load, const Mat3& resistance,
                   const Vec3& f0) noexcept {
  const Vec3 push = load + f0;
  if (!rail.isZero(0))
    return along_rail(max_speed, rail, rail.dot(push), -rail.dot(resistance * rail));
  if (push.isZero(0)) return Vec3::Zero();
  const auto slowed_by = [&](double drag) -> Vec3 {
    return (drag * Mat3::Identity() - resistance).inverse() * push;
  };
  double high = push.norm() / max_speed, low = kNoDrag * high;
  Vec3 undamped = slowed_by(low);
  if (undamped.norm() <= max_speed) return undamped;
  for (int i = 0; i < kDoublings && !(slowed_by(high).norm() <= max_speed); ++i) high *= 2;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (low + high) / 2;
    (slowed_by(middle).norm() <= max_speed ? high : low) = middle;
  }
  return bounded(slowed_by(high), max_speed);
}

}  // namespace toothprep
