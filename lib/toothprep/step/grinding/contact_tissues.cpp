// What lies of the pieces of an element in the tooth, and in which tissue. The tooth is as it was given,
// whatever is cut: what was read of its fields stands as long as a piece is in the same cell.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// The axes of a piece in index space, scaled by half its extents: what a field's gradient is
// multiplied by to get its half range.
struct HalfAxes {
  Eigen::Vector3f along, around;
  float range_along(const FieldSample& s) const {
    return s.gx * along.x() + s.gy * along.y() + s.gz * along.z();
  }
  float range_around(const FieldSample& s) const {
    return s.gx * around.x() + s.gy * around.y() + s.gz * around.z();
  }
};

// The middle of what is covered of a piece, -1 .. 1 along its axes.
struct Middle {
  float x, y;
};

// Half range of a field over what is covered of a piece, by those over all of it. Exact where that is
// a part on one side of a line along an axis: it is as wide as its middle is far from the other side.
template <class T>
T range_over_covered(const T& along, const T& around, const T& x, const T& y) noexcept {
  return magnitude(along) * (1 - magnitude(x)) + magnitude(around) * (1 - magnitude(y));
}

// How what is covered of a piece is shared among the tissues; adds up to 1, or to 0 in air. By the
// tissues' level sets; where a tissue without one occurs, by the trilinear blend of the labels.
void tissue_shares(const Workpiece& workpiece, std::size_t brick, const Index3& cell,
                   const Eigen::Vector3f& in_cell, const Eigen::Vector3f& ahead,
                   const HalfAxes& axes, const Middle& covered, PerTissue<float>& share) noexcept {
  const LabelGrid& labels = workpiece.labels();
  if (labels.is_uniform(brick) && (cell.x() & 7) < 7 && (cell.y() & 7) < 7 && (cell.z() & 7) < 7) {
    const std::uint8_t label = labels.uniform_value(brick);
    if (label != 0) share[label - 1] = 1;
    return;
  }
  PerTissue<float> blend{};
  float total = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int ix = corner >> 2, iy = (corner >> 1) & 1, iz = corner & 1;
    const std::uint8_t label = labels.value(cell.x() + ix, cell.y() + iy, cell.z() + iz);
    if (label == 0) continue;
    const float w = (ix ? in_cell.x() : 1 - in_cell.x()) * (iy ? in_cell.y() : 1 - in_cell.y()) *
                    (iz ? in_cell.z() : 1 - in_cell.z());
    blend[label - 1] += w;
    total += w;
  }
  if (total <= 0) return;
  constexpr int kOther = tissue_index(Tissue::kOther);
  if (blend[kOther] == 0) {
    float sum = 0;
    for (int k = 0; k < kOther; ++k) {
      float corners[8];
      cell_corners(workpiece.tooth().remains[k], cell.x(), cell.y(), cell.z(), corners);
      const FieldSample s = sample_cell(corners, in_cell.x(), in_cell.y(), in_cell.z());
      const float along = axes.range_along(s), around = axes.range_around(s);
      share[k] = share_inside(at_surface(s, ahead) + along * covered.x + around * covered.y,
                              range_over_covered(along, around, covered.x, covered.y));
      sum += share[k];
    }
    if (sum > 0) {
      for (int k = 0; k < kOther; ++k) share[k] /= sum;
      return;
    }
  }
  for (int k = 0; k < kTissueCount; ++k) share[k] = blend[k] / total;
}

}  // namespace

// Of pieces that both the cut and the tooth's surface cross, what lies under both.
void ContactModel::cover_both(const Int4& where, const Borders& surface, Lanes& s) noexcept {
  const auto line = [](const Borders& b, int p) {
    return DividingLine{b.value[p], b.along[p], b.around[p]};
  };
  for (int p = 0; p < kPieces; ++p) {
    if (!where[p]) continue;
    const CoveredPart<float> part = covered_by_both(line(s.cut, p), line(surface, p));
    s.share[p] = part.share, s.x[p] = part.x, s.y[p] = part.y;
  }
}

// What is covered of the pieces lies in the tooth in part, and in which tissue.
void ContactModel::cover_tooth(const Scan& scan, int i, const PieceAxes& axes, const Pieces& pieces,
                               int first, Lanes& s) noexcept {
  const Workpiece& workpiece = scan.workpiece;
  const Standing& standing = standing_[i];
  Int4 at_surface{}, only{};
  for (int p = 0; p < kPieces; ++p) {
    if (!(s.share[p] > kLeastShare)) continue;
    const auto b = static_cast<std::size_t>(s.cells->brick[p]);
    at_surface[p] = standing.inside_tooth || workpiece.deep(b) ? 0 : -1;
    only[p] = standing.only != 0 ? standing.only : workpiece.only_tissue(b);
  }
  KeptTissues& kept = tissues_[i];
  kept.move_to(s.cells->x, s.cells->y, s.cells->z);
  if (any(at_surface)) {
    kept.read_solid(workpiece, at_surface);
    const FourSamples solid = kept.solid.at(s.fx, s.fy, s.fz), g = scan.frame.gradients(solid);
    const Float4 along = axes.along(g), around = axes.around(g);
    const Float4 value = straightened(at_surface4(solid, s.ahead), along, around,
                                      axes.bent_along(g), axes.bent_around(g));
    const Borders surface{value, along, around};
    const CoveredPart<Float4> part = surface.part();
    const Int4 both = at_surface & (least(part.share, s.share) > kLeastShare) &
                      (greatest(part.share, s.share) < 1 - kLeastShare);
    s.cover(at_surface & (part.share < s.share), part);
    if (any(both)) cover_both(both, surface, s);
    s.note_crossing(at_surface, value, along, around, along4(solid, s.unit));
  }
  const Int4 counts = s.share > kLeastShare;
  const std::int32_t one = std::max(std::max(only[0], only[1]), std::max(only[2], only[3]));
  const bool alone = !any(counts & (only != one)), none = !any(counts);
  s.tissue = none ? 0 : alone ? one - 1 : -1;
  if (s.tissue < 0) share_tissues(scan, axes, pieces, first, counts, only, kept, s);
}

// How what is covered of the pieces that count is shared among the tissues: by their level sets four at
// a time, where these tell.
void ContactModel::share_tissues(const Scan& scan, const PieceAxes& axes, const Pieces& pieces,
                                 int first, const Int4& counts, const Int4& only, KeptTissues& kept,
                                 Lanes& s) const noexcept {
  const Int4 wanted = counts & (only == 0);
  std::fill_n(s.of_tissue, kTissueCount, Float4{});
  Float4 sum{};
  if (any(wanted)) {
    kept.read_tissues(scan.workpiece, wanted);
    for (int k = 0; k < KeptTissues::kFields; ++k) {
      const FourSamples field = kept.tissues[k].at(s.fx, s.fy, s.fz);
      const FourSamples g = scan.frame.gradients(field);
      const Float4 along = axes.along(g), around = axes.around(g);
      const Float4 middle = straightened(at_surface4(field, s.ahead), along, around,
                                         axes.bent_along(g), axes.bent_around(g));
      const Float4 value = middle + along * s.x + around * s.y;
      const Float4 extent = range_over_covered(along, around, s.x, s.y);
      const Float4 share = 0.5f - 0.5f * value / greatest(extent, all4(kLeastExtent));
      s.of_tissue[k] = least(greatest(share, Float4{}), all4(1));
      sum += s.of_tissue[k];
      s.note_crossing(wanted, value, along, around, along4(field, s.unit));
    }
    for (int k = 0; k < KeptTissues::kFields; ++k) s.of_tissue[k] /= sum;
  }
  const Int4 known = wanted & kept.by_fields & (sum > 0);
  for (int p = 0; p < kPieces; ++p) {
    if (known[p]) continue;
    PerTissue<float> shares{};
    if (only[p] != 0)
      shares[only[p] - 1] = 1;
    else if (counts[p])
      shares = shares_of(scan, pieces, first, p, s), s.stays[p] = s.holds[p] = 0;
    for (int k = 0; k < kTissueCount; ++k) s.of_tissue[k][p] = shares[k];
  }
}

// How what is covered of a piece is shared among the tissues.
PerTissue<float> ContactModel::shares_of(const Scan& scan, const Pieces& pieces, int first, int p,
                                         const Lanes& s) const noexcept {
  const IndexFrame& f = scan.frame;
  const int q = first + p;
  const HalfAxes axes{pieces.half_along[first] * f.turned(pieces.lx[q], pieces.ly[q], pieces.lz[q]),
                      pieces.half_around[first] * f.turned(pieces.tx[q], pieces.ty[q], 0)};
  PerTissue<float> shares{};
  tissue_shares(scan.workpiece, static_cast<std::size_t>(s.cells->brick[p]),
                Index3(s.cells->x[p], s.cells->y[p], s.cells->z[p]),
                Eigen::Vector3f(s.fx[p], s.fy[p], s.fz[p]), s.ahead, axes, {s.x[p], s.y[p]},
                shares);
  return shares;
}

}  // namespace toothprep
