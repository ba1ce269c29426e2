// Rays and nearest points of a triangle mesh, by Embree's tree of boxes.
//
// Accuracy: the tree picks the triangle in single precision, from a local origin (the middle of the
// mesh), so that a mesh far from the world's origin loses nothing; places and distances are then
// computed in double precision from the mesh's vertices. Nearest distances are good to 1e-12 mm or
// so. A ray whose way past an edge is closer than about 1e-6 of the mesh's size may be said to meet
// it; it can't slip through between two triangles. Which of several triangles met or near equally
// is returned doesn't depend on the tree: the one that comes first in the mesh.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

struct SurfacePoint {
  Vec3 point = Vec3::Zero();     // mm, W
  double distance = 0;           // mm: along the ray, or to the asked point; never negative
  std::uint32_t triangle = 0;    // index into the mesh's triangles
  Vec3 weights = Vec3(1, 0, 0);  // barycentric: the point is the sum of weights * corners
};

struct TreeRay {
  Vec3 origin = Vec3::Zero();        // mm, W
  Vec3 direction = Vec3::UnitZ();    // any length but zero
  double nearest = 0, furthest = 0;  // mm
};

// Immutable after construction, so that any number of threads may query it.
class TriangleTree {
 public:
  // Copies what it needs of the mesh; vertices at the same place count as one. Throws Error for a
  // mesh without triangles, with an index out of range or with a coordinate that is not finite.
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

  // The same of up to kTogether rays at once, which is faster still for rays from near places: bit i
  // of the result is that of rays[i].
  static constexpr std::size_t kTogether = 8;
  [[nodiscard]] std::uint32_t which_hit(std::span<const TreeRay> rays) const;
  // first_hit() of each, faster for rays side by side.
  [[nodiscard]] std::array<std::optional<SurfacePoint>, kTogether> first_hits(
      std::span<const TreeRay> rays) const;

  // The nearest point of the surface. Throws Error if x is not finite.
  SurfacePoint nearest(const Vec3& x) const;

  // Distance to the surface (mm), negative inside a closed mesh that is oriented outward; the sign
  // is that of the angle-weighted pseudonormal at the nearest point (Baerentzen and Aanaes, IEEE
  // TVCG 2005;11:243-253), which is exact at edges and vertices too.
  double signed_distance(const Vec3& x) const;

  // Geometric normal of a triangle, unit, by the right-hand rule of its corners; zero if it has no
  // area.
  Vec3 normal(std::uint32_t triangle) const;

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace toothprep
