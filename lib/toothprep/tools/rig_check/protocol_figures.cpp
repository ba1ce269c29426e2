#include "toothprep/tools/rig_check/protocol_figures.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/device/closed_loop.h"
#include "toothprep/tools/device/high_pass_rms.h"

namespace toothprep {
namespace {

constexpr double kTouching = 0.02;        // N: below it the wall counts as not touched
constexpr double kSpeedBlock = 0.05;      // s: a vibration above 20 Hz cancels out
constexpr double kShortestSignal = 0.2;   // s: for an rms above 20 Hz
constexpr std::size_t kFewestTicks = 20;  // of a level that was stopped for vibrating
constexpr double kGovernorLeast = 0.2;    // N: no governor stops what vibrates less

double protocol_time(const SessionRecording& r, std::size_t row) {
  return r.header.trace.rows[row].handle.time - r.header.trace.rows[0].handle.time;
}

// The force that answers the reading of `row`, as it was sent.
const Vec3& answer(const SessionRecording& r, std::size_t row) { return r.force_sent[row + 1]; }

// Of a signal too short to resolve 20 Hz: about its mean.
double rms_of_axes(const std::vector<Vec3>& forces, double rate) {
  double sum = 0;
  if (static_cast<double>(forces.size()) * kVibrationCorner < 2 * rate) {
    Vec3 mean = Vec3::Zero();
    for (const Vec3& f : forces) mean += f / static_cast<double>(forces.size());
    for (const Vec3& f : forces) sum += (f - mean).squaredNorm();
    return std::sqrt(sum / static_cast<double>(forces.size()));
  }
  std::vector<double> signal(forces.size());
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < forces.size(); ++i) signal[i] = forces[i][axis];
    const double rms = rms_above(signal, rate, kVibrationCorner);
    sum += rms * rms;
  }
  return std::sqrt(sum);
}

// Speed along the path of the means of blocks, in which a vibration cancels out.
double slow_speed(const SessionRecording& r, const std::vector<std::size_t>& rows) {
  const auto block = static_cast<std::size_t>(std::lround(kSpeedBlock * r.header.rate_hz));
  std::vector<Vec3> means;
  for (std::size_t begin = 0; begin + block <= rows.size(); begin += block) {
    means.emplace_back(Vec3::Zero());
    for (std::size_t i = begin; i < begin + block; ++i)
      means.back() += r.device_position[rows[i]] / static_cast<double>(block);
  }
  double path = 0;
  for (std::size_t i = 1; i < means.size(); ++i) path += (means[i] - means[i - 1]).norm();
  return means.size() > 1 ? path / (static_cast<double>(means.size() - 1) * kSpeedBlock) : 0;
}

LevelFigures level_figures(const SessionRecording& r, const Protocol& p, const RigMethod& method,
                           double count, int level) {
  const double rate = r.header.rate_hz;
  LevelFigures f;
  f.level = protocol_level(p, level);
  std::vector<std::size_t> rows;
  std::size_t rows_of_level = 0, saturated = 0, last_row = 0;
  std::optional<std::size_t> taken_away;
  const double begins = kProtocolLead + level * p.hold_s;
  const double settled = begins + std::min(method.settling_s, p.hold_s / 4);
  double limit = r.header.max_force_n;
  if (r.header.force_limit_n > 0) limit = std::min(limit, r.header.force_limit_n);
  for (std::size_t i = 0; i + 1 < r.servo_time.size() && !taken_away; ++i) {
    const double t = protocol_time(r, i);
    if (protocol_level_at(p, t) != level) continue;
    constexpr std::uint32_t kOther = kReadingRejected | kSwitchOpen;
    if (r.fault[i] == 0 && r.flags[i] & kForceWithheld && !(r.flags[i] & kOther)) {
      taken_away = i;
      break;
    }
    ++rows_of_level;
    last_row = i;
    saturated += (r.flags[i] & kForceClamped) || answer(r, i).norm() >= 0.99 * limit;
    if (t >= settled) rows.push_back(i);
  }
  if (rows_of_level == 0) return f;  // stopped before this level
  f.saturated_share = static_cast<double>(saturated) / static_cast<double>(rows_of_level);
  // A level that ends early: because it vibrated and was stopped for that, or because somebody
  // stopped.
  bool governed = false;
  const bool half = static_cast<double>(rows_of_level) >= 0.5 * p.hold_s * rate;
  if ((taken_away || !half) && rows_of_level >= kFewestTicks) {
    std::vector<Vec3> last;
    const auto most = static_cast<std::size_t>(kShortestSignal * rate);
    for (std::size_t i = last_row - std::min(most, rows_of_level) + 1; i <= last_row; ++i)
      last.push_back(answer(r, i));
    f.rms_above_20 = rms_of_axes(last, rate);
    governed = f.saturated_share > kSaturatedTolerated ||
               f.rms_above_20 > std::max(method.vibration_rms_n, kGovernorLeast);
  }
  if (!governed && !half) return f;

  std::vector<Vec3> forces;
  for (const std::size_t i : rows) forces.push_back(answer(r, i));
  if (static_cast<double>(forces.size()) >= kShortestSignal * rate) {
    f.rms_above_20 = rms_of_axes(forces, rate);
    for (int axis = 0; axis < 3; ++axis) {
      const auto [least, most] =
          std::minmax_element(forces.begin(), forces.end(),
                              [&](const Vec3& a, const Vec3& b) { return a[axis] < b[axis]; });
      f.peak_to_peak = std::max(f.peak_to_peak, (*most)[axis] - (*least)[axis]);
    }
    f.speed = slow_speed(r, rows);
  }
  const double counts_per_second = count > 0 ? f.speed / count : 0;
  if (p.kind == ProtocolKind::kDampingSweep)  // level in N·s/m
    f.counts_rms = f.level * 1e-3 * count * rate * std::sqrt(counts_per_second / rate);
  else
    f.counts_rms =
        f.level * count *
        std::min(1 / std::sqrt(12.0),
                 std::sqrt(counts_per_second / (2 * units::kPi * units::kPi * kVibrationCorner)));
  const double quiet = std::max(method.vibration_rms_n, method.vibration_factor * f.counts_rms);
  if (governed || f.saturated_share > kSaturatedTolerated)
    f.verdict = LevelVerdict::kUnstable;
  else if (f.rms_above_20 > quiet)
    f.verdict = LevelVerdict::kVibrates;
  else if (f.peak_to_peak == 0 ||
           (p.kind == ProtocolKind::kDampingSweep && f.speed < method.exercise_speed_mm_s))
    f.verdict = LevelVerdict::kNotExercised;
  else
    f.verdict = LevelVerdict::kStable;
  return f;
}

}  // namespace

const char* name_of(LevelVerdict verdict) noexcept {
  switch (verdict) {
    case LevelVerdict::kStable:
      return "stable";
    case LevelVerdict::kVibrates:
      return "vibrates";
    case LevelVerdict::kUnstable:
      return "unstable";
    case LevelVerdict::kNotExercised:
      return "not exercised";
    case LevelVerdict::kNotRun:
      return "not run";
  }
  return "";
}

Measured<StepFigures> step_figures(const SessionRecording& r, const Protocol& p) {
  const std::size_t n = r.servo_time.size();
  Vec3 mean = Vec3::Zero();
  std::vector<std::size_t> on;
  for (std::size_t i = 0; i + 1 < n; ++i)
    if (protocol_step_on(p, protocol_time(r, i))) {
      on.push_back(i);
      mean += r.force_commanded[i];
    }
  if (static_cast<double>(on.size()) < 0.9 * 0.5 * p.duration_s * r.header.rate_hz ||
      on.size() < 50)
    return Measured<StepFigures>::no("the recording ends before the step does");
  if (!(mean.norm() > 0)) return Measured<StepFigures>::no("no force was commanded in the step");
  const Vec3 u = mean.normalized();

  StepFigures f;
  const auto jump = [&](const std::vector<Vec3>& force, std::size_t from) {
    while (from < n && force[from].dot(u) < 0.5 * p.force_n) ++from;
    return from;
  };
  f.onset = jump(r.force_commanded, on.front() > 0 ? on.front() - 1 : 0);
  const std::size_t sent = jump(r.force_sent, f.onset);
  if (f.onset >= on.back() || sent >= n)
    return Measured<StepFigures>::no("the commanded or the sent force never reached half of it");
  // What row n says was sent in row n - 1.
  f.latency_ticks = static_cast<int>(sent) - 1 - static_cast<int>(f.onset);

  std::vector<double> forces;
  for (const std::size_t i : on)
    if (i > f.onset + 1) forces.push_back(answer(r, i).dot(u));
  f.force = quantile(forces, 0.5);
  f.force_error_percent = (f.force / p.force_n - 1) * 100;

  const std::size_t tenth = std::max<std::size_t>(1, on.size() / 10);
  double before = 0, after = 0;
  std::size_t count_before = 0;
  for (std::size_t i = f.onset > tenth ? f.onset - tenth : 0; i <= f.onset; ++i, ++count_before)
    before += r.device_position[i].dot(u);
  before /= static_cast<double>(count_before);
  for (std::size_t i = on.size() - tenth; i < on.size(); ++i)
    after += r.device_position[on[i]].dot(u) / static_cast<double>(tenth);
  f.displacement = after - before;
  std::size_t at10 = n, at90 = n;
  double most = 0;
  for (std::size_t i = f.onset; i <= on.back(); ++i) {
    const double part =
        f.displacement != 0 ? (r.device_position[i].dot(u) - before) / f.displacement : 0;
    if (at10 == n && part >= 0.1) at10 = i;
    if (at90 == n && part >= 0.9) at90 = i;
    most = std::max(most, part);
  }
  if (at10 < n && at90 < n) f.rise_time = r.servo_time[at90] - r.servo_time[at10];
  f.overshoot_percent = std::max(0.0, most - 1) * 100;
  return f;
}

Measured<SweepFigures> sweep_figures(const SessionRecording& r, const Protocol& p,
                                     const RigMethod& method, double count) {
  SweepFigures f;
  bool any = false, still = true;
  for (int level = 0; level < p.count; ++level) {
    f.levels.push_back(level_figures(r, p, method, count, level));
    const LevelFigures& l = f.levels.back();
    any = any || (l.verdict != LevelVerdict::kNotRun && l.verdict != LevelVerdict::kNotExercised);
    if (l.verdict == LevelVerdict::kStable && still) f.last_stable = l.level;
    if (l.verdict == LevelVerdict::kVibrates || l.verdict == LevelVerdict::kUnstable) still = false;
    if (l.verdict == LevelVerdict::kVibrates && !f.first_vibrating) f.first_vibrating = l.level;
    if (l.verdict == LevelVerdict::kUnstable && !f.first_unstable) f.first_unstable = l.level;
  }
  if (!any)
    return Measured<SweepFigures>::no(
        "no level was run with the handle in motion; move it slowly all the time");
  return f;
}

Measured<WallFigures> wall_figures(const SessionRecording& r, const Protocol& p) {
  const std::size_t n = r.servo_time.size();
  Vec3 mean = Vec3::Zero();
  for (std::size_t i = 0; i + 1 < n; ++i) mean += answer(r, i);
  if (!(mean.norm() > 0)) return Measured<WallFigures>::no("the wall was never touched");
  const Vec3 u = mean.normalized();

  constexpr std::uint32_t kChanged = kForceClamped | kForceRateLimited | kForceHeatLimited |
                                     kForceNotFinite | kForceRamped | kForceWithheld;
  std::vector<double> depth, force;
  std::size_t run = 0, longest = 0, longest_end = 0;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double f = answer(r, i).dot(u);
    run = f > kTouching ? run + 1 : 0;
    if (run > longest) {
      longest = run;
      longest_end = i + 1;
    }
    // At the end of the travel the force stays: no longer a spring.
    const bool spring = f < 0.99 * p.stiffness_n_per_mm * p.travel_mm;
    if (f <= kTouching || !spring || r.flags[i] & kChanged || r.force_scale[i] < 1) continue;
    depth.push_back(-r.device_position[i].dot(u));
    force.push_back(f);
  }
  if (depth.size() < 50)
    return Measured<WallFigures>::no("the wall was touched in fewer than 50 unlimited ticks");
  const auto count = static_cast<double>(depth.size());
  double mean_d = 0, mean_f = 0, df = 0, dd = 0;
  for (std::size_t i = 0; i < depth.size(); ++i) {
    mean_d += depth[i] / count;
    mean_f += force[i] / count;
  }
  for (std::size_t i = 0; i < depth.size(); ++i) {
    df += (depth[i] - mean_d) * (force[i] - mean_f);
    dd += (depth[i] - mean_d) * (depth[i] - mean_d);
  }
  WallFigures w;
  w.stiffness = dd > 0 ? df / dd : 0;
  if (!(w.stiffness > 0))
    return Measured<WallFigures>::no("the force does not grow with the depth; press in and out");
  w.stiffness_ratio = w.stiffness / p.stiffness_n_per_mm;
  const double plane = mean_d - mean_f / w.stiffness;
  const auto deepest =
      static_cast<std::size_t>(std::max_element(depth.begin(), depth.end()) - depth.begin());
  w.penetration = depth[deepest] - plane;
  w.penetration_theory = force[deepest] / p.stiffness_n_per_mm;
  w.largest_force = *std::max_element(force.begin(), force.end());
  w.contact_seconds = static_cast<double>(longest) / r.header.rate_hz;
  if (w.contact_seconds >= kShortestSignal) {
    std::vector<Vec3> forces;
    for (std::size_t i = longest_end - longest; i < longest_end; ++i)
      forces.push_back(answer(r, i));
    w.vibration_rms = rms_of_axes(forces, r.header.rate_hz);
  }
  return w;
}

}  // namespace toothprep
