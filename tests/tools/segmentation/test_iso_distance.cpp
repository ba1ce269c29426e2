#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "toothprep/tools/segmentation/iso_distance.h"

namespace toothprep {
namespace {

constexpr float kBand = 3;

std::vector<float> sampled(const Index3& size, const std::function<double(const Vec3&)>& f) {
  std::vector<float> field;
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i) field.push_back(static_cast<float>(f(Vec3(i, j, k))));
  return field;
}

TEST(IsoDistance, IsExactForAPlaneInAnyDirection) {
  // The field is linear, so linear interpolation along the edges is exact; away from the array's
  // borders the foot of the perpendicular lies on the triangulated part.
  const Index3 size(24, 24, 24);
  for (const Vec3& direction : {Vec3(0, 0, 1), Vec3(1, 1, 0), Vec3(0.3, -0.5, 0.8)}) {
    const Vec3 n = direction.normalized();
    const auto signed_distance = [&](const Vec3& x) { return n.dot(x - Vec3(11.3, 11.6, 11.4)); };
    const auto field = sampled(size, [&](const Vec3& x) { return -7.5 * signed_distance(x); });
    const auto phi = iso_distance(size, field, kBand);
    double worst = 0;
    for (int k = 5; k < 19; ++k)
      for (int j = 5; j < 19; ++j)
        for (int i = 5; i < 19; ++i) {
          const double truth = std::clamp(signed_distance(Vec3(i, j, k)), -3.0, 3.0);
          worst = std::max(worst, std::abs(phi[(k * 24 + j) * 24 + i] - truth));
        }
    EXPECT_LT(worst, 1e-4) << n.transpose();
  }
}

TEST(IsoDistance, OfABallConvergesWithTheSquareOfTheVoxel) {
  // Linear interpolation of a distance of curvature 1/R over edges of length 1: error at most
  // 1/(8R) at the crossings, and the chord's sagitta 2/(8R) inside a cell's triangles (diagonal
  // sqrt 2).
  double previous = 0;
  for (const double radius : {5.0, 10.0, 20.0}) {
    const int n = static_cast<int>(2 * radius) + 12;
    const Vec3 centre = Vec3::Constant(n / 2.0) + Vec3(0.2, -0.1, 0.37);
    const auto field =
        sampled(Index3(n, n, n), [&](const Vec3& x) { return radius - (x - centre).norm(); });
    const auto phi = iso_distance(Index3(n, n, n), field, kBand);
    double worst = 0;
    for (int k = 0; k < n; ++k)
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
          const double truth = (Vec3(i, j, k) - centre).norm() - radius;
          const float value = phi[static_cast<std::size_t>((k * n + j) * n + i)];
          EXPECT_EQ(value < 0, truth < 0);
          if (std::abs(truth) < 2.5) worst = std::max(worst, std::abs(value - truth));
        }
    EXPECT_LT(worst, 3 / (8 * radius));
    if (previous > 0) {
      EXPECT_LT(worst, 0.65 * previous);  // error in voxels falls with 1/R
    }
    previous = worst;
  }
}

TEST(IsoDistance, NeverDisagreesWithTheSignOfTheField) {
  // All 256 sign patterns of a cell, the ambiguous ones too, occur in white noise.
  std::mt19937 random(7);
  std::uniform_real_distribution<float> value(-1, 1);
  const Index3 size(40, 40, 40);
  std::vector<float> field(64000);
  for (float& f : field) f = value(random);
  const auto phi = iso_distance(size, field, kBand);
  for (std::size_t v = 0; v < field.size(); ++v) {
    ASSERT_EQ(phi[v]<0, field[v]> 0);
    // A neighbour of the other sign is never farther than one voxel, and the crossing lies between.
    if (v % 40 != 39 && (field[v] > 0) != (field[v + 1] > 0)) {
      EXPECT_LE(std::abs(phi[v]), field[v] / (field[v] - field[v + 1]) + 1e-5);
    }
  }
}

TEST(IsoDistance, IsTheBandWhereThereIsNoSurface) {
  for (const float f : {-1.0f, 1.0f})
    for (const float d : iso_distance(Index3(5, 6, 7), std::vector<float>(210, f), kBand))
      EXPECT_EQ(d, f > 0 ? -kBand : kBand);
}

}  // namespace
}  // namespace toothprep
