#include "toothprep/step/grinding/swept_outline.h"

#include <cmath>

namespace toothprep {
namespace {

constexpr float kDeep = 1e3f;         // mm
constexpr float kLeast = 1e-9f;       // mm
constexpr float kRounding = 1e-5f;    // mm
constexpr float kNoSteeper = 0.999f;  // sine
constexpr int kNewtonSteps = 4;

}  // namespace

bool SweptOutline::set(const ConvexProfile& bur, float rise) noexcept {
  bur_ = &bur, rise_ = rise, count_ = 0;
  for (const ConvexProfile::Face& face : bur.faces()) {
    const float sine = -rise * face.z;
    if (!(std::abs(sine) < kNoSteeper * face.r)) continue;  // the nearer the farther the bur goes
    if (count_ == kMostFaces) return false;
    const float cosine = std::sqrt(face.r * face.r - sine * sine);
    passing_[count_++] = {&face, sine / cosine, cosine};
  }
  return bur.is_known();
}

// So far of what is nearest.
struct SweptOutline::Nearest {
  Sample s{all4(kDeep), Float4{}, Float4{}, Float4{}, Float4{}};
  void meet(const Int4& counts, const Float4& value, const Float4& ahead, const Float4& r,
            const Float4& z) {
    const Int4 nearer = counts & (value < s.value);
    s.value = nearer ? value : s.value;
    s.ahead = nearer ? ahead : s.ahead;
    s.by_r = nearer ? -r : s.by_r;
    s.by_z = nearer ? -z : s.by_z;
  }
};

// Where the nearest place of an arc's ring is square to the way.
Float4 SweptOutline::ahead_of(const ConvexProfile::Arc& arc, const Float4& beside,
                              const Float4& level) const noexcept {
  const float square = 1 + rise_ * rise_, centre = arc.centre_r;
  const Float4 wanted = rise_ * (arc.centre_z - level), w = magnitude(wanted);
  if (centre == 0) return wanted / square;
  // The root of x (square - centre / r) - w, r² = beside² + x², not below 0.
  const Float4 l = greatest(beside, all4(kLeast)), by_l = square - centre / l;
  Float4 x = (w + centre) / square;
  x = centre > 0 ? (by_l > 0 ? least(x, w / by_l) : x) : greatest(x, w / by_l);
  for (int i = 0; i < kNewtonSteps; ++i) {
    const Float4 r2 = l * l + x * x, per_r = 1 / square_root(r2), of = centre * per_r;
    x = greatest(x - (x * (square - of) - w) / (square - of * (l * l) * (per_r * per_r)), Float4{});
  }
  return turned_where_negative(wanted, x);
}

void SweptOutline::meet(const ConvexProfile::Arc& arc, const Float4& beside, const Float4& level,
                        Nearest& nearest) const noexcept {
  const Float4 ahead = ahead_of(arc, beside, level),
               r = square_root(beside * beside + ahead * ahead);
  const ConvexProfile::OfArc of(arc, r, level + rise_ * ahead);
  nearest.meet(of.is_beside, of.value, ahead, of.r, of.z);
}

// Where both faces are equally far: out_z (r - edge.r) = out_r (z - edge.z).
void SweptOutline::meet(const ConvexProfile::Edge& edge, const Float4& beside, const Float4& level,
                        Nearest& nearest) const noexcept {
  const float sign = edge.out_z < 0 ? -1 : 1, out_z = sign * edge.out_z, out_r = edge.out_r * rise_,
              bends = out_z * out_z - out_r * out_r;
  // The root ahead of out_z r = at_0 + out_r ahead, r² = beside² + ahead².
  const Float4 at_0 = out_z * edge.r + sign * edge.out_r * (level - edge.z), l2 = beside * beside,
               square = at_0 * at_0 - bends * l2,
               root = out_z * square_root(greatest(square, Float4{}));
  Float4 ahead = (out_z * out_z * l2 - at_0 * at_0) / greatest(root + out_r * at_0, all4(kLeast));
  if (bends < 0) ahead = at_0 > 0 ? ahead : (out_r * at_0 - root) / bends;
  const Int4 is_root = (square >= 0) & (at_0 + out_r * ahead > -kRounding);
  ahead *= sign;
  const Float4 r = square_root(l2 + ahead * ahead);
  // How steeply they come nearer, per r.
  const ConvexProfile::Face &below = edge.below, &above = edge.above;
  const Float4 comes = -(below.r * ahead + rise_ * below.z * r),
               goes = above.r * ahead + rise_ * above.z * r;
  const Int4 counts = is_root & (comes > 0) & (goes > 0);
  if (!any(counts)) return;
  const Float4 share = goes / greatest(comes + goes, all4(kLeast));
  nearest.meet(counts, below.within(r, level + rise_ * ahead), ahead,
               above.r + share * (below.r - above.r), above.z + share * (below.z - above.z));
}

SweptOutline::Sample SweptOutline::at(const Float4& beside, const Float4& level) const noexcept {
  const Float4 l = magnitude(beside);
  Nearest nearest;
  for (std::size_t i = 0; i < count_; ++i) {
    const ConvexProfile::Face& face = *passing_[i].face;
    nearest.meet(Int4{-1, -1, -1, -1}, face.reach - passing_[i].falls * l - face.z * level,
                 passing_[i].ahead * l, all4(face.r), all4(face.z));
  }
  for (const ConvexProfile::Arc& arc : bur_->arcs()) meet(arc, l, level, nearest);
  for (const ConvexProfile::Edge& edge : bur_->edges()) meet(edge, l, level, nearest);
  nearest.s.r = square_root(l * l + nearest.s.ahead * nearest.s.ahead);
  return nearest.s;
}

}  // namespace toothprep
