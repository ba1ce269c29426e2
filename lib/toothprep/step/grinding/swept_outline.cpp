#include "toothprep/step/grinding/swept_outline.h"

#include <cmath>

namespace toothprep {
namespace {

constexpr float kShort = 1e-9f;       // mm
constexpr float kRounding = 1e-5f;    // mm
constexpr float kNoSteeper = 0.999f;  // sine
constexpr int kNewtonSteps = 8;
constexpr float kExactly = 1e-3f;  // mm along the way; a step that is smaller is the last one

}  // namespace

SweptOutline::Passing SweptOutline::passing(const ConvexProfile::Face& face) const noexcept {
  const float sine = -rise_ * face.z;
  if (!(std::abs(sine) < kNoSteeper * face.r)) return {};
  const float cosine = std::sqrt(face.r * face.r - sine * sine);
  return {&face, sine / cosine, face.r / cosine, cosine};
}

bool SweptOutline::set(const ConvexProfile& bur, float rise) noexcept {
  rise_ = rise, passing_count_ = round_count_ = edge_count_ = 0;
  if (!bur.is_known() || bur.faces().size() > kMostFaces || bur.arcs().size() > kMostArcs ||
      bur.edges().size() > kMostEdges)
    return false;
  for (const ConvexProfile::Face& face : bur.faces())
    if (const Passing at = passing(face); at.face) passing_[passing_count_++] = at;
  for (const ConvexProfile::Arc& arc : bur.arcs())
    rounds_[round_count_++] = {&arc, passing(arc.to)};
  for (const ConvexProfile::Edge& edge : bur.edges())
    edges_[edge_count_++] = {&edge, passing(edge.below), passing(edge.above)};
  return true;
}

// So far of what is nearest.
struct SweptOutline::Nearest {
  Sample s{all4(kUnknown), Float4{}, Float4{}, Float4{}, Float4{}};
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
  const Float4 l = greatest(beside, all4(kShort)), by_l = square - centre / l;
  Float4 x = (w + centre) / square;
  x = centre > 0 ? (by_l > 0 ? least(x, w / by_l) : x) : greatest(x, w / by_l);
  const Float4 l2 = l * l;
  for (int i = 0; i < kNewtonSteps; ++i) {
    const Float4 r2 = l2 + x * x, r = square_root(r2),
                 step =
                     r2 * (x * (square * r - centre) - w * r) / (square * (r2 * r) - centre * l2);
    x = greatest(x - step, Float4{});
    if (!any(magnitude(step) > kExactly)) break;
  }
  return turned_where_negative(wanted, x);
}

void SweptOutline::meet(const Round& round, const Float4& beside, const Float4& level,
                        Nearest& nearest) const noexcept {
  const ConvexProfile::Arc& arc = *round.arc;
  const Passing& to = round.to;
  if (to.face) {  // does any of the places lie below where that face begins?
    const Float4 dr = to.r * beside - arc.centre_r,
                 dz = level + rise_ * to.ahead * beside - arc.centre_z;
    if (!any(dr * arc.to.z - dz * arc.to.r >= 0)) return;
  }
  const Float4 ahead = ahead_of(arc, beside, level),
               r = square_root(beside * beside + ahead * ahead);
  const ConvexProfile::OfArc of(arc, r, level + rise_ * ahead);
  nearest.meet(of.is_beside, of.value, ahead, of.r, of.z);
}

// Where both faces are equally far: out_z (r - edge.r) = out_r (z - edge.z).
void SweptOutline::meet(const Sharp& sharp, const Float4& beside, const Float4& level,
                        Nearest& nearest) const noexcept {
  const ConvexProfile::Edge& edge = *sharp.edge;
  // Are all places nearer to one of its faces, where that passes by, than to the other?
  const auto is_all_of = [&](const Passing& own, const ConvexProfile::Face& other) {
    if (!own.face) return false;
    const Float4 r = own.r * beside, z = level + rise_ * own.ahead * beside;
    return all(other.within(r, z) >= own.face->within(r, z));
  };
  if (is_all_of(sharp.above, edge.below) || is_all_of(sharp.below, edge.above)) return;
  const float sign = edge.out_z < 0 ? -1 : 1, out_z = sign * edge.out_z, out_r = edge.out_r * rise_,
              bends = out_z * out_z - out_r * out_r;
  // The root ahead of out_z r = at_0 + out_r ahead, r² = beside² + ahead².
  const Float4 at_0 = out_z * edge.r + sign * edge.out_r * (level - edge.z), l2 = beside * beside,
               square = at_0 * at_0 - bends * l2,
               root = out_z * square_root(greatest(square, Float4{}));
  Float4 ahead = (out_z * out_z * l2 - at_0 * at_0) / greatest(root + out_r * at_0, all4(kShort));
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
  const Float4 share = goes / greatest(comes + goes, all4(kShort));
  nearest.meet(counts, below.within(r, level + rise_ * ahead), ahead,
               above.r + share * (below.r - above.r), above.z + share * (below.z - above.z));
}

SweptOutline::Sample SweptOutline::at(const Float4& beside, const Float4& level) const noexcept {
  const Float4 l = magnitude(beside);
  Nearest nearest;
  for (std::size_t i = 0; i < passing_count_; ++i) {
    const ConvexProfile::Face& face = *passing_[i].face;
    nearest.meet(Int4{-1, -1, -1, -1}, face.reach - passing_[i].falls * l - face.z * level,
                 passing_[i].ahead * l, all4(face.r), all4(face.z));
  }
  for (std::size_t i = 0; i < round_count_; ++i) meet(rounds_[i], l, level, nearest);
  for (std::size_t i = 0; i < edge_count_; ++i) meet(edges_[i], l, level, nearest);
  nearest.s.r = square_root(l * l + nearest.s.ahead * nearest.s.ahead);
  return nearest.s;
}

}  // namespace toothprep
