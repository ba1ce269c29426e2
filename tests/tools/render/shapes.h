// Surfaces whose pictures are known.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// A sphere: an octahedron with each edge cut into `steps`, blown up. Its facets lie within about
// radius / steps^2 of it: edges span at most sqrt(6) / steps, a facet's circle edge / sqrt(3), and
// the sagitta is half the square of that.
inline TriangleMesh make_sphere(const Vec3& centre, double radius, int steps) {
  TriangleMesh mesh;
  std::map<std::array<int, 3>, std::uint32_t> known;
  const auto vertex = [&](int x, int y, int z) {  // |x| + |y| + |z| = steps
    const auto [at, fresh] = known.try_emplace({x, y, z}, mesh.vertices.size());
    if (fresh)
      mesh.vertices.push_back((centre + radius * Vec3(x, y, z).normalized()).cast<float>());
    return at->second;
  };
  for (int octant = 0; octant < 8; ++octant) {
    const int sx = octant & 1 ? -1 : 1, sy = octant & 2 ? -1 : 1, sz = octant & 4 ? -1 : 1;
    const auto corner = [&](int i, int j) { return vertex(sx * i, sy * j, sz * (steps - i - j)); };
    const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (sx * sy * sz < 0) std::swap(b, c);
      mesh.triangles.push_back({a, b, c});
    };
    for (int i = 0; i < steps; ++i)
      for (int j = 0; i + j < steps; ++j) {
        add(corner(i, j), corner(i + 1, j), corner(i, j + 1));
        if (i + j + 1 < steps) add(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
  }
  return mesh;
}

// Enamel for z > 0, dentin below, pulp within 1 mm of the middle: a ball of 3 mm.
inline LayeredTooth make_ball(double voxel) {
  Lattice lattice;
  lattice.voxel = voxel;
  lattice.origin = Vec3::Constant(0.5 * voxel);
  const int reach = static_cast<int>(3.0 / voxel) + 5;
  return build_tooth(
      lattice, Index3::Constant(-reach), Index3::Constant(reach),
      [](const Vec3& x) {
        ToothSample s;
        const auto r = static_cast<float>(x.norm()), z = static_cast<float>(x.z());
        s.solid = r - 3;
        s.tissue = {std::max({s.solid, -z, 1 - r}), std::max({s.solid, z, 1 - r}), r - 1};
        s.label = r >= 3   ? Tissue::kAir
                  : r < 1  ? Tissue::kPulp
                  : z >= 0 ? Tissue::kEnamel
                           : Tissue::kDentin;
        return s;
      },
      true);
}

}  // namespace toothprep
