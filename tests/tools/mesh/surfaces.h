// Teeth made of fields, and CGAL, with exact predicates, as the judge of their surfaces.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep::surfaces {

namespace pmp = CGAL::Polygon_mesh_processing;
using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;

// CGAL's half-edge mesh with the same vertices and triangles; refuses what is not 2-manifold.
inline Mesh judged(const TriangleMesh& surface) {
  std::vector<Point> points;
  for (const auto& v : surface.vertices) points.emplace_back(v.x(), v.y(), v.z());
  std::vector<std::vector<std::size_t>> faces;
  for (const auto& t : surface.triangles) faces.push_back({t[0], t[1], t[2]});
  Mesh mesh;
  EXPECT_TRUE(pmp::is_polygon_soup_a_polygon_mesh(faces)) << "an edge of more than two triangles";
  pmp::polygon_soup_to_polygon_mesh(points, faces, mesh);
  EXPECT_EQ(num_faces(mesh), surface.triangles.size());
  EXPECT_EQ(num_vertices(mesh), surface.vertices.size()) << "a vertex of more than one fan";
  return mesh;
}

inline void expect_valid(const TriangleMesh& surface) {
  ASSERT_FALSE(surface.triangles.empty());
  ASSERT_EQ(surface.tissue.size(), surface.vertices.size());
  const Mesh mesh = judged(surface);
  EXPECT_TRUE(mesh.is_valid());
  EXPECT_TRUE(CGAL::is_closed(mesh));
  EXPECT_TRUE(pmp::does_bound_a_volume(mesh)) << "outward, and cavities inward";
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  pmp::self_intersections<CGAL::Sequential_tag>(mesh, std::back_inserter(pairs));
  EXPECT_EQ(pairs.size(), 0u) << "pairs of triangles that intersect";
  for (const auto f : mesh.faces()) ASSERT_GT(pmp::face_area(f, mesh), 0);
}

// A tooth whose solid is one field, all of it dentin.
inline LayeredTooth tooth_of(const std::function<double(const Vec3&)>& field, double half_size,
                             double voxel) {
  Lattice lattice;
  lattice.voxel = voxel;
  const int n = static_cast<int>(std::ceil(half_size / voxel)) + 4;
  return build_tooth(
      lattice, Index3::Constant(-n), Index3::Constant(n),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(field(x));
        s.tissue = {1e3F, s.solid, 1e3F};
        if (s.solid < 0) s.label = Tissue::kDentin;
        return s;
      },
      false);
}

// Cuts the tooth by a field that is negative where material is removed; it knows both.
inline void cut_by(LayeredTooth& tooth, const std::function<double(const Vec3&)>& cut_field) {
  const auto band = static_cast<float>(tooth.band());
  LevelSet cut(tooth.solid.first_brick(), tooth.solid.brick_counts(), -band, {band});
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    for (int v = 0; v < kBrickVoxels; ++v)
      values[v] = std::clamp(static_cast<float>(-cut_field(tooth.lattice.to_world(
                                 cut.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7)))),
                             -band, band);
    cut.set_brick(b, values.data());
  }
  apply_cut(tooth, cut);
}

// What remains of that tooth under the cut.
inline LayeredTooth cut_tooth(const std::function<double(const Vec3&)>& tooth_field,
                              const std::function<double(const Vec3&)>& cut_field, double half_size,
                              double voxel) {
  LayeredTooth tooth = tooth_of(tooth_field, half_size, voxel);
  cut_by(tooth, cut_field);
  return tooth;
}

inline double box_distance(const Vec3& x, const Vec3& half) {
  const Vec3 q = x.cwiseAbs() - half;
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

}  // namespace toothprep::surfaces
