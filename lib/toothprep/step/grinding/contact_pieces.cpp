// Contact of an element piece by piece: four at a time, as many as a vector has lanes.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// Where the surface is this close to parallel to the motion (sine), tissue counts only if the
// sample farther ahead finds it too: there the surface bends away from fresh tissue, and the wall of
// a slot that is passed again is as near as ever.
constexpr float kParallel = 0.15f;
// Of tissue beside a wall that stands out (kWallAtMost) no more is asked for than this part of the depth at
// which fresh tissue is found.
constexpr float kFresh = 0.5f;
// What a sharp edge left stands out by more (voxels): the lattice rounds corners, and there are ridges
// between the sub-poses of a sweep. It lies towards the edge, where
// the wall of an earlier cut beside the bur lies around the axis.
constexpr float kEdgeStandsOut = 0.1f;
constexpr float kParallelAtEdge = 0.35f;  // sine, likewise
constexpr float kBeside = 4;              // 1 / cosine² up to which an edge lies beside the motion
// The floor that it left ahead of the bur, likewise.
constexpr float kFloorStandsOut = 0.05f;
// For this much of the way (voxels) at most what was found of a piece stands: between the lattice's points a gradient
// changes. Slots were found over several cells.
constexpr double kSettled = 0.2, kSettledBySlots = 0.4, kSettledBySweeps = 1;
constexpr float kUnbounded = 1e3f;  // mm of way
// So far ahead (voxels) the bur's own print is out of the way, and a field as steep as this (squared, 1 being a
// distance) is that of one wall.
constexpr float kClearOfPrint = 2, kStandsAlone = 0.9f;
// Of a piece that less than this is covered of, what lies beside a ridge is noise.
constexpr float kLeastBesideRidge = 0.05f;
// What lies ahead is met head-on if it rises by more than this along the motion (sine). How it is curved is read from
// second differences of the lattice, unless these say that walls meet there: beyond so much of D² times the larger of
// the bur's curvatures there, or to the other side by more than that.
constexpr float kMeets = 0.15f, kMostCurved = 2.5f, kOtherSide = 0.3f;
constexpr double kInside = 1e-5;  // mm; of the bur somewhere else
// Of places spread evenly, over half of their range squared.
constexpr float kVariance = 1.0f / 3;

// By how much (mm) the floor that a sharp edge left is too high at that edge, from the field's value in
// the middle of pieces there and its rise from the edge to the middle.
Float4 floor_too_high(const Float4& value, const Float4& rise, float voxel) {
  return rise > 0 ? doubt_of_thin(rise - value, kFloorStandsOut * voxel) : Float4{};
}

}  // namespace

// Element i piece by piece.
void ContactModel::divide(const Scan& scan, int i) noexcept {
  const SurfaceElements& e = elements_;
  Standing& standing = standing_[i];
  const bool by_sums = been_.empty() && !scan.retraced && surely_advances(scan, i);
  if (by_sums && standing.summed >= 0 && way_ < settled_[i]) return add_sums(scan, standing);
  const bool strips = e.curvature_along[i] == 0 && (standing.strips || found_[i] == Found::kInside);
  const Pieces& pieces = strips ? strips_ : squares_;
  const int first = i * kPieces;
  Lanes lanes;
  lanes.curvature_along = e.curvature_along[i];
  lanes.curvature_around = load4(&pieces.curvature_around[first]);
  lanes.edge = edge_[i];
  // Squares lie two by two, the lower of each first.
  const std::int32_t lower = strips || lanes.edge < 0 ? -1 : 0, upper = strips ? -1 : -1 - lower;
  lanes.at_edge = lanes.edge == 0 ? Int4{} : Int4{lower, upper, lower, upper};
  const Eigen::Vector3f u = scan.velocity_at(e.x[i], e.y[i], e.z[i]);
  lanes.speed = scan.turns ? u.norm() : scan.speed;
  lanes.unit = scan.turns ? scan.unit_of(u, lanes.speed) : scan.unit;
  lanes.ahead = scan.reach * lanes.unit;
  feed(scan, pieces, first, lanes);
  const Int4 felt = lanes.live;
  if (!any(felt)) return;
  const bool simple = standing.inside_tooth && standing.only != 0;
  lanes.tissue = standing.only - 1;
  if (simple && found_[i] == Found::kInside) {
    lanes.share = all4(1);
  } else {
    if (way_ < settled_[i])
      take_settled(standing, lanes);
    else if (way_ < moves_[i])
      find_moved(i, lanes);
    else
      find_covered(scan, i, pieces, first, simple, lanes);
    held_ = std::min(held_, standing.holds - way_);
  }
  lanes.share = felt ? lanes.share : Float4{};
  if (advance_[i] < range_[i]) cover_advancing(pieces, first, lanes);
  if (!been_.empty() || scan.retraced) leave_out_where_it_was(scan, pieces, first, lanes);
  if (!by_sums || lanes.tissue < 0) return add_covered(pieces, first, lanes);
  const Int4 counts = lanes.share > kLeastShare;
  const CoveredPart<Float4> part{lanes.share, lanes.x, lanes.y};
  standing.sums = ContactSet::sums_of(middles(pieces, first, part, lanes),
                                      counts ? lanes.share : Float4{}, scan.turns);
  standing.summed = -(counts[0] + counts[1] + counts[2] + counts[3]);
  add_sums(scan, standing);
}

// What is covered of the pieces, and in which tissue.
void ContactModel::find_covered(const Scan& scan, int i, const Pieces& pieces, int first,
                                bool simple, Lanes& s) noexcept {
  s.cells = &near_[i];
  s.slots_from = &standing_[i].slots_from;
  s.parts_from = &standing_[i].parts_from;
  s.by_sweeps = s.by_rates = Int4{};
  s.stays = s.holds = s.moves = all4(kUnbounded);
  s.rise = Float4{};
  locate(scan, pieces, first, s);
  const PieceAxes axes(pieces, first, s.curvature_along);
  Standing& standing = standing_[i];
  if (found_[i] != Found::kInside) {
    if (way_ < cut_moves_[i]) {
      take_cut(i, s);
    } else {
      cover(scan, axes, pieces, first, far_[i], s);
      if (!simple) keep_cut(scan, i, s);
    }
  }
  if (!simple) cover_tooth(scan, i, axes, s);

  standing.tissue = s.tissue;
  if (s.tissue < 0) std::copy_n(s.of_tissue, kTissueCount, standing.of_tissue);
  standing.rise = s.rise;
  standing.by_rates = s.by_rates, standing.per_way = s.per_way;
  standing.by_sweeps = are_told_by(s.by_sweeps, s);
  const double farthest = farthest_of(scan, s);
  moves_[i] = simple ? std::min(farthest, until(s, s.are_moved() ? s.moves : s.stays)) : -1;
  keep(i, farthest, s);
}

// Whether of all pieces that are covered in part these lines tell.
bool ContactModel::are_told_by(const Int4& lines, const Lanes& s) noexcept {
  const Int4 divided = (s.share > kLeastShare) & (s.share < 1);
  return any(lines) && !any(divided & ~lines);
}

// Until where on the way what was found stands at most.
double ContactModel::farthest_of(const Scan& scan, const Lanes& s) const noexcept {
  return way_ + scan.workpiece.voxel() * (are_told_by(s.by_sweeps, s)  ? kSettledBySweeps
                                          : are_told_by(s.by_slots, s) ? kSettledBySlots
                                                                       : kSettled);
}

// Keeps what was found of the cut alone, beside which the tooth's own surface or tissues may move on.
void ContactModel::keep_cut(const Scan& scan, int i, const Lanes& s) noexcept {
  Standing& standing = standing_[i];
  standing.by_cut = {s.share, s.x, s.y};
  standing.cut = s;
  standing.cut_by_sweeps = s.by_sweeps;
  standing.cut_by_rates = s.by_rates, standing.cut_per_way = s.per_way;
  standing.cut_rise = s.rise;
  standing.cut_path = path_;
  cut_moves_[i] = std::min(farthest_of(scan, s), until(s, s.are_moved() ? s.moves : s.stays));
}

// The same again, moved on.
void ContactModel::take_cut(int i, Lanes& s) const noexcept {
  const Standing& standing = standing_[i];
  s.share = standing.by_cut.share, s.x = standing.by_cut.x, s.y = standing.by_cut.y;
  static_cast<Crossing&>(s) = standing.cut;
  s.by_sweeps = standing.cut_by_sweeps;
  s.by_rates = standing.cut_by_rates, s.per_way = standing.cut_per_way;
  s.rise = standing.cut_rise;
  move_on(static_cast<float>(path_ - standing.cut_path), s);
  const Float4 left = all4(static_cast<float>(cut_moves_[i] - way_));
  s.stays = least(s.stays, left), s.holds = least(s.holds, left), s.moves = least(s.moves, left);
}

// What the cut covers after so much more of the path (mm).
void ContactModel::move_on(float path, Lanes& s) noexcept {
  s.cut.value += path * s.rise;
  CoveredPart<Float4> part = s.cut.part();
  if (any(s.by_rates)) {
    const auto moved = [&](const Float4& now, const Float4& rate, const Float4& by_border) {
      return s.by_rates ? now + path * rate : by_border;
    };
    part = {greatest(least(moved(s.share, s.per_way.share, part.share), all4(1)), Float4{}),
            within(moved(s.x, s.per_way.x, part.x), all4(1)),
            within(moved(s.y, s.per_way.y, part.y), all4(1))};
  }
  const Int4 moves = s.are_moved();
  s.cover(moves, part);
  s.note_crossing(moves, s.cut.value, s.cut.along, s.cut.around, s.rise);
  s.note_rate(s.by_rates, s.per_way.share);
}

// Until where a way of the pieces leads. What doesn't advance counts only once the motion turns, which is way as well.
double ContactModel::until(const Lanes& s, const Float4& way) const noexcept {
  return way_ + double{least_of(s.advance > 0 ? way : all4(kUnbounded))};
}

// Keeps what was found to be covered of the pieces, until `farthest` at most.
void ContactModel::keep(int i, double farthest, const Lanes& s) noexcept {
  Standing& standing = standing_[i];
  store4(s.share, standing.covered.data());
  store4(s.x, standing.x.data());
  store4(s.y, standing.y.data());
  standing.crossing = s;
  standing.path = path_;
  standing.summed = -1;
  settled_[i] = std::min(farthest, until(s, s.stays));
  standing.holds = until(s, s.holds);
}

// The same where the cut's borders moved along since.
void ContactModel::find_moved(int i, Lanes& s) noexcept {
  const Standing& standing = standing_[i];
  take_settled(standing, s);
  s.stays = s.holds = s.moves = all4(kUnbounded);
  s.rise = standing.rise, s.by_rates = standing.by_rates, s.per_way = standing.per_way;
  move_on(static_cast<float>(path_ - standing.path), s);
  keep(i, moves_[i], s);
}

// The same as it was found before.
void ContactModel::take_settled(const Standing& standing, Lanes& s) noexcept {
  s.share = load4(standing.covered.data());
  s.x = load4(standing.x.data()), s.y = load4(standing.y.data());
  static_cast<Crossing&>(s) = standing.crossing;
  s.tissue = standing.tissue;
  if (s.tissue < 0) std::copy_n(standing.of_tissue, kTissueCount, s.of_tissue);
}

// Puts what is covered into the contact, as sums.
void ContactModel::add_sums(const Scan& scan, const Standing& standing) noexcept {
  held_ = std::min(held_, standing.holds - way_);
  if (standing.summed > 0)
    contact_.add_advancing(standing.sums, standing.summed, standing.tissue, scan.turns);
}

// The same tissue by tissue, each piece apart.
void ContactModel::add_covered(const Pieces& pieces, int first, const Lanes& s) noexcept {
  const CoveredPart<Float4> all{s.share, s.x, s.y};
  if (s.tissue >= 0) {
    contact_.add_four(middles(pieces, first, all, s), s.tissue, s.share, kLeastShare);
    return;
  }
  const Int4 counts = s.share > kLeastShare;
  for (int k = 0; k < kTissueCount; ++k) {
    const CoveredPart<Float4>& part = s.of_tissue[k];
    const Float4 share = counts ? part.share : Float4{};
    if (any(share > kLeastShare))
      contact_.add_four(middles(pieces, first, part, s), k, share, kLeastShare);
  }
}

// The velocities of the pieces; those that may advance with a velocity that covers() allows live.
void ContactModel::feed(const Scan& scan, const Pieces& pieces, int first,
                        Lanes& s) const noexcept {
  s.ux = s.uy = s.uz = Float4{};
  if (scan.turns) {
    const Float4 x = load4(&pieces.x[first]), y = load4(&pieces.y[first]),
                 z = load4(&pieces.z[first]);
    const float ox = scan.omega.x(), oy = scan.omega.y(), oz = scan.omega.z();
    s.ux = oy * z - oz * y, s.uy = oz * x - ox * z, s.uz = ox * y - oy * x;
  }
  s.ux += scan.v.x(), s.uy += scan.v.y(), s.uz += scan.v.z();
  s.advance = s.ux * load4(&pieces.nx[first]) + s.uy * load4(&pieces.ny[first]) +
              s.uz * load4(&pieces.nz[first]);
  // Half of a piece may be in front of its middle.
  const Float4 turn = std::abs(s.curvature_along * pieces.half_along[first]) +
                      magnitude(s.curvature_around * load4(&pieces.half_around[first]));
  s.live = s.advance >= -(kMarginSine + turn) * s.speed;
  s.x = s.y = Float4{};
}

// The cells of the samples of the pieces, and whether they are in the box and not in air.
void ContactModel::locate(const Scan& scan, const Pieces& pieces, int first,
                          Lanes& s) const noexcept {
  const IndexFrame& f = scan.frame;
  const float* a = f.a;
  const Float4 x = load4(&pieces.x[first]), y = load4(&pieces.y[first]),
               z = load4(&pieces.z[first]);
  s.ix = (f.fx + s.ahead.x()) + (a[0] * x + a[1] * y + a[2] * z);
  s.iy = (f.fy + s.ahead.y()) + (a[3] * x + a[4] * y + a[5] * z);
  s.iz = (f.fz + s.ahead.z()) + (a[6] * x + a[7] * y + a[8] * z);
  const FourPlaces at(s.ix, s.iy, s.iz);
  s.fx = at.fx, s.fy = at.fy, s.fz = at.fz;
  s.cells->read(scan.workpiece, at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(),
                Int4{-1, -1, -1, -1}, scan.cuts);
  s.live = s.cells->live;
  s.share = s.live ? all4(1) : Float4{};
}

// The part of each piece that is covered by what remains under the cut.
void ContactModel::cover(const Scan& scan, const PieceAxes& axes, const Pieces& pieces, int first,
                         KeptCells& farther, Lanes& s) const noexcept {
  const CutOfPieces cut(scan, axes, walls_, pieces, first, s);
  const Int4 may_count = s.live;
  const Float4 surface = cover_here(scan, cut, s), here = s.share;
  if (any(s.live)) cover_ahead(scan, cut, surface, farther, s);
  cover_by_far_walls(scan, cut, may_count, s.share < here, s);
}

// As it is at the surface: a wall that was ground before counts no earlier than it is reached. Returns the cut's
// value in the middle of the pieces, mm.
Float4 ContactModel::cover_here(const Scan& scan, const CutOfPieces& cut, Lanes& s) noexcept {
  FourSamples here = scan.frame.gradients(s.cells->cells.at(s.fx, s.fy, s.fz));
  const Int4 meets = correct_where_it_meets(scan, cut, s, here);
  const Float4 surface = cut.at_surface(here, scan.reach);
  const Float4 along = cut.axes.along(here), around = cut.axes.around(here);
  s.note_crossing(s.live, surface, along, around, cut.rise(here));
  s.cut = cut.borders(surface, here, Float4{}, Float4{});
  s.rise = s.live ? cut.rise(here) : Float4{};
  const Int4 crossed =
      s.live & ~meets & (magnitude(surface) < kMayCross * (magnitude(along) + magnitude(around)));
  if (!cut.straight && any(crossed)) {
    const AtBorder at = look_at_border(scan, cut, s.cut, {scan.frame, s.ix, s.iy, s.iz}, crossed);
    s.cut.replace(crossed,
                  cut.borders(cut.at_surface(at.sample, scan.reach), at.sample, at.x, at.y));
    s.rise = crossed ? cut.rise(at.sample) : s.rise;
  }
  s.cover(s.live, s.cut.part());
  s.share = s.live ? s.share : Float4{};
  s.live = s.share > kLeastShare;
  return surface;
}

// Interpolated, what a bur left lies in front of its place, by half of the second differences times f (1 - f) along each
// axis of the lattice, and has the gradient of the cell's middle. A bur that comes back to it head-on would meet it that
// much too early. Corrects the samples `here` at the surface of the pieces that are about to, and returns these.
Int4 ContactModel::correct_where_it_meets(const Scan& scan, const CutOfPieces& cut, const Lanes& s,
                                          FourSamples& here) noexcept {
  const float square = cut.voxel * cut.voxel, along = magnitude(cut.curvature_along);
  const Float4 around = magnitude(cut.curvature_around), most = 0.125f * square * (along + around),
               larger = square * greatest(all4(along), around);
  const Float4 value = here.value - kTakenBack * scan.reach * cut.rise(here);
  Int4 meets = s.live & (cut.rise(here) < -kMeets) & (magnitude(value) < most);
  if (!any(meets)) return meets;
  const FourPlaces at(s.ix, s.iy, s.iz);
  const Float4 f[3] = {s.fx, s.fy, s.fz};
  const Int4 cell[3] = {at.x + scan.frame.base.x(), at.y + scan.frame.base.y(),
                        at.z + scan.frame.base.z()};
  const FourCells& cells = s.cells->cells;
  Float4 early{}, bends[3];
  for (int axis = 0; axis < 3; ++axis) {
    FourCells before, after;
    const auto beside = [&](int way, FourCells& to) {
      Int4 place[3] = {cell[0], cell[1], cell[2]};
      place[axis] += way;
      to.read(scan.workpiece.cut(), place[0], place[1], place[2], meets);
    };
    beside(-1, before), beside(1, after);
    const int bit = 4 >> axis, next = (axis + 1) % 3, last = (axis + 2) % 3;
    bends[axis] = Float4{};
    for (int k = 0; k < 8; ++k) {
      if (k & bit) continue;
      const Float4 low = cells.corner(k), high = cells.corner(k | bit),
                   at_low = before.corner(k) - 2 * low + high,
                   at_high = low - 2 * high + after.corner(k | bit);
      meets &= (least(at_low, at_high) > -kMostCurved * larger) &
               (greatest(at_low, at_high) < kOtherSide * larger);
      const Float4 by_next = k & (4 >> next) ? f[next] : 1 - f[next],
                   by_last = k & (4 >> last) ? f[last] : 1 - f[last];
      bends[axis] += by_next * by_last * (at_low + f[axis] * (at_high - at_low));
    }
    early -= 0.5f * bends[axis] * f[axis] * (1 - f[axis]);
  }
  // No less than is taken off walls in general (kWall).
  here.value += meets ? greatest(early - cut.wall, Float4{}) : Float4{};
  const float* a = scan.frame.a;
  for (int axis = 0; axis < 3; ++axis) {
    const Float4 turn = meets ? bends[axis] * (f[axis] - 0.5f) : Float4{};
    here.gx += a[3 * axis] * turn, here.gy += a[3 * axis + 1] * turn;
    here.gz += a[3 * axis + 2] * turn;
  }
  return meets;
}

// Where walls meet, the bur's own print and another's or its floor and its side, the field in the middle of a
// piece doesn't tell where their border is. The cut is looked at where it should be; `middle`: of the pieces,
// from the tip's voxel.
ContactModel::AtBorder ContactModel::look_at_border(const Scan& scan, const CutOfPieces& cut,
                                                    const Borders& borders, const Place& middle,
                                                    const Int4& wanted) noexcept {
  const Float4 by_along = borders.along / (cut.half_along * cut.half_along),
               by_around = borders.around / (cut.half_around * cut.half_around);
  const Float4 way =
      -borders.value /
      greatest(borders.along * by_along + borders.around * by_around, all4(kLeastExtent));
  const Float4 x = within(way * by_along, all4(kWithinPiece)),
               y = within(way * by_around, all4(kWithinPiece));
  return look_at(scan, cut, x, y, middle, wanted);
}

// The cut at the places x, y (-1 .. 1) of four pieces; `middle`: theirs, from the tip's voxel.
ContactModel::AtBorder ContactModel::look_at(const Scan& scan, const CutOfPieces& cut,
                                             const Float4& x, const Float4& y, const Place& middle,
                                             const Int4& wanted) noexcept {
  const IndexFrame& f = middle.frame;
  const Displaced d = cut.displaced(x, y);
  const FourPlaces at = middle.beside(d.x, d.y, d.z);
  FourCells cells;
  cells.read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), wanted);
  return {x, y, f.gradients(cells.at(at.fx, at.fy, at.fz))};
}

// The middles of the pieces so far ahead (mm), straight on or along an arc.
ContactModel::Place ContactModel::ahead_of(const Scan& scan, const Lanes& s, const Float4& way,
                                           const AlongWay* arc) noexcept {
  if (!arc) {
    const Float4 far = way - scan.reach;
    return {scan.frame, s.ix + far * s.unit.x(), s.iy + far * s.unit.y(), s.iz + far * s.unit.z()};
  }
  return arc->of(s.ix - s.ahead.x(), s.iy - s.ahead.y(), s.iz - s.ahead.z());
}

// How a place of the surface gets away from the bur's own print on the way: by `advance` of it and `bend` (1/mm) of half its
// square.
ContactModel::FromPrint ContactModel::from_print(const Scan& scan, const CutOfPieces& cut,
                                                 const Lanes& s) noexcept {
  if (!scan.farther) return {greatest(s.advance * cut.per_speed, Float4{}), cut.bend};
  const Float4 pace = cut.per_speed * cut.pace, x = pace * cut.wx, y = pace * cut.wy,
               z = pace * cut.wz;
  const Eigen::Vector3f& t = scan.turning;
  const Float4 towards = cut.nx * (t.y() * z - t.z() * y) + cut.ny * (t.z() * x - t.x() * z) +
                         cut.nz * (t.x() * y - t.y() * x);
  return {greatest(cut.nx * x + cut.ny * y + cut.nz * z, Float4{}),
          greatest(cut.pace * cut.pace * cut.bend + towards, Float4{})};
}

// The same farther ahead; the cells of the samples at the surface stay.
void ContactModel::cover_ahead(const Scan& scan, const CutOfPieces& cut, const Float4& surface,
                               KeptCells& farther, Lanes& s) const noexcept {
  const PieceAxes& axes = cut.axes;
  const float ka = cut.curvature_along, voxel = cut.voxel;
  const Float4& kt = cut.curvature_around;
  const float look_ahead = static_cast<float>(look_ahead_), look = look_ahead - scan.reach;
  const Place middle = ahead_of(scan, s, all4(look_ahead), scan.farther);
  const IndexFrame& f = middle.frame;
  const FourPlaces at(middle.x, middle.y, middle.z);
  farther.read(scan.workpiece, at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), s.live,
               scan.cuts);
  const FourSamples there = f.gradients(farther.cells.at(at.fx, at.fy, at.fz));
  const Float4 value = farther.live ? there.value + cut.stands_out(there) : all4(-1e3f);
  const Float4 rise = cut.rise_on_way(there), back = value - look_ahead * rise;
  const Float4 range_along = axes.along(there), range_around = axes.around(there);
  const Float4 towards_edge = range_along * range_along;
  // What an edge left runs along the motion.
  const Float4 across = kAcross * magnitude(rise);
  const Float4 of_edge = s.at_edge ? greatest(1 - across, Float4{}) * towards_edge /
                                         greatest(towards_edge + range_around * range_around,
                                                  all4(kLeastExtent * kLeastExtent))
                                   : Float4{};
  const Float4 fresh =
      (kFresh * 0.5f * look * look) * from_print(scan, cut, s).bend +
      (s.at_edge ? all4(kFresh * look * cut.per_speed) : Float4{}) * greatest(s.advance, Float4{});
  // Of a flat end only beside the axis, where floor and wall of its slot meet.
  const Float4 beside = kt != 0 ? all4(1) : greatest(1 - kBeside * cut.vl * cut.vl, Float4{});
  const Float4 stands_out =
      kWallAtMost * voxel * voxel * (ka + kt) + kEdgeStandsOut * voxel * of_edge * beside;
  // A ridge between the bur's own print and a wall along the motion is rounded on the lattice; farther ahead that wall
  // stands alone.
  const Float4 slope = there.gx * there.gx + there.gy * there.gy + there.gz * there.gz;
  const Int4 alone = !cut.straight && look > kClearOfPrint * voxel
                         ? (slope > kStandsAlone) & (across < 1) &
                               (magnitude(surface - back) < kRounded * voxel) &
                               (s.share > kLeastBesideRidge)
                         : Int4{};
  Float4 hidden = alone ? back : least(least(value, back), surface);
  if (s.edge != 0) hidden += of_edge * floor_too_high(hidden, -s.edge * range_along, voxel);
  s.note_crossing(s.live, hidden, range_along, range_around, cut.rise(there));
  const Int4 parallel = s.advance < (s.at_edge ? all4(kParallelAtEdge) : all4(kParallel)) * s.speed;
  const Float4 tells = parallel ? greatest(hidden, value + least(fresh, stands_out)) : hidden;
  Borders ahead = cut.borders(tells, there, Float4{}, Float4{});
  Float4 rise_ahead = cut.rise(there);
  const Int4 crossed =
      s.live & farther.live & (value <= least(back, surface)) &
      (magnitude(tells) < kMayCross * (magnitude(range_along) + magnitude(range_around)));
  if (!cut.straight && any(crossed)) {
    const AtBorder found = look_at_border(scan, cut, ahead, middle, crossed);
    ahead.replace(crossed, cut.borders(found.sample.value + cut.wall + (tells - value),
                                       found.sample, found.x, found.y));
    rise_ahead = crossed ? cut.rise(found.sample) : rise_ahead;
  }
  const CoveredPart<Float4> part = ahead.part();
  const Int4 counts = (part.share < s.share) | alone;
  s.cut.replace(counts, ahead);
  s.rise = counts ? rise_ahead : s.rise;
  s.cover(counts, part);
}

// The part of each piece that advances; what doesn't at all is kept for when the motion turns.
void ContactModel::cover_advancing(const Pieces& pieces, int first, Lanes& s) const noexcept {
  const Float4 lx = load4(&pieces.lx[first]), ly = load4(&pieces.ly[first]),
               lz = load4(&pieces.lz[first]), tx = load4(&pieces.tx[first]),
               ty = load4(&pieces.ty[first]);
  const float turn_along = s.curvature_along * pieces.half_along[first];
  const Float4 turn_around = s.curvature_around * load4(&pieces.half_around[first]);
  const Borders border{-s.advance, -turn_along * (s.ux * lx + s.uy * ly + s.uz * lz),
                       -turn_around * (s.ux * tx + s.uy * ty)};
  const CoveredPart<Float4> part = border.part();
  const Int4 partly = (part.share > kLeastShare) & (part.share < 1 - kLeastShare);
  const Int4 crossed = partly & (s.share > kLeastShare) & (s.share < 1 - kLeastShare);
  const Float4 before = s.share;
  s.cover(partly & (s.share >= 1 - kLeastShare), part);
  for (int p = 0; p < kPieces; ++p) {
    if (!crossed[p]) continue;
    // Where the surface turns away from the motion its own print lies behind it: the cut leaves out the same.
    const CoveredPart<float> left = s.also_under(p, border.line(p));
    s.share[p] = left.share, s.x[p] = left.x, s.y[p] = left.y;
  }
  if (s.tissue >= 0) return;
  const Float4 left = s.share / greatest(before, all4(kLeastShare));
  for (auto& of : s.of_tissue) {
    const Int4 less = partly & (s.share < of.share);
    of = {partly ? of.share * left : of.share, less ? s.x : of.x, less ? s.y : of.y};
  }
}

// Leaves out pieces of which the middle of what is covered lies where the bur has been: between the lattice's cuts
// a bur that goes to and fro would grind the same tissue each time, and back through its own slot the lattice is off by
// some thousandths of a voxel.
void ContactModel::leave_out_where_it_was(const Scan& scan, const Pieces& pieces, int first,
                                          Lanes& s) const noexcept {
  const auto at = [first](const std::vector<float>& of, int p) {
    return static_cast<double>(of[static_cast<std::size_t>(first + p)]);
  };
  for (int p = 0; p < kPieces; ++p) {
    if (!(s.share[p] > kLeastShare)) continue;
    const double along = at(pieces.half_along, p) * static_cast<double>(s.x[p]),
                 around = at(pieces.half_around, p) * static_cast<double>(s.y[p]),
                 down = -0.5 * (static_cast<double>(s.curvature_along) * along * along +
                                static_cast<double>(s.curvature_around[p]) * around * around);
    const Vec3 x(at(pieces.x, p) + along * at(pieces.lx, p) + around * at(pieces.tx, p) +
                     down * at(pieces.nx, p),
                 at(pieces.y, p) + along * at(pieces.ly, p) + around * at(pieces.ty, p) +
                     down * at(pieces.ny, p),
                 at(pieces.z, p) + along * at(pieces.lz, p) + down * at(pieces.nz, p));
    const auto was_over = [&](const Been& been) {
      const Vec3 there = been.turn * x + been.way;
      return bur_.distance(there.head<2>().norm(), there.z()) < -kInside;
    };
    if (std::any_of(been_.begin(), been_.end(), was_over) ||
        (scan.retraced && scan.retraced->was_over(bur_, sampled_pose_.to_world(x), kInside)))
      s.share[p] = 0;
  }
}

// The middle of what is covered of each piece, with the mean normal there; and the arm that makes the mean
// torque of it.
ContactSet::FourElements ContactModel::middles(const Pieces& pieces, int first,
                                               const CoveredPart<Float4>& part,
                                               const Lanes& s) noexcept {
  const Float4 nx = load4(&pieces.nx[first]), ny = load4(&pieces.ny[first]),
               nz = load4(&pieces.nz[first]), tx = load4(&pieces.tx[first]),
               ty = load4(&pieces.ty[first]), lx = load4(&pieces.lx[first]),
               ly = load4(&pieces.ly[first]), lz = load4(&pieces.lz[first]);
  const Float4 px = load4(&pieces.x[first]), py = load4(&pieces.y[first]),
               pz = load4(&pieces.z[first]), radius = load4(&pieces.arm[first]);
  const Float4 half_around = load4(&pieces.half_around[first]);
  const Float4 da = pieces.half_along[first] * part.x, dt = half_around * part.y;
  const Float4 turn_l = s.curvature_along * da, turn_t = s.curvature_around * dt;
  const Float4 round = dt / radius / radius, lr = (lx * px + ly * py) / radius;
  ContactSet::FourElements e;
  e.nx = nx + turn_l * lx + turn_t * tx;
  e.ny = ny + turn_l * ly + turn_t * ty;
  e.nz = nz + turn_l * lz;
  e.tx = tx - round * px;
  e.ty = ty - round * py;
  const Float4 x = px + da * lx + dt * tx, y = py + da * ly + dt * ty, z = pz + da * lz;
  e.arm = radius + da * lr;
  // Half the variance of the places around and along the profile, about the middle of the piece.
  const Float4 wide = half_around * (1 - magnitude(part.y)),
               high = pieces.half_along[first] * (1 - magnitude(part.x));
  const Float4 spread_around = 0.5f * (dt * dt + kVariance * wide * wide),
               spread_along = 0.5f * (da * da + kVariance * high * high);
  if (s.curvature_along != 0) {
    const float k = s.curvature_along;
    const Float4 advance = s.ux * e.nx + s.uy * e.ny + s.uz * e.nz,
                 change = k * high * (s.ux * lx + s.uy * ly + s.uz * lz);
    // Both r and v·n grow along the profile, or fall; v·n is nowhere negative in what counts.
    const Float4 together =
        greatest(least(change / greatest(advance, all4(kLeastExtent)), all4(1)), all4(-1));
    e.arm += kVariance * lr * high * together - k * (nx * px + ny * py) / radius * spread_along;
    const Float4 mean = 1 - k * k * spread_along;
    e.nx *= mean, e.ny *= mean, e.nz *= mean;
  }
  const Float4 mean = 1 - spread_around / (radius * radius);
  e.nx *= mean, e.ny *= mean;
  e.mx = y * e.nz - z * e.ny;
  e.my = z * e.nx - x * e.nz;
  e.mz = x * e.ny - y * e.nx;
  e.weight = load4(&pieces.weight[first]);
  return e;
}

}  // namespace toothprep
