// The distance function against definitions: nearest point of a densely sampled outline, winding
// number, gradient.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "bur_cases.h"
#include "toothprep/step/bur/distance_kernels.h"

namespace toothprep {
namespace {

using testing::all_burs;
using testing::Random;
using units::kPi;

struct Sampled {
  std::vector<double> r, z;
  double spacing = 0;            // largest distance of successive samples
  double smallest_radius = 1e9;  // of the arcs
};

Sampled sample(const Bur& bur, int per_piece) {
  Sampled s;
  for (const ProfilePiece& piece : bur.profile()) {
    for (int i = 0; i <= per_piece; ++i) {
      const ProfilePoint p = point_on(piece, static_cast<double>(i) / per_piece);
      s.r.push_back(p.r);
      s.z.push_back(p.z);
    }
    s.spacing = std::max(s.spacing, length_of(piece) / per_piece);
    if (piece.kind == ProfilePiece::Kind::kArc)
      s.smallest_radius = std::min(s.smallest_radius, arc_span(piece).radius);
  }
  return s;
}

// Turns of the sampled outline, closed along the axis, about a point.
double winding(const Sampled& s, double r, double z) {
  double turns = 0;
  for (std::size_t i = 0; i < s.r.size(); ++i) {
    const std::size_t j = (i + 1) % s.r.size();
    const double ar = s.r[i] - r, az = s.z[i] - z, br = s.r[j] - r, bz = s.z[j] - z;
    turns += std::atan2(ar * bz - az * br, ar * br + az * bz);
  }
  return turns / (2 * kPi);
}

TEST(BurDistance, IsTheDistanceToTheNearestOfADenseSampleOfTheOutline) {
  for (const Bur& bur : all_burs()) {
    const Sampled s = sample(bur, 2000);
    Random random(1);
    for (int k = 0; k < 100; ++k) {
      const double r = random.within(0, bur.max_radius() + 1);
      const double z = random.within(-1, bur.head_length() + 1);
      double nearest = 1e300;
      for (std::size_t i = 0; i < s.r.size(); ++i)
        nearest = std::min(nearest, std::hypot(s.r[i] - r, s.z[i] - z));
      const double d = std::abs(bur.distance(r, z));
      // The nearest point has a sample within half a spacing along the outline. On a line that
      // lengthens the distance to sqrt(d^2 + s^2), on an arc of radius rho to sqrt(d^2 + (1 + d /
      // rho) s^2) at most.
      const double half = 0.5 * s.spacing;
      EXPECT_LE(d, nearest + 1e-9) << bur.name() << " at " << r << ", " << z;
      EXPECT_GE(d, std::sqrt(std::max(
                       0.0, nearest * nearest - (1 + nearest / s.smallest_radius) * half * half)) -
                       1e-9)
          << bur.name() << " at " << r << ", " << z;
    }
  }
}

TEST(BurDistance, IsNegativeWhereTheOutlineWindsAroundThePoint) {
  for (const Bur& bur : all_burs()) {
    const Sampled s = sample(bur, 300);
    Random random(2);
    for (int k = 0; k < 150; ++k) {
      const double r = random.within(1e-6, bur.max_radius() + 0.3);
      const double z = random.within(-0.3, bur.head_length() + 0.3);
      const double d = bur.distance(r, z);
      if (std::abs(d) < 1e-3) continue;  // the sampled polygon cuts its arcs' corners
      const bool inside = winding(s, r, z) > 0.5;
      EXPECT_EQ(d < 0, inside) << bur.name() << " at " << r << ", " << z;
    }
  }
}

TEST(BurDistance, SignHoldsAtTheHeightsOfTheJointsAndOnTheAxis) {
  // There a ray from the point passes through a corner: the classical failure of crossing tests.
  for (const Bur& bur : all_burs()) {
    const Sampled s = sample(bur, 300);
    std::vector<double> heights;
    for (const ProfilePiece& piece : bur.profile()) {
      heights.push_back(piece.z1);
      if (piece.kind == ProfilePiece::Kind::kArc)
        for (const double side : {-1.0, 0.0, 1.0})
          heights.push_back(piece.centre_z + side * arc_span(piece).radius);
    }
    for (double& z : heights) z = std::clamp(z, -1.0, bur.head_length() + 1);
    std::sort(heights.begin(), heights.end());
    heights.erase(std::unique(heights.begin(), heights.end()), heights.end());
    for (const double z : heights) {
      for (int i = 0; i <= 20; ++i) {
        const double r = i * 0.05 * (bur.max_radius() + 0.1);
        const double d = bur.distance(r, z);
        if (std::abs(d) < 1e-3) continue;
        // On the axis the closed outline passes through the point; a hair off it doesn't.
        EXPECT_EQ(d<0, winding(s, std::max(r, 1e-4), z)> 0.5)
            << bur.name() << " at " << r << ", " << z;
        const float fr = static_cast<float>(r), fz = static_cast<float>(z);
        float fast;
        bur.mitred_distances(&fr, &fz, &fast, 1);
        EXPECT_EQ(fast < 0, d < 0) << bur.name() << " at " << r << ", " << z;
      }
    }
  }
}

TEST(BurDistance, SolvesTheEikonalEquation) {
  const double h = 1e-5;
  for (const Bur& bur : all_burs()) {
    Random random(3);
    int smooth = 0;
    for (int k = 0; k < 200; ++k) {
      const double r = random.within(0.01, bur.max_radius() + 0.5);
      const double z = random.within(-0.5, bur.head_length() + 0.5);
      const double d = bur.distance(r, z);
      const double right = (bur.distance(r + h, z) - d) / h,
                   left = (d - bur.distance(r - h, z)) / h;
      const double up = (bur.distance(r, z + h) - d) / h, down = (d - bur.distance(r, z - h)) / h;
      for (const double slope : {right, left, up, down}) EXPECT_LE(std::abs(slope), 1 + 1e-9);
      // Where the nearest point jumps (the medial axis) the slopes of the two sides differ.
      if (std::abs(right - left) > 1e-3 || std::abs(up - down) > 1e-3) continue;
      ++smooth;
      EXPECT_NEAR(std::hypot(0.5 * (right + left), 0.5 * (up + down)), 1, 1e-6)
          << bur.name() << " at " << r << ", " << z;
    }
    EXPECT_GT(smooth, 190) << bur.name();
  }
}

TEST(BurDistance, IsTheStepTakenAlongTheNormalFromTheSurface) {
  for (const Bur& bur : all_burs()) {
    for (const ProfilePiece& piece : bur.profile()) {
      if (length_of(piece) < 0.05) continue;
      for (const double fraction : {0.3, 0.5, 0.7}) {
        const ProfilePoint p = point_on(piece, fraction);
        EXPECT_NEAR(bur.distance(p.r, p.z), 0, 1e-12) << bur.name();
        for (const double h : {-0.005, 0.005})
          EXPECT_NEAR(bur.distance(p.r + h * p.along_z, p.z - h * p.along_r), h, 1e-12)
              << bur.name() << " piece " << (&piece - bur.profile().data()) << " at " << fraction;
      }
    }
  }
}

TEST(BurDistance, OfABallIsTheDistanceFromItsCentreLessItsRadius) {
  const Bur ball = make_bur("ball:D1.2", "");
  for (const double r : {0.0, 0.1, 0.6, 2.0})
    for (const double z : {-1.0, 0.0, 0.25, 0.6, 1.2, 3.0})
      EXPECT_NEAR(ball.distance(r, z), std::hypot(r, z - 0.6) - 0.6, 1e-15);
}

// The larger of the distances from the lines through an edge's two faces.
double beyond_faces(const SharpEdge& e, double r, double z) {
  const auto beyond = [&](const ProfilePoint& p) {
    return (r - p.r) * p.along_z - (z - p.z) * p.along_r;
  };
  return std::max(beyond(e.before), beyond(e.after));
}

// Whether the edge, and no place beside it, is nearest.
bool is_nearest(const SharpEdge& e, double r, double z, double distance) {
  return std::abs(std::hypot(r - e.after.r, z - e.after.z) - distance) < 1e-9;
}

TEST(MitredDistances, AreDistancesButOutsideOfSharpEdges) {
  for (const Bur& bur : all_burs()) {
    const std::vector<SharpEdge> edges = sharp_edges(bur.profile());
    Random random(4);
    std::vector<float> r, z;
    while (r.size() < 4000) {
      const float pr = static_cast<float>(random.within(0, bur.max_radius() + 0.6));
      const float pz = static_cast<float>(random.within(-0.6, bur.head_length() + 0.6));
      r.push_back(pr);
      z.push_back(pz);
      // and a voxel-like lattice, where points coincide with joints and axis
      r.push_back(0.1f * static_cast<float>(r.size() % 12));
      z.push_back(0.1f * static_cast<float>(r.size() / 24 % 80) - 0.5f);
    }
    std::vector<float> d(r.size());
    bur.mitred_distances(r.data(), z.data(), d.data(), static_cast<int>(r.size()));
    double worst = 0, worst_far = 0;
    for (std::size_t i = 0; i < r.size(); ++i) {
      const double exact = bur.distance(r[i], z[i]);
      double expected = exact;
      for (const SharpEdge& e : edges)
        if (exact > 0 && is_nearest(e, r[i], z[i], exact)) expected = beyond_faces(e, r[i], z[i]);
      // In front of a concave part an edge farther away may be mitred as well.
      if (!is_convex(bur.profile()) && d[i] < exact - 1e-5 && d[i] > 0) continue;
      (std::abs(exact) < 0.5 ? worst : worst_far) =
          std::max(std::abs(exact) < 0.5 ? worst : worst_far, std::abs(d[i] - expected));
    }
    EXPECT_LT(worst, 1e-5) << bur.name();
    // Farther away, as coordinates up to 10 mm round: some ulps of 1e-6 mm.
    EXPECT_LT(worst_far, 2e-5) << bur.name();
  }
}

TEST(MitredDistances, HaveTheSignOfTheDistanceAndAreNoLargerAndNoSteeper) {
  for (const Bur& bur : all_burs()) {
    Random random(8);
    for (int k = 0; k < 2000; ++k) {
      const auto near = [&](double value) {
        return static_cast<float>(std::max(0.0, value + random.within(-0.02, 0.02)));
      };
      const double at_r = random.within(0, bur.max_radius() + 0.3),
                   at_z = random.within(0, bur.head_length() + 0.3);
      const float r[2] = {near(at_r), near(at_r)}, z[2] = {near(at_z) - 0.1f, near(at_z) - 0.1f};
      float d[2];
      bur.mitred_distances(r, z, d, 2);
      for (int i = 0; i < 2; ++i) {
        const double exact = bur.distance(r[i], z[i]);
        EXPECT_LT(d[i], exact + 1e-5) << bur.name() << " at " << r[i] << ", " << z[i];
        if (std::abs(exact) < 1e-5) continue;
        EXPECT_EQ(d[i] < 0, exact < 0) << bur.name() << " at " << r[i] << ", " << z[i];
      }
      EXPECT_LT(std::abs(d[1] - d[0]), std::hypot(r[1] - r[0], z[1] - z[0]) + 1e-5f)
          << bur.name() << " at " << r[0] << ", " << z[0];
    }
  }
}

TEST(MitredDistances, OfAPointDoNotDependOnItsNeighboursOrTheirNumber) {
  const Bur bur = make_bur("pear:D1.0xL2.0xN0.5", "");
  constexpr int kMost = 70;
  std::vector<float> r(kMost), z(kMost), alone(kMost);
  for (int i = 0; i < kMost; ++i) {
    r[i] = 0.013f * static_cast<float>(i);
    z[i] = 0.031f * static_cast<float>(i) - 0.1f;
    bur.mitred_distances(&r[i], &z[i], &alone[i], 1);
  }
  for (int n = 0; n <= kMost; ++n) {
    std::vector<float> d(n + 1, -7.0f);
    bur.mitred_distances(r.data(), z.data(), d.data(), n);
    for (int i = 0; i < n; ++i) EXPECT_EQ(d[i], alone[i]) << "n " << n << ", i " << i;
    EXPECT_EQ(d[n], -7.0f) << "wrote beyond n = " << n;
  }
}

TEST(BurDistance, IsTheSameToTheLastBitForEveryProcessor) {
  Random random(7);
  std::vector<float> r, z;
  for (int i = 0; i < 10003; ++i) {  // not a multiple of any vector's width
    r.push_back(static_cast<float>(random.within(0, 2)));
    z.push_back(static_cast<float>(random.within(-1, 6)));
  }
  const int n = static_cast<int>(r.size());
  const std::vector<DistanceKernel> kernels = distance_kernels();
  for (const Bur& bur : all_burs()) {
    std::vector<float> used(r.size()), one(r.size());
    bur.mitred_distances(r.data(), z.data(), used.data(), n);
    for (int i = 0; i < n; ++i) bur.mitred_distances(&r[i], &z[i], &one[i], 1);
    EXPECT_EQ(used, one) << bur.name();
    const DistanceOutline<float> outline = fast_outline(bur.profile());
    for (const DistanceKernel& kernel : kernels) {
      std::vector<float> d(r.size());
      kernel.run(outline, r.data(), z.data(), d.data(), n);
      EXPECT_EQ(d, used) << bur.name() << ", " << kernel.name;
    }
  }
}

TEST(MitredDistances, OfPointsInABallAreThoseOfEachPoint) {
  const std::vector<DistanceKernel> kernels = distance_kernels();
  for (const Bur& bur : all_burs()) {
    const DistanceOutline<float> outline = fast_outline(bur.profile());
    Random random(9);
    for (int k = 0; k < 400; ++k) {
      // From a block of the finest voxels to one that holds most of the head, whose middle may be on
      // a joint.
      const double radius = std::pow(10.0, random.within(-2, 0.3));
      const ProfilePiece& piece = bur.profile()[static_cast<std::size_t>(k) % bur.profile().size()];
      const bool at_joint = k % 4 == 0;
      const double at_r = at_joint ? piece.r1 : random.within(0, bur.max_radius() + 0.5),
                   at_z = at_joint ? piece.z1 : random.within(-0.5, bur.head_length() + 0.5);
      const DistanceBall ball{static_cast<float>(at_r), static_cast<float>(at_z),
                              static_cast<float>(radius) + 1e-5f};
      std::vector<float> r, z;
      while (r.size() < kDistanceBlock) {
        const double way = radius * std::sqrt(random.within(0, 1)),
                     turn = random.within(0, 2 * kPi);
        const double pr = at_r + way * std::cos(turn);
        if (pr < 0) continue;
        r.push_back(static_cast<float>(pr));
        z.push_back(static_cast<float>(at_z + way * std::sin(turn)));
      }
      std::vector<float> each(r.size()), near(r.size());
      bur.mitred_distances(r.data(), z.data(), each.data(), kDistanceBlock);
      bur.mitred_distances_near(ball, r.data(), z.data(), near.data());
      EXPECT_EQ(near, each) << bur.name() << " about " << at_r << ", " << at_z << ", " << radius;
      for (const DistanceKernel& kernel : kernels) {
        kernel.run_near(outline, ball, r.data(), z.data(), near.data());
        EXPECT_EQ(near, each) << bur.name() << ", " << kernel.name;
      }
    }
  }
}

TEST(PlacesOfBlock, AreThoseInTheBursFrameAndTheSameToTheLastBitForEveryProcessor) {
  Random random(11);
  const auto any = [&] { return random.within(-1, 1); };
  for (int k = 0; k < 200; ++k) {
    const Mat3 to_bur =
        random.within(0.02, 0.1) * Quat(any(), any(), any(), any()).normalized().toRotationMatrix();
    const Vec3 first = 30 * Vec3(any(), any(), any());
    std::array<float, 9> m;
    Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(m.data()) = to_bur.cast<float>();
    const Eigen::Vector3f from = first.cast<float>();
    std::array<float, kDistanceBlock> r, z, kernels_r, kernels_z;
    places_of_block(m.data(), from.data(), r.data(), z.data());
    for (int p = 0; p < kDistanceBlock; ++p) {
      const Vec3 at = to_bur * (first + Vec3(p / 16, p / 4 % 4, p % 4));
      // A handful of roundings of lengths below 6 mm.
      EXPECT_NEAR(r[p], std::hypot(at.x(), at.y()), 4e-6);
      EXPECT_NEAR(z[p], at.z(), 4e-6);
    }
    for (const DistanceKernel& kernel : distance_kernels()) {
      kernel.places(m.data(), from.data(), kernels_r.data(), kernels_z.data());
      EXPECT_EQ(kernels_r, r) << kernel.name;
      EXPECT_EQ(kernels_z, z) << kernel.name;
    }
  }
}

}  // namespace
}  // namespace toothprep
