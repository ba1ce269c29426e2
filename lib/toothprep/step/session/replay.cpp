#include "toothprep/step/session/replay.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "toothprep/step/core/errors.h"

namespace toothprep {

ReplayResult replay(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                    const std::vector<HandleSample>& path,
                    const std::function<void(double)>& progress) {
  if (path.size() < 2) throw Error("a trajectory needs at least two samples");
  using Clock = std::chrono::steady_clock;
  if (path.front().rejected) throw Error("the first sample of a trajectory must not be rejected");
  Session session(bur, workpiece, parameters, drive, path.front());
  ReplayResult result;
  result.rows.reserve(path.size());
  result.rows.push_back(session.initial());
  std::vector<float> step_us;
  step_us.reserve(path.size());
  for (std::size_t i = 1; i < path.size(); ++i) {
    const auto start = Clock::now();
    result.rows.push_back(session.step(path[i]));
    const std::chrono::duration<double, std::micro> us = Clock::now() - start;
    step_us.push_back(static_cast<float>(us.count()));
    result.seconds_computed += us.count() * 1e-6;
    if (progress && i % 1024 == 0)
      progress(static_cast<double>(i) / static_cast<double>(path.size()));
  }
  session.finish(result.rows.back());

  result.totals = session.totals();
  for (int k = 0; k < kTissueCount; ++k)
    result.removed_energy += parameters.tissue[k].specific_energy * result.totals.removed[k];
  result.energy_ratio = result.removed_energy > 0
                            ? result.totals.torque_work / result.removed_energy
                            : std::numeric_limits<double>::quiet_NaN();
  result.seconds_simulated = path.back().time - path.front().time;
  std::sort(step_us.begin(), step_us.end());
  result.step_us_p50 = step_us[step_us.size() / 2];
  result.step_us_p99 = step_us[step_us.size() * 99 / 100];
  result.step_us_max = step_us.back();
  return result;
}

double distance_to_tooth(const std::vector<HandleSample>& path, const Box& box) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const HandleSample& s : path) {
    if (s.rejected) continue;
    const Vec3 outside = (box.min - s.pose.position).cwiseMax(s.pose.position - box.max);
    nearest = std::min(nearest, outside.cwiseMax(0.0).norm());
  }
  return nearest;
}

}  // namespace toothprep
