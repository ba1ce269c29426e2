// The molar's surface, judged by CGAL with exact predicates.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, std::vector<Kernel::Triangle_3>::iterator>;
using Judge = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

TEST(TreeAgainstCgal, DistancesAndSignsToTheMolarAgree) {
  const LayeredTooth tooth = make_molar({.voxel = 0.2});
  const TriangleMesh mesh = extract_surface(tooth, SurfaceOf::kAll);
  std::vector<Kernel::Triangle_3> triangles;
  const auto point = [](const Vec3& x) { return Kernel::Point_3(x.x(), x.y(), x.z()); };
  for (const auto& t : mesh.triangles)
    triangles.emplace_back(point(mesh.vertices[t[0]].cast<double>()),
                           point(mesh.vertices[t[1]].cast<double>()),
                           point(mesh.vertices[t[2]].cast<double>()));
  Judge judge(triangles.begin(), triangles.end());
  judge.accelerate_distance_queries();
  const TriangleTree tree(mesh);
  const Box bounds = molar_bounds();
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  double worst = 0;
  for (int n = 0; n < 20000; ++n) {
    Vec3 x;
    if (n % 2 == 0) {  // anywhere in a box twice the tooth's
      for (int k = 0; k < 3; ++k)
        x[k] = bounds.min[k] + (2 * unit(random) - 0.5) * (bounds.max[k] - bounds.min[k]);
    } else {  // within 0.1 mm of the surface
      const auto& t = mesh.triangles[random() % mesh.triangles.size()];
      x = mesh.vertices[t[0]].cast<double>();
      for (int k = 0; k < 3; ++k) x[k] += 0.2 * unit(random) - 0.1;
    }
    const double expected = std::sqrt(judge.squared_distance(point(x)));
    const double distance = tree.signed_distance(x);
    worst = std::max(worst, std::abs(std::abs(distance) - expected));
    // Inside: a ray crosses the surface an odd number of times.
    if (n % 20 == 0) {
      const Kernel::Ray_3 ray(point(x), Kernel::Vector_3(0.317, 0.211, 0.925));
      ASSERT_EQ(distance < 0, judge.number_of_intersected_primitives(ray) % 2 == 1) << n;
    }
  }
  RecordProperty("worst_difference_mm", std::to_string(worst));
  EXPECT_LT(worst, 1e-9);  // both in double precision
}

}  // namespace
}  // namespace toothprep
