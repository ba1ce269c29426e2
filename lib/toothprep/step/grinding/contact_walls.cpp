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

// The sample lies where the bur's own print is so far away (voxels).
constexpr float kFromPrint = 2.5f;
// A field as steep as this (squared, 1 being a distance) is that of one wall, and that runs along the motion where
// the sine of the angle between them is below 1 over this: where a cavity's wall bends, nearer ones are seen.
constexpr float kOneWall = 0.8f, kAlong = 30;
// Of a piece that less than this was found to be covered of, a wall takes off, and adds nothing.
constexpr float kLeastWithWall = 0.05f;
// The walls of a ridge are looked at so far from it (voxels) along each, where no cell holds both, and
// they meet in one if each lies that far (voxels) within the other.
constexpr float kAside = 1.5f, kApart = 0.05f;
constexpr float kFlat = 1e-3f;  // 1/mm; keeps a division defined

// Whether a field is that of one wall, along the motion by its rise.
Int4 is_one_wall(const FourSamples& g, const Float4& rise) {
  return (g.gx * g.gx + g.gy * g.gy + g.gz * g.gz > kOneWall) & (kAlong * magnitude(rise) < 1);
}

}  // namespace

// Where the sample farther ahead finds a wall along the motion that crosses a piece, it divides the piece, whatever
// nearer samples found.
void ContactModel::cover_by_far_wall(const Scan& scan, const CutOfPieces& cut,
                                     Lanes& s) const noexcept {
  const float voxel = cut.voxel;
  // The print falls behind by `advance` of the way, and by its curvature along the motion.
  const Float4 advance = greatest(s.advance * cut.per_speed, Float4{});
  const float from_print = kFromPrint * voxel;
  const Float4 way = 2 * from_print /
                     greatest(advance + square_root(advance * advance + 2 * from_print * cut.bend),
                              all4(kLeastExtent)),
               look = least(way, all4(scan.straight));
  const Int4 wanted = s.live & (s.share > kLeastShare) & (look > static_cast<float>(look_ahead_));
  if (!any(wanted)) return;

  const Float4 far = look - scan.reach;
  const Place middle{s.ix + far * s.unit.x(), s.iy + far * s.unit.y(), s.iz + far * s.unit.z()};
  const FourPlaces at(middle.x, middle.y, middle.z);
  const IndexFrame& f = scan.frame;
  KeptCells cells;
  cells.read(scan.workpiece, at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), wanted,
             scan.cuts);
  const FourSamples there = f.gradients(cells.cells.at(at.fx, at.fy, at.fz));
  // The wall that a surface leaves which is swept along itself has no curvature that way, and all of the
  // surface's Gaussian one.
  const Float4 of_motion =
                   cut.bend / greatest(cut.vl * cut.vl + cut.vt * cut.vt, all4(kLeastExtent)),
               gaussian = cut.curvature_along * cut.curvature_around,
               stands_out = greatest(
                   kWallAtMost * voxel * voxel * gaussian / greatest(of_motion, all4(kFlat)),
                   cut.wall);
  const Float4 value = there.value + stands_out;
  Borders border = cut.borders(value, there, Float4{}, Float4{});
  const Int4 crossed =
      wanted & cells.live & is_one_wall(there, cut.rise(there)) &
      (magnitude(value) < kMayCross * (magnitude(border.along) + magnitude(border.around)));
  if (!any(crossed)) return;
  const AtBorder found = look_at_border(scan, cut, border, middle, crossed);
  border.replace(crossed,
                 cut.borders(found.sample.value + stands_out, found.sample, found.x, found.y));
  const CoveredPart<Float4> part = border.part();
  const Int4 counts = crossed & is_one_wall(found.sample, cut.rise(found.sample)) &
                      ((part.share < s.share) | ((s.share > kLeastWithWall) & ~s.at_edge));
  s.cut.replace(counts, border);
  s.cover(counts, part);
  if (cut.may_be_ridges) cover_ridges(scan, cut, border, middle, stands_out, counts, s);
}

// Two earlier cuts leave a ridge between them. The lattice rounds it, and one border doesn't divide a piece in which
// it lies: both walls are looked at beside it. `stands_out`: mm, of walls on the lattice.
void ContactModel::cover_ridges(const Scan& scan, const CutOfPieces& cut, const Borders& border,
                                const Place& middle, const Float4& stands_out, const Int4& wanted,
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

  const AtBorder sides[2] = {look_at(scan, cut, x + dx, y + dy, middle, wanted),
                             look_at(scan, cut, x - dx, y - dy, middle, wanted)};
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
