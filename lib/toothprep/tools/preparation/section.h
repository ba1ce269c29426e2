// A plane section through a tooth, with what was measured in it: for drawings.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

using Vec2 = Eigen::Vector2d;  // in a section's plane, mm

// An outline in the section's plane, mm. Closed ones don't repeat their first point.
struct Outline {
  std::vector<Vec2> points;  // mm
  bool closed = false;       // the last point joins the first
};

// A straight line fitted to a wall or floor, or a dimension between two points, with what to write.
struct SectionMark {
  Vec2 from = Vec2::Zero(), to = Vec2::Zero();  // mm, in the plane
  std::string text;                             // "6.1°", "1.24 mm"; may be empty
  bool dimension = false;                       // a distance (drawn with ticks), not a fitted line
};

struct Section {                      // a plane through the tooth, with what it cuts
  std::string name;                   // "buccolingual", ...
  Vec3 origin = Vec3::Zero();         // mm, W: where the plane's (0, 0) lies
  Vec3 right = Vec3::UnitX();         // unit, W: the plane's x
  Vec3 up = Vec3::UnitY();            // unit, W: the plane's y, towards the opening
  std::string left_side, right_side;  // of the tooth: "lingual", "buccal"; may be empty
  std::vector<Outline> original, prepared, target, pulp, dentin;  // any may be empty
  std::vector<SectionMark> marks;                                 // what was measured in it
};

// Where the plane of `section` cuts a surface: outlines in the plane's coordinates, closed for a
// closed surface. Points lie on the mesh's edges.
[[nodiscard]] std::vector<Outline> outlines_of(const TriangleMesh& surface, const Section& section);

}  // namespace toothprep
