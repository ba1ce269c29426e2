// What lies of the pieces of an element in the tooth, and in which tissue. The tooth is as it was given,
// whatever is cut: what was read of its fields stands as long as a piece is in the same cell.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// How a place in a cell is shared among the tissues where their level sets don't tell: by the trilinear
// blend of the labels. Adds up to 1, or to 0 in air.
PerTissue<float> blend_of_labels(const LabelGrid& labels, std::int64_t brick, const Index3& cell,
                                 const Eigen::Vector3f& in_cell) noexcept {
  PerTissue<float> share{};
  const auto b = static_cast<std::size_t>(brick);
  if (labels.is_uniform(b) && (cell.x() & 7) < 7 && (cell.y() & 7) < 7 && (cell.z() & 7) < 7) {
    const std::uint8_t label = labels.uniform_value(b);
    if (label != 0) share[label - 1] = 1;
    return share;
  }
  float total = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int ix = corner >> 2, iy = (corner >> 1) & 1, iz = corner & 1;
    const std::uint8_t label = labels.value(cell.x() + ix, cell.y() + iy, cell.z() + iz);
    if (label == 0) continue;
    const float w = (ix ? in_cell.x() : 1 - in_cell.x()) * (iy ? in_cell.y() : 1 - in_cell.y()) *
                    (iz ? in_cell.z() : 1 - in_cell.z());
    share[label - 1] += w;
    total += w;
  }
  for (float& k : share) k /= std::max(total, kLeastExtent);
  return share;
}

}  // namespace

// Of pieces that both the cut and the tooth's surface cross, what lies under both. What slots leave under the cut,
// `by_cut`, is known better than by its lines: of it the part that these say.
void ContactModel::cover_both(const Int4& where, const CoveredPart<Float4>& by_cut,
                              Lanes& s) noexcept {
  for (int p = 0; p < kPieces; ++p) {
    if (!where[p]) continue;
    CoveredPart<float> part = s.under_all(p, DividingLine::none());
    if (s.by_slots[p]) {
      const CoveredPart<float> by_line = covered_by_all({s.cut.line(p)});
      if (!(by_line.share > kLeastShare)) continue;
      part = {by_cut.share[p] * part.share / by_line.share, by_cut.x[p] + part.x - by_line.x,
              by_cut.y[p] + part.y - by_line.y};
    }
    s.share[p] = part.share, s.x[p] = part.x, s.y[p] = part.y;
  }
}

// What is covered of the pieces lies in the tooth in part, and in which tissue.
void ContactModel::cover_tooth(const Scan& scan, int i, const PieceAxes& axes, Lanes& s) noexcept {
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
    const Float4 value =
        straightened(at_surface4(solid, s.ahead), along, around, axes.bent_along(g),
                     axes.bent_around(g), axes.widening * around);
    s.surface.replace(at_surface, {value, along, around});
    const CoveredPart<Float4> part = s.surface.part();
    const Int4 both = at_surface & (least(part.share, s.share) > kLeastShare) &
                      (greatest(part.share, s.share) < 1 - kLeastShare);
    const CoveredPart<Float4> by_cut{s.share, s.x, s.y};
    s.cover(at_surface & (part.share < s.share), part);
    if (any(both)) cover_both(both, by_cut, s);
    s.note_crossing(at_surface, value, along, around, along4(solid, s.unit));
  }
  const Int4 counts = s.share > kLeastShare;
  const std::int32_t one = std::max(std::max(only[0], only[1]), std::max(only[2], only[3]));
  const bool alone = !any(counts & (only != one)), none = !any(counts);
  s.tissue = none ? 0 : alone ? one - 1 : -1;
  if (s.tissue < 0) share_tissues(scan, axes, counts, only, kept, s);
}

// How what is covered of the pieces that count is divided among the tissues: by their level sets four at
// a time, where these tell.
void ContactModel::share_tissues(const Scan& scan, const PieceAxes& axes, const Int4& counts,
                                 const Int4& only, KeptTissues& kept, Lanes& s) noexcept {
  const Int4 wanted = counts & (only == 0);
  for (auto& part : s.of_tissue) part = {Float4{}, s.x, s.y};
  Borders borders[KeptTissues::kFields];
  Int4 met{}, known{};  // minus the tissues met; -1: their level sets tell
  if (any(wanted)) {
    kept.read_tissues(scan.workpiece, wanted);
    for (int k = 0; k < KeptTissues::kFields; ++k) {
      const FourSamples field = kept.tissues[k].at(s.fx, s.fy, s.fz);
      const FourSamples g = scan.frame.gradients(field);
      const Float4 along = axes.along(g), around = axes.around(g);
      const Float4 value =
          straightened(at_surface4(field, s.ahead), along, around, axes.bent_along(g),
                       axes.bent_around(g), axes.widening * around);
      borders[k] = {value, along, around};
      CoveredPart<Float4>& part = s.of_tissue[k] = borders[k].part();
      part.share = part.share > kLeastShare ? part.share : Float4{};
      met += part.share > 0;
      s.note_crossing(wanted, value, along, around, along4(field, s.unit));
    }
    known = wanted & kept.by_fields & (met < 0);
    const Int4 crossed = known & (met < -1) & (s.share < 1 - kLeastShare);
    Float4 sum{};
    for (int k = 0; k < KeptTissues::kFields; ++k) {
      CoveredPart<Float4>& part = s.of_tissue[k];
      for (int p = 0; p < kPieces; ++p) {
        if (!crossed[p] || !(part.share[p] > 0)) continue;
        const CoveredPart<float> under = s.under_all(p, borders[k].line(p));
        part.share[p] = under.share, part.x[p] = under.x, part.y[p] = under.y;
      }
      sum += part.share;
    }
    known &= sum > kLeastExtent;
    const Float4 of_all = s.share / greatest(sum, all4(kLeastExtent));
    for (int k = 0; k < KeptTissues::kFields; ++k) {
      CoveredPart<Float4>& part = s.of_tissue[k];
      part.share *= of_all;
      part.x = met == -1 ? s.x : part.x, part.y = met == -1 ? s.y : part.y;
    }
  }
  for (int p = 0; p < kPieces; ++p) {
    if (known[p]) continue;
    PerTissue<float> shares{};
    if (only[p] != 0)
      shares[only[p] - 1] = 1;
    else if (counts[p]) {
      shares = blend_of_labels(scan.workpiece.labels(), s.cells->brick[p],
                               Index3(s.cells->x[p], s.cells->y[p], s.cells->z[p]),
                               Eigen::Vector3f(s.fx[p], s.fy[p], s.fz[p]));
      s.stays[p] = s.holds[p] = 0;
    }
    for (int k = 0; k < kTissueCount; ++k) {
      CoveredPart<Float4>& part = s.of_tissue[k];
      part.share[p] = shares[k] * s.share[p], part.x[p] = s.x[p], part.y[p] = s.y[p];
    }
  }
}

}  // namespace toothprep
