// What drawn edges cut against the least distance of a bur that goes along its way.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/swept_slot.h"

namespace toothprep::testing {
namespace {

// Of a place (mm, B) from a bur that goes from `from` to `to` (mm) along a way, as removal measures it; and where on the
// way that is. Of a convex solid there is one least value.
struct Nearest {
  double distance, at;
};
Nearest nearest_of(const Bur& bur, const Vec3& place, const Vec3& along, double from, double to) {
  const auto distance = [&](double way) {
    const Vec3 q = place - way * along;
    const auto r = static_cast<float>(std::hypot(q.x(), q.y())), z = static_cast<float>(q.z());
    float d;
    bur.mitred_distances(&r, &z, &d, 1);
    return double{d};
  };
  for (int i = 0; i < 60; ++i) {
    const double a = from + (to - from) / 3, c = to - (to - from) / 3;
    if (distance(a) < distance(c))
      to = c;
    else
      from = a;
  }
  return {distance((from + to) / 2), (from + to) / 2};
}

// Leant along the way and beside it, and plunged.
std::vector<Vec3> ways() {
  std::vector<Vec3> all = {Vec3(0, 0, -1), Vec3(0.3, 0.1, -0.9)};
  for (const double lean : {0.05, -0.17, 0.35})
    for (const double beside : {0.0, 0.6})
      all.emplace_back(std::cos(beside), std::sin(beside), std::tan(lean));
  for (Vec3& way : all) way.normalize();
  return all;
}

struct Draw {  // places, mm
  std::mt19937 numbers{1};
  double operator()(double low, double high) {
    return low + (high - low) * static_cast<double>(numbers()) / 4294967296.0;
  }
};

// Where an edge says that it is nearest, it is, and as far as it says. That it is said wherever it is true shows in the
// whole slot, below.
TEST(SweptEdge, IsAsFarAsTheNearestPlaceOfTheBurOnItsWay) {
  Draw draw;
  for (const char* spec : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8"}) {
    const Bur bur = make_bur(spec, "");
    const std::vector<SharpEdge> edges = sharp_edges(bur.profile());
    ASSERT_EQ(edges.size(), 1u) << spec;
    SweptEdge edge(edges.front());
    int counted = 0, others = 0;
    for (const Vec3& way : ways()) {
      edge.move(way);
      ASSERT_TRUE(edge.draws());
      for (int i = 0; i < 400; ++i) {
        const double angle = draw(-units::kPi, units::kPi), r = draw(0.3, 0.75);
        const Vec3 at(r * std::cos(angle), r * std::sin(angle), draw(-0.15, 0.15));
        const Nearest nearest = nearest_of(bur, at, way, -1.5, 1.5);
        const auto f = [](double x) { return all4(static_cast<float>(x)); };
        const SweptEdge::Sample s =
            edge.at(edge.across(f(at.x()), f(at.y()), f(at.z() - double{edge.height()})));
        const double distance = double{s.distance[0]};
        if (!s.counts[0]) {
          ++others;
          continue;
        }
        ++counted;
        EXPECT_NEAR(distance, nearest.distance, 2e-5)
            << spec << ", way " << way.transpose() << ", at " << at.transpose();
        const double there = double{edge.way_to(f(at.z()), s.distance)[0]};
        EXPECT_NEAR(nearest_of(bur, at, way, there, there).distance, distance, 2e-5)
            << spec << ", way " << way.transpose() << ", at " << at.transpose();
      }
    }
    EXPECT_GT(counted, 300) << spec;
    EXPECT_GT(others, 300) << spec;
  }
}

TEST(SweptEdge, DrawsNothingSquareToTheAxis) {
  SweptEdge edge(sharp_edges(make_bur("cylinder:D1.2xL3.0", "").profile()).front());
  edge.move(Vec3(1, 0, 0));
  EXPECT_FALSE(edge.draws());
}

// The bur's outline is what it leaves then.
TEST(SweptSlot, SquareToTheAxisHasTheDistanceFromTheOutlineWithRoundedCorners) {
  Draw draw;
  for (const char* spec : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8",
                           "cylinder:D1.2xL4.0xR0.3", "cone:D1.6xL4.0xT1.2xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    std::optional<SweptSlot> slot = SweptSlot::of(bur.profile());
    ASSERT_TRUE(slot) << spec;
    ASSERT_TRUE(slot->move(Vec3(0.6, 0.8, 0))) << spec;
    for (int i = 0; i < 400; ++i) {
      const double l = draw(-0.75, 0.75), h = draw(-0.1, 0.5);
      const SweptSlot::Sample s =
          slot->at({all4(static_cast<float>(l)), all4(static_cast<float>(h))});
      float r = static_cast<float>(std::abs(l)), z = static_cast<float>(h), distance = 0;
      bur.mitred_distances(&r, &z, &distance, 1);
      if (s.value[0] > 0.25f) continue;
      EXPECT_NEAR(double{s.value[0]}, -double{distance}, 2e-5) << spec << ' ' << l << ' ' << h;
      const SweptSlot::Place found = slot->place_of(s);
      EXPECT_NEAR(double{slot->at(found).value[0]}, double{s.value[0]}, 2e-5) << spec;
    }
  }
  EXPECT_FALSE(SweptSlot::of(make_bur("ball:D1.2", "").profile()));
}

TEST(SweptSlot, HasTheDistanceOfItsNearestFloorOrWallAndItsGradient) {
  Draw draw;
  constexpr float kStep = 1e-2f, kDeep = 0.3f, kInArc = 0.25f;
  for (const char* spec : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8",
                           "cylinder:D1.2xL4.0xR0.3", "cone:D1.6xL4.0xT1.2xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    SweptSlot slot = SweptSlot::of(bur.profile()).value();
    for (const Vec3& way : ways()) {
      if (!slot.move(way)) continue;
      for (int i = 0; i < 200; ++i) {
        const double angle = draw(-units::kPi, units::kPi), r = draw(0.3, 0.75);
        const Vec3 at(r * std::cos(angle), r * std::sin(angle), draw(-0.1, 0.4));
        const auto f = [](double x) { return all4(static_cast<float>(x)); };
        const SweptEdge& edge = slot.edge();
        const SweptSlot::Place place =
            edge.across(f(at.x()), f(at.y()), f(at.z() - double{edge.height()}));
        const SweptSlot::Sample s = slot.at(place);
        if (!slot.has_sharp_edge() && s.value[0] > kInArc) continue;  // as deep as its centre
        EXPECT_NEAR(double{s.value[0]}, -nearest_of(bur, at, way, -3, 3).distance, 2e-5)
            << spec << ", way " << way.transpose() << ", at " << at.transpose();
        if (s.value[0] > kDeep) continue;  // as near to the other wall
        // Back from value and gradient to the place; along a wall it isn't known where.
        const SweptSlot::Place found = slot.place_of(s);
        EXPECT_NEAR(double{slot.at(found).value[0]}, double{s.value[0]}, 2e-5) << spec;
        const SweptSlot::Sample ahead = slot.at(place + all4(kStep) * s.gradient);
        const double steep = double{s.gradient.l[0]} * double{s.gradient.l[0]} +
                             double{s.gradient.h[0]} * double{s.gradient.h[0]};
        EXPECT_GE(double{ahead.value[0] - s.value[0]}, -1e-5) << spec;
        EXPECT_LE(double{ahead.value[0] - s.value[0]}, double{kStep} * steep * 1.0001 + 1e-5)
            << spec;
      }
    }
  }
}

}  // namespace
}  // namespace toothprep::testing
