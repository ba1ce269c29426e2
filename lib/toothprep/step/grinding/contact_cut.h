// The cut against four pieces of an element: what contact_pieces.cpp and contact_walls.cpp share. Internal to
// contact*.cpp.
#pragma once

#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/wall_curvature.h"

namespace toothprep {

// Interpolated on the lattice, the wall that a convex bur left stands out by D²/12 times its
// curvature on average. A swept wall is curved across the sweep only, and where two cuts meet the
// interpolant errs to the other side: a third of the sum of the bur's curvatures is least biased.
constexpr float kWall = 1.0f / 36;
// A wall is along the motion where the sine of the angle between them is below 1 over this.
constexpr float kAcross = 10;
// And so much along it where the sine is below 1 over this that it may be looked for farther ahead: where a cavity's
// wall bends, nearer ones are seen.
constexpr float kAlong = 30;
constexpr float kFlat = 1e-3f;  // 1/mm; keeps a division defined
// A border may cross a piece where the field in its middle is this many times its half range from zero.
constexpr float kMayCross = 1.5f;

// A wall crosses the surface at more than this angle (sine squared), else it may be what the bur left here itself.
constexpr float kCrosses = 0.1f;
constexpr float kWithinPiece = 0.8f;  // of half its extents: at its rim lie other walls as well

// Of walls that stand alone a chip thinner than this (voxels) may be none.
constexpr float kThinChip = 0.02f;
// By how much (mm) a wall must stand out that makes a chip as thick as this (mm): one thinner than `most` may be
// none, and from twice as much on it counts as a whole, so that a chip isn't made thinner.
inline Float4 doubt_of_thin(const Float4& thick, float most) {
  return greatest(least(2 * most - thick, all4(most)), Float4{});
}

// A field as steep as this (squared, 1 being a distance) is that of one wall; as near to that, where its curvature is
// known.
constexpr float kOneWall = 0.8f, kOneKnownWall = 0.03f;

// A wall of an earlier cut, looked at beside the middle of each of four pieces.
struct ContactModel::Wall {
  FourSamples sample;  // gradient in B, per mm
  Float4 x, y, z;      // mm, B, from the middle
  void replace(const Int4& where, const Wall& by) {
    sample.replace(where, by.sample);
    x = where ? by.x : x, y = where ? by.y : y, z = where ? by.z : z;
  }
};

// From the middles of four pieces, mm, B.
struct ContactModel::Displaced {
  Float4 x, y, z;
};

// Four pieces of an element against the cut: where its field, by what is found of it, divides them.
struct ContactModel::CutOfPieces {
  const PieceAxes& axes;
  const WallCurvature& walls;  // that the bur leaves
  float half_along;            // of the pieces, mm
  Float4 half_around;
  float curvature_along;
  Float4 curvature_around;
  float voxel;      // mm
  Float4 wall;      // mm; by how much a wall stands out
  float per_speed;  // s/mm
  bool flat;        // as a flat end is
  bool straight;    // as a side is: what that leaves is plane, and its own print is swept as it is
  Float4 nx, ny, nz;  // normal, B
  Float4 ux, uy, uz;  // velocity, mm/s, B
  Float4 wx, wy, wz;  // as long, along earlier walls: on an arc about its centre
  Float4 pace;        // way along them per way of the tip
  Eigen::Vector3f turning = Eigen::Vector3f::Zero();  // as of Scan
  Float4 vl, vt;  // its direction's parts along the profile and around the axis
  Float4 bend;    // 1/mm, of the surface along the motion, where it is convex

  CutOfPieces(const Scan& scan, const PieceAxes& piece_axes, const WallCurvature& wall_curvature,
              const Pieces& pieces, int first, const Lanes& s)
      : axes(piece_axes),
        walls(wall_curvature),
        half_along(pieces.half_along[first]),
        half_around(load4(&pieces.half_around[first])),
        curvature_along(s.curvature_along),
        curvature_around(s.curvature_around),
        voxel(static_cast<float>(scan.workpiece.voxel())),
        wall(kWall * voxel * voxel * (curvature_along + curvature_around)),
        per_speed(s.speed > 0 ? 1 / s.speed : 0),
        flat(curvature_along == 0 && !any(curvature_around != 0)),
        straight(curvature_along == 0 && !flat),
        nx(load4(&pieces.nx[first])),
        ny(load4(&pieces.ny[first])),
        nz(load4(&pieces.nz[first])),
        ux(s.ux),
        uy(s.uy),
        uz(s.uz),
        wx(ux),
        wy(uy),
        wz(uz),
        pace(all4(1)),
        vl((ux * axes.along_x + uy * axes.along_y + uz * axes.along_z) * (per_speed / half_along)),
        vt((ux * axes.around_x + uy * axes.around_y) * (per_speed / half_around)),
        bend(greatest(curvature_along * vl * vl + curvature_around * vt * vt, Float4{})) {
    if (!scan.farther) return;
    const Float4 x = load4(&pieces.x[first]), y = load4(&pieces.y[first]),
                 z = load4(&pieces.z[first]);
    turning = scan.turning;
    wx = scan.tangent.x() + turning.y() * z - turning.z() * y;
    wy = scan.tangent.y() + turning.z() * x - turning.x() * z;
    wz = scan.tangent.z() + turning.x() * y - turning.y() * x;
    pace = greatest(square_root(wx * wx + wy * wy + wz * wz), all4(kLeastExtent));
    const Float4 speed = s.speed / pace;
    wx *= speed, wy *= speed, wz *= speed;
  }

  // To places x, y (-1 .. 1) on the pieces.
  Displaced displaced(const Float4& x, const Float4& y) const {
    const PieceAxes& a = axes;
    const Float4 xx = x * x, yy = y * y, wide = y * (1 + a.widening * x);
    return {a.along_x * x + a.around_x * wide + a.bent_along_x * xx + a.bent_around_x * yy,
            a.along_y * x + a.around_y * wide + a.bent_along_y * xx + a.bent_around_y * yy,
            a.along_z * x + a.bent_along_z * xx};
  }
  // To places on the surface, x along the profile and y around the axis (mm).
  Displaced on_surface(const Float4& x, const Float4& y) const {
    const Float4 by_along = x / half_along, by_around = y / half_around,
                 down = -0.5f * (curvature_along * x * x + curvature_around * y * y);
    return {axes.along_x * by_along + axes.around_x * by_around + down * nx,
            axes.along_y * by_along + axes.around_y * by_around + down * ny,
            axes.along_z * by_along + down * nz};
  }
  // Of a field with gradient g (B, per mm), its change along the motion.
  Float4 rise(const FourSamples& g) const {
    return per_speed * (g.gx * ux + g.gy * uy + g.gz * uz);
  }
  // The same along walls.
  Float4 rise_on_way(const FourSamples& g) const {
    return per_speed * (g.gx * wx + g.gy * wy + g.gz * wz);
  }
  // Across walls' direction and a field's gradient, in B; as long as the gradient's part across the motion.
  struct Across {
    Float4 x, y, z;
  };
  Across across(const FourSamples& g) const {
    return {per_speed * (g.gy * wz - g.gz * wy), per_speed * (g.gz * wx - g.gx * wz),
            per_speed * (g.gx * wy - g.gy * wx)};
  }
  // Whether the curvature of the wall is known that has this field: else it is taken to be the bur's here.
  Int4 knows(const FourSamples& g) const { return walls.know(-g.gz); }
  // What the arc that left it needs to know: its normal is a unit vector even where the lattice's gradient isn't.
  SweptArc::Known known(const FourSamples& g, const Across& w) const {
    const Float4 per_length =
        1 / greatest(square_root(g.gx * g.gx + g.gy * g.gy + g.gz * g.gz), all4(kFlat));
    return {g.value, -per_length * g.gz, per_length * w.z, per_speed * wz};
  }
  // The wall's curvature (1/mm) in that direction; 0 where it isn't known.
  Float4 known_curvature(const FourSamples& g, const Across& w) const {
    const Int4 is_known = knows(g);
    if (!any(is_known)) return Float4{};
    const SweptArc::Known k = known(g, w);
    return is_known ? walls.arc(k.normal).curvature(k) : Float4{};
  }
  // The bur's own curvature there, if it may have left a wall that isn't plane.
  Float4 curvature_here(const Across& w) const {
    const Float4 l = (axes.along_x * w.x + axes.along_y * w.y + axes.along_z * w.z) / half_along,
                 t = (axes.around_x * w.x + axes.around_y * w.y) / half_around, ll = l * l,
                 tt = t * t;
    return straight
               ? Float4{}
               : (curvature_along * ll + curvature_around * tt) / greatest(ll + tt, all4(kFlat));
  }
  // Of a wall along an arc, about whose centre it is round: its curvature that way, 1/mm, positive where it is concave.
  Float4 curvature_on_way(const FourSamples& g) const {
    const Float4 x = per_speed * wx, y = per_speed * wy, z = per_speed * wz;
    return (g.gx * (turning.y() * z - turning.z() * y) +
            g.gy * (turning.z() * x - turning.x() * z) +
            g.gz * (turning.x() * y - turning.y() * x)) /
           pace;
  }
  // By how much a wall with this field stands out: of straight sides only one that they may have left.
  Float4 stands_out(const FourSamples& g) const {
    return straight ? wall * (g.gx * g.gx + g.gy * g.gy) : wall;
  }
  // By how much a wall stands out on the lattice that the surface leaves when it is swept along itself: that has no
  // curvature that way, and all of the surface's Gaussian one.
  Float4 swept_wall() const {
    const Float4 of_motion = bend / greatest(vl * vl + vt * vt, all4(kLeastExtent)),
                 gaussian = curvature_along * curvature_around;
    return greatest(kWallAtMost * voxel * voxel * gaussian / greatest(of_motion, all4(kFlat)),
                    wall);
  }
  // A wall as it is where the lattice has the sample g: a concave one stands out between the lattice's points, and a
  // cell's gradient is that in its middle.
  FourSamples wall_at(const IndexFrame& frame, const FourPlaces& at, const FourSamples& g) const {
    FourSamples found = g;
    const Int4 known = knows(g);
    const Across w = across(g);
    const Float4 by_voxel = known_curvature(g, w) * voxel;
    const bool on_arc = !turning.isZero();
    const Float4 on_way = on_arc ? voxel * curvature_on_way(g) : Float4{};
    const Float4 in_cell[3] = {at.fx, at.fy, at.fz};
    for (int i = 0; i < 3; ++i) {
      const float x = frame.a[3 * i] * voxel, y = frame.a[3 * i + 1] * voxel,
                  z = frame.a[3 * i + 2] * voxel;
      const Float4 part = x * w.x + y * w.y + z * w.z;
      Float4 bends = by_voxel * part * part;
      if (on_arc) {
        const Float4 along = per_speed * (x * wx + y * wy + z * wz);
        bends += on_way * along * along;
      }
      const Float4 turn = bends * (0.5f - in_cell[i]);
      found.gx += turn * x, found.gy += turn * y, found.gz += turn * z;
      found.value += 0.5f * voxel * bends * in_cell[i] * (1 - in_cell[i]);
    }
    found.value += known ? Float4{} : straight ? stands_out(g) : swept_wall();
    return found;
  }
  // A wall's field at a place beside the middle (mm, B): by its arc, or as if it were a circle.
  FourSamples field(const Wall& by, const Float4& x, const Float4& y, const Float4& z) const {
    FourSamples g = by.sample;
    const Float4 dx = x - by.x, dy = y - by.y, dz = z - by.z;
    const Across w = across(g);
    const Int4 is_known = knows(g);
    const SweptArc::Known k = known(g, w);
    const SweptArc of = walls.arc(k.normal);
    const SweptArc arc{
        is_known ? of.centre : Float4{},
        is_known ? of.radius : g.value + 1 / greatest(curvature_here(w), all4(kFlat))};
    const SweptArc::Tangent there =
        arc.at(k, -(g.gx * dx + g.gy * dy + g.gz * dz), w.x * dx + w.y * dy + w.z * dz);
    g.value = there.value;
    g.gx = there.cosine * g.gx - there.sine * w.x;
    g.gy = there.cosine * g.gy - there.sine * w.y;
    g.gz = there.cosine * g.gz - there.sine * w.z;
    return g;
  }
  // What it is at most where another wall is: where its curvature isn't known, as if it were flat, since all that a
  // bur leaves are concave.
  Float4 at_most(const Wall& by, const Wall& other) const {
    const FourSamples& g = by.sample;
    const Float4 by_plane =
        g.value + g.gx * (other.x - by.x) + g.gy * (other.y - by.y) + g.gz * (other.z - by.z);
    return knows(g) ? field(by, other.x, other.y, other.z).value : by_plane;
  }
  // Whether that is one wall, along the motion.
  Int4 is_one_wall(const FourSamples& g) const {
    const Float4 square = g.gx * g.gx + g.gy * g.gy + g.gz * g.gz;
    const Int4 one = knows(g) ? magnitude(square - 1) < kOneKnownWall : square > kOneWall;
    return one & (kAlong * magnitude(rise_on_way(g)) < 1);
  }
  // Its borders, by what it is in the middle of the pieces.
  Borders borders(const Wall& by) const {
    const FourSamples g = field(by, Float4{}, Float4{}, Float4{});
    return borders(g.value, g, Float4{}, Float4{});
  }
  // Of a border, how much the field changes over 1 mm across it on the surface, squared; and whether that is so much that
  // its wall crosses the surface.
  Float4 slope_squared(const Borders& border) const {
    const Float4 along = border.along / half_along, around = border.around / half_around;
    return along * along + around * around;
  }
  Int4 crosses(const Borders& border) const { return slope_squared(border) > kCrosses; }
  // The border of a wall that stands alone, so that what may be no chip is none.
  Borders without_thin(Borders border) const {
    const Float4 thick = magnitude(border.along) + magnitude(border.around) - border.value;
    border.value += doubt_of_thin(thick, kThinChip * voxel);
    return border;
  }
  // Its value at the surface from the sample ahead of it: a wall that was ground before counts no earlier
  // than it is reached.
  Float4 at_surface(const FourSamples& found, float reach) const {
    return found.value + stands_out(found) - kTakenBack * reach * rise(found);
  }
  // Its borders by its value (mm) at the places x, y (-1 .. 1). A wall that was swept along the motion is curved
  // across it, as the bur is.
  Borders borders(const Float4& value, const FourSamples& g, const Float4& x,
                  const Float4& y) const {
    const Across w = across(g);
    const Float4 l = axes.along_x * w.x + axes.along_y * w.y + axes.along_z * w.z,
                 t = axes.around_x * w.x + axes.around_y * w.y;
    // What the bur is fed against is its own print, as curved as it is.
    const Float4 beside = least(w.x * w.x + w.y * w.y + w.z * w.z, all4(1));
    Float4 towards_l = all4(curvature_along), towards_t = straight ? Float4{} : curvature_around;
    if (const Int4 known = straight ? Int4{} : knows(g); any(known)) {
      const Float4 curvature = known_curvature(g, w);
      towards_l = known ? curvature : towards_l, towards_t = known ? curvature : towards_t;
    }
    const Float4 wall_along = beside * (-0.5f * towards_l) * l * l,
                 wall_around = beside * (-0.5f * towards_t) * t * t,
                 wall_both = beside * (-0.5f * (towards_l + towards_t)) * l * t,
                 bent_along = beside * axes.bent_along(g),
                 bent_around = beside * axes.bent_around(g);
    const Float4 straight_along = axes.along(g), straight_around = axes.around(g);
    const Float4 along = straight_along - 2 * wall_along * x - wall_both * y,
                 around = straight_around - 2 * wall_around * y - wall_both * x;
    const Float4 widens = axes.widening * straight_around;
    const Float4 middle = value - straight_along * x - straight_around * y +
                          (wall_both - widens) * x * y + (wall_along - bent_along) * x * x +
                          (wall_around - bent_around) * y * y;
    return {straightened(middle, along, around, bent_along + wall_along, bent_around + wall_around,
                         widens + wall_both),
            along, around};
  }
};

}  // namespace toothprep
