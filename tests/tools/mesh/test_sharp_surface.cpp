// The margin of a prepared tooth is the curve in which tooth and cut meet. Here both are known, and
// so is the curve; CGAL judges whether the surface is fit for use.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "surfaces.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/sharp_surface.h"

namespace toothprep {
namespace {

using surfaces::box_distance;
using surfaces::expect_valid;
using surfaces::tooth_of;
using units::kPi;
using Field = std::function<double(const Vec3&)>;

LayeredTooth cut_tooth(const Field& tooth_field, const Field& cut_field, double half_size,
                       double voxel) {
  LayeredTooth tooth = tooth_of(tooth_field, half_size, voxel);
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
  return tooth;
}

// A tooth, a cut, and the curve in which they meet: its distance from a point, and points on it.
struct Preparation {
  std::string name;
  Field tooth, cut, from_curve;
  std::vector<Vec3> curve;
  // Where a crease of the tooth itself is farther than two voxels: it is bevelled.
  std::function<bool(const Vec3&)> judged = [](const Vec3&) { return true; };
};

// In a frame whose y axis points out of the tooth, turned by q.
Preparation ball_in_sphere(const Quat& q) {
  static constexpr double kTooth = 3, kBur = 0.6, kFrom = 2.9;
  // Two spheres meet in a circle in the plane at `height`.
  static constexpr double kHeight = (kFrom * kFrom + kTooth * kTooth - kBur * kBur) / (2 * kFrom);
  const double radius = std::sqrt(kTooth * kTooth - kHeight * kHeight);
  Preparation p;
  p.name = "ball in sphere";
  p.tooth = [](const Vec3& x) { return x.norm() - kTooth; };
  p.cut = [q](const Vec3& x) { return (x - q * Vec3(0, kFrom, 0)).norm() - kBur; };
  p.from_curve = [q, radius](const Vec3& x) {
    const Vec3 l = q.conjugate() * x;
    return std::hypot(l.y() - kHeight, std::hypot(l.x(), l.z()) - radius);
  };
  for (int i = 0; i < 360; ++i)
    p.curve.push_back(
        q * Vec3(radius * std::cos(i * kPi / 180), kHeight, radius * std::sin(i * kPi / 180)));
  return p;
}

// A cylinder that lies 0.2 mm under the top of a block, along z: two straight edges.
Preparation slot_in_block(const Quat& q) {
  const Vec3 half(1.6, 1.5, 1.7);
  static constexpr double kBur = 0.6, kDepth = 0.2, kMiddle = 0.11;
  const double width = std::sqrt(kBur * kBur - kDepth * kDepth);
  Preparation p;
  p.name = "slot in block";
  p.tooth = [q, half](const Vec3& x) { return box_distance(q.conjugate() * x, half); };
  p.cut = [q, half](const Vec3& x) {
    const Vec3 l = q.conjugate() * x;
    return std::hypot(l.x() - kMiddle, l.y() - (half.y() - kDepth)) - kBur;
  };
  p.from_curve = [q, half, width](const Vec3& x) {
    const Vec3 l = q.conjugate() * x;
    return std::hypot(l.y() - half.y(), std::abs(l.x() - kMiddle) - width);
  };
  p.judged = [q, half](const Vec3& x) {
    return std::abs((q.conjugate() * x).z()) < half.z() - 0.2;
  };
  for (int i = -148; i <= 148; ++i)
    for (const double side : {-width, width})
      p.curve.push_back(q * Vec3(kMiddle + side, half.y(), 0.01 * i));
  return p;
}

// A ball that is moved along z, 0.3 mm above the top of a block: two edges and two half circles.
Preparation ball_slot_in_block(const Quat& q) {
  const Vec3 half(1.6, 1.5, 1.7);
  static constexpr double kBur = 0.6, kAbove = 0.3, kWay = 0.8;
  const double width = std::sqrt(kBur * kBur - kAbove * kAbove);
  const auto from_way = [](Vec3 l) {
    l.z() -= std::clamp(l.z(), -kWay, kWay);
    return l;
  };
  Preparation p;
  p.name = "ball's slot in block";
  p.tooth = [q, half](const Vec3& x) { return box_distance(q.conjugate() * x, half); };
  p.cut = [q, half, from_way](const Vec3& x) {
    return from_way(q.conjugate() * x - Vec3(0, half.y() + kAbove, 0)).norm() - kBur;
  };
  p.from_curve = [q, half, width, from_way](const Vec3& x) {
    const Vec3 l = from_way(q.conjugate() * x);
    return std::hypot(l.y() - half.y(), std::hypot(l.x(), l.z()) - width);
  };
  for (int i = 0; i < 360; ++i) {
    const double c = width * std::cos(i * kPi / 180), s = width * std::sin(i * kPi / 180);
    p.curve.push_back(q * Vec3(c, half.y(), s + (s >= 0 ? kWay : -kWay)));
  }
  return p;
}

double from_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 along = b - a;
  const double length = along.squaredNorm();
  const double t = length > 0 ? std::clamp((x - a).dot(along) / length, 0.0, 1.0) : 0;
  return (x - a - t * along).norm();
}

// The farthest that margin and curve are from one another, mm.
double margin_error(const SharpSurface& surface, const Preparation& p) {
  const auto at = [&](std::uint32_t v) -> Vec3 { return surface.mesh.vertices[v].cast<double>(); };
  double error = 0;
  for (const auto& edge : surface.margin)
    for (const std::uint32_t v : edge)
      if (p.judged(at(v))) error = std::max(error, p.from_curve(at(v)));
  for (const Vec3& x : p.curve) {
    double nearest = std::numeric_limits<double>::max();
    for (const auto& edge : surface.margin)
      nearest = std::min(nearest, from_segment(x, at(edge[0]), at(edge[1])));
    error = std::max(error, nearest);
  }
  return error;
}

// Measured: 0.013 to 0.066 voxels. Linear interpolation over a tetrahedron's diagonal bounds each
// field's error by 3/8 D²/R, 0.06 D for R = 0.6 mm and D = 0.1 mm, and the surfaces meet at 35 to 90
// degrees.
TEST(SharpSurface, TheMarginIsWithinATenthOfAVoxelOfTheCurveInWhichToothAndCutMeet) {
  const Quat upright = Quat::Identity(), tilted(Eigen::AngleAxisd(0.6, Vec3(1, 2, 3).normalized()));
  for (const Quat& q : {upright, tilted})
    for (const Preparation& p : {ball_in_sphere(q), slot_in_block(q), ball_slot_in_block(q)})
      for (const double voxel : {0.1, 0.05}) {
        SCOPED_TRACE(p.name + (q.w() == 1 ? ", upright, " : ", tilted, ") + std::to_string(voxel));
        const LayeredTooth tooth = cut_tooth(p.tooth, p.cut, 3.1, voxel);
        const SharpSurface surface = extract_sharp_surface(tooth);
        ASSERT_FALSE(surface.margin.empty());
        EXPECT_LT(margin_error(surface, p) / voxel, 0.1);
        if (voxel == 0.1) expect_valid(surface.mesh);
      }
}

TEST(SharpSurface, TheMarginIsAClosedCurveOfEdgesOfTheMesh) {
  const Preparation p = ball_in_sphere(Quat::Identity());
  const SharpSurface surface = extract_sharp_surface(cut_tooth(p.tooth, p.cut, 3.1, 0.1));
  std::map<std::uint32_t, int> ends;
  for (const auto& edge : surface.margin)
    for (const std::uint32_t v : edge) ++ends[v];
  for (const auto& [v, count] : ends) ASSERT_EQ(count, 2) << v;
  std::map<std::array<std::uint32_t, 2>, int> edges;
  for (const auto& t : surface.mesh.triangles)
    for (int k = 0; k < 3; ++k)
      ++edges[{std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])}];
  for (const auto& [a, b] : surface.margin)
    ASSERT_EQ(edges.count({std::min(a, b), std::max(a, b)}), 1u);
}

// One field bevels the margin: what it loses there is of the order of D² times the margin's length.
TEST(SharpSurface, HoldsTheVolumeThatOneFieldLosesAtTheMargin) {
  const Preparation p = ball_in_sphere(Quat::Identity());
  const LayeredTooth tooth = cut_tooth(p.tooth, p.cut, 3.1, 0.1);
  // Sphere less the lens of both balls at distance d.
  constexpr double R = 3, r = 0.6, d = 2.9;
  const double lens = kPi * (R + r - d) * (R + r - d) *
                      (d * d + 2 * d * r - 3 * r * r + 2 * d * R + 6 * r * R - 3 * R * R) /
                      (12 * d);
  const double exact = 4 * kPi / 3 * R * R * R - lens;
  const double sharp = mesh_volume_mm3(extract_sharp_surface(tooth).mesh),
               bevelled = mesh_volume_mm3(extract_surface(tooth, SurfaceOf::kAll));
  EXPECT_LT(std::abs(sharp - exact), std::abs(bevelled - exact));
  EXPECT_NEAR(sharp / exact, 1, 1e-3);
}

TEST(SharpSurface, OfACutThatFollowsOrGrazesTheToothIsValid) {
  const Field block = [](const Vec3& x) { return box_distance(x, Vec3(1.5, 1.5, 1.5)); };
  const auto box_at = [](const Vec3& middle, const Vec3& half) {
    return [=](const Vec3& x) { return box_distance(x - middle, half); };
  };
  // A cut whose side lies in the block's, and one that only touches the top.
  expect_valid(extract_sharp_surface(
                   cut_tooth(block, box_at(Vec3(1, 1.2, 0), Vec3(0.5, 0.6, 0.5)), 2.2, 0.1))
                   .mesh);
  const SharpSurface touched = extract_sharp_surface(
      cut_tooth(block, box_at(Vec3(0, 2.1, 0), Vec3(0.8, 0.6, 0.8)), 2.2, 0.1));
  expect_valid(touched.mesh);
  EXPECT_TRUE(touched.margin.empty()) << "nothing was cut";
}

TEST(SharpSurface, OfACutFullOfWallsThinnerThanAVoxelIsValid) {
  const Field block = [](const Vec3& x) { return box_distance(x, Vec3(1.5, 1.5, 1.5)); };
  const Field waves = [](const Vec3& x) {
    return 0.1 * (std::sin(11 * x.x()) * std::cos(13 * x.y()) +
                  std::sin(9 * x.y()) * std::cos(12 * x.z()) +
                  std::sin(10 * x.z()) * std::cos(8 * x.x()));
  };
  expect_valid(extract_sharp_surface(cut_tooth(block, waves, 2.2, 0.15)).mesh);
}

TEST(SharpSurface, IsTheSameWhateverTheThreads) {
  const Preparation p = ball_in_sphere(Quat::Identity());
  const LayeredTooth tooth = cut_tooth(p.tooth, p.cut, 3.1, 0.1);
  const SharpSurface all = extract_sharp_surface(tooth);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const SharpSurface alone = extract_sharp_surface(tooth);
  EXPECT_EQ(all.mesh.vertices, alone.mesh.vertices);
  EXPECT_EQ(all.mesh.triangles, alone.mesh.triangles);
  EXPECT_EQ(all.margin, alone.margin);
}

TEST(SharpSurface, NeedsAToothWhoseCutIsKnown) {
  const Field ball = [](const Vec3& x) { return x.norm() - 1; };
  EXPECT_THROW(static_cast<void>(extract_sharp_surface(tooth_of(ball, 1.2, 0.1))), Error);
}

}  // namespace
}  // namespace toothprep
