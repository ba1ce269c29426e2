#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/known_sweep.h"
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
  scan(std::max(from, nearest.at - 0.03), std::min(to, nearest.at + 0.03));
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
              nearest_of(bur, at, along, here - touches - 0.03, here - touches + 0.03).distance,
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

// Square to the axis, hardly leaning, leaning; short and long; beside the way and around its ends. How much a bur that
// hardly leans moves along its axis is left out beside its edges (KnownSweep), but for the floor that its flat end leaves.
TEST(KnownSweep, TellsHowFarPlacesLieWithinWhatABurTookOnItsWay) {
  std::mt19937 numbers(6);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(numbers()) / 4294967296.0;
  };
  const Quat turned(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  const Lattice lattice{Vec3(-3, 1, 2), 0.1};
  const Index3 base(7, -4, 12);
  for (const char* spec : {"ball:D1.2", "cylinder:D1.2xL3.0", "taper:D1.4xL4.0xA4",
                           "inverted-cone:D1.2xL1.6xA8", "cylinder:D1.2xL4.0xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    const ConvexProfile standing(bur.profile());
    for (const Vec3& way : {Vec3(0.05, 0, 0), Vec3(0.7, -0.6, 0), Vec3(0.08, 0.01, 0.004),
                            Vec3(-0.06, 0, -0.0045), Vec3(0.1, 0.02, 0.04), Vec3(0.3, 0.4, -0.3)}) {
      const StraightSweep sweep{Pose{Vec3(1, 2, 3), turned}, turned * way};
      const double length = way.norm(), lean = std::abs(way.z()),
                   allowed = 4e-4 + (lean < 0.05 * lattice.voxel ? lean : 0);
      KnownSweep known;
      ASSERT_TRUE(known.set(bur, standing, sweep, static_cast<float>(lattice.voxel)));
      known.put(lattice, base);
      const auto value_at = [&](const Vec3& at) {
        const Vec3 voxels = (sweep.from.to_world(at) - lattice.to_world(base)) / lattice.voxel;
        const auto f = [](double x) { return all4(static_cast<float>(x)); };
        return known.at(f(voxels.x()), f(voxels.y()), f(voxels.z()));
      };
      for (int i = 0; i < 600; ++i) {
        const bool at_floor = i >= 300;
        const Vec3 at{draw(-1, 1.4), draw(-1, 1), at_floor ? draw(-0.01, 0.01) : draw(-0.4, 1)};
        const double distance = nearest_of(bur, at, way / length, 0, length).distance;
        if (std::abs(distance) > (at_floor ? 0.01 : 0.1)) continue;
        const KnownSweep::Sample s = value_at(at);
        EXPECT_NEAR(double{s.value[0]}, -distance, at_floor ? std::min(allowed, 2e-3) : allowed)
            << spec << ", way " << way.transpose() << ", at " << at.transpose();
        // And its gradient, which at edges is that of one side, and flatter where distances are mitred.
        const Vec3 g = Vec3(s.gx[0], s.gy[0], s.gz[0]) / lattice.voxel;
        EXPECT_GT(g.norm(), 0.5);
        const double ahead = 0.01 * g.norm() * g.norm(),
                     by = double{value_at(at + 0.01 * (turned.conjugate() * g)).value[0]};
        EXPECT_LT(by - double{s.value[0]}, ahead + allowed);
      }
    }
  }
}

}  // namespace
}  // namespace toothprep
