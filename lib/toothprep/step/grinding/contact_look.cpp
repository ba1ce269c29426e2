// What is found of elements as a whole: four at a time, since many are looked at where a cut was put
// in place, and those beside a wall at nearly every step.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_frame.h"

namespace toothprep {
namespace {

// A field's range over an element is taken this much larger before it counts as engaged as a whole.
constexpr float kSlack = 1.1f;
// Where the cut's range along a straight profile is below this part of the element's half width,
// the element is divided around the axis alone.
constexpr float kAlongWall = 0.1f;
// The tooth's surface crosses an element obliquely if its gradient along the profile lies between these. Strips are as
// long as the element, too long to follow an edge of that surface.
constexpr float kAlongSurface = 0.05f, kAcrossSurface = 0.7f;
// Beyond the rim of what advances less than this (sine) lies the wall ahead, not a floor.
constexpr float kAdvancesLittle = 0.02f;
// The floor at a sharp edge is looked at so far beside it (voxels), if the profile lies across the motion (sine). It is
// one if it is as steep as this (squared), runs along the motion (1 over the sine) and lies that far (voxels) above.
constexpr float kBesideEdge = 2, kAcrossProfile = 0.3f, kSteep = 0.4f, kAlongFloor = 30,
                kThinFloor = 0.02f;
// So far within a cut (voxels) a corner is in the void, and so far outside of it in tissue, whatever the lattice rounds.
constexpr float kCornerInVoid = 0.005f, kCornerInTissue = 0.02f;
// Of what is known of sweeps: outside of these.
constexpr float kCornerLeft = 0.005f;
// The lattice is off by less than this (voxels) from what known sweeps tell.
constexpr float kRoundedOff = 0.3f;
// Another wall than in an element's middle is met at an end whose values differ by more than this (voxels).
constexpr float kAnotherWall = 0.1f;
// What is found stands for this many voxels at most.
constexpr float kMostStanding = 1;
// And for so many voxels at most by how it changes along the motion, rather than by the way alone.
constexpr float kAsideVoxels = 0.1f;

// Half the range of a field over an element whose corner is so far from its middle. Where the field's
// values end, at the border of its band, its gradient tells too little.
Float4 range_in_band(const Float4& value, const Float4& range, float corner,
                     const Workpiece& workpiece) {
  const float band = workpiece.band(), voxel = static_cast<float>(workpiece.voxel());
  const Float4 away = magnitude(value);
  const Int4 at_border = (away > band - 2 * voxel) & (away < band - 0.001f * voxel);
  return at_border ? greatest(range, all4(corner)) : range;
}

// Of the way, until what is a gap (mm) away is met that comes so much nearer per mm of it: a wall along which the bur moves
// comes no nearer, as far as the cell of the lattice goes.
Float4 way_beside(const Float4& gap, const Float4& nears, const Workpiece& workpiece) {
  return least(kStands * (gap + kLeastExtent) / greatest(nears, all4(kLeastExtent)),
               all4(kAsideVoxels * static_cast<float>(workpiece.voxel())));
}

}  // namespace

struct ContactModel::Look {
  const std::int32_t* elements;
  int count;
  Eigen::Vector3f u[kPieces], unit[kPieces],
      ahead[kPieces];             // of the motion: unit, B; voxels per mm;
                                  // voxels
  Float4 unit_x, unit_y, unit_z;  // as unit[]
  Float4 lx, ly, lz, tx, ty, half_along, half_around, corner, sag;  // as of Shape
  Float4 at_x, at_y, at_z;              // of the samples, from the tip's voxel
  Int4 x, y, z;                         // their cells
  Int4 live;                            // within the box, and not in air
  Float4 value, extent, along, around;  // of the cut at the surface, and its half ranges, mm
  Float4 ahead_value;                   // of the cut, not taken back to the surface
  Float4 rate;                          // by which it changes along the motion, per mm
  Int4 remains;                         // -1: not all of it is void
  Float4 clear;                         // mm: the next wall is at least so far away
  Float4 stands;                        // and isn't met on so much of the way, mm
  float left[kPieces];                  // as left_

  // Half the ranges over the elements of a field with gradient g (per mm, B).
  Float4 range_along(const FourSamples& g) const {
    return magnitude(g.gx * lx + g.gy * ly + g.gz * lz) * half_along;
  }
  Float4 range_around(const FourSamples& g) const {
    return magnitude(g.gx * tx + g.gy * ty) * half_around;
  }
  // By how much a field with gradient g (per voxel) changes along the motion, per mm.
  Float4 rate_along(const FourSamples& g) const {
    return g.gx * unit_x + g.gy * unit_y + g.gz * unit_z;
  }
};

// What is found of up to four elements as a whole.
void ContactModel::look(const Scan& scan, const std::int32_t* elements, int count) noexcept {
  const Workpiece& workpiece = scan.workpiece;
  Look s;
  s.elements = elements, s.count = count;
  locate(scan, s);
  const Float4 clear_of = s.extent + s.sag;  // a wall may bend towards the element's corners
  const Float4 gap = s.value - clear_of,
               left = greatest(kStands * gap, way_beside(gap, magnitude(s.rate), workpiece));
  s.remains = s.live & (s.value < clear_of);
  for (int p = 0; p < count; ++p)
    if (s.live[p] && !s.remains[p] && (floor_at_edge(scan, p, s) || corner_in_tissue(scan, p, s)))
      s.remains[p] = -1;
  // What known parts of the way tell of an element's pieces stands, if these are the same.
  struct Earlier {
    bool by_sweeps, inside_tooth, strips;
    std::uint8_t only;
    double settled, moves, cut_moves;
  } earlier[kPieces];
  for (int p = 0; p < count; ++p) {
    const std::int32_t i = elements[p];
    const Standing& was = standing_[i];
    earlier[p] = {found_[i] == Found::kCrossed && was.by_sweeps,
                  was.inside_tooth,
                  was.strips,
                  was.only,
                  settled_[i],
                  moves_[i],
                  cut_moves_[i]};
    settled_[i] = moves_[i] = cut_moves_[i] = -1;
    slack_[i] = kStands * (1 - 1 / kSlack) * s.extent[p];
    found_[i] = Found::kVoid;
    left_[i] = s.live[p] ? left[p] : kStands * workpiece.band();
    // What it says of the pieces is read only once they are looked at.
    Standing& standing = standing_[i];
    standing.inside_tooth = standing.strips = standing.oblique = false;
    standing.only = 0;
    standing.share = 0;
    looked_x_[i] = s.u[p].x(), looked_y_[i] = s.u[p].y(), looked_z_[i] = s.u[p].z();
  }
  if (!any(s.remains)) return;
  for (int p = 0; p < count; ++p)
    if (s.remains[p]) look_for_tissue(scan, p, s);
  // A distance changes by no more than the way: where the nearest wall is farther than a corner
  // there is none. Else the bur's own last cut may hide one, which it doesn't farther ahead.
  s.clear = -s.value - s.corner;
  look_farther(scan, s);
  for (int p = 0; p < count; ++p) {
    if (!s.remains[p]) continue;
    note_found(scan, p, s);
    const std::int32_t i = elements[p];
    const Standing& is = standing_[i];
    const Earlier& was = earlier[p];
    if (was.by_sweeps && found_[i] == Found::kCrossed && is.strips == was.strips &&
        is.only == was.only && is.inside_tooth == was.inside_tooth)
      settled_[i] = was.settled, moves_[i] = was.moves, cut_moves_[i] = was.cut_moves;
  }
}

// Where the elements are, and the cut there.
void ContactModel::locate(const Scan& scan, Look& s) noexcept {
  const IndexFrame& f = scan.frame;
  const float* a = f.a;
  const auto row = [&](int p) { return &shapes_[s.elements[std::min(p, s.count - 1)]].x; };
  Float4 x = load4(row(0)), y = load4(row(1)), z = load4(row(2));
  s.sag = load4(row(3));
  transpose(x, y, z, s.sag);
  s.lx = load4(row(0) + 4), s.ly = load4(row(1) + 4), s.lz = load4(row(2) + 4);
  s.half_along = load4(row(3) + 4);
  transpose(s.lx, s.ly, s.lz, s.half_along);
  s.tx = load4(row(0) + 8), s.ty = load4(row(1) + 8), s.half_around = load4(row(2) + 8);
  s.corner = load4(row(3) + 8);
  transpose(s.tx, s.ty, s.half_around, s.corner);

  Float4 ahead_x, ahead_y, ahead_z;
  for (int p = 0; p < kPieces; ++p) {
    if (p == 0 || scan.turns) {
      Eigen::Vector3f u = scan.velocity_at(x[p], y[p], z[p]);
      const float speed = u.norm();
      u = speed > 0 ? Eigen::Vector3f(u / speed) : Eigen::Vector3f(Eigen::Vector3f::Zero());
      s.u[p] = u;
      s.unit[p] = f.turned(u.x(), u.y(), u.z());
      s.ahead[p] = scan.reach * s.unit[p];
    } else {
      s.u[p] = s.u[0], s.unit[p] = s.unit[0], s.ahead[p] = s.ahead[0];
    }
    s.unit_x[p] = s.unit[p].x(), s.unit_y[p] = s.unit[p].y(), s.unit_z[p] = s.unit[p].z();
    ahead_x[p] = s.ahead[p].x(), ahead_y[p] = s.ahead[p].y(), ahead_z[p] = s.ahead[p].z();
  }
  s.at_x = f.fx + (a[0] * x + a[1] * y + a[2] * z) + ahead_x;
  s.at_y = f.fy + (a[3] * x + a[4] * y + a[5] * z) + ahead_y;
  s.at_z = f.fz + (a[6] * x + a[7] * y + a[8] * z) + ahead_z;
  const FourPlaces at(s.at_x, s.at_y, s.at_z);
  s.x = at.x + f.base.x(), s.y = at.y + f.base.y(), s.z = at.z + f.base.z();
  const float* corners[kPieces];
  for (int p = 0; p < kPieces; ++p) {
    KeptCell& cell = cells_[s.elements[std::min(p, s.count - 1)]];
    cell.read(scan.workpiece, Int4{s.x[p], s.y[p], s.z[p], 0}, scan.cuts);
    s.live[p] = cell.brick >= 0 ? -1 : 0;
    corners[p] = cell.corners;
  }
  FourCells cells;
  cells.set(load4(corners[0]), load4(corners[1]), load4(corners[2]), load4(corners[3]),
            load4(corners[0] + 4), load4(corners[1] + 4), load4(corners[2] + 4),
            load4(corners[3] + 4));
  const FourSamples cut = cells.at(at.fx, at.fy, at.fz);
  s.ahead_value = cut.value;
  s.value = cut.value - cut.gx * (kTakenBack * ahead_x) - cut.gy * (kTakenBack * ahead_y) -
            cut.gz * (kTakenBack * ahead_z);
  s.rate = s.rate_along(cut);
  const FourSamples in_bur = f.gradients(cut);
  s.along = s.range_along(in_bur), s.around = s.range_around(in_bur);
  s.extent = kSlack * (s.along + s.around);
}

// Whether one that lies at a sharp edge meets a floor there that its middle, nearer to a wall, doesn't tell.
bool ContactModel::floor_at_edge(const Scan& scan, int p, const Look& s) const noexcept {
  const int i = s.elements[p];
  if (edge_[i] == 0 || !(s.value[p] < s.corner[p])) return false;
  const SurfaceElements& e = elements_;
  const Eigen::Vector3f n(e.nx[i], e.ny[i], e.nz[i]);
  if (n.dot(s.u[p]) < kAdvancesLittle) return false;
  const float way = edge_[i] * e.half_along[i];
  const Eigen::Vector3f end = Eigen::Vector3f(s.at_x[p], s.at_y[p], s.at_z[p]) +
                              scan.frame.turned(way * e.lx[i], way * e.ly[i], way * e.lz[i]);
  const LevelSet& cut = scan.workpiece.cut();
  const auto voxel = static_cast<float>(scan.workpiece.voxel());
  if (field_at(cut, scan.frame.base, end).value < -kRounded * voxel) return true;
  // The wall rounds the floor. Beside it, across the motion and clear of the bur's own print, the floor stands alone.
  const float ahead = scan.known_way(end - s.ahead[p], s.unit[p], scan.straight),
              far = ahead - scan.reach;
  const Eigen::Vector3f profile = scan.frame.turned(e.lx[i], e.ly[i], e.lz[i]),
                        across = s.unit[p].cross(profile);
  if (!(far > 0) || !(across.norm() > kAcrossProfile * s.unit[p].norm() * profile.norm()))
    return false;
  std::optional<AlongWay> arc;
  if (scan.farther) arc.emplace(scan, ahead);
  for (const float voxels : {-kBesideEdge, kBesideEdge}) {
    const Eigen::Vector3f aside = voxels * across.normalized();
    const FieldSample floor = field_at(cut, scan.frame.base,
                                       arc ? arc->of(Eigen::Vector3f(end - s.ahead[p] + aside))
                                           : Eigen::Vector3f(end + far * s.unit[p] + aside));
    Eigen::Vector3f g(floor.gx, floor.gy, floor.gz);
    if (arc) g = arc->turn.transpose() * g;
    const float rise = g.dot(s.unit[p].normalized());
    if (g.squaredNorm() > kSteep * voxel * voxel && kAlongFloor * std::abs(rise) < voxel &&
        floor.value - g.dot(aside) < -kThinFloor * voxel)
      return true;
  }
  return false;
}

// The tissue of one of them.
void ContactModel::look_for_tissue(const Scan& scan, int p, Look& s) noexcept {
  const int i = s.elements[p];
  Standing& standing = standing_[i];
  const float left =
      look_for_tissue(scan, i, Index3(s.x[p], s.y[p], s.z[p]),
                      Eigen::Vector3f(s.at_x[p], s.at_y[p], s.at_z[p]), s.ahead[p], standing);
  s.left[p] = left;
  if (left >= 0) return;  // else in air
  left_[i] = -left, slack_[i] = 0;
  s.remains[p] = 0;
}

// The next wall of those in which the bur's own last cut may hide one.
void ContactModel::look_farther(const Scan& scan, Look& s) noexcept {
  s.stands = kStands * s.clear;
  const Int4 hidden = s.remains & (s.value <= -s.extent) & (s.clear < 0);
  if (!any(hidden)) return;
  const float farther = static_cast<float>(look_ahead_) - scan.reach, reach = scan.reach;
  const Place place = scan.farther
                          ? scan.farther->of(s.at_x - reach * s.unit_x, s.at_y - reach * s.unit_y,
                                             s.at_z - reach * s.unit_z)
                          : Place{scan.frame, s.at_x + farther * s.unit_x,
                                  s.at_y + farther * s.unit_y, s.at_z + farther * s.unit_z};
  const IndexFrame& f = place.frame;
  const FourPlaces at(place.x, place.y, place.z);
  FourCells cells;
  cells.read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(), hidden);
  const FourSamples sample = cells.at(at.fx, at.fy, at.fz), cut = f.gradients(sample);
  const Float4 here = -s.extent - s.value,
               there = -cut.value - kSlack * (s.range_along(cut) + s.range_around(cut));
  s.clear = hidden ? least(here, there) : s.clear;
  const Float4 beside = least(way_beside(here, s.rate, scan.workpiece),
                              way_beside(there, s.rate_along(sample), scan.workpiece));
  s.stands = hidden ? greatest(kStands * s.clear, beside) : s.stands;
}

// The samples at the corners of one of them.
ContactModel::Place ContactModel::corners(const Scan& scan, int p, const Look& s) const noexcept {
  const IndexFrame& f = scan.frame;
  const int i = s.elements[p];
  const SurfaceElements& e = elements_;
  const Eigen::Vector3f along = e.half_along[i] * f.turned(e.lx[i], e.ly[i], e.lz[i]),
                        around = e.half_around[i] * f.turned(e.tx[i], e.ty[i], 0),
                        down = s.sag[p] * f.turned(e.nx[i], e.ny[i], e.nz[i]);
  // Farther from the axis it is wider.
  const float wider =
      e.half_along[i] * (e.lx[i] * e.x[i] + e.ly[i] * e.y[i]) / (e.radius[i] * e.radius[i]);
  const Float4 up{1, 1, -1, -1}, aside = Float4{1, -1, 1, -1} * (1 + wider * up);
  return {f, s.at_x[p] - down.x() + up * along.x() + aside * around.x(),
          s.at_y[p] - down.y() + up * along.y() + aside * around.y(),
          s.at_z[p] - down.z() + up * along.z() + aside * around.z()};
}

// A field there, mm.
Float4 ContactModel::at_corners(const Scan& scan, const LevelSet& field, int p,
                                const Look& s) const noexcept {
  const Place there = corners(scan, p, s);
  const FourPlaces at(there.x, there.y, there.z);
  const Index3& base = scan.frame.base;
  FourCells cells;
  cells.read(field, at.x + base.x(), at.y + base.y(), at.z + base.z(), Int4{-1, -1, -1, -1});
  return cells.at(at.fx, at.fy, at.fz).value;
}

// What known sweeps make of places of one of them, as taken_by_sweeps().
Float4 ContactModel::taken_from(const Scan& scan, int p, const Look& s, const Place& at) noexcept {
  const Eigen::Vector3f& ahead = s.ahead[p];
  return taken_by_sweeps(scan, s.elements[p],
                         {scan.frame, at.x - ahead.x(), at.y - ahead.y(), at.z - ahead.z()});
}

// Whether a corner of one of them lies in a cut that its middle doesn't tell of: there the bur's own print is nearer.
bool ContactModel::corner_in_void(const Scan& scan, int p, const Look& s) noexcept {
  const float least_value = kCornerInVoid * static_cast<float>(scan.workpiece.voxel());
  if (!(-s.value[p] < s.corner[p])) return false;
  const Float4 values = at_corners(scan, scan.workpiece.cut(), p, s);
  const float rounded = kRoundedOff * static_cast<float>(scan.workpiece.voxel());
  return any(values > least_value) ||
         (scan.knows_parts() && any(values > -rounded) &&
          any(taken_from(scan, p, s, corners(scan, p, s)) > least_value));
}

// Whether a corner of one of them lies in tissue that its middle doesn't tell of: over an earlier slot's floor that is
// nearer than the wall beside it. Of corners at the bur's own edges floor_at_edge() tells, or known sweeps which took the
// middle.
bool ContactModel::corner_in_tissue(const Scan& scan, int p, const Look& s) noexcept {
  const int i = s.elements[p];
  const SurfaceElements& e = elements_;
  const float voxel = static_cast<float>(scan.workpiece.voxel());
  if (!(s.value[p] < s.corner[p] &&
        Eigen::Vector3f(e.nx[i], e.ny[i], e.nz[i]).dot(s.u[p]) > kAdvancesLittle))
    return false;
  const std::int32_t upper = edge_[i] > 0 ? 0 : -1, lower = edge_[i] < 0 ? 0 : -1;
  const Float4 values = at_corners(scan, scan.workpiece.cut(), p, s);
  const Int4 in_tissue = values < -kCornerInTissue * voxel;
  if (any(Int4{upper, upper, lower, lower} & in_tissue)) return true;
  const Place middle{scan.frame, all4(s.at_x[p]), all4(s.at_y[p]), all4(s.at_z[p])};
  return scan.knows_parts() && any(values < kRoundedOff * voxel) &&
         taken_from(scan, p, s, middle)[0] > 0 &&
         any(taken_from(scan, p, s, corners(scan, p, s)) < -kCornerLeft * voxel);
}

// Whether another wall than in the middle of one of them is met at its upper or lower end: the floor of an earlier layer.
// That at the bur's own edge floor_at_edge() tells.
bool ContactModel::ends_differ(const Scan& scan, int p, const Look& s) const noexcept {
  const Float4 corners = at_corners(scan, scan.workpiece.cut(), p, s);
  const float slack =
      s.along[p] + s.sag[p] + kAnotherWall * static_cast<float>(scan.workpiece.voxel());
  const auto differs = [&](int a, int b) {
    return std::abs(0.5f * (corners[a] + corners[b]) - s.ahead_value[p]) > slack;
  };
  const float edge = edge_[s.elements[p]];
  return (!(edge > 0) && differs(0, 1)) || (!(edge < 0) && differs(2, 3));
}

// Whether the tooth's surface has an edge in one of them: it isn't level between two of its corners and the others.
bool ContactModel::has_edge_of_tooth(const Scan& scan, int p, const Look& s) const noexcept {
  if (standing_[s.elements[p]].inside_tooth) return false;
  const LevelSet& solid = scan.workpiece.solid();
  const Float4 corners = at_corners(scan, solid, p, s);
  const float middle =
                  field_at(solid, scan.frame.base, Eigen::Vector3f(s.at_x[p], s.at_y[p], s.at_z[p]))
                      .value,
              mean = 0.25f * (corners[0] + corners[1] + corners[2] + corners[3]);
  return std::abs(mean - middle) > kAnotherWall * static_cast<float>(scan.workpiece.voxel());
}

void ContactModel::note_found(const Scan& scan, int p, const Look& s) noexcept {
  const int i = s.elements[p];
  const auto voxel = static_cast<float>(scan.workpiece.voxel());
  const float value = s.value[p], extent = s.extent[p], clear = s.clear[p];
  Standing& standing = standing_[i];
  left_[i] = std::min(s.left[p], kMostStanding * voxel);
  const bool in_one_tissue = standing.inside_tooth && standing.only != 0;
  const float wall_stands_out =
      kWallAtMost * voxel * voxel * (elements_.curvature_along[i] + elements_.curvature_around[i]);
  if (in_one_tissue && value <= -extent - wall_stands_out && clear >= 0 &&
      !corner_in_void(scan, p, s)) {
    found_[i] = Found::kInside;
    left_[i] = std::min(left_[i], s.stands[p]);
    return;
  }
  found_[i] = Found::kCrossed;
  standing.share = share_inside(value, extent);
  // A strip is as long as the element: what crosses it of the tooth's surface and its tissues must be known as far.
  const bool known = in_one_tissue || elements_.half_along[i] + voxel < scan.workpiece.band();
  standing.strips = (clear < 0 || !standing.oblique) && elements_.curvature_along[i] == 0 &&
                    known && s.along[p] < kAlongWall * elements_.half_around[i] &&
                    !floor_at_edge(scan, p, s) && !ends_differ(scan, p, s) &&
                    !has_edge_of_tooth(scan, p, s);
}

// Whether element i lies in the tooth as a whole, and in which tissue. Returns how far that stands,
// mm; negative where all of it lies in air.
float ContactModel::look_for_tissue(const Scan& scan, int i, const Index3& cell,
                                    const Eigen::Vector3f& at, const Eigen::Vector3f& ahead,
                                    Standing& s) noexcept {
  const SurfaceElements& e = elements_;
  const Workpiece& workpiece = scan.workpiece;
  const IndexFrame& f = scan.frame;
  float left = kMostStanding * static_cast<float>(workpiece.voxel());
  const float sag = shapes_[i].sag;
  // A brick's flags are those of all cells that start in it or in its upper neighbours: taken a
  // voxel beyond the element's lower corner they hold for all of it.
  const auto margin = 1 + static_cast<int>(std::ceil(std::max(e.half_along[i], e.half_around[i]) /
                                                     static_cast<float>(workpiece.voxel())));
  const std::int64_t lower =
      workpiece.cut().brick_index(cell.x() - margin, cell.y() - margin, cell.z() - margin);
  const auto brick = static_cast<std::size_t>(lower);
  s.only = lower < 0 ? 0 : workpiece.only_tissue(brick);
  s.inside_tooth = lower >= 0 && workpiece.deep(brick);
  if (s.inside_tooth && s.only != 0) return left;
  KeptFields& fields = fields_[i];
  fields.read(workpiece, Int4{cell.x(), cell.y(), cell.z(), 0});
  const FourSamples found = fields.cells.at(all4(at.x() - static_cast<float>(cell_of(at.x()))),
                                            all4(at.y() - static_cast<float>(cell_of(at.y()))),
                                            all4(at.z() - static_cast<float>(cell_of(at.z()))));
  const FourSamples g = f.gradients(found);
  const Float4 value = at_surface4(found, ahead);
  const Float4 along = magnitude(g.gx * e.lx[i] + g.gy * e.ly[i] + g.gz * e.lz[i]),
               around = magnitude(g.gx * e.tx[i] + g.gy * e.ty[i]);
  const Float4 range = kSlack * (along * e.half_along[i] + around * e.half_around[i]);
  const Float4 extent = range_in_band(value, range, shapes_[i].corner, workpiece) + sag;
  s.oblique = !s.inside_tooth && along[0] > kAlongSurface && along[0] < kAcrossSurface;
  if (!s.inside_tooth) {
    if (value[0] >= extent[0]) return -std::max(kStands * (value[0] - extent[0]), kLeastExtent);
    s.inside_tooth = value[0] <= -extent[0];
    left = std::min(left, kStands * std::abs(value[0] + extent[0]));
  }
  for (int k = 0; s.only == 0 && k < KeptTissues::kFields; ++k) {
    if (value[k + 1] > -extent[k + 1]) continue;
    s.only = static_cast<std::uint8_t>(k + 1);
    left = std::min(left, kStands * (-extent[k + 1] - value[k + 1]));
  }
  return left;
}

}  // namespace toothprep
