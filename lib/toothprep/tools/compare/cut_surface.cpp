#include "toothprep/tools/compare/cut_surface.h"

#include <tbb/parallel_for.h>

#include "toothprep/step/tooth/level_at.h"

namespace toothprep {

std::vector<float> depth_inside(const TriangleMesh& surface, const LayeredTooth& original) {
  std::vector<float> depth(surface.vertices.size());
  tbb::parallel_for(std::size_t{0}, depth.size(), [&](std::size_t v) {
    depth[v] = static_cast<float>(
        -level_at(original.solid, original.lattice, surface.vertices[v].cast<double>()));
  });
  return depth;
}

std::vector<double> vertex_areas(const TriangleMesh& surface) {
  std::vector<double> areas(surface.vertices.size(), 0.0);
  for (const auto& t : surface.triangles) {
    const Vec3 a = surface.vertices[t[0]].cast<double>();
    const double third = (surface.vertices[t[1]].cast<double>() - a)
                             .cross(surface.vertices[t[2]].cast<double>() - a)
                             .norm() /
                         6;
    for (const std::uint32_t v : t) areas[v] += third;
  }
  return areas;
}

}  // namespace toothprep
