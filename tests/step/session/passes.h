// Straight passes of a bur through a block, one beside the other, and the exact energy of what each newly
// sweeps: shared by the tests of fresh slots, of chosen passes and of passes drawn by lot.
#pragma once

#include <gtest/gtest.h>

#include <optional>

#include "experiment.h"
#include "toothprep/proof/reference/swept_passes.h"
#include "toothprep/step/core/units.h"

namespace toothprep::testing {

constexpr double kLength = 3;  // mm, of the block along the feed
constexpr double kStart = 3;   // mm before and behind its middle: the head is clear of it

// The bur upright over the block's top face, then leant across the feed and along it.
inline Quat upright_leant(double across, double along) {
  return Quat(Eigen::AngleAxisd(across, Vec3::UnitX()) * Eigen::AngleAxisd(along, Vec3::UnitZ()) *
              Eigen::AngleAxisd(-units::kPi / 2, Vec3::UnitX()));
}

struct LeantBur {
  const char* bur;
  double across, along;  // rad
};

struct Passes {
  const char* bur;
  double depth;          // of the tip below the top face, mm
  double across, along;  // rad
  double enamel;         // mm
  std::vector<double> z;
  double speed = 8;         // mm/s
  double element_size = 0;  // mm; 0: the default
  bool forgets = false;  // back in a new session, which knows of the cut but not of the bur's way
  std::vector<double> deeper = {};  // than `depth`, of each pass, mm; empty: none
  // Each pass in a session of its own on the tooth that the one before left, with what that keeps of the burs' ways, or
  // without it, as after the other engine.
  bool each_alone = false, way_unknown = false;
  std::vector<LeantBur> others =
      {};  // of the passes after the first; empty: as that. Each in a session of its own

  LeantBur bur_of(std::size_t pass) const {
    return pass == 0 || others.empty() ? LeantBur{bur, across, along} : others[pass - 1];
  }
  Quat lean_of(std::size_t pass) const {
    return upright_leant(bur_of(pass).across, bur_of(pass).along);
  }
  double depth_of(std::size_t pass) const { return depth + (deeper.empty() ? 0 : deeper[pass]); }
};

struct Work {
  double pass = 0, back = 0;  // mJ: along the pass, and back through its own slot
};

// Of each pass.
inline std::vector<Bur> burs_of(const Passes& p) {
  std::vector<Bur> burs;
  for (std::size_t i = 0; i < p.z.size(); ++i) burs.push_back(make_bur(p.bur_of(i).bur, ""));
  return burs;
}

inline std::vector<Work> work_of(const Passes& p, double voxel) {
  const std::vector<Bur> burs = burs_of(p);
  LayeredTooth tooth = block(voxel, p.enamel, Vec3(kLength, 3, 4));
  Parameters parameters = paper_without_stall();
  parameters.element_size = p.element_size;
  std::optional<Workpiece> workpiece(std::in_place, tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -p.depth, p.z.front()), p.lean_of(0)}, kPedalButton};
  std::optional<Session> session(std::in_place, burs[0], *workpiece, parameters, Drive::kDirect,
                                 handle);
  StepRecord last;
  const auto cut_to = [&](double x, Session& by) {
    const double before = by.totals().torque_work, from = handle.pose.position.x();
    const int steps = static_cast<int>(std::ceil(std::abs(x - from) / p.speed / 1e-3));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position.x() = from + (x - from) * i / steps;
      last = by.step(handle);
    }
    return by.totals().torque_work - before;
  };
  std::vector<Work> work;
  for (std::size_t i = 0; i < p.z.size(); ++i) {
    // To the start of the pass with the motor off: nothing is ground on the way.
    handle.pose = Pose{Vec3(-kStart, -p.depth_of(i), p.z[i]), p.lean_of(i)};
    if (i > 0 && (p.each_alone || !p.others.empty())) {
      session->finish(last);
      session.reset();
      if (p.each_alone) {
        apply_cut(tooth, *workpiece);
        if (p.way_unknown) tooth.parts->way.reset();
        workpiece.emplace(tooth);
      }
      session.emplace(burs[i], *workpiece, parameters, Drive::kDirect, handle);
    }
    handle.buttons = 0;
    session->step(handle);
    handle.buttons = kPedalButton;
    const double pass = cut_to(kStart, *session);
    if (p.forgets) {
      session->finish(last);
      LayeredTooth left = tooth;
      apply_cut(left, *workpiece);
      left.parts->way.reset();
      Workpiece without_way(left);
      Session other(burs[i], without_way, parameters, Drive::kDirect, handle);
      work.push_back({pass, cut_to(-kStart, other)});
    } else {
      work.push_back({pass, cut_to(-kStart, *session)});
    }
  }
  return work;
}

// The forces of each pass while the tip is within half a millimetre of the block's middle.
inline std::vector<std::vector<Vec3>> forces_in_the_middle(const Passes& p, double voxel) {
  const Bur bur = make_bur(p.bur, "");
  const LayeredTooth tooth = block(voxel, p.enamel, Vec3(kLength, 3, 4));
  const Quat q = upright_leant(p.across, p.along);
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -p.depth, p.z.front()), q}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  std::vector<std::vector<Vec3>> forces;
  for (std::size_t i = 0; i < p.z.size(); ++i) {
    forces.emplace_back();
    handle.pose.position = Vec3(-kStart, -p.depth_of(i), p.z[i]);
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

// Of a first pass, while the tip is within half a millimetre of the block's middle, mJ/mm.
inline double work_per_mm_in_the_middle(const Passes& p, double voxel) {
  const Bur bur = make_bur(p.bur, "");
  const LayeredTooth tooth = block(voxel, p.enamel, Vec3(kLength, 3, 4));
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -p.depth, 0), upright_leant(p.across, p.along)},
                      kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  double before = 0, from = -kStart;
  for (double x = -kStart; x <= 0.5; x += p.speed * 1e-3) {
    if (x < -0.5) before = session.totals().torque_work, from = x;
    handle.time += 1e-3;
    handle.pose.position.x() = x;
    session.step(handle);
  }
  return (session.totals().torque_work - before) /
         (handle.pose.position.x() - from + p.speed * 1e-3);
}

inline std::vector<double> energy_of(const Passes& p) {
  const std::vector<Bur> burs = burs_of(p);
  std::vector<reference::StraightPass> passes;
  for (std::size_t i = 0; i < p.z.size(); ++i)
    passes.push_back(
        {p.others.empty() ? &burs[0] : &burs[i], p.lean_of(i), Vec3(0, -p.depth_of(i), p.z[i])});
  std::vector<double> energy;
  for (const PerTissue<double>& area :
       reference::newly_swept_sections(passes, reference::Block{Vec3(kLength, 3, 4), p.enamel}))
    energy.push_back(kLength * (300 * area[0] + 100 * area[1]));
  return energy;
}

// The largest errors. Allowed are `of_pass` of the pass's own energy or `of_slot` of the first's,
// whichever is larger: a chip can be as thin as the error of a voxel's wall.
struct Errors {
  double beyond = 0;  // of a pass: over what is allowed, 1 being just that
  double back = 0;    // relative to the first
};
inline Errors errors_of(const Passes& p, double voxel, double of_pass = 0.01,
                        double of_slot = 0.002) {
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

// And back through its own slot, upright or leant, a bur feels nothing.
inline void expect_right(const Passes& p, const Errors& e) {
  EXPECT_LT(e.beyond, 1) << p.bur << ", leant by " << p.across << ", " << p.along;
  EXPECT_LT(e.back, 0.001) << p.bur << ", leant by " << p.across << ", " << p.along;
}

}  // namespace toothprep::testing
