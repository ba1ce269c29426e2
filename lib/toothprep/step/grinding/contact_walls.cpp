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

// The samples lie where the bur's own print is so far away (voxels), of a wall and of what is looked at around a
// groove or a slot.
constexpr float kFromPrint = 2.5f, kGrooveFromPrint = 4.5f;
// Of a piece that less than this was found to be covered of, a wall takes off. It adds to it only at a sharp edge, on a
// flat end and on a straight side, where it crosses the surface: else it may be what this part of the bur left itself. On
// a straight side, away from its edges, such a wall is a floor or a step of an earlier layer, and thin is only what it
// leaves of the piece. On a flat end it must be as straight as this in its cell (voxels), which isn't the narrow ellipse
// that the end itself leaves when it leans.
constexpr float kLeastWithWall = 0.05f, kLinear = 0.1f;
// The walls of a ridge are looked at so far from it (voxels), where no cell holds both: each at the nearest place where
// the next one confirms it. They meet in a ridge if each lies that far (voxels) within the other.
constexpr float kAside[] = {1.5f, 2.25f, 3, 3.75f}, kApart = 0.05f;
// Where its curvature is known, a wall tells what is found farther along it, to so many voxels. Elsewhere its normal
// turns by less than this (sine, squared): else one of the two is a blend of walls that meet.
constexpr float kAgrees = 0.015f, kSameWall = 0.05f;
// The lattice flattens a ridge by less than this (voxels).
constexpr float kFlattened = 0.2f;
// And it was taken where a point of it is deeper (voxels) than both of its walls are there.
constexpr float kTaken = 0.01f;
// What was found ahead is looked for at these parts of the way there. The lattice, which rounds edges, may have less void
// by so many voxels.
constexpr float kBetween[] = {0.75f, 0.5f, 0.25f}, kLessBetween = 0.5f;

// Square of the difference of two gradients.
Float4 turned(const FourSamples& a, const FourSamples& b) {
  const Float4 x = a.gx - b.gx, y = a.gy - b.gy, z = a.gz - b.gz;
  return x * x + y * y + z * z;
}

}  // namespace

// Walls along the motion that the samples at the surface and ahead don't tell of. `may_count`: the pieces that do
// if they are covered. `lessened`: of these less was found to be covered a little ahead than at the surface.
void ContactModel::cover_by_far_walls(const Scan& scan, const CutOfPieces& cut,
                                      const Int4& may_count, const Int4& lessened,
                                      Lanes& s) const noexcept {
  // Deeper in the void than the print makes it and than half of a piece is large, no wall crosses it.
  const Int4 near =
      (s.cut.value < cut.half_along + cut.half_around + kRounded * cut.voxel) | lessened;
  Int4 others = may_count & near;
  if (!any(others)) return;
  // The print falls behind by `advance` of the way, and by its curvature along the motion. With fine voxels it is out of
  // the way at the sample a little ahead, which doesn't tell of ridges.
  const auto look_ahead = static_cast<float>(look_ahead_);
  const FromPrint from = from_print(scan, cut, s);
  const Float4 &advance = from.advance, &bend = from.bend;
  const auto way_from_print = [&](float voxels) {
    const float away = voxels * cut.voxel;
    Float4 way =
        2 * away /
        greatest(advance + square_root(advance * advance + 2 * away * bend), all4(kLeastExtent));
    way = least(greatest(way, all4(look_ahead)), all4(scan.straight));
    const Eigen::Vector3f back = scan.reach * s.unit;
    for (int p = 0; p < kPieces; ++p)
      if (others[p])
        way[p] = scan.known_way(Eigen::Vector3f(s.ix[p], s.iy[p], s.iz[p]) - back, s.unit, way[p]);
    if (scan.farther) {
      // On an arc all of them as far as the farthest.
      float farthest = 0;
      for (int p = 0; p < kPieces; ++p)
        if (others[p]) farthest = std::max(farthest, way[p]);
      way = all4(farthest);
    }
    return way;
  };
  std::optional<AlongWay> arc;
  const auto ahead = [&](const Float4& way) {
    if (scan.farther) arc.emplace(scan, way[0]);
    return ahead_of(scan, s, way, arc ? &*arc : nullptr);
  };
  const Float4 way = way_from_print(kFromPrint);
  const Int4 clear = way >= look_ahead;
  const bool by_sweeps = scan.knows_parts();
  const bool by_slots = leaves_slots_ && (has_edges_ || cut.straight || slot_->edge().draws());
  if (has_edges_ || by_slots || by_sweeps) {
    const Float4 way_there = way_from_print(kGrooveFromPrint);
    Int4 beside_slots = others & (s.advance > 0);  // ahead of others lies the bur itself
    if (by_sweeps && any(beside_slots)) {
      others &= ~cover_by_sweeps(scan, cut, ahead(way_there), beside_slots, lessened, s);
      beside_slots &= others;
    }
    for (int p = 0; p < kPieces; ++p) beside_slots[p] &= way_ < (*s.slots_from)[p] ? 0 : -1;
    if (by_slots && any(beside_slots))
      others &= ~cover_by_slots(scan, cut, ahead(way_there),
                                way_there * (advance + 0.5f * bend * way_there), beside_slots, s);
    if (has_edges_ && any(others & clear))
      others &= ~cover_corners(scan, cut, ahead(way_there), others & clear, s);
  }
  others &= clear;
  if (any(others)) cover_by_wall(scan, cut, ahead(way), others, s);
}

// Of pieces, those that what was found ahead, at their middles `far` with that value (mm), reaches: on the way there,
// straight also where the path is an arc, the lattice has no less void.
Int4 ContactModel::reaches_here(const Scan& scan, const Place& far, const Float4& value, Int4 where,
                                const Lanes& s) noexcept {
  if (!any(where)) return where;
  const Float4 x = s.ix - s.ahead.x(), y = s.iy - s.ahead.y(), z = s.iz - s.ahead.z();
  const IndexFrame& f = scan.frame;
  const float less = kLessBetween * static_cast<float>(scan.workpiece.voxel());
  for (const float t : kBetween) {
    const FourPlaces at(x + t * (far.x - x), y + t * (far.y - y), z + t * (far.z - z));
    FourCells between;
    between.read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(),
                 where);
    where &= value - between.at(at.fx, at.fy, at.fz).value < less;
  }
  return where;
}

// The cut far ahead, at places `at` beside the middles `far` of four pieces.
ContactModel::Wall ContactModel::look_at_wall(const Scan& scan, const CutOfPieces& cut,
                                              const Displaced& at, const Place& far,
                                              const Int4& wanted) noexcept {
  const IndexFrame& f = far.frame;
  const FourPlaces places = far.beside(at.x, at.y, at.z);
  FourCells cells;
  cells.read(scan.workpiece.cut(), places.x + f.base.x(), places.y + f.base.y(),
             places.z + f.base.z(), wanted);
  return {cut.wall_at(f, places, f.gradients(cells.at(places.fx, places.fy, places.fz))), at.x,
          at.y, at.z};
}

// Where the sample farther ahead finds a wall along the motion that crosses a piece, it divides the piece, whatever
// nearer samples found.
void ContactModel::cover_by_wall(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                 const Int4& wanted, Lanes& s) const noexcept {
  const FourPlaces at(far.x, far.y, far.z);
  const IndexFrame& f = far.frame;
  KeptCells cells;
  cells.read(scan.workpiece, at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), wanted,
             scan.cuts);
  const FourSamples there = cut.wall_at(f, at, f.gradients(cells.cells.at(at.fx, at.fy, at.fz)));
  Borders border = cut.borders(there.value, there, Float4{}, Float4{});
  const Int4 along =
      reaches_here(scan, far, there.value,
                   wanted & cells.live & (kAlong * magnitude(cut.rise_on_way(there)) < 1), s);
  const Float4 reach = kMayCross * (magnitude(border.along) + magnitude(border.around)),
               away = magnitude(there.value);
  const Int4 crossed = along & (away < reach) & cut.is_one_wall(there), known = cut.knows(there);
  Int4 may_be_ridge =
      along & (known ? away < reach + kFlattened * cut.voxel : (away < reach) & ~crossed);
  if (any(crossed)) {
    const Float4 per_square =
        -border.value / greatest(cut.slope_squared(border), all4(kLeastExtent));
    const Displaced on_border = cut.on_surface(
        within(per_square * border.along / cut.half_along, all4(kWithinPiece * cut.half_along)),
        within(per_square * border.around / cut.half_around, kWithinPiece * cut.half_around));
    const Wall found = look_at_wall(scan, cut, on_border, far, crossed);
    border.replace(crossed, cut.borders(found));
    const Int4 steep = cut.crosses(border);
    const Int4 of_layer = cut.straight ? steep & ~s.at_edge : Int4{},
               found_little = ((s.share <= kLeastWithWall) & ~of_layer) | s.at_edge;
    border.replace(found_little, cut.without_thin(border));
    const CoveredPart<Float4> part = border.part();
    const Int4 crosses = (cut.flat ? cells.cells.bend() < kLinear * cut.voxel : s.at_edge) & steep;
    const Int4 counts = crossed & cut.is_one_wall(found.sample) &
                        ((part.share < s.share) | crosses | ~found_little);
    s.cut.replace(counts, border);
    s.rise = counts ? Float4{} : s.rise;
    s.cover(counts, part);
    may_be_ridge |= counts;
  }
  if (any(may_be_ridge)) cover_ridges(scan, cut, there, border, far, may_be_ridge, s);
}

// Whether the cut is deeper around places beside the middles `far` (mm, B) than two walls alone would be.
Int4 ContactModel::is_deeper(const Scan& scan, const CutOfPieces& cut, const Place& far,
                             const Displaced& beside, const Wall (&walls)[2],
                             const Int4& wanted) noexcept {
  const IndexFrame& f = far.frame;
  const FourPlaces at = far.beside(beside.x, beside.y, beside.z);
  FourCells cells;
  cells.read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), wanted);
  const float square = cut.voxel * cut.voxel;
  const float* a = f.a;
  Int4 deeper{};
  for (int k = 0; k < 8; ++k) {
    const Float4 dx = square * (static_cast<float>(k >> 2) - at.fx),
                 dy = square * (static_cast<float>((k >> 1) & 1) - at.fy),
                 dz = square * (static_cast<float>(k & 1) - at.fz);
    const Float4 x = beside.x + a[0] * dx + a[3] * dy + a[6] * dz,
                 y = beside.y + a[1] * dx + a[4] * dy + a[7] * dz,
                 z = beside.z + a[2] * dx + a[5] * dy + a[8] * dz;
    const auto is_below = [&](const Wall& wall) {
      return cells.corner(k) - cut.field(wall, x, y, z).value > kTaken * cut.voxel;
    };
    deeper |= is_below(walls[0]) & is_below(walls[1]);
  }
  return deeper;
}

// Whether the bur went straight over the place x, y of piece p before: of a ridge that it took between two rows of the
// lattice's points, these don't tell.
bool ContactModel::was_over(const Scan& scan, const CutOfPieces& cut, int p, float x, float y,
                            const Lanes& s) const noexcept {
  const IndexFrame& f = scan.frame;
  const Displaced d = cut.displaced(all4(x), all4(y));
  const Eigen::Vector3f from_tip = Eigen::Vector3f(s.ix[p], s.iy[p], s.iz[p]) -
                                   scan.reach * s.unit + f.turned(d.x[p], d.y[p], d.z[p]);
  const Lattice& lattice = scan.workpiece.lattice();
  const Vec3 place = lattice.to_world(f.base) + lattice.voxel * from_tip.cast<double>();
  return went_over(scan, place);
}

// Two earlier cuts leave a ridge between them. The lattice rounds it, and one border doesn't divide a piece in which
// it lies: both walls are looked at beside it, across the motion. `there`: the cut in the pieces' middles.
void ContactModel::cover_ridges(const Scan& scan, const CutOfPieces& cut, const FourSamples& there,
                                const Borders& border, const Place& far, const Int4& wanted,
                                Lanes& s) const noexcept {
  // From where the border passes the middle.
  const Float4 to_border = -border.value / greatest(cut.slope_squared(border), all4(kLeastExtent));
  const Displaced from =
      cut.on_surface(within(to_border * border.along / cut.half_along, all4(cut.half_along)),
                     within(to_border * border.around / cut.half_around, cut.half_around));
  const CutOfPieces::Across across = cut.across(there);
  const Float4 aside =
      cut.voxel /
      square_root(greatest(across.x * across.x + across.y * across.y + across.z * across.z,
                           all4(kLeastExtent)));
  // The walls of which more than one look tells.
  Int4 ridge = wanted;
  const auto look_beside = [&](float side) {
    Wall wall{};
    Int4 looked = wanted, found{};
    for (const float voxels : kAside) {
      const Float4 way = side * voxels * aside;
      const Displaced at{from.x + way * across.x, from.y + way * across.y, from.z + way * across.z};
      const Wall farther = look_at_wall(scan, cut, at, far, looked);
      if (voxels > kAside[0]) {
        const Int4 agrees =
            ~cut.is_one_wall(farther.sample) |
            (cut.knows(wall.sample) ? magnitude(cut.at_most(wall, farther) - farther.sample.value) <
                                          kAgrees * cut.voxel
                                    : turned(wall.sample, farther.sample) < kSameWall);
        found |= looked & cut.is_one_wall(wall.sample) & agrees;
      }
      looked &= ~found;
      if (!any(looked)) break;
      wall.replace(looked, farther);
    }
    ridge &= found;
    return wall;
  };
  const Wall sides[2] = {look_beside(1), look_beside(-1)};
  // How far each lies within the other (mm, negative).
  const Float4 one = cut.at_most(sides[0], sides[1]) - sides[1].sample.value,
               other = cut.at_most(sides[1], sides[0]) - sides[0].sample.value,
               apart = all4(-kApart * cut.voxel);
  ridge &= (one < apart) & (other < apart);
  // Unless it was taken since.
  const Int4 known = ridge & cut.knows(sides[0].sample) & cut.knows(sides[1].sample);
  if (any(known)) {
    const Float4 way = other / least(one + other, apart);
    const Displaced crest{sides[0].x + way * (sides[1].x - sides[0].x),
                          sides[0].y + way * (sides[1].y - sides[0].y),
                          sides[0].z + way * (sides[1].z - sides[0].z)};
    ridge &= ~(known & is_deeper(scan, cut, far, crest, sides, known));
  }
  if (!any(ridge)) return;
  const Borders borders[2] = {cut.borders(sides[0]), cut.borders(sides[1])};
  for (int p = 0; p < kPieces; ++p) {
    if (!ridge[p]) continue;
    const CoveredPart<float> part = covered_by_all({borders[0].line(p), borders[1].line(p)});
    if (part.share > kLeastShare && was_over(scan, cut, p, part.x, part.y, s))
      ridge[p] = 0;
    else
      s.share[p] = part.share, s.x[p] = part.x, s.y[p] = part.y;
  }
  s.rise = ridge ? Float4{} : s.rise;
  s.cut.replace(ridge, borders[0]);
  s.beside.replace(ridge, borders[1]);
}

}  // namespace toothprep
