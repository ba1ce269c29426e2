// The recording against what should be: limits of stability, and the same session replayed.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/device/stability_map.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

constexpr double kMovingSpeed = 0.01;  // mm/s: below it a quotient by the speed says nothing

bool same(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }
template <class Vector>
bool all_same(const Vector& a, const Vector& b) {
  for (int i = 0; i < a.size(); ++i)
    if (!same(a[i], b[i])) return false;
  return true;
}
bool all_same(const PerTissue<double>& a, const PerTissue<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), same);
}

// The first of the values that isn't the same in both, or nullptr.
const char* first_difference(const StepRecord& a, const StepRecord& b, bool with_removal) {
  if (!all_same(a.bur.position, b.bur.position)) return "the bur's position";
  if (!all_same(a.bur.orientation.coeffs(), b.bur.orientation.coeffs()))
    return "the bur's orientation";
  if (!all_same(a.bur_velocity, b.bur_velocity)) return "the bur's velocity";
  if (!all_same(a.device_force, b.device_force)) return "the device's force";
  if (!all_same(a.grinding_force, b.grinding_force)) return "the grinding force";
  if (!same(a.torque, b.torque)) return "the torque";
  if (!same(a.torque_trial, b.torque_trial)) return "the torque that the stall was judged on";
  if (!same(a.rotation_rate, b.rotation_rate)) return "the rotation rate";
  if (a.stalled != b.stalled) return "the stall";
  if (with_removal && !all_same(a.removed_volume, b.removed_volume)) return "the removed volume";
  return nullptr;
}

}  // namespace

Measured<StabilityFigures> stability_figures(const SessionRecording& r, const Parameters& p,
                                             const DeviceTraits* device, const RigMethod& method) {
  if (!device)
    return Measured<StabilityFigures>::no("the limits file has no device whose models fit \"" +
                                          r.header.device_model + "\"; add a [[device]] table");
  const double T = 1 / r.header.rate_hz;
  StabilityFigures f;
  f.device = device->name;
  f.status = device->status;
  f.count = device->encoder_count;
  if (const Measured<QuantumFigures> quantum = quantum_figures(r, method)) {
    f.count = quantum->largest;
    f.count_measured = true;
  }
  f.stiffness = p.coupling.stiffness;
  // A delay of d ticks adds to the half tick of the hold: coupling_stiffness_limit with 2 d + 1
  // times the step.
  const double held = (2.0 * device->delay_ticks + 1) * T;
  f.limit_device = coupling_stiffness_limit(device->damping, held);
  f.limit_hand = coupling_stiffness_limit(device->damping + method.hand_damping, held);
  f.limit_friction = friction_stiffness_limit(device->friction, f.count);
  f.coupling_margin = std::max(f.limit_hand, f.limit_friction) / f.stiffness;

  std::vector<double> dampings, speeds;
  for (const StepRecord& row : r.header.trace.rows) {
    const double speed = row.bur_velocity.norm();
    if (row.stalled || speed < kMovingSpeed || row.torque <= 0) continue;
    speeds.push_back(speed);
    dampings.push_back(row.grinding_force.norm() / speed);
  }
  f.speed = speeds.empty() ? method.feed_speed_mm_s : quantile(speeds, 0.5);
  if (!dampings.empty()) f.tooth_damping = quantile(dampings, 0.5);
  f.limit_linear = linear_damping_limit(device->apparent_mass, T, device->delay_ticks);
  f.limit_counts = quantisation_damping_limit(device->apparent_mass, f.speed, f.count);
  f.limit_count_friction = friction_damping_limit(device->friction, T, f.count);
  if (f.tooth_damping && *f.tooth_damping > 0)
    f.direct_margin = std::min(f.limit_linear, std::max(f.limit_counts, f.limit_count_friction)) /
                      *f.tooth_damping;
  return f;
}

std::string unreplayable(const SessionRecording& r) {
  const RecorderFigures recorder = recorder_figures(r);
  const long lost = std::max(recorder.dropped, recorder.gaps_in_count);
  if (lost > 0) return std::to_string(lost) + " ticks lack that the recorder dropped";
  if (r.header.trace.rows.size() < 2) return "fewer than two rows";
  return {};
}

Measured<ReplayFigures> compare_replay(const SessionRecording& r,
                                       const std::vector<StepRecord>& replayed) {
  const std::vector<StepRecord>& rows = r.header.trace.rows;
  if (const std::string reason = unreplayable(r); !reason.empty())
    return Measured<ReplayFigures>::no(reason);
  if (rows.size() != replayed.size())
    return Measured<ReplayFigures>::no("the replay has another number of rows");
  ReplayFigures f;
  f.rows = static_cast<long>(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const StepRecord &a = rows[i], &b = replayed[i];
    // What is due is removed at the end only if the session came to its end.
    const bool with_removal = i + 1 < rows.size() || r.complete;
    f.largest_force = std::max(f.largest_force, (a.device_force - b.device_force).norm());
    f.largest_position = std::max(f.largest_position, (a.bur.position - b.bur.position).norm());
    f.largest_torque = std::max(f.largest_torque, std::abs(a.torque - b.torque));
    for (std::size_t k = 0; with_removal && k < a.removed_volume.size(); ++k)
      f.largest_removal =
          std::max(f.largest_removal, std::abs(a.removed_volume[k] - b.removed_volume[k]));
    const char* const what = first_difference(a, b, with_removal);
    if (!what) continue;
    if (f.differing++ == 0) {
      f.first_at = a.handle.time;
      f.first_what = what;
    }
  }
  return f;
}

}  // namespace toothprep
