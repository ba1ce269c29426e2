// The cut against four pieces of an element: what contact_pieces.cpp and contact_walls.cpp share. Internal to
// contact*.cpp.
#pragma once

#include "toothprep/step/grinding/contact_frame.h"

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

// Of walls that stand alone a chip thinner than this (voxels) may be none.
constexpr float kThinChip = 0.02f;
// By how much (mm) a wall must stand out that makes a chip as thick as this (mm): one thinner than `most` may be
// none, and from twice as much on it counts as a whole, so that a chip isn't made thinner.
inline Float4 doubt_of_thin(const Float4& thick, float most) {
  return greatest(least(2 * most - thick, all4(most)), Float4{});
}

// Four pieces of an element against the cut: where its field, by what is found of it, divides them.
struct ContactModel::CutOfPieces {
  const PieceAxes& axes;
  float half_along;  // of the pieces, mm
  Float4 half_around;
  float curvature_along;
  Float4 curvature_around;
  float voxel;         // mm
  Float4 wall;         // mm; by how much a wall stands out
  float per_speed;     // s/mm
  bool may_be_ridges;  // not along straight sides, which are swept as they are
  Float4 ux, uy, uz;   // velocity, mm/s, B
  Float4 vl, vt;       // its direction's parts along the profile and around the axis
  Float4 bend;         // 1/mm, of the surface along the motion, where it is convex

  CutOfPieces(const Scan& scan, const PieceAxes& piece_axes, const Pieces& pieces, int first,
              const Lanes& s)
      : axes(piece_axes),
        half_along(pieces.half_along[first]),
        half_around(load4(&pieces.half_around[first])),
        curvature_along(s.curvature_along),
        curvature_around(s.curvature_around),
        voxel(static_cast<float>(scan.workpiece.voxel())),
        wall(kWall * voxel * voxel * (curvature_along + curvature_around)),
        per_speed(s.speed > 0 ? 1 / s.speed : 0),
        may_be_ridges(curvature_along != 0 || !any(curvature_around != 0)),
        ux(s.ux),
        uy(s.uy),
        uz(s.uz),
        vl((ux * axes.along_x + uy * axes.along_y + uz * axes.along_z) * (per_speed / half_along)),
        vt((ux * axes.around_x + uy * axes.around_y) * (per_speed / half_around)),
        bend(greatest(curvature_along * vl * vl + curvature_around * vt * vt, Float4{})) {}

  // Of a field with gradient g (B, per mm), its change along the motion.
  Float4 rise(const FourSamples& g) const {
    return per_speed * (g.gx * ux + g.gy * uy + g.gz * uz);
  }
  // By how much a wall stands out on the lattice that the surface leaves when it is swept along itself: that has no
  // curvature that way, and all of the surface's Gaussian one.
  Float4 swept_wall() const {
    const Float4 of_motion = bend / greatest(vl * vl + vt * vt, all4(kLeastExtent)),
                 gaussian = curvature_along * curvature_around;
    return greatest(kWallAtMost * voxel * voxel * gaussian / greatest(of_motion, all4(kFlat)),
                    wall);
  }
  // The border of a wall that stands alone, so that what may be no chip is none.
  Borders without_thin(Borders border) const {
    const Float4 thick = magnitude(border.along) + magnitude(border.around) - border.value;
    border.value += doubt_of_thin(thick, kThinChip * voxel);
    return border;
  }
  // Its value at the surface from the sample ahead of it: a wall that was ground before counts no earlier
  // than it is reached.
  Float4 at_surface(const FourSamples& found, float reach) const {
    return found.value + wall - kTakenBack * reach * rise(found);
  }
  // Its borders by its value (mm) at the places x, y (-1 .. 1). A wall that was swept along the motion is curved
  // across it, as the bur is.
  Borders borders(const Float4& value, const FourSamples& g, const Float4& x,
                  const Float4& y) const {
    const Float4 wx = per_speed * (g.gy * uz - g.gz * uy), wy = per_speed * (g.gz * ux - g.gx * uz),
                 wz = per_speed * (g.gx * uy - g.gy * ux);
    const Float4 l = axes.along_x * wx + axes.along_y * wy + axes.along_z * wz,
                 t = axes.around_x * wx + axes.around_y * wy;
    // What the bur is fed against is its own print, as curved as it is.
    const Float4 beside = least(wx * wx + wy * wy + wz * wz, all4(1));
    const Float4 wall_along = beside * (-0.5f * curvature_along) * l * l,
                 wall_around = beside * (-0.5f * curvature_around) * t * t,
                 wall_both = beside * (-0.5f * (curvature_along + curvature_around)) * l * t,
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
