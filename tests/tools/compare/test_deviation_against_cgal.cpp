// The deviation of every vertex against CGAL's exact distances and its test of sides.
#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <gtest/gtest.h>

#include "cut_teeth.h"
#include "toothprep/tools/compare/deviation.h"

namespace toothprep {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Tree =
    CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_face_graph_triangle_primitive<Mesh>>>;

Kernel::Point_3 cgal(const Eigen::Vector3f& v) {
  return {static_cast<double>(v.x()), static_cast<double>(v.y()), static_cast<double>(v.z())};
}

TEST(Deviation, IsCgalsExactSignedDistance) {
  const LayeredTooth tooth = molar(0.2);
  const Solid original = solid_of("original", tooth);
  const Solid target = on_lattice(solid_of("target", carved(tooth, class_one())), original);
  // Deeper, turned and shifted: deviations of both signs and all sizes.
  const Pose off = pose_of(Vec3(0.2, -0.1, 0.3), Vec3(1, 2, 0.5), 4);
  const Solid prepared = on_lattice(
      solid_of("prepared",
               carved(tooth, [&](const Vec3& x) { return class_one(0.4)(off.to_local(x)); })),
      original);
  const Deviation d = measure_deviation(original, prepared, target);

  Mesh mesh;
  for (const auto& v : target.surface.vertices) mesh.add_vertex(cgal(v));
  for (const auto& t : target.surface.triangles)
    ASSERT_NE(
        mesh.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2])),
        Mesh::null_face());
  const Tree tree(faces(mesh).first, faces(mesh).second, mesh);
  const CGAL::Side_of_triangle_mesh<Mesh, Kernel> side(mesh);
  std::size_t compared = 0, over = 0, under = 0;
  for (std::size_t v = 0; v < d.per_vertex.size(); ++v) {
    if (std::isnan(d.per_vertex[v])) continue;
    const Kernel::Point_3 p = cgal(prepared.surface.vertices[v]);
    const double distance = std::sqrt(tree.squared_distance(p));
    ++compared;
    ASSERT_NEAR(std::abs(static_cast<double>(d.per_vertex[v])), distance, 1e-5);
    if (distance < 1e-4) continue;
    (d.per_vertex[v] < 0 ? over : under)++;
    ASSERT_EQ(d.per_vertex[v] < 0, side(p) == CGAL::ON_BOUNDED_SIDE);
  }
  EXPECT_GT(compared, 500U);
  EXPECT_GT(over, 100U);
  EXPECT_GT(under, 20U);
}

}  // namespace
}  // namespace toothprep
