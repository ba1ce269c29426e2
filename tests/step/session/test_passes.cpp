// Overlapping passes, as every real cavity is cut: the work of the torque over each pass is the
// specific energy of what the pass newly sweeps. Expected from the union of the swept outlines
// (proof/reference/swept_passes.h), checked here against closed forms first.
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/proof/reference/swept_passes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::testing {
namespace {

constexpr double kLength = 3;  // mm, of the block along the feed
constexpr double kStart = 3;   // mm before and behind its middle: the head is clear of it

// The bur upright over the block's top face, then leant across the feed and along it.
Quat upright_leant(double across, double along) {
  return Quat(Eigen::AngleAxisd(across, Vec3::UnitX()) * Eigen::AngleAxisd(along, Vec3::UnitZ()) *
              Eigen::AngleAxisd(-units::kPi / 2, Vec3::UnitX()));
}

struct Passes {
  const char* bur;
  double depth;          // of the tip below the top face, mm
  double across, along;  // rad
  double enamel;         // mm
  std::vector<double> z;
  double speed = 8;  // mm/s
};

struct Work {
  double pass = 0, back = 0;  // mJ: along the pass, and back through its own slot
};

std::vector<Work> work_of(const Passes& p, double voxel) {
  const Bur bur = make_bur(p.bur, "");
  const LayeredTooth tooth = block(voxel, p.enamel, Vec3(kLength, 3, 4));
  Parameters parameters = paper_without_stall();
  const Quat q = upright_leant(p.across, p.along);
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -p.depth, p.z.front()), q}, kPedalButton};
  Session session(bur, workpiece, parameters, Drive::kDirect, handle);
  const auto cut_to = [&](double x) {
    const double before = session.totals().torque_work, from = handle.pose.position.x();
    const int steps = static_cast<int>(std::ceil(std::abs(x - from) / p.speed / 1e-3));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position.x() = from + (x - from) * i / steps;
      session.step(handle);
    }
    return session.totals().torque_work - before;
  };
  std::vector<Work> work;
  for (const double z : p.z) {
    // To the start of the pass with the motor off: nothing is ground on the way.
    handle.pose.position = Vec3(-kStart, -p.depth, z);
    handle.buttons = 0;
    session.step(handle);
    handle.buttons = kPedalButton;
    const double pass = cut_to(kStart);
    work.push_back({pass, cut_to(-kStart)});
  }
  return work;
}

// The forces of each pass while the tip is within half a millimetre of the block's middle.
std::vector<std::vector<Vec3>> forces_in_the_middle(const Passes& p, double voxel) {
  const Bur bur = make_bur(p.bur, "");
  const LayeredTooth tooth = block(voxel, p.enamel, Vec3(kLength, 3, 4));
  const Quat q = upright_leant(p.across, p.along);
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -p.depth, p.z.front()), q}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  std::vector<std::vector<Vec3>> forces;
  for (const double z : p.z) {
    forces.emplace_back();
    handle.pose.position = Vec3(-kStart, -p.depth, z);
    handle.buttons = 0;
    session.step(handle);
    handle.buttons = kPedalButton;
    for (double x = -kStart; x <= kStart; x += p.speed * 1e-3) {
      handle.time += 1e-3;
      handle.pose.position.x() = x;
      const StepRecord row = session.step(handle);
      if (std::abs(x) < 0.5) forces.back().push_back(row.grinding_force);
    }
  }
  return forces;
}

std::vector<double> energy_of(const Passes& p) {
  std::vector<Vec3> tips;
  for (const double z : p.z) tips.emplace_back(0, -p.depth, z);
  std::vector<double> energy;
  for (const PerTissue<double>& area :
       reference::newly_swept_sections(make_bur(p.bur, ""), upright_leant(p.across, p.along), tips,
                                       reference::Block{Vec3(kLength, 3, 4), p.enamel}))
    energy.push_back(kLength * (300 * area[0] + 100 * area[1]));
  return energy;
}

// The largest errors. Allowed are `of_pass` of the pass's own energy or `of_slot` of the first's,
// whichever is larger: a chip can be as thin as the error of a voxel's wall.
struct Errors {
  double beyond = 0;  // of a pass: over what is allowed, 1 being just that
  double back = 0;    // relative to the first
};
Errors errors_of(const Passes& p, double voxel, double of_pass = 0.01, double of_slot = 0.002) {
  const std::vector<double> energy = energy_of(p);
  const std::vector<Work> work = work_of(p, voxel);
  Errors e;
  std::printf("%-28s tilt %4.2f %4.2f, %.3f mm:", p.bur, p.across, p.along, voxel);
  for (std::size_t i = 0; i < work.size(); ++i) {
    const double error = std::abs(work[i].pass - energy[i]);
    e.beyond = std::max(e.beyond, error / std::max(of_pass * energy[i], of_slot * energy[0]));
    e.back = std::max(e.back, std::abs(work[i].back) / energy[0]);
    std::printf("  %.4f (%+.2f %%, back %.2f %%)", work[i].pass / energy[i],
                100 * (work[i].pass - energy[i]) / energy[0], 100 * work[i].back / energy[0]);
  }
  std::printf("\n");
  return e;
}

TEST(SweptSections, OfUprightBallsAndCylindersAreTheClosedForms) {
  // A cylinder newly sweeps step x depth; a ball that is half immersed, the strip between two arcs.
  const Passes cylinder{"cylinder:D1.2xL3.0", 1.1, 0, 0, 2, {0, 0.2, 0.37}};
  const std::vector<double> c = energy_of(cylinder);
  EXPECT_NEAR(c[0], kLength * 300 * 1.2 * 1.1, 1e-3 * c[0]);
  EXPECT_NEAR(c[1], kLength * 300 * 0.2 * 1.1, 1e-3 * c[0]);
  EXPECT_NEAR(c[2], kLength * 300 * 0.17 * 1.1, 1e-3 * c[0]);
  const double R = 0.6, s = 0.2;
  const std::vector<double> b = energy_of({"ball:D1.2", 0.6, 0, 0, 2, {0, s}});
  // Two discs of radius R at distance s overlap by 2 R² acos(s/2R) - s/2 sqrt(4R² - s²), half of it
  // below the face.
  const double overlap = R * R * std::acos(s / (2 * R)) - s / 4 * std::sqrt(4 * R * R - s * s);
  EXPECT_NEAR(b[0], kLength * 300 * units::kPi * R * R / 2, 1e-3 * b[0]);
  EXPECT_NEAR(b[1], kLength * 300 * (units::kPi * R * R / 2 - overlap), 1e-3 * b[0]);
}

const std::vector<Passes>& selection() {
  static const std::vector<Passes> kCases = {
      {"ball:D1.2", 0.3, 0, 0, 2, {0, 0.2, 0.37, 0.55}},
      {"cylinder:D1.2xL3.0", 1.1, 0, 0, 2, {0, 0.2, 0.37, 0.55}},
      {"cylinder:D1.2xL3.0", 1.0, 0.31, -0.17, 0.6, {0, 0.024, 0.3, 0.9}},
      {"taper:D1.4xL4.0xT0.8", 1.2, -0.23, 0.29, 2, {0, 0.25, 0.6}},
      {"inverted-cone:D1.2xL1.6xA8", 0.8, 0.12, 0.08, 0.5, {0, 0.2, 0.5}},
      {"cone:D1.6xL4.0xT1.2xR0.3", 1.1, 0.15, 0.21, 2, {0, 0.3, 0.7}},
  };
  return kCases;
}

TEST(OverlappingPasses, WorkIsTheEnergyOfWhatIsNewlySweptAtATenthOfAMillimetre) {
  for (const Passes& p : selection()) EXPECT_LT(errors_of(p, 0.1).beyond, 1) << p.bur;
}

// A fifth of the speed: cuts come as near to the surface as before.
TEST(OverlappingPasses, ASlowBurFeelsWhatAFastOneDoes) {
  for (Passes p : {selection()[0], selection()[4]}) {
    p.speed = 1.6;
    EXPECT_LT(errors_of(p, 0.1).beyond, 1) << p.bur;
  }
}

// The first two passes.
TEST(OverlappingPasses, WorkIsThreeTimesCloserAtHalfOfThat) {
  for (Passes p : selection()) {
    p.z.resize(2);
    EXPECT_LT(errors_of(p, 0.05, 0.003, 0.0005).beyond, 1) << p.bur;
  }
}

TEST(OverlappingPasses, SideStepsFromAFiftiethToHalfOfTheDiameterAreRight) {
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL4.0xR0.3"})  // the second ends in a torus
    for (const double step : {0.024, 0.6})
      EXPECT_LT(errors_of({bur, 0.5, 0.1, -0.15, 0.3, {0, step}}, 0.1).beyond, 1)
          << bur << ", " << step;
}

TEST(OverlappingPasses, BackThroughItsOwnSlotAnUprightBurFeelsNothing) {
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL3.0"}) {
    EXPECT_LT(errors_of({bur, 0.5, 0, 0, 2, {0}}, 0.1).back, 0.001) << bur;
    EXPECT_LT(errors_of({bur, 0.5, 0, 0, 2, {0}}, 0.05).back, 0.001) << bur;
  }
}

// A bur that stands in its slot goes aside by `aside` and back in place, four times: the work of each
// turn over the energy of what the first takes, a segment of the bur's section.
std::vector<double> work_aside_and_back(double aside, double voxel) {
  const double R = 0.6, depth = 0.6, speed = 1.6;
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -depth, 0), upright_leant(0, 0)}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  const auto go = [&](const Vec3& to, double mm_s) {
    const Vec3 from = handle.pose.position;
    const int steps = static_cast<int>(std::ceil((to - from).norm() / mm_s / 1e-3 - 1e-9));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position = from + (to - from) * i / steps;
      session.step(handle);
    }
  };
  go(Vec3(kStart, -depth, 0), 8);
  go(Vec3(0, -depth, 0), speed);
  const double angle = std::acos(1 - aside / R);
  const double energy = 300 * depth * R * R * (angle - std::sin(angle) * std::cos(angle));
  std::vector<double> work;
  for (int turn = 0; turn < 4; ++turn) {
    const double before = session.totals().torque_work;
    go(Vec3(0, -depth, aside), speed);
    go(Vec3(0, -depth, 0), speed);
    work.push_back((session.totals().torque_work - before) / energy);
  }
  return work;
}

// A cut is due after a voxel of way: until then the second turn may meet the same tissue. What is
// left afterwards is the wall's error on the lattice, D²/8R: 2.1 um of the 40 at a tenth of a
// millimetre, where the two outermost planes of voxels do not see the segment's tip.
TEST(OverlappingPasses, WhatIsGroundAsideAndBackInPlaceIsGroundOnce) {
  struct Case {
    double aside, voxel, first, later;
  };
  for (const Case c :
       {Case{0.04, 0.1, 0.15, 0.07}, {0.07, 0.1, 0.08, 0.01}, {0.04, 0.05, 0.05, 0.002}}) {
    const std::vector<double> work = work_aside_and_back(c.aside, c.voxel);
    std::printf("aside by %.2f mm at %.2f mm: %.4f %.4f %.4f %.4f of the energy\n", c.aside,
                c.voxel, work[0], work[1], work[2], work[3]);
    EXPECT_NEAR(work[0], 1, c.first) << c.aside << " mm, " << c.voxel;
    EXPECT_LT(work[2], c.later) << c.aside << " mm, " << c.voxel;
    EXPECT_LT(work[3], c.later) << c.aside << " mm, " << c.voxel;
  }
}

// In the middle of the block the force is level: its vector against the integral over the part of
// the bur's surface that no earlier pass has been at.
TEST(OverlappingPasses, ForceVectorsAreThoseOfTheExactIntegralOverTheEngagedSurface) {
  for (const std::size_t chosen : {0, 2, 4}) {
    const Passes& p = selection()[chosen];
    const Bur bur = make_bur(p.bur, "");
    const Parameters parameters = paper_without_stall();
    const reference::Scene scene =
        reference::make_scene(bur, {Vec3(kLength, 3, 4), p.enamel}, parameters);
    std::vector<Vec3> tips;
    for (const double z : p.z) tips.emplace_back(0, -p.depth, z);
    const std::vector<reference::Load> loads =
        reference::loads_in_swept(scene, bur, upright_leant(p.across, p.along), tips,
                                  std::vector<double>(tips.size(), p.speed));
    const std::vector<std::vector<Vec3>> forces = forces_in_the_middle(p, 0.1);
    double full = 0;
    for (std::size_t i = 0; i < p.z.size(); ++i) {
      const Vec3 exact = loads[i].force;
      full = std::max(full, exact.norm());
      double square = 0;
      for (const Vec3& f : forces[i]) square += (f - exact).squaredNorm();
      const double rms = std::sqrt(square / static_cast<double>(forces[i].size()));
      std::printf("%-28s pass %zu: exact %.4f N, RMS %.2f %% of it, %.2f %% of a full slot\n",
                  p.bur, i, exact.norm(), 100 * rms / exact.norm(), 100 * rms / full);
      // A chip as thin as a voxel's wall error: of a full slot's force.
      EXPECT_LT(rms, std::max(0.01 * exact.norm(), 0.002 * full)) << p.bur << ", pass " << i;
    }
  }
}

TEST(ElementSize, AboveAQuarterOfTheBursRadiusIsRefusedWithTheLargestThatWouldDo) {
  Parameters p = paper_without_stall();
  const Bur ball = paper_ball();  // R = 0.6 mm
  EXPECT_EQ(element_size(ball, p), kElementSize);
  EXPECT_EQ(element_size(make_bur("ball:D0.2", ""), p), 0.1 / 8);
  p.element_size = 0.15;
  EXPECT_EQ(element_size(ball, p), 0.15);
  p.element_size = 0.16;
  try {
    element_size(ball, p);
    FAIL() << "not refused";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("engine.element_mm"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("use at most 0.150000 mm"), std::string::npos);
  }
}

}  // namespace
}  // namespace toothprep::testing
