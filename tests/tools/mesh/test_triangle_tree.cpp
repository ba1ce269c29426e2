#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <limits>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

Vec3 at(const TriangleMesh& mesh, std::uint32_t triangle, int corner) {
  return mesh.vertices[mesh.triangles[triangle][corner]].cast<double>();
}

// Axis-aligned box, outward.
void add_box(TriangleMesh& mesh, const Vec3& low, const Vec3& high) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (int c = 0; c < 8; ++c)
    mesh.vertices.push_back(
        Vec3(c & 1 ? high.x() : low.x(), c & 2 ? high.y() : low.y(), c & 4 ? high.z() : low.z())
            .cast<float>());
  const std::array<std::uint32_t, 3> faces[] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6},
                                                {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7},
                                                {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  for (const auto& f : faces) mesh.triangles.push_back({first + f[0], first + f[1], first + f[2]});
}

TriangleMesh unit_cube() {
  TriangleMesh mesh;
  add_box(mesh, Vec3::Zero(), Vec3::Ones());
  return mesh;
}

// An L extruded along z: concave along the edge x = y = 1.
TriangleMesh l_shape() {
  const double outline[6][2] = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
  const std::uint32_t cut[4][3] = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}};
  TriangleMesh mesh;
  for (const double z : {0., 1.})
    for (const auto& p : outline) mesh.vertices.push_back(Vec3(p[0], p[1], z).cast<float>());
  for (const auto& t : cut) {
    mesh.triangles.push_back({t[0], t[2], t[1]});
    mesh.triangles.push_back({t[0] + 6, t[1] + 6, t[2] + 6});
  }
  for (std::uint32_t i = 0; i < 6; ++i) {
    const std::uint32_t j = (i + 1) % 6;
    mesh.triangles.push_back({i, j, j + 6});
    mesh.triangles.push_back({i, j + 6, i + 6});
  }
  return mesh;
}

TriangleMesh moved(TriangleMesh mesh, const Vec3& by) {
  for (auto& v : mesh.vertices) v += by.cast<float>();
  return mesh;
}

TriangleMesh random_triangles(int count, std::mt19937& random) {
  std::uniform_real_distribution<float> place(-5, 5), size(-1.5f, 1.5f);
  TriangleMesh mesh;
  for (int t = 0; t < count; ++t) {
    const Eigen::Vector3f a(place(random), place(random), place(random));
    for (int k = 0; k < 3; ++k)
      mesh.vertices.push_back(a + Eigen::Vector3f(size(random), size(random), size(random)));
    const auto v = static_cast<std::uint32_t>(3 * t);
    mesh.triangles.push_back({v, v + 1, v + 2});
  }
  return mesh;
}

Vec3 random_place(std::mt19937& random, double reach) {
  std::uniform_real_distribution<double> place(-reach, reach);
  const double x = place(random), y = place(random), z = place(random);
  return {x, y, z};
}

// Distance to a triangle by refining a barycentric grid: slow, and nothing like what is tested.
double sampled_distance(const TriangleMesh& mesh, std::uint32_t t, const Vec3& x) {
  const Vec3 a = at(mesh, t, 0), b = at(mesh, t, 1) - a, c = at(mesh, t, 2) - a;
  double best = 1e30, u0 = 0.5, v0 = 0.5, reach = 0.5;
  for (int round = 0; round < 24; ++round, reach *= 0.5) {
    double next_u = u0, next_v = v0;
    for (int i = -4; i <= 4; ++i)
      for (int j = -4; j <= 4; ++j) {
        const double u = std::clamp(u0 + i * reach / 4, 0., 1.);
        const double v = std::clamp(v0 + j * reach / 4, 0., 1. - u);
        const double d = (a + u * b + v * c - x).norm();
        if (d < best) {
          best = d;
          next_u = u;
          next_v = v;
        }
      }
    u0 = next_u;
    v0 = next_v;
  }
  return best;
}

// Solves origin + t direction = a + u b + v c.
std::optional<double> ray_triangle(const TriangleMesh& mesh, std::uint32_t t, const Vec3& origin,
                                   const Vec3& direction, double& margin) {
  const Vec3 a = at(mesh, t, 0);
  Mat3 m;
  m << at(mesh, t, 1) - a, at(mesh, t, 2) - a, -direction;
  const Vec3 s = m.fullPivLu().solve(origin - a);
  margin = std::min({s[0], s[1], 1 - s[0] - s[1]});
  if (margin < 0 || s[2] < 0) return std::nullopt;
  return s[2];
}

TEST(TriangleTree, RaysMeetWhatTryingEveryTriangleFinds) {
  std::mt19937 random(11);
  const TriangleMesh mesh = random_triangles(400, random);
  const TriangleTree tree(mesh);
  int met = 0, close_calls = 0;
  for (int n = 0; n < 2000; ++n) {
    const Vec3 origin = random_place(random, 8);
    const Vec3 direction = (random_place(random, 5) - origin).normalized();
    std::optional<double> expected;
    bool close_call = false;  // the ray passes an edge by less than 1e-5 of the triangle
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      double margin = 0;
      const auto d = ray_triangle(mesh, t, origin, direction, margin);
      if (std::abs(margin) < 1e-5) close_call = true;
      if (d && (!expected || *d < *expected)) expected = d;
    }
    if (close_call) {
      ++close_calls;
      continue;
    }
    const auto hit = tree.first_hit(origin, 3.7 * direction);  // of any length
    ASSERT_EQ(hit.has_value(), expected.has_value()) << n;
    EXPECT_EQ(tree.hits(origin, direction), expected.has_value());
    if (!hit) continue;
    ++met;
    EXPECT_NEAR(hit->distance, *expected, 1e-9);
    EXPECT_LT((hit->point - (origin + hit->distance * direction)).norm(), 1e-9);
    Vec3 sum = Vec3::Zero();
    for (int k = 0; k < 3; ++k) sum += hit->weights[k] * at(mesh, hit->triangle, k);
    EXPECT_LT((hit->point - sum).norm(), 1e-12);
    // Limits: just before it there is nothing, just behind it not this one.
    EXPECT_FALSE(tree.hits(origin, direction, 0, hit->distance - 1e-4));
    const auto next = tree.first_hit(origin, direction, hit->distance + 1e-4);
    if (next) {
      EXPECT_GT(next->distance, hit->distance);
    }
  }
  EXPECT_GT(met, 1000);
  EXPECT_LT(close_calls, 100);
}

TEST(TriangleTree, RaysTogetherMeetWhatEachMeetsAlone) {
  std::mt19937 random(12);
  const TriangleTree tree(random_triangles(400, random));
  const double nan = std::nan("");
  int met = 0, missed = 0;
  for (std::size_t n = 0; n < 2000; ++n) {
    std::vector<TreeRay> rays;  // also fewer than it takes, and none
    for (std::size_t i = 0; i < n % (TriangleTree::kTogether + 1); ++i) {
      const Vec3 origin = random_place(random, 8);
      rays.push_back({origin, 3.7 * (random_place(random, 5) - origin), 0.5, i % 3 == 0 ? 4 : 1e6});
      if (i % 7 == 6) rays.back().direction.x() = nan;
    }
    const std::uint32_t together = tree.which_hit(rays);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const TreeRay& r = rays[i];
      const bool alone = tree.hits(r.origin, r.direction, r.nearest, r.furthest);
      EXPECT_EQ((together >> i & 1) != 0, alone) << n << ", ray " << i;
      ++(alone ? met : missed);
    }
    EXPECT_EQ(together >> rays.size(), 0U);
    const auto first = tree.first_hits(rays);
    for (std::size_t i = 0; i < first.size(); ++i) {
      if (i >= rays.size()) {
        EXPECT_FALSE(first[i]);
        continue;
      }
      const TreeRay& r = rays[i];
      const auto alone = tree.first_hit(r.origin, r.direction, r.nearest, r.furthest);
      ASSERT_EQ(first[i].has_value(), alone.has_value()) << n << ", ray " << i;
      if (!alone) continue;
      EXPECT_EQ(first[i]->triangle, alone->triangle);
      EXPECT_NEAR(first[i]->distance, alone->distance, 1e-4);
    }
  }
  EXPECT_GT(met, 1000);
  EXPECT_GT(missed, 1000);
}

TEST(TriangleTree, NearestPointsAreThoseOfTryingEveryTriangle) {
  std::mt19937 random(5);
  const TriangleMesh mesh = random_triangles(150, random);
  const TriangleTree tree(mesh);
  for (int n = 0; n < 60; ++n) {
    const Vec3 x = random_place(random, n % 3 == 0 ? 40 : 6);
    double expected = 1e30;
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
      expected = std::min(expected, sampled_distance(mesh, t, x));
    const SurfacePoint p = tree.nearest(x);
    // The search over a grid of barycentric coordinates ends at 2^-24 of a triangle of 3 mm.
    EXPECT_NEAR(p.distance, expected, 2e-6);
    EXPECT_NEAR((p.point - x).norm(), p.distance, 1e-12);
    EXPECT_GE(p.weights.minCoeff(), 0);
    EXPECT_NEAR(p.weights.sum(), 1, 1e-15);
  }
}

// The signed distance to an axis-aligned box has a closed form.
double box_distance(const Vec3& x, const Vec3& low, const Vec3& high) {
  const Vec3 q = (x - (low + high) / 2).cwiseAbs() - (high - low) / 2;
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

TEST(TriangleTree, SignIsRightOverFacesEdgesAndCorners) {
  const TriangleTree tree(unit_cube());
  std::mt19937 random(3);
  for (int n = 0; n < 3000; ++n) {
    const Vec3 x = Vec3(0.5, 0.5, 0.5) + random_place(random, 1.2);
    EXPECT_NEAR(tree.signed_distance(x), box_distance(x, Vec3::Zero(), Vec3::Ones()), 1e-12);
  }
  // Exactly over edges, corners and diagonals of faces, where several triangles are equally near.
  for (const double d : {-0.25, -1e-6, 1e-6, 0.25, 3.0})
    for (const Vec3& x : {Vec3(1 + d, 1 + d, 0.5), Vec3(1 + d, 1 + d, 1 + d), Vec3(-d, 0.5, 0.5),
                          Vec3(0.5, 0.5, 1 + d), Vec3(-d, -d, -d), Vec3(1 + d, 0, 0.5)})
      EXPECT_NEAR(tree.signed_distance(x), box_distance(x, Vec3::Zero(), Vec3::Ones()), 1e-12)
          << x.transpose();
  EXPECT_EQ(tree.signed_distance(Vec3(1, 1, 1)), 0);
}

TEST(TriangleTree, SignIsRightInAConcaveEdge) {
  const TriangleTree tree(l_shape());
  EXPECT_NEAR(tree.signed_distance(Vec3(1.5, 1.2, 0.5)), 0.2, 1e-12);
  EXPECT_NEAR(tree.signed_distance(Vec3(0.9, 0.9, 0.5)), -0.1 * std::sqrt(2.), 1e-12);
  EXPECT_NEAR(tree.signed_distance(Vec3(0.5, 0.5, 0.5)), -0.5, 1e-12);
  EXPECT_NEAR(tree.signed_distance(Vec3(0.75, 0.75, 0.5)), -0.25 * std::sqrt(2.), 1e-12);
  std::mt19937 random(9);
  for (int n = 0; n < 3000; ++n) {
    const Vec3 x = Vec3(1, 1, 0.5) + random_place(random, 1.5);
    const bool inside = box_distance(x, Vec3::Zero(), Vec3(2, 1, 1)) < 0 ||
                        box_distance(x, Vec3::Zero(), Vec3(1, 2, 1)) < 0;
    EXPECT_EQ(tree.signed_distance(x) < 0, inside) << x.transpose();
  }
}

TEST(TriangleTree, RepeatedVerticesChangeNoSign) {
  const TriangleMesh cube = unit_cube();
  TriangleMesh soup;  // as a .stl has it
  for (std::uint32_t t = 0; t < cube.triangles.size(); ++t) {
    for (int k = 0; k < 3; ++k) soup.vertices.push_back(cube.vertices[cube.triangles[t][k]]);
    soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  const TriangleTree tree(soup), expected(cube);
  std::mt19937 random(4);
  for (int n = 0; n < 1000; ++n) {
    const Vec3 x = random_place(random, 2);
    EXPECT_EQ(tree.signed_distance(x), expected.signed_distance(x));
  }
}

TEST(TriangleTree, FarFromTheOriginNothingIsLost) {
  // 1024 and the coordinates 0 and 1 are exact in single precision, so the meshes are the same.
  const Vec3 far(1024, -2048, 1024);
  const TriangleTree near_tree(unit_cube()), far_tree(moved(unit_cube(), far));
  std::mt19937 random(21);
  for (int n = 0; n < 500; ++n) {
    const Vec3 x = random_place(random, 3);
    EXPECT_NEAR(far_tree.signed_distance(x + far), near_tree.signed_distance(x), 1e-11);
    const Vec3 direction = Vec3(0.5, 0.5, 0.5) + 0.2 * random_place(random, 1) - x;
    const auto a = near_tree.first_hit(x, direction), b = far_tree.first_hit(x + far, direction);
    ASSERT_TRUE(a && b);
    EXPECT_NEAR(a->distance, b->distance, 1e-11);
  }
}

TEST(TriangleTree, ARayFromFarAwayIsAimedAsWell) {
  const TriangleTree tree(unit_cube());
  const Vec3 target(0.25, 0.125, 1), from(3e4, -2e4, 5e4);
  const auto hit = tree.first_hit(from, target - from);
  ASSERT_TRUE(hit);
  EXPECT_LT((hit->point - target).norm(), 1e-10);
  EXPECT_NEAR(hit->distance, (target - from).norm(), 1e-9);
}

TEST(TriangleTree, NoRaySlipsThroughAnEdgeAndTheFirstTriangleIsTold) {
  // A flat sheet of 20 x 20 squares with diagonals: rays on every vertex, edge and diagonal.
  TriangleMesh sheet;
  const std::uint32_t n = 20;
  for (std::uint32_t i = 0; i <= n; ++i)
    for (std::uint32_t j = 0; j <= n; ++j)
      sheet.vertices.emplace_back(0.1f * static_cast<float>(i), 0.1f * static_cast<float>(j), 0.f);
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::uint32_t a = i * (n + 1) + j, b = a + n + 1;
      sheet.triangles.push_back({a, b, b + 1});
      sheet.triangles.push_back({a, b + 1, a + 1});
    }
  const TriangleTree tree(sheet);
  tbb::task_arena one(1);
  std::unique_ptr<TriangleTree> alone;
  one.execute([&] { alone = std::make_unique<TriangleTree>(sheet); });
  for (std::uint32_t i = 1; i < 2 * n; ++i)
    for (std::uint32_t j = 1; j < 2 * n; ++j) {
      const Vec3 below(0.5 * (static_cast<double>(0.1f * static_cast<float>(i / 2)) +
                              static_cast<double>(0.1f * static_cast<float>((i + 1) / 2))),
                       0.5 * (static_cast<double>(0.1f * static_cast<float>(j / 2)) +
                              static_cast<double>(0.1f * static_cast<float>((j + 1) / 2))),
                       -1);
      const auto hit = tree.first_hit(below, Vec3::UnitZ());
      ASSERT_TRUE(hit) << i << " " << j;
      EXPECT_NEAR(hit->distance, 1, 1e-12);
      // The lowest number of all triangles that hold the point.
      std::uint32_t expected = UINT32_MAX;
      for (std::uint32_t t = 0; t < sheet.triangles.size() && expected == UINT32_MAX; ++t) {
        double margin = 0;
        ray_triangle(sheet, t, below, Vec3::UnitZ(), margin);
        if (margin > -1e-10) expected = t;
      }
      EXPECT_EQ(hit->triangle, expected);
      EXPECT_EQ(alone->first_hit(below, Vec3::UnitZ())->triangle, expected);
      EXPECT_EQ(tree.nearest(below).triangle, alone->nearest(below).triangle);
    }
}

TEST(TriangleTree, TrianglesWithoutAreaDoNoHarm) {
  TriangleMesh mesh = unit_cube();
  mesh.triangles.push_back({0, 0, 0});
  mesh.triangles.push_back({0, 7, 0});
  mesh.triangles.push_back({1, 3, 1});
  const TriangleTree tree(mesh);
  EXPECT_NEAR(tree.signed_distance(Vec3(1.5, 0.5, 0.5)), 0.5, 1e-12);
  EXPECT_EQ(tree.normal(12), Vec3::Zero());
  EXPECT_TRUE(tree.first_hit(Vec3(0.5, 0.5, 9), -Vec3::UnitZ()));
}

TEST(TriangleTree, NormalFollowsTheRightHand) {
  const TriangleTree tree(unit_cube());
  const auto hit = tree.first_hit(Vec3(0.3, 0.2, 5), -Vec3::UnitZ());
  ASSERT_TRUE(hit);
  EXPECT_LT((tree.normal(hit->triangle) - Vec3::UnitZ()).norm(), 1e-15);
}

TEST(TriangleTree, ARayThatHasNoSenseMeetsNothing) {
  const TriangleTree tree(unit_cube());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(tree.first_hit(Vec3(nan, 0, 0), Vec3::UnitX()));
  EXPECT_FALSE(tree.hits(Vec3(-5, 0.5, 0.5), Vec3(nan, 0, 0)));
  EXPECT_FALSE(tree.hits(Vec3(-5, 0.5, 0.5), Vec3::UnitX(), 3, 2));
  EXPECT_THROW(tree.nearest(Vec3(nan, 0, 0)), Error);
}

TEST(TriangleTree, MeshesThatAreNoneAreRefused) {
  EXPECT_THAT([] { TriangleTree tree(TriangleMesh{}); },
              ThrowsMessage<Error>(HasSubstr("no triangles")));
  TriangleMesh wild = unit_cube();
  wild.triangles[4][1] = 8;
  EXPECT_THAT([&] { TriangleTree tree(wild); },
              ThrowsMessage<Error>(HasSubstr("triangle 4 of the mesh names vertex 8")));
  TriangleMesh broken = unit_cube();
  broken.vertices[3].y() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT([&] { TriangleTree tree(broken); },
              ThrowsMessage<Error>(HasSubstr("vertex 3 of the mesh is not finite")));
}

}  // namespace
}  // namespace toothprep
