// What is covered of four pieces of an element, where the cut is known at every place of them: part by part. What
// contact_slots.cpp and contact_sweeps.cpp share. Internal to contact*.cpp.
#pragma once

#include <cstdint>

#include "toothprep/step/grinding/contact_cut.h"

namespace toothprep {

constexpr float kUnlimited = 1e3f;  // mm
// The lattice's values are those that slots make if none differs by more than this (voxels).
constexpr float kExplained = 0.05f;
// What is farther from a slot's surface than this (voxels) says nothing of where it is, and nothing crosses a piece
// whose middle is this much farther than its rim.
constexpr float kFarOff = 2.5f, kBeyondRim = 0.5f;
// Chips that thin (voxels) may be none: slots are known better than single walls.
constexpr float kThinSlot = 0.005f;
// Cells are looked at in a piece's middle and near its corners (of half its extents).
constexpr float kNearCorner = 0.8f;
constexpr int kCellsInPiece = 5, kCorners = 8;

// Rows between these places along the profile, the narrowest at its ends: at the bur's edge chips of floor are as thin as a
// slot's ellipse. Each of so many parts around the axis.
struct ContactModel::Parts {
  static constexpr float kRows[] = {-1, -0.88f, -0.6f, 0, 0.6f, 0.88f, 1};
  static constexpr int kRowCount = 6, kAcross = 3, kCount = kRowCount * kAcross;

  // Part number k of a piece: its middle, -1 .. 1, and half of its extents.
  struct Part {
    float x, y, half_along, half_around;
    static Part whole() { return {0, 0, 1, 1}; }
    Part(float at_x, float at_y, float along, float around)
        : x(at_x), y(at_y), half_along(along), half_around(around) {}
    explicit Part(int k) {
      const int row = k / kAcross, column = k % kAcross;
      half_along = 0.5f * (kRows[row + 1] - kRows[row]), half_around = 1.0f / kAcross;
      x = kRows[row] + half_along;
      y = half_around * static_cast<float>(2 * column + 1 - kAcross);
    }
    float weight() const { return half_along * half_around; }
  };

  // `border_of`: of a part, as Borders.
  template <class BorderOf>
  explicit Parts(const BorderOf& border_of) : count_(kCount) {
    for (int k = 0; k < kCount; ++k) borders_[k] = border_of(k, Part(k));
  }
  // What lies under another border of part k counts as well, as void. The border rises by `rise` per mm of way.
  void divide(int k, const Borders& other, const Float4& rise) {
    if (!any(other.value + magnitude(other.along) + magnitude(other.around) > 0)) return;
    others_[other_count_] = {other, rise};
    other_of_[k] = static_cast<std::int8_t>(++other_count_);
  }
  // All of the piece as one part.
  explicit Parts(const Borders& border) : borders_{border}, count_(1) {}

  // Covers the pieces `where`. What is thinner than `thin` (mm) may be none.
  void cover(const CutOfPieces& cut, const Int4& where, float thin, Lanes& s) {
    Float4 thick{};
    Borders border{};  // as straight as it is on the whole
    float xx = 0, yy = 0;
    for (int k = 0; k < count_; ++k) {
      const Part part = number(k);
      const Borders& of = borders_[k];
      thick = greatest(thick, magnitude(of.along) + magnitude(of.around) - of.value);
      const float weight = part.weight();
      border.value += weight * of.value;
      border.along += weight * part.x * of.value, xx += weight * part.x * part.x;
      border.around += weight * part.y * of.value, yy += weight * part.y * part.y;
    }
    if (count_ == 1) border = borders_[0];
    if (count_ > 1) border.along *= 1 / xx, border.around *= 1 / yy;
    // A floor or a step that crosses a straight side goes on beside a piece that it hardly touches.
    const Int4 goes_on = cut.straight ? cut.crosses(border) & ~s.at_edge : Int4{};
    const Float4 doubt = goes_on ? Float4{} : doubt_of_thin(thick, thin);
    border.value += doubt;
    s.by_slots |= where;
    s.rise = where ? Float4{} : s.rise;
    doubt_ = doubt;
    s.cover(where, covered(0, nullptr));
    s.cut.replace(where, border);
  }

  // What was taken off for being thin, mm.
  const Float4& doubt() const { return doubt_; }

  // What is covered `way` (mm) farther on, where each part's border rises by `rises` per mm.
  CoveredPart<Float4> covered(float way, const Float4* rises) const {
    CoveredPart<Float4> sum{};
    for (int k = 0; k < count_; ++k) {
      const Part part = number(k);
      Borders of = borders_[k];
      of.value += doubt_;
      if (rises) of.value += way * rises[k];
      CoveredPart<Float4> covered = of.part();
      if (other_of_[k] > 0) under_both(of, others_[other_of_[k] - 1], rises ? way : 0, covered);
      const Float4 share = part.weight() * covered.share;
      sum.share += share;
      sum.x += share * (part.x + part.half_along * covered.x);
      sum.y += share * (part.y + part.half_around * covered.y);
    }
    const Float4 per_share = 1 / greatest(sum.share, all4(kLeastShare));
    return {sum.share, per_share * sum.x, per_share * sum.y};
  }

 private:
  struct Other {
    Borders border;
    Float4 rise;
  };
  Part number(int k) const { return count_ == 1 ? Part::whole() : Part(k); }
  // Of the lanes that the other border divides.
  static void under_both(const Borders& one, const Other& other, float way,
                         CoveredPart<Float4>& covered) {
    Borders second = other.border;
    second.value += way * other.rise;
    const Int4 divides = second.value + magnitude(second.along) + magnitude(second.around) > 0;
    for (int p = 0; p < 4; ++p) {
      if (!divides[p]) continue;
      const CoveredPart<float> under = covered_by_all({one.line(p), second.line(p)});
      covered.share[p] = under.share, covered.x[p] = under.x, covered.y[p] = under.y;
    }
  }

  Borders borders_[kCount];
  Other others_[kCount];
  std::int8_t other_of_[kCount] = {};  // 1 + its place among others_
  int other_count_ = 0;
  Float4 doubt_{};
  int count_;
};

}  // namespace toothprep
