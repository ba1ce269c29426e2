// Whether a ball of points nears the bur or leaves it, against the exact distance of its points.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/feed_sides.h"

namespace toothprep::testing {
namespace {

using Side = FeedSides::Side;

TEST(FeedSides, OnlyConvexHeadsAreJudged) {
  EXPECT_TRUE(is_convex(make_bur("cylinder:D1.2xL3.0", "").profile()));
  EXPECT_TRUE(is_convex(make_bur("ball:D1.2", "").profile()));
  const Bur waist("waist",
                  {line_piece(0, 0, 0.5, 0), line_piece(0.5, 0, 0.3, 1), line_piece(0.3, 1, 0.5, 2),
                   line_piece(0.5, 2, 0, 2, false)},
                  0, 0);
  EXPECT_FALSE(is_convex(waist.profile()));
  EXPECT_EQ(FeedSides(waist, 0.1, 0.3).of(0.6f, 0, 0.6f, 0.5f, {0.1f, 0, 0, 0.1f, 1e-5f}),
            Side::kEither);
}

TEST(FeedSides, EveryPointOfABallAheadComesNearerAndOfOneBehindIsLeft) {
  constexpr double kBall = 0.1, kFarthest = 0.3, kStep = 0.03;
  std::mt19937 random(7);
  const auto uniform = [&random](double from, double to) {
    return from + (to - from) * (static_cast<double>(random()) / 4294967296.0);
  };
  const auto inside_unit_ball = [&uniform] {
    Vec3 p;
    do p = Vec3(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    while (p.squaredNorm() > 1);
    return p;
  };
  for (const char* name : {"cylinder:D1.2xL3.0", "ball:D1.2", "cone:D1.6xL4.0xT1.2xR0.3",
                           "inverted-cone:D1.2xL1.5xA10", "round-cylinder:D1.2xL4.0"}) {
    const Bur bur = make_bur(name, "");
    const FeedSides sides(bur, kBall, kFarthest);
    const auto distance = [&bur](const Vec3& p) {
      return bur.distance(std::hypot(p.x(), p.y()), p.z());
    };
    int near = 0, judged = 0;
    for (int i = 0; i < 8000; ++i) {
      const double r = bur.max_radius() + kFarthest;
      const Vec3 middle(uniform(-r, r), uniform(-r, r),
                        uniform(-kFarthest, bur.head_length() + kFarthest));
      if (std::abs(distance(middle)) > kFarthest) continue;
      const Vec3 step = kStep * inside_unit_ball().normalized();
      const Eigen::Vector3f m = step.cast<float>(), at = middle.cast<float>();
      const Side side = sides.of(at.x(), at.y(), std::hypot(at.x(), at.y()), at.z(),
                                 {m.x(), m.y(), m.z(), std::hypot(m.x(), m.y()), 1e-5f});
      ++near;
      if (side == Side::kEither) continue;
      ++judged;
      for (int k = 0; k < 20; ++k) {
        // Both places of the point, as the bur sees it, are in the ball.
        const Vec3 from = middle + (kBall - kStep) * inside_unit_ball().normalized();
        const double change = distance(from - step) - distance(from);
        ASSERT_LT(side == Side::kAhead ? change : -change, 0) << name;
      }
    }
    EXPECT_GT(judged, 0.4 * near) << name;
  }
}

}  // namespace
}  // namespace toothprep::testing
