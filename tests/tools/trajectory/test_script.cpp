#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

std::vector<HandleSample> run(const std::string& script) {
  return parse_script(script, "s.toml").samples;
}

std::string error_of(const std::string& script) {
  try {
    static_cast<void>(parse_script(script, "s.toml"));
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

double angle_between(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

const char* kTop = "start_mm = [0, 0, 0]\nrate_hz = 1000\n";

TEST(Script, ALineIsDrivenAtItsSpeedAndEndsExactlyAtItsEnd) {
  const auto s =
      run("start_mm = [1, 2, 3]\naxis = [0, 2, 0]\nrate_hz = 500\n"
          "[[segment]]\nkind = 'line'\nto_mm = [1, -0.5, 3]\nspeed_mm_s = 0.5\n");
  ASSERT_EQ(s.size(), 2501u);  // 2.5 mm at 0.5 mm/s at 500 Hz
  for (std::size_t i = 0; i < s.size(); ++i) {
    ASSERT_EQ(s[i].time, static_cast<double>(i) / 500.0);
    ASSERT_NEAR(s[i].pose.position.y(), 2.0 - 0.5 * s[i].time, 1e-12);
    ASSERT_LT(angle_between(s[i].pose.orientation * Vec3::UnitZ(), Vec3::UnitY()), 1e-12);
    ASSERT_EQ(s[i].buttons, kPedalButton);
  }
  EXPECT_EQ(s.front().pose.position, Vec3(1, 2, 3));
  EXPECT_EQ(s.back().pose.position, Vec3(1, -0.5, 3));
}

TEST(Script, TheTimeGridRunsThroughSegmentsThatEndBetweenSamples) {
  // 0.0007 s and 0.0013 s at 1 kHz: samples at 0, 1, 2 ms; the second is 0.3 ms into segment 2.
  const auto s = run(std::string(kTop) +
                     "[[segment]]\nkind='line'\nto_mm=[0.7,0,0]\nspeed_mm_s=1000\n"
                     "[[segment]]\nkind='line'\nto_mm=[0.7,1.3,0]\nspeed_mm_s=1000\npedal=false\n");
  ASSERT_EQ(s.size(), 3u);
  EXPECT_LT((s[1].pose.position - Vec3(0.7, 0.3, 0)).norm(), 1e-12);
  EXPECT_EQ(s[2].pose.position, Vec3(0.7, 1.3, 0));
  EXPECT_EQ(s[0].buttons & kPedalButton, 1u);
  EXPECT_EQ(s[1].buttons & kPedalButton, 0u);
  // An end between samples is reached by the first sample after it.
  const auto t = run(std::string(kTop) + "[[segment]]\nkind='hold'\nduration_s=0.0015\n");
  ASSERT_EQ(t.size(), 3u);
  EXPECT_EQ(t.back().time, 0.002);
}

TEST(Script, AnAcceleratedLineCoversHalfATSquared) {
  const auto s =
      run(std::string(kTop) + "[[segment]]\nkind='line'\nto_mm=[0,-2,0]\nacceleration_mm_s2=0.1\n");
  const double end = std::sqrt(2 * 2 / 0.1);
  EXPECT_EQ(s.size(), static_cast<std::size_t>(std::ceil(end * 1000)) + 1);
  for (const auto& sample : s)
    if (sample.time < end) {
      ASSERT_NEAR(sample.pose.position.y(), -0.5 * 0.1 * sample.time * sample.time, 1e-12);
    }
  EXPECT_EQ(s.back().pose.position, Vec3(0, -2, 0));
}

TEST(Script, AnAcceleratedLineStartsFromItsSpeedAndMayBrake) {
  // From 2 mm/s braking at 1 mm/s2: 1.5 mm take 1 s (2 - 1/2).
  const auto s = run(std::string(kTop) +
                     "[[segment]]\nkind='line'\nto_mm=[1.5,0,0]\nspeed_mm_s=2\n"
                     "acceleration_mm_s2=-1\n");
  ASSERT_EQ(s.size(), 1001u);
  EXPECT_NEAR(s[500].pose.position.x(), 2 * 0.5 - 0.5 * 0.25, 1e-12);
  EXPECT_THAT(
      error_of(std::string(kTop) + "[[segment]]\nkind='line'\nto_mm=[2.1,0,0]\nspeed_mm_s=2\n"
                                   "acceleration_mm_s2=-1\n"),
      HasSubstr("segment[0].acceleration_mm_s2: stops the bur after 2 of 2.1 mm"));
}

TEST(Script, AnArcKeepsItsRadiusSpeedAndSense) {
  const double degrees = 270, r = 5, v = 2;  // centre (0,3,1), start at distance 5 in y and z
  const auto s =
      run("start_mm = [1, 6, 5]\n"
          "[[segment]]\nkind='arc'\ncenter_mm=[-7,3,1]\nnormal=[3,0,0]\nangle_deg=270\n"
          "speed_mm_s=2\n");
  EXPECT_EQ(s.size(),
            static_cast<std::size_t>(std::ceil(units::from_degree(degrees) * r / v * 1000)) + 1);
  const Vec3 center(1, 3, 1);  // the foot of the start on the axis
  for (std::size_t i = 0; i + 2 < s.size(); ++i) {
    const Vec3 a = s[i].pose.position - center, b = s[i + 1].pose.position - center;
    ASSERT_NEAR(a.norm(), r, 1e-12);
    ASSERT_NEAR(a.x(), 0, 1e-12);
    ASSERT_GT(a.cross(b).x(), 0);                     // right-handed about +x
    ASSERT_NEAR((b - a).norm() * 1000, v, v * 1e-7);  // chord: 1 - (v dt / r)^2 / 24
  }
  // A quarter before the start, seen along the axis: (4, -3) instead of (3, 4).
  EXPECT_LT((s.back().pose.position - Vec3(1, 3 + 4, 1 - 3)).norm(), 1e-12);
}

TEST(Script, AnArcMayTurnBackwardsAndMoreThanOnce) {
  const auto s = run(
      "start_mm = [1, 0, 0]\n"
      "[[segment]]\nkind='arc'\ncenter_mm=[0,0,0]\nnormal=[0,0,1]\nangle_deg=-450\nspeed_mm_s=1\n");
  EXPECT_LT(s[1].pose.position.y(), 0);
  EXPECT_LT((s.back().pose.position - Vec3(0, -1, 0)).norm(), 1e-12);
  EXPECT_NEAR(s.back().time, 2.5 * units::kPi, 1e-3);
}

TEST(Script, WaypointsAreVisitedAtOneSpeed) {
  const auto s = run(std::string(kTop) +
                     "[[segment]]\nkind='waypoints'\nspeed_mm_s=2\n"
                     "points_mm=[[3,0,0],[3,0,0],[3,4,0],[0,0,0]]\n");
  EXPECT_NEAR(s.back().time, (3 + 4 + 5) / 2.0, 1e-9);
  EXPECT_LT((s[1500].pose.position - Vec3(3, 0, 0)).norm(), 1e-12);
  EXPECT_LT((s[3500].pose.position - Vec3(3, 4, 0)).norm(), 1e-12);
  for (std::size_t i = 0; i + 1 < s.size(); ++i)
    ASSERT_NEAR((s[i + 1].pose.position - s[i].pose.position).norm(), 2e-3, 1e-12);
}

// The pocket's floor is covered when every point of every layer is within half a pass distance of
// the path (a bur wider than the pass distance then leaves nothing).
TEST(Script, ALatticeCoversThePocketLayerByLayer) {
  const Vec3 origin(1, 2, 5), u(4, 0, 0), v(0, 0.6, 0.8);  // |v| = 1
  const double step = 0.3, depth = 0.5, speed = 3, plunge = 1;
  const auto s =
      run("start_mm = [1, 2, 8]\naxis = [0, -0.8, 0.6]\nrate_hz = 200\n"
          "[[segment]]\nkind='lattice'\norigin_mm=[1,2,5]\nu_mm=[4,0,0]\nv_mm=[0,0.6,0.8]\n"
          "step_mm=0.3\nlayers=3\nlayer_depth_mm=0.5\nspeed_mm_s=3\nplunge_speed_mm_s=1\n");
  const Vec3 down(0, 0.8, -0.6);  // against the bur's axis
  const int passes = 5;           // ceil(1 / 0.3) = 4 intervals of 0.25
  const double total = 3 / speed + 3 * (depth / plunge + (passes * u.norm() + v.norm()) / speed);
  EXPECT_NEAR(s.back().time, total, 1.0 / 200);
  const auto inside = [](double x, double low, double high) {
    return x >= low - 1e-9 && x <= high + 1e-9;
  };
  std::vector<std::vector<bool>> hit(3, std::vector<bool>(passes * 81, false));
  for (const auto& sample : s) {
    const Vec3 r = sample.pose.position - origin;
    if (sample.time < 3 / speed) continue;  // on the way to the origin
    const double a = r.dot(u) / 16.0, b = r.dot(v), d = r.dot(down);
    ASSERT_TRUE(inside(a, 0, 1) && inside(b, 0, 1) && inside(d, 0, 1.5)) << r.transpose();
    const double layer = d / depth, row = b / 0.25;
    if (std::abs(layer - std::round(layer)) < 1e-9 && layer > 0.5 &&
        std::abs(row - std::round(row)) < 1e-9)
      hit[static_cast<std::size_t>(std::lround(layer) - 1)]
         [static_cast<std::size_t>(std::lround(row) * 81 + std::lround(a * 80))] = true;
  }
  // One sample is 0.015 mm along a pass: every 0.05 mm cell of every pass has been visited.
  for (const auto& layer : hit)
    ASSERT_EQ(std::count(layer.begin(), layer.end(), true), passes * 81);
  EXPECT_LE(0.25, step);
  // Odd number of passes and layers, going back and forth: ends at the far corner of the last
  // layer.
  EXPECT_LT((s.back().pose.position - (origin + u + v + 1.5 * down)).norm(), 1e-12);
}

TEST(Script, AStepThatDividesTheEdgeIsKeptAndALayerlessLatticeStaysOnItsPlane) {
  const auto s = run(std::string(kTop) +
                     "[[segment]]\nkind='lattice'\norigin_mm=[0,0,0]\nu_mm=[1,0,0]\n"
                     "v_mm=[0,0.9,0]\nstep_mm=0.3\nspeed_mm_s=1\n");
  EXPECT_NEAR(s.back().time, 4 * 1 + 0.9, 1e-9);  // 4 passes, 3 steps aside
  for (const auto& sample : s) EXPECT_EQ(sample.pose.position.z(), 0);
}

TEST(Script, TheBurTurnsEvenlyByTheShortestArc) {
  const auto s =
      run("start_mm = [0,0,0]\naxis = [0,0,1]\n"
          "[[segment]]\nkind='hold'\nduration_s=2\naxis=[1,0,0]\n"
          "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=1\n"
          "[[segment]]\nkind='hold'\nduration_s=1\nspin_deg=360\n");
  ASSERT_EQ(s.size(), 4001u);
  for (std::size_t i = 0; i <= 2000; ++i) {
    const double turned = units::kPi / 2 * s[i].time / 2;
    ASSERT_LT((s[i].pose.orientation * Vec3::UnitZ() - Vec3(std::sin(turned), 0, std::cos(turned)))
                  .norm(),
              1e-12);
  }
  for (std::size_t i = 2000; i <= 4000; ++i)  // the axis stays, also while the bur spins
    ASSERT_LT((s[i].pose.orientation * Vec3::UnitZ() - Vec3::UnitX()).norm(), 1e-12);
  // A quarter of the full turn after 0.25 s: the bur's x axis is at right angles to where it was.
  EXPECT_NEAR(
      (s[3250].pose.orientation * Vec3::UnitX()).dot(s[3000].pose.orientation * Vec3::UnitX()), 0,
      1e-12);
  EXPECT_LT(s[4000].pose.orientation.angularDistance(s[3000].pose.orientation), 1e-7);
}

TEST(Script, ASegmentTurnsByThePlainSlerpOfItsEnds) {
  const auto s =
      run("start_mm=[0,0,0]\naxis=[0,1,1]\nspin_deg=20\nrate_hz=100\n"
          "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=1\naxis=[1,-1,3]\n");
  const Quat a = s.front().pose.orientation, b = s.back().pose.orientation;
  for (const auto& sample : s)
    ASSERT_LT(sample.pose.orientation.angularDistance(a.slerp(sample.time, b)), 1e-7);
  EXPECT_LT(angle_between(b * Vec3::UnitZ(), Vec3(1, -1, 3)), 1e-12);
}

TEST(Script, IsTurnedWithItsFrame) {
  // Invariance: a quarter turn of every vector about x turns every sample.
  const auto a =
      run("start_mm=[0,0,0]\n[[segment]]\nkind='arc'\ncenter_mm=[1,1,0]\nnormal=[0,0,1]\n"
          "angle_deg=100\nspeed_mm_s=3\naxis=[0,1,1]\n");
  const auto b =
      run("start_mm=[0,0,0]\naxis=[0,-1,0]\n[[segment]]\nkind='arc'\ncenter_mm=[1,0,1]\n"
          "normal=[0,-1,0]\nangle_deg=100\nspeed_mm_s=3\naxis=[0,-1,1]\n");
  const Mat3 turn = Eigen::AngleAxisd(units::kPi / 2, Vec3::UnitX()).toRotationMatrix();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_LT((turn * a[i].pose.position - b[i].pose.position).norm(), 1e-12);
    ASSERT_LT(
        (turn * (a[i].pose.orientation * Vec3::UnitZ()) - b[i].pose.orientation * Vec3::UnitZ())
            .norm(),
        1e-12);
  }
}

TEST(Script, WhatCannotBeRunIsRefusedByKey) {
  const std::string top = kTop;
  const std::string line = "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=1\n";
  const std::string arc =
      "[[segment]]\nkind='arc'\ncenter_mm=[1,0,0]\nnormal=[0,0,1]\nangle_deg=90\nspeed_mm_s=1\n";
  const auto lattice = [](const std::string& more) {
    return "[[segment]]\nkind='lattice'\norigin_mm=[0,0,0]\nu_mm=[1,0,0]\nv_mm=[0,1,0]\n"
           "speed_mm_s=1\n" +
           more;
  };
  const auto without = [](std::string text, const std::string& key) {
    const std::size_t at = text.find("\n" + key + "=");
    return text.erase(at, text.find('\n', at + 1) - at);
  };
  const std::vector<std::pair<std::string, std::string>> table = {
      {"", "start_mm: is missing"},
      {line, "start_mm: is missing"},
      {top, "segment: is missing"},
      {top + "segment = []", "segment: is missing"},
      {top + "segment = [1]", "segment[0]: must be a table"},
      {top + "[segment]\nkind='line'", "segment: must be tables"},
      {"start_mm = [0,0]\n" + line, "start_mm: must be three numbers [x, y, z], not a list of 2"},
      {"start_mm = [0,0,nan]\n" + line, "start_mm: must be finite"},
      {"start_mm = [0,0,'a']\n" + line, "start_mm: must be three numbers"},
      {"axis=[0,0,0]\n" + top + line, "axis: must not be zero"},
      {"start_mm=[0,0,0]\nrate_hz=0\n" + line, "rate_hz: must be positive"},
      {"start_mm=[0,0,0]\nrate_hz=inf\n" + line, "rate_hz: must be positive and finite"},
      {"start_mm=[0,0,0]\nrate_hz=1e12\n" + line, "rate_hz: makes more than 20000000 samples"},
      {"start=[0,0,0]\n" + top + line, "start: unknown key"},
      {top + "[[segments]]\nkind='line'\n", "did you mean 'segment'"},
      {top + "[[segment]]\nto_mm=[1,0,0]", "segment[0].kind: is missing"},
      {top + "[[segment]]\nkind='lin'", "did you mean \"line\""},
      {top + line + "speed=1\n",
       "segment[0].speed: unknown key on line 7; did you mean 'speed_mm_s'"},
      {top + without(line, "speed_mm_s"), "segment[0].speed_mm_s: is missing"},
      {top + without(line, "to_mm"), "segment[0].to_mm: is missing"},
      {top + line + line, "segment[1].to_mm: is where the bur already is"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=0",
       "speed_mm_s: must be positive"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=-1",
       "speed_mm_s: must be positive"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=nan", "speed_mm_s"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nspeed_mm_s=1e-9", "24 h"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nacceleration_mm_s2=0", "must not be 0"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nacceleration_mm_s2=-1", "stops the bur"},
      {top + "[[segment]]\nkind='line'\nto_mm=[1,0,0]\nacceleration_mm_s2=inf", "must be finite"},
      {top + "[[segment]]\nkind='hold'", "segment[0].duration_s: is missing"},
      {top + "[[segment]]\nkind='hold'\nduration_s=-1", "duration_s: must be positive"},
      {top + "[[segment]]\nkind='hold'\nduration_s=1e300", "24 h"},
      {top + "[[segment]]\nkind='hold'\nduration_s=1\naxis=[0,0,-1]", "axis: is opposite"},
      {top + "[[segment]]\nkind='hold'\nduration_s=1\npedal=1", "pedal: must be true or false"},
      {top + "[[segment]]\nkind='hold'\nduration_s=1\nspin_deg=inf", "spin_deg: must be finite"},
      {top + without(arc, "center_mm"), "center_mm: is missing"},
      {top + without(arc, "normal"), "normal: is missing"},
      {top + without(arc, "angle_deg"), "angle_deg: is missing"},
      {top + without(arc, "center_mm") + "center_mm=[0,0,9]\n", "center_mm: the bur stands on"},
      {top + without(arc, "angle_deg") + "angle_deg=0\n", "angle_deg: must be finite and not 0"},
      {top + "[[segment]]\nkind='waypoints'\nspeed_mm_s=1\npoints_mm=[]", "points_mm: is empty"},
      {top + "[[segment]]\nkind='waypoints'\nspeed_mm_s=1\npoints_mm=[[0,0,0]]", "already is"},
      {top + "[[segment]]\nkind='waypoints'\nspeed_mm_s=1\npoints_mm=[[1,0,0],[1,0]]",
       "segment[0].points_mm[1]: must be three numbers"},
      {top + lattice(""), "step_mm: is missing"},
      {top + lattice("step_mm=0"), "step_mm: must be positive"},
      {top + lattice("step_mm=1e-12"), "more than a million passes"},
      {top + lattice("step_mm=1\nlayers=0"), "layers: must be 1 or more"},
      {top + lattice("step_mm=1\nlayers=1.5"), "layers: must be a whole number"},
      {top + lattice("step_mm=1\nlayers=2"), "layer_depth_mm: must be positive"},
      {top + lattice("step_mm=1\nlayers=9000000000000000000\nlayer_depth_mm=1"), "million passes"},
      {top + lattice("step_mm=1\nlayer_depth_mm=-1"), "layer_depth_mm: must not be negative"},
      {top + without(lattice("step_mm=1"), "v_mm") + "\nv_mm=[-2,0,0]", "v_mm: is parallel"},
      {top + "[[segment]\n", "line 3"}};
  for (const auto& [script, part] : table) {
    ASSERT_THAT(error_of(script), HasSubstr(part)) << script;
    ASSERT_THAT(error_of(script), HasSubstr("s.toml: "));
  }
  EXPECT_THROW(static_cast<void>(read_script("no/such.toml")), InputError);
}

}  // namespace
}  // namespace toothprep
