#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/known_sweep.h"
#include "toothprep/step/grinding/swept_outline.h"

namespace toothprep {
namespace {

// The outlines of all kinds, and one with an edge that is as steep on both sides.
std::vector<Bur> every_bur() {
  std::vector<Bur> burs;
  for (const char* spec :
       {"ball:D1.2", "cylinder:D1.2xL3.0", "taper:D1.4xL4.0xA4", "inverted-cone:D1.2xL1.6xA8",
        "cylinder:D1.2xL4.0xR0.3", "cylinder:D1.2xL4.0xR0.05", "round-cylinder:D1.2xL4.0",
        "cone:D1.2xL4.0xT0.6", "pear:D0.8xL1.8xA4xR0.3", "flame:D1.2xL4.0", "torpedo:D1.4xL4.0"})
    burs.push_back(make_bur(spec, ""));
  burs.emplace_back("waist",
                    std::vector{line_piece(0, 0, 0.4, 0), line_piece(0.4, 0, 0.7, 1),
                                line_piece(0.7, 1, 0.4, 2), line_piece(0.4, 2, 0, 2, false)},
                    0.4, 5);
  return burs;
}

constexpr double kAllowed = 2e-4;  // mm

struct Nearest {
  double distance, at;  // mm; along the motion
};

// The least of the distances by which removal carves, as the bur goes along `way` by so much (mm).
Nearest nearest_of(const Bur& bur, const Vec3& place, const Vec3& way, double from, double to) {
  Nearest nearest{1e9, 0};
  const auto scan = [&](double low, double high) {
    constexpr int kPlaces = 600;
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
  for (const Bur& bur : every_bur()) {
    const ConvexProfile standing(bur.profile());
    ASSERT_TRUE(standing.is_known()) << bur.name();
    for (const double rise : {1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.7, 1.0, 3.0}) {
      SweptOutline outline;
      ASSERT_TRUE(outline.set(standing, static_cast<float>(rise))) << bur.name();
      const Vec3 along = Vec3(1, 0, rise).normalized();
      for (int i = 0; i < 200; ++i) {
        const Vec3 at{draw(-0.8, 0.8), draw(-0.8, 0.8), draw(-0.2, 1)};
        const Nearest nearest = nearest_of(bur, at, along, -5, 5);
        if (std::abs(nearest.distance) > 0.2) continue;
        const auto f = [](double x) { return all4(static_cast<float>(x)); };
        const double level = at.z() - rise * at.x();
        const SweptOutline::Sample s = outline.at(f(at.y()), f(level));
        // Around the edge at the shank distances aren't mitred.
        if (std::max(level + rise * double{s.ahead[0]}, at.z() - nearest.at * along.z()) >
            bur.head_length() - 0.2)
          continue;
        EXPECT_NEAR(double{s.value[0]}, -nearest.distance, kAllowed)
            << bur.name() << ", rise " << rise << ", at " << at.transpose();
        const double r = std::hypot(at.y(), double{s.ahead[0]}),
                     way = (at.x() - double{s.ahead[0]}) / along.x();
        EXPECT_NEAR(double{s.r[0]}, r, 1e-5);
        EXPECT_NEAR(nearest_of(bur, at, along, way, way).distance, nearest.distance, kAllowed)
            << bur.name() << ", rise " << rise << ", at " << at.transpose();
        // The way changes nothing.
        EXPECT_NEAR(double{s.by_r[0] * s.ahead[0] / s.r[0] + static_cast<float>(rise) * s.by_z[0]},
                    0, 5e-3)
            << bur.name() << ", rise " << rise << ", at " << at.transpose();
      }
    }
  }
}

// Square to the axis, hardly leaning, leaning, along it; short and long; beside the way, around its ends, and near its floor.
TEST(KnownSweep, TellsHowFarPlacesLieWithinWhatABurTookOnItsWay) {
  std::mt19937 numbers(6);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(numbers()) / 4294967296.0;
  };
  const Quat turned(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  const Lattice lattice{Vec3(-3, 1, 2), 0.1};
  const Index3 base(7, -4, 12);
  for (const Bur& bur : every_bur()) {
    const ConvexProfile standing(bur.profile());
    for (const Vec3& way :
         {Vec3(0.05, 0, 0), Vec3(0.7, -0.6, 0), Vec3(0.08, 0.01, 0.004), Vec3(-0.06, 0, -0.0045),
          Vec3(0.1, 0.02, 0.04), Vec3(0.3, 0.4, -0.3), Vec3(0, 0, -0.3), Vec3(0, 0, 0.05),
          Vec3(0.01, -0.02, -0.4), Vec3(0.0004, 0.0001, -0.1284)}) {
      const StraightSweep sweep{Pose{Vec3(1, 2, 3), turned}, turned * way};
      const double length = way.norm();
      KnownSweep known;
      ASSERT_TRUE(known.set(standing, sweep));
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
        EXPECT_NEAR(double{s.value[0]}, -distance, kAllowed)
            << bur.name() << ", way " << way.transpose() << ", at " << at.transpose();
        // And its gradient, which is flatter where distances are mitred.
        const Vec3 g = Vec3(s.gx[0], s.gy[0], s.gz[0]) / lattice.voxel;
        EXPECT_GT(g.norm(), 0.5);
        const double ahead = 0.01 * g.norm() * g.norm(),
                     by = double{value_at(at + 0.01 * (turned.conjugate() * g)).value[0]};
        EXPECT_LT(by - double{s.value[0]}, ahead + kAllowed);
        // Where it changes evenly, in any direction.
        const Vec3 step = 0.005 * Vec3(draw(-1, 1), draw(-1, 1), draw(-1, 1)).normalized();
        const double later{value_at(at + step).value[0]}, before{value_at(at - step).value[0]};
        if (std::abs(later + before - 2 * double{s.value[0]}) > 1e-4) continue;
        EXPECT_NEAR(0.5 * (later - before), g.dot(turned * step), 4e-4)
            << bur.name() << ", way " << way.transpose() << ", at " << at.transpose();
      }
    }
  }
}

}  // namespace
}  // namespace toothprep
