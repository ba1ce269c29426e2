// Convex polyhedra made by cutting a box with planes: exact distances and volumes for test pieces.
#pragma once

#include <array>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// {x : normal·x <= offset}; normal of unit length, pointing out.
struct HalfSpace {
  Vec3 normal = Vec3::UnitX();
  double offset = 0;  // mm
};

// The half-space through `point` with the outward normal `normal` (any length but zero).
HalfSpace half_space(const Vec3& normal, const Vec3& point);

struct PolyhedronFace {
  HalfSpace plane;
  std::vector<Vec3> corners;  // counter-clockwise seen from outside
};

struct ConvexPolyhedron {
  std::vector<PolyhedronFace> faces;  // none: empty

  bool empty() const { return faces.empty(); }
  // Signed distance, mm, negative inside; exact everywhere (inside it is the nearest plane's,
  // outside that of the nearest face, edge or corner).
  double distance(const Vec3& x) const;
};

ConvexPolyhedron box_polyhedron(const Vec3& low, const Vec3& high);

// What lies in the half-space too. Corners within 1e-10 mm of the plane count as on it.
ConvexPolyhedron clipped(const ConvexPolyhedron& body, const HalfSpace& plane);
ConvexPolyhedron intersection(ConvexPolyhedron a, const ConvexPolyhedron& b);

// Every plane moved outward by `distance`: edges stay sharp.
ConvexPolyhedron planes_moved(const ConvexPolyhedron& body, double distance);

double volume_mm3(const ConvexPolyhedron& body);
double area_mm2(const std::vector<Vec3>& polygon);
Vec3 area_vector(const std::vector<Vec3>& polygon);  // area along the normal

// Least distance between two; 0 where they overlap. The nearest points are a corner and a face or a
// point on each of two edges.
double distance_between(const ConvexPolyhedron& a, const ConvexPolyhedron& b);

// The part of {x outside `body`, nearer to it than `reach`} that lies in z-slab
// low < axis·x < high, mm³: Steiner's decomposition into prisms on the faces, sectors of cylinders
// along the edges and sectors of balls at the corners, each of which is cut exactly as long as no
// ball sector, and no sector of an edge across the slab's ends, is cut; those must lie on one side
// (false in `exact` otherwise, and the part is counted by where its edge or corner lies).
double shell_volume_mm3(const ConvexPolyhedron& body, double reach, const Vec3& axis, double low,
                        double high, bool& exact);

}  // namespace toothprep
