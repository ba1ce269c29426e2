#include "toothprep/compare/cut_surface.h"

#include <tbb/parallel_for.h>

namespace toothprep {

double sample(const LevelSet& level_set, const Lattice& lattice, const Vec3& x) {
  const Vec3 at = lattice.to_index(x);
  // Far outside, where the index would not fit an int.
  if (!(at.cwiseAbs().maxCoeff() < 1e9)) return level_set.background();
  const Index3 i = at.array().floor().cast<int>();
  const Vec3 f = at - i.cast<double>();
  const auto row = [&](int dx, int dy) {
    const double a = level_set.value(i.x() + dx, i.y() + dy, i.z());
    const double b = level_set.value(i.x() + dx, i.y() + dy, i.z() + 1);
    return a + f.z() * (b - a);
  };
  const double low = row(0, 0) + f.y() * (row(0, 1) - row(0, 0));
  const double high = row(1, 0) + f.y() * (row(1, 1) - row(1, 0));
  return low + f.x() * (high - low);
}

std::vector<float> depth_inside(const TriangleMesh& surface, const LayeredTooth& original) {
  std::vector<float> depth(surface.vertices.size());
  tbb::parallel_for(std::size_t{0}, depth.size(), [&](std::size_t v) {
    depth[v] = static_cast<float>(
        -sample(original.solid, original.lattice, surface.vertices[v].cast<double>()));
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
