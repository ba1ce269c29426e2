// Rays and nearest points of a triangle mesh, by Embree's tree of boxes.
//
// Accuracy: coordinates are single precision, so distances carry about 2e-6 mm on a tooth of 20 mm;
// differences are taken from a local origin (the middle of the mesh) so that a mesh far from the
// world's origin keeps it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "toothprep/core/geometry.h"
#include "toothprep/mesh/surface.h"

namespace toothprep {

struct SurfacePoint {
  Vec3 point = Vec3::Zero();     // mm, W
  double distance = 0;           // mm: along the ray, or to the asked point; never negative
  std::uint32_t triangle = 0;    // index into the mesh's triangles
  Vec3 weights = Vec3(1, 0, 0);  // barycentric: the point is the sum of weights * corners
};

// Immutable after construction, so that any number of threads may ask.
class TriangleTree {
 public:
  // Copies what it needs of the mesh. Throws Error for a mesh without triangles, with an index out
  // of range or with a coordinate that is not finite.
  explicit TriangleTree(const TriangleMesh& mesh);
  ~TriangleTree();
  TriangleTree(TriangleTree&&) noexcept;

  // The first triangle that the ray from `origin` along `direction` (any length but zero) meets
  // between the distances `nearest` and `furthest` (mm), from either side.
  std::optional<SurfacePoint> first_hit(const Vec3& origin, const Vec3& direction,
                                        double nearest = 0, double furthest = 1e6) const;
  // Whether there is one (faster).
  bool hits(const Vec3& origin, const Vec3& direction, double nearest = 0,
            double furthest = 1e6) const;

  // The nearest point of the surface.
  SurfacePoint nearest(const Vec3& x) const;

  // Distance to the surface (mm), negative inside a closed mesh that is oriented outward; the sign
  // is that of the angle-weighted pseudonormal at the nearest point (Baerentzen and Aanaes, IEEE
  // TVCG 2005;11:243-253), which is exact at edges and vertices too.
  double signed_distance(const Vec3& x) const;

  // Geometric normal of a triangle, unit, by the right-hand rule of its corners.
  Vec3 normal(std::uint32_t triangle) const;

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace toothprep
