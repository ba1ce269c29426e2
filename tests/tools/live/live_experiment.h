// A hand that grinds a block on the simulated device, computed as fast as possible.
#pragma once

#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/device/simulated_device.h"
#include "toothprep/tools/live/live_loop.h"

namespace toothprep::testing {

class Rows : public TickSink {
 public:
  explicit Rows(std::size_t most = 20000) { ticks.reserve(most); }
  void take(const LiveTick& tick) noexcept override {
    if (ticks.size() < ticks.capacity()) ticks.push_back(tick);
  }
  std::vector<LiveTick> ticks;
};

inline Bur paper_cylinder() { return make_bur("cylinder:D1.2xL3.0", ""); }

inline LayeredTooth enamel_block() {
  BlockOptions o;
  o.size = Vec3(6, 4, 6);
  o.enamel = 4;
  return make_block(o);
}

// From 1.2 mm beside the block into its face and along, 2 mm deep, at `speed`; frame W = D.
inline std::vector<HandleSample> slot(double speed, double seconds) {
  std::vector<HandleSample> path;
  const Pose start{Vec3(-4.8, -2, 0), orientation_of_axis(Vec3(0, 1, 0))};
  for (int n = 0; n <= static_cast<int>(seconds * 1000); ++n) {
    HandleSample s{1e-3 * n, start, kPedalButton};
    s.pose.position.x() += speed * s.time;
    path.push_back(s);
  }
  return path;
}

inline ForceLimits no_watch() {
  ForceLimits limits;
  limits.max_force = 7.9;
  limits.continuous_force = 1.75;
  return limits;
}

// W and D are the same.
inline Registration same_frame() {
  Registration r;
  r.translation = Vec3::Zero();
  return r;
}

}  // namespace toothprep::testing
