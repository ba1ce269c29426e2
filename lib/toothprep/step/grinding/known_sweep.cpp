#include "toothprep/step/grinding/known_sweep.h"

#include <cmath>

namespace toothprep {
namespace {

constexpr double kNoWay = 2e-4;         // mm
constexpr float kHardlyLeans = 0.05f;   // voxels of it
constexpr float kNoRadius = 1e-6f;      // mm
constexpr float kInsideOfEdge = 1e-4f;  // mm; there the end's face tells, not the one beside it

}  // namespace

bool KnownSweep::is_of(const StraightSweep& other) const noexcept {
  return other.way == sweep_.way && other.from.position == sweep_.from.position &&
         other.from.orientation.coeffs() == sweep_.from.orientation.coeffs();
}

bool KnownSweep::set(const Bur& bur, const ConvexProfile& standing, const StraightSweep& sweep,
                     float voxel) noexcept {
  sweep_ = sweep;
  standing_ = &standing;
  const double way = sweep.way.norm();
  // Where the bur hardly moved any direction will do.
  const Vec3 along =
      way > kNoWay ? Vec3(sweep.from.orientation.conjugate() * sweep.way / way) : Vec3::UnitX();
  length_ = static_cast<float>(way);
  lean_ = static_cast<float>(along.z());
  square_ = static_cast<float>(std::hypot(along.x(), along.y()));
  const float on_axis = std::abs(lean_ * length_);
  leans_ = !sweep.leans()                                             ? Leans::kNot
           : on_axis < kHardlyLeans * voxel && std::abs(lean_) < 0.5f ? Leans::kHardly
                                                                      : Leans::kFar;
  known_ = leans_ != Leans::kFar || outline_.draw(bur.profile(), along);
  axes_ = leans_ != Leans::kFar ? SweptOutline::axes_of(along) : outline_.axes();
  return known_;
}

void KnownSweep::put(const Lattice& lattice, const Index3& base) noexcept {
  const auto put_one = [&](const Vec3& axis, float(&to)[4]) {
    const Vec3 in_world = sweep_.from.orientation * axis;
    for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(lattice.voxel * in_world[i]);
    to[3] = static_cast<float>(in_world.dot(lattice.to_world(base) - sweep_.from.position));
  };
  put_one(axes_.beside, l_), put_one(axes_.up, h_), put_one(axes_.along, t_);
  put_one(Vec3::UnitZ(), z_);
}

// As of the bur that stands so far along the way, at places across the way, along it, and along the axis.
KnownSweep::Sample KnownSweep::where_it_stood(const Float4& end, const Across& at) const noexcept {
  const Float4 along = at.way - end, up = at.axial - lean_ * end,
               radius = square_root(
                   greatest(at.l * at.l + at.h * at.h + along * along - up * up, Float4{})),
               per_radius = 1 / greatest(radius, all4(kNoRadius));
  const ConvexProfile::Sample b = standing_->at(radius, up);
  const Float4 by_r = per_radius * b.by_r, by_l = by_r * at.l, by_h = by_r * at.h,
               by_t = by_r * along, by_z = b.by_z - by_r * up;
  const auto gradient = [&](int axis) {
    return by_l * l_[axis] + by_h * h_[axis] + by_t * t_[axis] + by_z * z_[axis];
  };
  return {b.value, gradient(0), gradient(1), gradient(2)};
}

// Where along the way the lower edge of a leaning flat end, which counts as far as `radius`, passes over places that are then
// so high above that end.
Float4 KnownSweep::edge_passes(const Across& at, const Float4& radius,
                               const Float4& height) const noexcept {
  const Float4 in_end = square_root(greatest(radius * radius - at.l * at.l, Float4{})),
               along = square_ * in_end;
  return at.way - lean_ * height + (lean_ < 0 ? along : -along);
}

KnownSweep::Sample KnownSweep::on_way(const Float4& way, const Across& at) const noexcept {
  return where_it_stood(greatest(least(way, all4(length_)), Float4{}), at);
}

// As of a bur that hardly leans, where it is deepest because of that: a flat end where its lower edge passes, an arc of the
// bur nearly at the deeper end of so short a way.
KnownSweep::Sample KnownSweep::where_it_dips(const Across& at, Beyond* beyond) const noexcept {
  const auto at_end = [&] { return where_it_stood(all4(lean_ < 0 ? length_ : 0), at); };
  if (!standing_->has_end()) return at_end();
  const Float4 first = edge_passes(at, standing_->end_radius(Float4{}), Float4{}),
               height = at.axial - lean_ * first,
               under = edge_passes(at, standing_->end_radius(height) - kInsideOfEdge, height);
  if (beyond)
    *beyond = {least(beyond->start, -greatest(first, under)),
               least(beyond->end, least(first, under) - length_)};
  const Sample by_edge = on_way(under, at);
  return standing_->has_sharp_end() ? by_edge : deeper(at_end(), by_edge);
}

KnownSweep::Sample KnownSweep::at(const Float4& x, const Float4& y, const Float4& z,
                                  Beyond* beyond_ends) const noexcept {
  const Across at{across(l_, x, y, z), across(h_, x, y, z), across(t_, x, y, z),
                  across(z_, x, y, z)};
  if (leans_ != Leans::kFar) {
    if (beyond_ends) *beyond_ends = {-at.way, at.way - length_};
    const Sample beside = on_way(at.way, at);
    return leans_ == Leans::kNot ? beside : deeper(beside, where_it_dips(at, beyond_ends));
  }
  const SweptOutline::Sample s = outline_.at(at.l, at.h);
  const auto gradient = [&](int axis) { return s.by_l * l_[axis] + s.by_h * h_[axis]; };
  if (beyond_ends) *beyond_ends = {s.from - at.way, at.way - (s.to + length_)};
  const Sample on_way{s.value, gradient(0), gradient(1), gradient(2)};
  const Int4 after = at.way > s.to + length_, beyond = (at.way < s.from) | after;
  if (!any(beyond)) return on_way;
  return chosen(beyond, where_it_stood(after ? all4(length_) : Float4{}, at), on_way);
}

}  // namespace toothprep
