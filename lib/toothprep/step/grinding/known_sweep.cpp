#include "toothprep/step/grinding/known_sweep.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kNoWay = 2e-4;  // mm
// Of a way that goes aside by less than this (sine) the outline isn't drawn.
constexpr double kSquareAtLeast = 0.1, kNotAside = 1e-9;
constexpr int kTimesHalved = 18;          // of it, until where it is deepest
constexpr float kSameDepthOnWay = 1e-4f;  // a depth, per way
constexpr float kNoRadius = 1e-6f;        // mm
constexpr float kNoFall = 1e-6f;          // of a depth, per way

}  // namespace

bool KnownSweep::is_of(const ConvexProfile& standing, const StraightSweep& other) const noexcept {
  return standing_ == &standing && other.way == sweep_.way &&
         other.from.position == sweep_.from.position &&
         other.from.orientation.coeffs() == sweep_.from.orientation.coeffs();
}

bool KnownSweep::set(const ConvexProfile& standing, const StraightSweep& sweep) noexcept {
  sweep_ = sweep;
  standing_ = &standing;
  leans_ = sweep.leans();
  const double way = sweep.way.norm();
  // Where the bur hardly moved any direction will do.
  const Vec3 along =
      way > kNoWay ? Vec3(sweep.from.orientation.conjugate() * sweep.way / way) : Vec3::UnitX();
  const double square = std::hypot(along.x(), along.y()), sign = along.z() < 0 ? -1 : 1;
  length_ = static_cast<float>(way);
  axial_ = static_cast<float>(along.z());
  ahead_ = static_cast<float>(sign * square);
  along_ = square > kNotAside ? Vec3(sign / square * Vec3(along.x(), along.y(), 0)) : Vec3::UnitX();
  rise_ = static_cast<float>(std::abs(along.z()) / std::max(square, kNotAside));
  known_ = standing.is_known();
  is_along_ = leans_ && !(known_ && square > kSquareAtLeast && outline_.set(standing, rise_));
  return known_;
}

void KnownSweep::put(const Lattice& lattice, const Index3& base) noexcept {
  const auto put_one = [&](const Vec3& axis, float(&to)[4]) {
    const Vec3 in_world = sweep_.from.orientation * axis;
    for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(lattice.voxel * in_world[i]);
    to[3] = static_cast<float>(in_world.dot(lattice.to_world(base) - sweep_.from.position));
  };
  put_one(Vec3(along_.y(), -along_.x(), 0), b_), put_one(along_, a_), put_one(Vec3::UnitZ(), z_);
}

KnownSweep::Sample KnownSweep::sample_of(const Stood& of) const noexcept {
  const auto gradient = [&](int i) {
    return of.by_beside * b_[i] + of.by_ahead * a_[i] + of.by_axial * z_[i];
  };
  return {of.value, gradient(0), gradient(1), gradient(2)};
}

KnownSweep::Stood KnownSweep::where_it_stood(const Float4& way, const Across& at) const noexcept {
  const Float4 ahead = at.ahead - ahead_ * way,
               r = square_root(at.beside * at.beside + ahead * ahead),
               per_r = 1 / greatest(r, all4(kNoRadius));
  const ConvexProfile::Sample s = standing_->at(r, at.axial - axial_ * way);
  const Float4 by_r = per_r * s.by_r;
  return {s.value, by_r * at.beside, by_r * ahead, s.by_z};
}

// As of the bur that stood where places lie deepest: on a straight way that is where their depth, which is concave, rises no
// more. Where it falls there at once, an edge of the bur made the wall, which runs along the way, between its two faces.
KnownSweep::Stood KnownSweep::deepest_on_way(const Across& at) const noexcept {
  const auto falls = [&](const Stood& of) { return of.by_ahead * ahead_ + of.by_axial * axial_; };
  // Beside a side along the way it stays the same.
  const auto may_rise = [&](const Float4& fall) { return fall < kSameDepthOnWay; };
  const auto may_fall = [&](const Float4& fall) { return fall > -kSameDepthOnWay; };
  const Int4 at_end = may_rise(falls(where_it_stood(all4(length_), at))),
             at_start = may_fall(falls(where_it_stood(Float4{}, at))) & ~at_end;
  Float4 from = at_end ? all4(length_) : Float4{}, to = at_start ? Float4{} : all4(length_);
  for (int i = 0; i < kTimesHalved && any(from < to); ++i) {
    const Float4 way = 0.5f * (from + to), fall = falls(where_it_stood(way, at));
    from = may_rise(fall) ? way : from;
    to = may_fall(fall) ? way : to;
  }
  const Stood before = where_it_stood(from, at), after = where_it_stood(to, at);
  const Float4 rises = greatest(-falls(before), Float4{}),
               part = rises / greatest(rises + greatest(falls(after), Float4{}), all4(kNoFall));
  const auto between = [&](const Float4& a, const Float4& b) { return a + part * (b - a); };
  return {greatest(before.value, after.value), between(before.by_beside, after.by_beside),
          between(before.by_ahead, after.by_ahead), between(before.by_axial, after.by_axial)};
}

KnownSweep::Sample KnownSweep::at(const Float4& x, const Float4& y, const Float4& z,
                                  Beyond* beyond) const noexcept {
  const Across at{across(b_, x, y, z), across(a_, x, y, z), across(z_, x, y, z)};
  const auto on_way = [&](const Float4& way) {
    return greatest(least(way, all4(length_)), Float4{});
  };
  const auto note_beyond = [&](const Float4& way) {
    if (beyond) *beyond = {-way, way - length_};
  };
  if (!leans_) {
    const Float4 way = at.ahead / ahead_;
    note_beyond(way);
    return sample_of(where_it_stood(on_way(way), at));
  }
  if (is_along_) {
    note_beyond(all4(0.5f * length_));  // of neither end alone, as far as is known
    return sample_of(deepest_on_way(at));
  }
  const SweptOutline::Sample s = outline_.at(at.beside, at.axial - rise_ * at.ahead);
  const Float4 way = (at.ahead - s.ahead) / ahead_, by_r = s.by_r / greatest(s.r, all4(kNoRadius));
  note_beyond(way);
  const Sample deepest = sample_of({s.value, by_r * at.beside, by_r * s.ahead, s.by_z});
  const Float4 stood = on_way(way);
  const Int4 is_beyond = (stood != way) | (s.value == SweptOutline::kUnknown);
  return any(is_beyond) ? chosen(is_beyond, sample_of(where_it_stood(stood, at)), deepest)
                        : deepest;
}

}  // namespace toothprep
