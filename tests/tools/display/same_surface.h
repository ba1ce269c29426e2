// What a surface must be, and whether two are the same one.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/tools/display/block_mesh.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep::testing {

using Point = std::array<float, 3>;
inline Point point(const Eigen::Vector3f& v) { return {v.x(), v.y(), v.z()}; }

// Every edge lies in two triangles, which run along it in opposite directions.
template <class Mesh>
bool is_closed(const Mesh& mesh) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges, turned;
  for (const auto& t : mesh.triangles)
    for (int i = 0; i < 3; ++i) {
      edges.emplace_back(t[i], t[(i + 1) % 3]);
      turned.emplace_back(t[(i + 1) % 3], t[i]);
    }
  std::sort(edges.begin(), edges.end());
  std::sort(turned.begin(), turned.end());
  return edges == turned && std::adjacent_find(edges.begin(), edges.end()) == edges.end();
}

// V - E + F of a closed mesh: 2 for each piece without handles.
template <class Mesh>
long euler_characteristic(const Mesh& mesh) {
  const auto v = static_cast<long>(mesh.vertices.size()),
             f = static_cast<long>(mesh.triangles.size());
  return v - 3 * f / 2 + f;
}

// Vertices with their tissues, and triangles from their least corner on, in order of place.
template <class Mesh>
std::vector<std::pair<Point, int>> sorted_vertices(const Mesh& mesh) {
  std::vector<std::pair<Point, int>> v;
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i)
    v.emplace_back(point(mesh.vertices[i]), mesh.tissue[i]);
  std::sort(v.begin(), v.end());
  return v;
}
template <class Mesh>
std::vector<std::array<Point, 3>> sorted_triangles(const Mesh& mesh) {
  std::vector<std::array<Point, 3>> triangles;
  for (const auto& t : mesh.triangles) {
    std::array<Point, 3> c = {point(mesh.vertices[t[0]]), point(mesh.vertices[t[1]]),
                              point(mesh.vertices[t[2]])};
    std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
    triangles.push_back(c);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

// The same vertices to the last bit, with the same tissues, and the same triangles.
inline void expect_same_surface(const DisplayMesh& blocks, const TriangleMesh& one_piece) {
  ASSERT_EQ(blocks.vertices.size(), one_piece.vertices.size());
  ASSERT_EQ(blocks.triangles.size(), one_piece.triangles.size());
  EXPECT_TRUE(sorted_vertices(blocks) == sorted_vertices(one_piece));
  EXPECT_TRUE(sorted_triangles(blocks) == sorted_triangles(one_piece));
}

// What remains, extracted in one piece as for a file.
inline TriangleMesh surface_in_one_piece(const Workpiece& workpiece) {
  LayeredTooth rest = workpiece.tooth();
  apply_remaining_solid(rest, workpiece.remaining_solid());
  return extract_surface(rest, SurfaceOf::kAll);
}

}  // namespace toothprep::testing
