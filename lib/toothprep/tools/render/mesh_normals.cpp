#include "toothprep/tools/render/mesh_normals.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using Vec3f = Eigen::Vector3f;
using Triangle = std::array<std::uint32_t, 3>;

std::vector<Triangle> welded(const TriangleMesh& mesh) {
  const auto before = [&](std::uint32_t a, std::uint32_t b) {
    const Vec3f &p = mesh.vertices[a], &q = mesh.vertices[b];
    return std::lexicographical_compare(p.data(), p.data() + 3, q.data(), q.data() + 3);
  };
  std::vector<std::uint32_t> order(mesh.vertices.size()), same(order.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), before);
  for (std::size_t i = 0; i < order.size(); ++i)
    same[order[i]] = i > 0 && mesh.vertices[order[i]] == mesh.vertices[order[i - 1]]
                         ? same[order[i - 1]]
                         : order[i];
  std::vector<Triangle> triangles = mesh.triangles;
  for (Triangle& t : triangles)
    for (std::uint32_t& corner : t) corner = same[corner];
  return triangles;
}

// The triangles around each vertex.
struct Around {
  std::vector<std::uint32_t> first, triangle;

  Around(const std::vector<Triangle>& triangles, std::size_t vertices) : first(vertices + 1, 0) {
    for (const Triangle& t : triangles)
      for (const std::uint32_t corner : t) ++first[corner + 1];
    std::partial_sum(first.begin(), first.end(), first.begin());
    triangle.resize(first.back());
    std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
    for (std::uint32_t t = 0; t < triangles.size(); ++t)
      for (const std::uint32_t corner : triangles[t]) triangle[next[corner]++] = t;
  }
};

}  // namespace

std::vector<Vec3f> corner_normals(const TriangleMesh& mesh, int passes) {
  const std::vector<Triangle> triangles = welded(mesh);
  const Around around(triangles, mesh.vertices.size());
  const std::size_t count = triangles.size();
  std::vector<Vec3f> normal(count), next(count);
  std::vector<float> area(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t t) {
    const Vec3 a = mesh.vertices[triangles[t][0]].cast<double>();
    const Vec3 n = (mesh.vertices[triangles[t][1]].cast<double>() - a)
                       .cross(mesh.vertices[triangles[t][2]].cast<double>() - a);
    area[t] = static_cast<float>(n.stableNorm());
    normal[t] = n.stableNormalized().cast<float>();
  });

  const float widest = 1 - std::cos(static_cast<float>(units::from_degree(50)));
  for (int pass = 0; pass < passes; ++pass) {
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t t) {
      Vec3f sum = Vec3f::Zero();
      for (const std::uint32_t corner : triangles[t])
        for (std::uint32_t k = around.first[corner]; k < around.first[corner + 1]; ++k) {
          const std::uint32_t other = around.triangle[k];
          const float alike = std::max(0.f, 1 - (1 - normal[t].dot(normal[other])) / widest);
          sum += area[other] * alike * alike * normal[other];
        }
      next[t] = sum.squaredNorm() > 0 ? Vec3f(sum.stableNormalized()) : normal[t];
    });
    normal.swap(next);
  }

  const float crease = std::cos(static_cast<float>(units::from_degree(40)));
  std::vector<Vec3f> corners(3 * count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t t) {
    for (int c = 0; c < 3; ++c) {
      const std::uint32_t here = triangles[t][c];
      Vec3f sum = Vec3f::Zero();
      for (std::uint32_t k = around.first[here]; k < around.first[here + 1]; ++k) {
        const std::uint32_t other = around.triangle[k];
        if (normal[other].dot(normal[t]) < crease) continue;
        const Triangle& o = triangles[other];
        const auto at = std::find(o.begin(), o.end(), here) - o.begin();
        const Vec3f p = mesh.vertices[o[(at + 1) % 3]] - mesh.vertices[here];
        const Vec3f q = mesh.vertices[o[(at + 2) % 3]] - mesh.vertices[here];
        sum += area[other] * std::atan2(p.cross(q).norm(), p.dot(q)) * normal[other];
      }
      corners[3 * t + c] = sum.squaredNorm() > 0 ? Vec3f(sum.stableNormalized()) : normal[t];
    }
  });
  return corners;
}

}  // namespace toothprep
