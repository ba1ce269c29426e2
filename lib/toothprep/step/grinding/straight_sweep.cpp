#include "toothprep/step/grinding/straight_sweep.h"

#include <algorithm>
#include <cmath>

namespace toothprep {

namespace {

// By how much another lean moves the head's points, mm.
double moved_by_lean(const Bur& bur, const Pose& from, const Pose& to) {
  return bur.head_length() *
         (to.orientation * Vec3::UnitZ() - from.orientation * Vec3::UnitZ()).norm();
}

constexpr double kSameWay = 0.999,  // cosine
    kHardlyBends = 0.96;            // and squared
constexpr double kUpright = 2e-4;   // mm of way along the axis

}  // namespace

bool StraightSweep::lead_on(const Bur& bur, const Pose& to, double most_aside) noexcept {
  const Vec3 farther = to.position - from.position;
  const double length2 = farther.squaredNorm(), before = way.dot(farther);
  if (!(before >= 0 && before <= length2)) return false;  // it turns back
  const Vec3 off = length2 > 0 ? Vec3(way - before / length2 * farther) : way;
  const double off_line = aside + off.norm();
  if (off_line + moved_by_lean(bur, from, to) > most_aside) return false;
  aside = off_line;
  way = farther;
  return true;
}

bool StraightSweep::leads_through(const Bur& bur, const Pose& pose, const Vec3& v,
                                  double off_line) const noexcept {
  const double length = way.norm(), speed = v.norm();
  if (!(length > 0 && speed > 0)) return false;
  const Vec3 along = way / length, here = pose.position - from.position;
  const double at = along.dot(here), on_way = along.dot(v) / speed;
  if (at < 0 || at > length || (here - at * along).norm() > off_line) return false;
  return std::abs(on_way) > kSameWay && (on_way > 0 ? length - at : at) > off_line &&
         moved_by_lean(bur, from, pose) < off_line;
}

bool StraightSweep::leads_to(const Bur& bur, const Pose& pose, const Vec3& direction,
                             double off_line) const noexcept {
  const double length = way.norm();
  if (!(length > 0)) return false;
  const Vec3 along = way / length, here = pose.position - from.position;
  const double at = along.dot(here);
  return along.dot(direction) > kSameWay && at > length - off_line &&
         (here - at * along).norm() < off_line && moved_by_lean(bur, from, pose) < off_line;
}

bool StraightSweep::follows(const StraightSweep& before) const noexcept {
  const double along = way.dot(before.way);
  return goes_on && along > 0 &&
         along * along > kHardlyBends * way.squaredNorm() * before.way.squaredNorm();
}

bool StraightSweep::leans() const noexcept {
  return std::abs(way.dot(from.orientation * Vec3::UnitZ())) >= kUpright;
}

bool StraightSweep::was_over(const Bur& bur, const Vec3& place, double depth) const noexcept {
  const Vec3 start = from.to_local(place), move = from.orientation.conjugate() * way,
             middle(0, 0, 0.5 * bur.head_length());
  const auto distance = [&](double t) {
    const Vec3 x = start - t * move;
    return bur.distance(x.head<2>().norm(), x.z());
  };
  // Nearest to a ball around the head.
  const double length2 = move.squaredNorm();
  const double nearest = length2 > 0 ? std::clamp(move.dot(start - middle) / length2, 0.0, 1.0) : 0;
  if ((start - nearest * move - middle).norm() > std::hypot(middle.z(), bur.max_radius()))
    return false;
  // From a convex body that moves straight on the distance has one least value: by golden sections.
  constexpr double kGolden = 0.6180339887498949;
  constexpr int kSections = 40;
  double low = 0, high = 1, a = high - kGolden, b = low + kGolden;
  double at_a = distance(a), at_b = distance(b);
  if (std::min(distance(low), distance(high)) < -depth) return true;
  const double length = std::sqrt(length2);
  for (int n = 0; n < kSections; ++n) {
    const double so_far = std::min(at_a, at_b);
    if (so_far < -depth) return true;
    // It changes no faster than the place.
    if (so_far - (high - low) * length > -depth) return false;
    if (at_a < at_b) {
      high = b, b = a, at_b = at_a;
      a = high - kGolden * (high - low), at_a = distance(a);
    } else {
      low = a, a = b, at_a = at_b;
      b = low + kGolden * (high - low), at_b = distance(b);
    }
  }
  return std::min(at_a, at_b) < -depth;
}

}  // namespace toothprep
