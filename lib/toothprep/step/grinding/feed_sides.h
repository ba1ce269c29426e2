// Which side of a moving bur a small ball of points lies on: whether all of it comes nearer to the
// bur's surface, or all of it is left behind, whatever part of the surface is nearest.
//
// The distance d from a convex solid changes by -n·t where the solid moves by t, with n the outward
// normal at the nearest point of its surface (inside: at any nearest point). Of a solid of revolution
// n lies in the half plane through the axis and the point. Along a convex outline it turns one way,
// from -z at the tip to +z at the other end; so of a ball the normals at the two ends of the part of
// the outline that can be nearest to it bound all others. That part lies within the ball's radius of
// the point that is nearest to its middle (outside: the nearest point moves no farther than the
// point does), or within |d| + 2 radii of the middle (everywhere). Both are looked up by the place
// of the middle in the half plane.
//
// So along a straight way the bur's last place cuts deepest ahead of it, and behind it nothing is
// cut that its place before didn't cut. Only convex heads have a table; others are never judged.
#pragma once

#include <vector>

#include "toothprep/step/bur/bur.h"

namespace toothprep {

class FeedSides {
 public:
  enum class Side { kEither, kAhead, kBehind };
  struct Motion {     // of the bur, in its own frame
    float x, y, z;    // mm
    float across;     // mm, its part across the axis
    float uncertain;  // mm: by which -n·t must be beyond doubt
  };

  // For balls of radius `ball` mm whose middles are no farther than `reach` mm from the head.
  FeedSides(const Bur& bur, double ball, double reach);

  // Of the ball about (x, y, z), which is r from the axis, mm in B.
  Side of(float x, float y, float r, float z, const Motion& motion) const noexcept;

 private:
  struct Normals {  // at the two ends of the outline's part, (r, z)
    float low_r = 0, low_z = -1, high_r = 0, high_z = 1;
  };
  Normals normals_about(const Bur& bur, const std::vector<ProfilePoint>& outline, double spacing,
                        double r, double z) const;

  float ball_, reach_, per_cell_ = 0;
  int across_ = 0, along_ = 0;  // cells
  std::vector<Normals> cells_;  // along the axis fastest
};

}  // namespace toothprep
