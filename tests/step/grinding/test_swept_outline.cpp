#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/swept_outline.h"

namespace toothprep {
namespace {

struct Nearest {
  double distance, at;  // mm; along the motion
};

// The least of the distances by which removal carves, as the bur goes along `way` by so much (mm).
Nearest nearest_of(const Bur& bur, const Vec3& place, const Vec3& way, double from, double to) {
  Nearest nearest{1e9, 0};
  const auto scan = [&](double low, double high) {
    constexpr int kPlaces = 400;
    for (int i = 0; i <= kPlaces; ++i) {
      const double t = low + (high - low) * i / kPlaces;
      const Vec3 x = place - t * way;
      const auto r = static_cast<float>(std::hypot(x.x(), x.y())), z = static_cast<float>(x.z());
      float d = 0;
      bur.mitred_distances(&r, &z, &d, 1);
      if (double{d} < nearest.distance) nearest = {double{d}, t};
    }
  };
  scan(from, to);
  scan(nearest.at - 0.03, nearest.at + 0.03);
  return nearest;
}

// And where on its way the bur was nearest.
TEST(SweptOutline, TellsHowFarPlacesLieWithinWhatEveryBurTakes) {
  std::mt19937 numbers(5);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(numbers()) / 4294967296.0;
  };
  for (const char* spec : {"ball:D1.2", "cylinder:D1.2xL3.0", "taper:D1.4xL4.0xA4",
                           "inverted-cone:D1.2xL1.6xA8", "cylinder:D1.2xL4.0xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    ASSERT_TRUE(is_convex(bur.profile()));
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0.6, -0.8, 0), Vec3(0.98, 0.1, 0.01),
                            Vec3(0.9, 0.2, 0.1), Vec3(0.3, -0.9, -0.3), Vec3(-0.5, 0.4, 0.6)}) {
      const Vec3 along = way.normalized();
      SweptOutline outline;
      ASSERT_TRUE(outline.draw(bur.profile(), along)) << spec;
      for (int i = 0; i < 200; ++i) {
        const Vec3 at{draw(-0.8, 0.8), draw(-0.8, 0.8), draw(-0.2, 1)};
        const Nearest nearest = nearest_of(bur, at, along, -2.5, 2.5);
        if (std::abs(nearest.distance) > 0.2) continue;
        const SweptOutline::Axes& axes = outline.axes();
        const auto f = [](double x) { return all4(static_cast<float>(x)); };
        const SweptOutline::Sample s = outline.at(f(axes.beside.dot(at)), f(axes.up.dot(at)));
        EXPECT_NEAR(double{s.value[0]}, -nearest.distance, 4e-4)
            << spec << ", way " << along.transpose() << ", at " << at.transpose();
        if (std::abs(nearest.distance) > 0.1) continue;
        const double here = axes.along.dot(at);
        for (const double touches : {double{s.from[0]}, double{s.to[0]}})
          EXPECT_NEAR(
              nearest_of(bur, at, along, here - touches - 0.002, here - touches + 0.002).distance,
              nearest.distance, 4e-4)
              << spec << ", way " << along.transpose() << ", at " << at.transpose();
      }
    }
  }
}

TEST(SweptOutline, ThereIsNoneAlongTheAxis) {
  SweptOutline outline;
  EXPECT_FALSE(outline.draw(make_bur("ball:D1.2", "").profile(), Vec3(0, 0, -1)));
}

}  // namespace
}  // namespace toothprep
