// Walls of earlier cuts that the bur's own last cut hides, also from the sample a little ahead: where a
// piece advances slowly its own print is near there as well. A wall along the motion is the same farther
// ahead, where it stands alone.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// The samples lie where the bur's own print is so far away (voxels), of a wall and of what is looked at beside a
// groove.
constexpr float kFromPrint = 2.5f, kGrooveFromPrint = 4.5f;
// A field as steep as this (squared, 1 being a distance) is that of one wall.
constexpr float kOneWall = 0.8f;
// Of a piece that less than this was found to be covered of, a wall takes off. It adds to it only at a sharp edge and on
// a flat end, where it crosses the surface at more than this angle (sine squared): else it may be what this part of the
// bur left itself. On a flat end it must be as straight as this in its cell (voxels), which isn't the narrow ellipse
// that the end itself leaves when it leans.
constexpr float kLeastWithWall = 0.05f, kCrosses = 0.1f, kLinear = 0.1f;
// The walls of a ridge are looked at so far from it (voxels) along each, where no cell holds both, twice as far if
// there isn't one wall yet, and they meet in one if each lies that far (voxels) within the other.
constexpr float kAside = 1.5f, kApart = 0.05f;

// Whether a field is that of one wall, along the motion by its rise.
Int4 is_one_wall(const FourSamples& g, const Float4& rise) {
  return (g.gx * g.gx + g.gy * g.gy + g.gz * g.gz > kOneWall) & (kAlong * magnitude(rise) < 1);
}

}  // namespace

// Walls along the motion that the samples at the surface and ahead don't tell of. `may_count`: the pieces that do
// if they are covered.
void ContactModel::cover_by_far_walls(const Scan& scan, const CutOfPieces& cut,
                                      const Int4& may_count, Lanes& s) const noexcept {
  // The print falls behind by `advance` of the way, and by its curvature along the motion.
  const Float4 advance = greatest(s.advance * cut.per_speed, Float4{});
  const auto way_from_print = [&](float voxels) {
    const float away = voxels * cut.voxel;
    const Float4 way = 2 * away /
                       greatest(advance + square_root(advance * advance + 2 * away * cut.bend),
                                all4(kLeastExtent));
    return least(way, all4(scan.straight));
  };
  const auto ahead = [&](const Float4& way) {
    const Float4 far = way - scan.reach;
    return Place{s.ix + far * s.unit.x(), s.iy + far * s.unit.y(), s.iz + far * s.unit.z()};
  };
  const Float4 way = way_from_print(kFromPrint);
  // Deeper in the void than the print makes it and than half of a piece is large, no wall crosses it.
  const Int4 near = s.cut.value < cut.half_along + cut.half_around + kRounded * cut.voxel;
  const Int4 wanted = may_count & near & (way > static_cast<float>(look_ahead_));
  if (!any(wanted)) return;
  if (has_edges_) cover_grooves(scan, cut, ahead(way_from_print(kGrooveFromPrint)), wanted, s);
  const Int4 others = wanted & ~s.groove;
  if (any(others)) cover_by_wall(scan, cut, ahead(way), others, s);
}

// Where the sample farther ahead finds a wall along the motion that crosses a piece, it divides the piece, whatever
// nearer samples found.
void ContactModel::cover_by_wall(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                 const Int4& wanted, Lanes& s) noexcept {
  const FourPlaces at(far.x, far.y, far.z);
  const IndexFrame& f = scan.frame;
  KeptCells cells;
  cells.read(scan.workpiece, at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), wanted,
             scan.cuts);
  const FourSamples there = f.gradients(cells.cells.at(at.fx, at.fy, at.fz));
  const Float4 stands_out = cut.swept_wall(), value = there.value + stands_out;
  Borders border = cut.borders(value, there, Float4{}, Float4{});
  const Int4 near =
      wanted & cells.live & (kAlong * magnitude(cut.rise(there)) < 1) &
      (magnitude(value) < kMayCross * (magnitude(border.along) + magnitude(border.around)));
  const Int4 crossed = near & is_one_wall(there, cut.rise(there)), rounded = near & ~crossed;
  if (cut.may_be_ridges && any(rounded))
    cover_ridges(scan, cut, border, far, stands_out, rounded, s);
  if (!any(crossed)) return;
  const AtBorder found = look_at_border(scan, cut, border, far, crossed);
  border.replace(crossed,
                 cut.borders(found.sample.value + stands_out, found.sample, found.x, found.y));
  const bool flat = cut.curvature_along == 0 && !any(cut.curvature_around != 0);
  const Int4 found_little = (s.share <= kLeastWithWall) | s.at_edge;
  border.replace(found_little, cut.without_thin(border));
  const CoveredPart<Float4> part = border.part();
  const Float4 along = border.along / cut.half_along, around = border.around / cut.half_around;
  const Int4 crosses = (flat ? cells.cells.bend() < kLinear * cut.voxel : s.at_edge) &
                       (along * along + around * around > kCrosses);
  const Int4 counts = crossed & is_one_wall(found.sample, cut.rise(found.sample)) &
                      ((part.share < s.share) | crosses | ~found_little);
  s.cut.replace(counts, border);
  s.cover(counts, part);
  if (cut.may_be_ridges) cover_ridges(scan, cut, border, far, stands_out, counts, s);
}

// Two earlier cuts leave a ridge between them. The lattice rounds it, and one border doesn't divide a piece in which
// it lies: both walls are looked at beside it. `stands_out`: mm, of walls on the lattice.
void ContactModel::cover_ridges(const Scan& scan, const CutOfPieces& cut, const Borders& border,
                                const Place& far, const Float4& stands_out, const Int4& wanted,
                                Lanes& s) noexcept {
  // Along the border, from where it passes the middle.
  const Float4 per_along = all4(1 / cut.half_along), per_around = 1 / cut.half_around;
  const Float4 by_along = border.along * per_along, by_around = border.around * per_around;
  const Float4 square = greatest(by_along * by_along + by_around * by_around, all4(kLeastExtent));
  const Float4 to_border = -border.value / square, aside = kAside * cut.voxel / square_root(square);
  const auto in_piece = [](const Float4& x) { return least(greatest(x, all4(-1)), all4(1)); };
  const Float4 x = in_piece(to_border * by_along * per_along),
               y = in_piece(to_border * by_around * per_around);
  const Float4 dx = -aside * by_around * per_along, dy = aside * by_along * per_around;

  const auto look_beside = [&](float times) {
    AtBorder at = look_at(scan, cut, x + times * dx, y + times * dy, far, wanted);
    const Int4 again = wanted & ~is_one_wall(at.sample, cut.rise(at.sample));
    if (any(again))
      at.replace(again, look_at(scan, cut, x + 2 * times * dx, y + 2 * times * dy, far, again));
    return at;
  };
  const AtBorder sides[2] = {look_beside(1), look_beside(-1)};
  // What the wall at one place, were it flat, would make of the other: more than what is there where a wall is hollow,
  // as all are that a bur leaves.
  const PieceAxes& axes = cut.axes;
  const auto within_other = [&](const AtBorder& from, const AtBorder& to) {
    const FourSamples& g = from.sample;
    const Float4 straight =
        axes.along(g) * (to.x - from.x) +
        axes.around(g) * (to.y - from.y + axes.widening * (to.x * to.y - from.x * from.y));
    const Float4 bent = axes.bent_along(g) * (to.x * to.x - from.x * from.x) +
                        axes.bent_around(g) * (to.y * to.y - from.y * from.y);
    return g.value + straight + bent - to.sample.value < -kApart * cut.voxel;
  };
  Int4 ridge = wanted & within_other(sides[0], sides[1]) & within_other(sides[1], sides[0]);
  Borders walls[2];
  for (int side = 0; side < 2; ++side) {
    const AtBorder& at = sides[side];
    ridge &= is_one_wall(at.sample, cut.rise(at.sample));
    walls[side] = cut.borders(at.sample.value + stands_out, at.sample, at.x, at.y);
  }
  if (!any(ridge)) return;
  s.cut.replace(ridge, walls[0]);
  s.beside.replace(ridge, walls[1]);
  for (int p = 0; p < kPieces; ++p) {
    if (!ridge[p]) continue;
    const CoveredPart<float> part = covered_by_all({s.cut.line(p), s.beside.line(p)});
    s.share[p] = part.share, s.x[p] = part.x, s.y[p] = part.y;
  }
}

}  // namespace toothprep
