// How far a coupled bur's force rises within a layer.
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/proof/reference/rise_in_layer.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::reference {
namespace {

const Vec3 kStart(0, 0.6, -1.5);

Scene scene_of(double rate, double u) {
  Parameters p = preset_parameters("paper");
  p.handpiece.rotation_rate = rate;
  p.tissue[0].specific_energy = u;
  return make_scene(bur_from_shorthand("cylinder:D1.2xL3.0"), {}, p);
}

double share(double k, double rate = 100, double u = 300) {
  return share_of_plateau(scene_of(rate, u), kStart, 2, 0.5, k);
}

TEST(RiseInLayer, DependsOnStiffnessOverResistanceAlone) {
  // B is in proportion to u/N: the same k/B, the same share.
  EXPECT_NEAR(share(2, 50), share(1, 100), 1e-5);
  EXPECT_NEAR(share(0.5, 100, 150), share(1, 100), 1e-5);
}

TEST(RiseInLayer, GrowsWithTheStiffnessTowardsDirectDrive) {
  double last = 0;
  for (const double k : {0.1, 0.3, 1.0, 3.0, 10.0}) {
    const double now = share(k);
    EXPECT_GT(now, last) << k;
    EXPECT_LT(now, 1) << k;
    last = now;
  }
  // At k = 100 N/mm the time constant, 0.09 s, is short against 2 mm at 0.5 mm/s.
  EXPECT_NEAR(share(100), 1, 1e-3);
}

TEST(RiseInLayer, IsNoMoreThanTheClosedFormOfABurThatIsEngagedFromTheStart) {
  // F = k (v t - x) where x is the depth. A bur that is engaged little by little is held back less,
  // gets there sooner, and so has less force than one that is engaged from the start, for which
  // F/(B v) = 1 - exp(-k t/B) and x = v (t - B/k (1 - exp(-k t/B))).
  const double drag = 300 * 3.0 / (4 * 0.25 * 100), k = 1, v = 0.5, depth = 2;
  double low = 0, high = 100;
  for (int i = 0; i < 60; ++i) {
    const double t = (low + high) / 2;
    (v * (t - drag / k * (1 - std::exp(-k * t / drag))) < depth ? low : high) = t;
  }
  const double engaged = 1 - std::exp(-k * low / drag);
  EXPECT_LT(share(k), engaged);
  EXPECT_GT(share(k), 0.8 * engaged);  // for the last 1.4 of the 2 mm it is engaged whole
}

TEST(RiseInLayer, RefusesWhatMakesNoSense) {
  EXPECT_THROW(share(0), Error);
  EXPECT_THROW(static_cast<void>(share_of_plateau(scene_of(100, 300), kStart, 9, 0.5, 1)), Error);
  EXPECT_THROW(static_cast<void>(share_of_plateau(scene_of(100, 300), kStart, 2, 0, 1)), Error);
}

}  // namespace
}  // namespace toothprep::reference
