// The run that the display is tested on: the paper's cylinder, upright, cuts a slot 6 mm long and
// 1.5 mm deep into the top of a block, from its side.
#pragma once

#include <limits>
#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/session.h"

namespace toothprep::testing {

inline LayeredTooth slot_block(double voxel = 0.1) {
  BlockOptions o;
  o.size = Vec3(9, 4, 5);
  o.enamel = 1;
  o.voxel = voxel;
  o.pose.position = Vec3(0.013, -0.021, 0.037);  // off the lattice
  return make_block(o);
}

inline Bur slot_bur() { return make_bur("cylinder:D1.2xL3.0", ""); }

constexpr double kSlotDepth = 1.5, kSlotLength = 6, kSlotStart = -4.5 - 0.7;

// At 1 kHz.
inline std::vector<HandleSample> slot_path(double speed_mm_s) {
  std::vector<HandleSample> path;
  const auto steps = static_cast<int>((kSlotLength + 0.7) / speed_mm_s * 1000);
  const Quat upright = orientation_of_axis(Vec3::UnitY());
  for (int i = 0; i <= steps; ++i)
    path.push_back({i * 1e-3,
                    Pose{Vec3(kSlotStart + speed_mm_s * 1e-3 * i, -kSlotDepth, 0), upright},
                    kPedalButton});
  return path;
}

inline Parameters slot_parameters(EngineKind engine = EngineKind::kLevelset) {
  Parameters p = preset_parameters("paper");
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  p.engine = engine;
  return p;
}

}  // namespace toothprep::testing
