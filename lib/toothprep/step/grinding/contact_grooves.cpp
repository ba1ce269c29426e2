// Grooves: where the floor and the wall of an earlier cut meet in a sharp corner, the lattice rounds it, and one
// border doesn't divide a piece in which it lies. Each of the two is looked at beside it, across the motion and far
// enough ahead for the bur's own print to be out of the way; outside of both is tissue.
#include <algorithm>
#include <cmath>

#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/contact_cut.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {
namespace {

// They are looked at so far from a piece's middle (voxels), in this order: far from the corner each stands alone,
// near it they are as they are there.
constexpr float kProbesBeside[] = {2.5f, 2, 1.5f};
// They are two if the cosine between them is below this, and each is as steep as this (squared): the floor of a flat
// end that leans along the motion isn't a distance, since distances are mitred at sharp edges.
constexpr float kTurned = 0.95f, kLeastSlope = 0.4f;
// What the lattice makes of both must be what it has, to so many voxels.
constexpr float kFits = 0.07f;
constexpr float kLeastAside = 0.3f;  // of the profile's direction, across the motion

Float4 dot(const FourSamples& a, const FourSamples& b) {
  return a.gx * b.gx + a.gy * b.gy + a.gz * b.gz;
}

}  // namespace

// The cut at a place beside the middle of each of four pieces.
struct ContactModel::Probe {
  FourSamples in_cells;  // gradients per voxel
  FourSamples sample;    // in B, per mm
  Float4 at_middle;      // mm: the field there, were it linear
  FourCells cells;
  Float4 fx, fy, fz;  // the place in its cell

  // x, y, z: mm, B, from there.
  Probe(const Scan& scan, const Place& middle, const Float4& x, const Float4& y, const Float4& z,
        const Int4& wanted) {
    const IndexFrame& f = middle.frame;
    const FourPlaces at = middle.beside(x, y, z);
    cells.read(scan.workpiece.cut(), at.x + f.base.x(), at.y + f.base.y(), at.z + f.base.z(),
               wanted);
    fx = at.fx, fy = at.fy, fz = at.fz;
    in_cells = cells.at(fx, fy, fz);
    sample = f.gradients(in_cells);
    at_middle = sample.value - (sample.gx * x + sample.gy * y + sample.gz * z);
  }
  // Of what is found, not of the cells.
  void replace(const Int4& where, const Probe& by) {
    in_cells.replace(where, by.in_cells);
    sample.replace(where, by.sample);
    at_middle = where ? by.at_middle : at_middle;
  }
};

// Whether what two probes found are floor and wall of a groove in which the middle lies, or of an edge of tissue: linear,
// they are what the lattice has there.
Int4 ContactModel::meet(const CutOfPieces& cut, const Probe& middle, const Probe& one,
                        const Probe& other, bool in_groove) noexcept {
  const auto stands_alone = [&](const FourSamples& g) {
    return (dot(g, g) > kLeastSlope) & (kAlong * magnitude(cut.rise_on_way(g)) < 1);
  };
  const Int4 two =
      stands_alone(one.sample) & stands_alone(other.sample) &
      (dot(one.sample, other.sample) <
       kTurned * square_root(dot(one.sample, one.sample) * dot(other.sample, other.sample)));
  if (!any(two)) return two;
  Float4 error{};
  for (int k = 0; k < 8; ++k) {
    const Float4 dx = static_cast<float>(k >> 2) - middle.fx,
                 dy = static_cast<float>((k >> 1) & 1) - middle.fy,
                 dz = static_cast<float>(k & 1) - middle.fz;
    const auto of = [&](const Probe& wall) {
      const FourSamples& g = wall.in_cells;
      return wall.at_middle + g.gx * dx + g.gy * dy + g.gz * dz;
    };
    const Float4 both = in_groove ? least(of(one), of(other)) : greatest(of(one), of(other));
    error = greatest(error, magnitude(middle.cells.corner(k) - both));
  }
  return two & (error < kFits * cut.voxel);
}

// Divides pieces in which a groove lies by both of its walls. `far`: their middles, so far ahead that the bur's own
// print is out of the way, in voxels.
Int4 ContactModel::cover_corners(const Scan& scan, const CutOfPieces& cut, const Place& far,
                                 const Int4& wanted, Lanes& s) noexcept {
  const PieceAxes& axes = cut.axes;
  const Probe middle(scan, far, Float4{}, Float4{}, Float4{}, wanted);
  const float rounded = kRounded * cut.voxel;
  const Float4 reach = kMayCross * (magnitude(axes.along(middle.sample)) +
                                    magnitude(axes.around(middle.sample))),
               // From beside a wall the field doesn't tell of a floor at the bur's own edge.
      to_edge = s.at_edge ? all4(cut.half_along) : Float4{};
  // Across the motion: as near to the profile's direction as may be, and beside that.
  const Float4 ux = cut.per_speed * cut.wx, uy = cut.per_speed * cut.wy,
               uz = cut.per_speed * cut.wz;
  Float4 lx = axes.along_x / cut.half_along - cut.vl * ux,
         ly = axes.along_y / cut.half_along - cut.vl * uy,
         lz = axes.along_z / cut.half_along - cut.vl * uz;
  const Float4 length = square_root(lx * lx + ly * ly + lz * lz);
  Int4 left = wanted & (kAlong * magnitude(cut.rise_on_way(middle.sample)) < 1) &
              (magnitude(middle.sample.value) < greatest(reach, to_edge) + rounded) &
              (length > kLeastAside);
  const Float4 per_length = 1 / greatest(length, all4(kLeastAside));
  lx *= per_length, ly *= per_length, lz *= per_length;
  const Float4 dx = ly * uz - lz * uy, dy = lz * ux - lx * uz, dz = lx * uy - ly * ux;

  Int4 found{};
  for (const float voxels : kProbesBeside) {
    if (!any(left)) break;
    // To either side, that first on which the place is deeper in the void.
    struct Sides {
      Probe deeper, other;
    };
    const auto beside = [&](const Float4& x, const Float4& y, const Float4& z) {
      const float way = voxels * cut.voxel;
      Sides sides{Probe(scan, far, way * x, way * y, way * z, left),
                  Probe(scan, far, -way * x, -way * y, -way * z, left)};
      const Int4 turned = sides.other.sample.value > sides.deeper.sample.value;
      const Probe first = sides.deeper;
      sides.deeper.replace(turned, sides.other), sides.other.replace(turned, first);
      return sides;
    };
    const Sides along = beside(lx, ly, lz), across = beside(dx, dy, dz);
    const Int4 groove = left & meet(cut, middle, along.deeper, across.deeper, true),
               edge = left & ~groove & meet(cut, middle, along.other, across.other, false);
    const Int4 both = groove | edge;
    if (!any(both)) continue;
    left &= ~both, found |= both;
    s.groove |= groove;
    s.rise = both ? Float4{} : s.rise;
    for (const Sides* sides : {&along, &across}) {
      Probe wall = sides->deeper;
      wall.replace(edge, sides->other);
      const Float4 out = cut.straight ? cut.stands_out(wall.sample) : cut.swept_wall();
      const Borders border = cut.borders(wall.at_middle + (groove ? cut.swept_wall() : out),
                                         wall.sample, Float4{}, Float4{});
      (sides == &along ? s.cut : s.beside).replace(both, cut.without_thin(border));
    }
    for (int p = 0; p < kPieces; ++p) {
      if (!both[p]) continue;
      const CoveredPart<float> part = s.under_all(p, DividingLine::none());
      s.share[p] = part.share, s.x[p] = part.x, s.y[p] = part.y;
    }
  }
  return found;
}

}  // namespace toothprep
