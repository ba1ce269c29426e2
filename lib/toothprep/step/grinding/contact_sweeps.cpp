// Straight parts of the bur's way: what it took there is known exactly. Where they make all of the lattice's values around
// four pieces, so is what is covered of these, however thin.
#include <algorithm>
#include <cmath>
#include <utility>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/contact_parts.h"

namespace toothprep {
namespace {

// More void than they make by this (voxels) was made by something else.
constexpr float kOtherVoid = 0.01f;
// So far (voxels) beyond a piece's rim a sweep doesn't matter: of cells there, what is a voxel deep in tissue says
// nothing.
constexpr float kMatters = 2.8f;
// They are chosen anew after so much of the way (mm), of those that come as near as that and this.
constexpr double kChosenFor = 0.25, kNear = 1;
// Shorter ones (mm) aren't worth it.
constexpr double kLeastWay = 1;
// What lies on another's way, to so many voxels, adds nothing.
constexpr double kSame = 0.01;

}  // namespace

// Of the known sweeps those that matter at four pieces.
struct ContactModel::NearSweeps {
  const Scan& scan;
  const CutOfPieces& cut;
  Float4 rise[3];  // over a cell, along the pieces' normal, mm
  const KnownSweep* sweeps[kMostKnown];
  int count = 0;

  NearSweeps(const Scan& in, const CutOfPieces& of) : scan(in), cut(of) {
    const float *a = scan.frame.a, square = cut.voxel * cut.voxel;
    for (int i = 0; i < 3; ++i)
      rise[i] = square * (a[3 * i] * cut.nx + a[3 * i + 1] * cut.ny + a[3 * i + 2] * cut.nz);
  }

  // At places (voxels, from the tip's): the largest value, and the largest of those where the bur wasn't nearest on
  // that way but at one of its ends: there it is less. Gradient per voxel.
  struct Taken {
    Float4 value = all4(-kUnlimited), at_ends = all4(-kUnlimited);
    Float4 gx{}, gy{}, gz{};
  };
  Taken at(const Float4& x, const Float4& y, const Float4& z) const noexcept {
    Taken taken;
    for (int k = 0; k < count; ++k) {
      const KnownSweep& of = *sweeps[k];
      const KnownSweep::Sample s = of.at(x, y, z);
      taken.at_ends = s.on_way ? taken.at_ends : greatest(taken.at_ends, s.value);
      const Int4 more = s.on_way & (s.value > taken.value);
      taken.value = more ? s.value : taken.value;
      taken.gx = more ? s.by_l * of.l[0] + s.by_h * of.h[0] : taken.gx;
      taken.gy = more ? s.by_l * of.l[1] + s.by_h * of.h[1] : taken.gy;
      taken.gz = more ? s.by_l * of.l[2] + s.by_h * of.h[2] : taken.gz;
    }
    return taken;
  }

  // A place beside others, by mm in B.
  Place beside(const Place& from, const Displaced& d) const {
    const float* a = scan.frame.a;
    return {scan.frame, from.x + (a[0] * d.x + a[1] * d.y + a[2] * d.z),
            from.y + (a[3] * d.x + a[4] * d.y + a[5] * d.z),
            from.z + (a[6] * d.x + a[7] * d.y + a[8] * d.z)};
  }

  // Of these pieces, those for which they make the lattice's values in the cells of places that are so far (mm) from the
  // bur's own print.
  Int4 explain(const Place& at, const Float4& from_print, Int4 good) const {
    const FourPlaces in(at.x, at.y, at.z);
    const Index3& base = scan.frame.base;
    const float voxel = cut.voxel;
    FourCells cells;
    cells.read(scan.workpiece.cut(), in.x + base.x(), in.y + base.y(), in.z + base.z(), good);
    for (int k = 0; k < kCorners && any(good); ++k) {
      const auto dx = static_cast<float>(k >> 2), dy = static_cast<float>((k >> 1) & 1),
                 dz = static_cast<float>(k & 1);
      const Float4 has = cells.corner(k),
                   value = this->at(as_float(in.x) + dx, as_float(in.y) + dy, as_float(in.z) + dz)
                               .value,
                   over = value - has,
                   outside = from_print + (dx - in.fx) * rise[0] + (dy - in.fy) * rise[1] +
                             (dz - in.fz) * rise[2];
      const Int4 print = has + outside < kOtherVoid * voxel;
      good &= ((over < kExplained * voxel) & (print | (over > -kOtherVoid * voxel))) |
              ((has > kFarOff * voxel) & (value > kFarOff * voxel)) |
              ((has < -voxel) & (value < -voxel));
    }
    return good;
  }
  // The same around the pieces, whose middles are these.
  Int4 explain_around(const Place& middles, const Float4& from_print, Int4 good) const {
    constexpr float kPlaces[kCellsInPiece][2] = {{0, 0},
                                                 {kNearCorner, -kNearCorner},
                                                 {-kNearCorner, kNearCorner},
                                                 {kNearCorner, kNearCorner},
                                                 {-kNearCorner, -kNearCorner}};
    for (const auto& [x, y] : kPlaces) {
      if (!any(good)) break;
      const Displaced d = cut.displaced(all4(x), all4(y));
      const Float4 outside = from_print + (cut.nx * d.x + cut.ny * d.y + cut.nz * d.z);
      good = explain(beside(middles, d), outside, good);
    }
    return good;
  }
};

// Chooses the sweeps that may be met here, but for that which leads here.
void ContactModel::know_sweeps(const Scan& scan) noexcept {
  if (scan.turns) return;
  if (scan.cuts != known_cuts_ || std::abs(path_ - known_at_) > kChosenFor) {
    known_cuts_ = scan.cuts, known_at_ = path_;
    const double aside = kSame * scan.workpiece.voxel();
    known_count_ = 0;
    for (auto sweep = scan.sweeps.rbegin();
         sweep != scan.sweeps.rend() && known_count_ < kMostKnown; ++sweep) {
      const auto holds_it = [&](const KnownSweep& chosen) {
        return chosen.sweep.contains(bur_, *sweep, aside);
      };
      const auto end = known_.begin() + static_cast<std::ptrdiff_t>(known_count_);
      if (sweep->way.norm() < kLeastWay || !sweep->may_meet(bur_, sampled_pose_, kNear) ||
          leads_here(scan, *sweep) || std::any_of(known_.begin(), end, holds_it))
        continue;
      // One that was known before needn't be drawn anew.
      const auto same = std::find_if(
          end, known_.end(), [&](const KnownSweep& before) { return before.is_of(*sweep); });
      if (same != known_.end()) std::swap(*same, *end);
      if (end->set(bur_, *sweep)) ++known_count_;
    }
  }
  for (std::size_t k = 0; k < known_count_; ++k)
    known_[k].put(scan.workpiece.lattice(), scan.frame.base);
}

bool ContactModel::knows_sweeps(const Scan& scan) const noexcept {
  return known_count_ > 0 && !scan.turns;
}

// The largest value of them all where the bur was nearest on the way.
Float4 ContactModel::taken_by_sweeps(const Place& at) const noexcept {
  Float4 value = all4(-kUnlimited);
  for (std::size_t k = 0; k < known_count_; ++k) {
    const KnownSweep::Sample s = known_[k].at(at.x, at.y, at.z);
    value = s.on_way ? greatest(value, s.value) : value;
  }
  return value;
}

// Pieces around which these sweeps make all that there is; the others are left. `far`: their middles, so far ahead that
// the bur's own print is `from_print` (mm) away.
Int4 ContactModel::cover_by_sweeps(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                   const Float4& from_print, const Int4& wanted,
                                   Lanes& s) const noexcept {
  const float voxel = cut.voxel;
  const Float4 rim = cut.half_along + cut.half_around;
  // In the middle of the step to come, so that a wall that is met head-on counts neither early nor late.
  const Eigen::Vector3f back = s.ahead - 0.5f * static_cast<float>(step_) * s.unit;
  const Place here{scan.frame, s.ix - back.x(), s.iy - back.y(), s.iz - back.z()};
  Int4 good{};
  NearSweeps near(scan, cut);
  for (std::size_t k = 0; k < known_count_; ++k) {
    const Float4 value = known_[k].at(here.x, here.y, here.z).value,
                 farther = known_[k].at(far.x, far.y, far.z).value;
    good |= wanted & (value > -rim - kBeyondRim * voxel);
    if (any(wanted & (greatest(value, farther) > -rim - kMatters * voxel)))
      near.sweeps[near.count++] = &known_[k];
  }
  if (!any(good)) return good;
  good = near.explain({scan.frame, s.ix, s.iy, s.iz}, scan.reach * cut.per_speed * s.advance, good);
  good = near.explain_around(far, from_print, good);
  if (!any(good)) return good;
  const Float4 stays = s.stays, holds = s.holds;
  s.stays = s.holds = all4(kUnlimited);
  const PieceAxes& a = cut.axes;
  const auto border_of = [&](const Parts::Part& part) {
    const Float4 x = all4(part.x), y = all4(part.y), wide = 1 + a.widening * x,
                 turned = a.widening * y;
    const Place at = near.beside(here, cut.displaced(x, y));
    const NearSweeps::Taken taken = near.at(at.x, at.y, at.z);
    // In B, per mm.
    const FourSamples g = scan.frame.gradients({taken.value, taken.gx, taken.gy, taken.gz});
    const Float4 around = a.around(g);
    const Borders border{taken.value,
                         part.half_along * (a.along(g) + turned * around + 2 * x * a.bent_along(g)),
                         part.half_around * (wide * around + 2 * y * a.bent_around(g))};
    const Float4 clear = -(part.half_along * cut.half_along + part.half_around * cut.half_around);
    good &= (taken.at_ends <= taken.value) | (taken.at_ends < clear);
    s.note_crossing(good, border.value, border.along, border.around, cut.rise(g));
    return border;
  };
  Parts parts(border_of);
  s.stays = good ? s.stays : stays, s.holds = good ? s.holds : holds;
  if (any(good)) parts.cover(cut, good, kThinSlot * voxel, s);
  s.by_sweeps = good;
  return good;
}

}  // namespace toothprep
