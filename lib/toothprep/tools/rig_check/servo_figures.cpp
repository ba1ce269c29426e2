// Time: periods, jitter, step cost, dropped rows.
#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {

void check_recording(const SessionRecording& r) {
  const std::size_t n = r.header.trace.rows.size();
  if (n == 0) throw Error("the recording holds no rows");
  if (!(std::isfinite(r.header.rate_hz) && r.header.rate_hz > 0))
    throw Error("the recording's rate must be above 0");
  for (const std::size_t size :
       {r.servo_time.size(), r.step_seconds.size(), r.force_scale.size(), r.tick.size(),
        r.missed.size(), r.flags.size(), r.fault.size(), r.device_buttons.size(),
        r.force_commanded.size(), r.force_sent.size(), r.device_position.size(),
        r.device_orientation.size()})
    if (size != n) throw Error("the recording's columns differ in length");
  for (std::size_t i = 0; i < n; ++i) {
    if (!(std::isfinite(r.servo_time[i]) && std::isfinite(r.step_seconds[i]) &&
          r.device_position[i].allFinite() && r.force_sent[i].allFinite() &&
          r.force_commanded[i].allFinite()))
      throw Error("the recording holds a value that is not finite in row " + std::to_string(i));
    if (i > 0 && !(r.servo_time[i] > r.servo_time[i - 1] && r.tick[i] > r.tick[i - 1]))
      throw Error("the recording's times or tick counts don't increase at row " +
                  std::to_string(i));
  }
}

ClockFit fit_clock(const SessionRecording& r) {
  const std::size_t n = r.servo_time.size();
  const double T = 1 / r.header.rate_hz;
  ClockFit fit;
  fit.index.assign(n, 0);
  // Follows the clock's phase slowly: jitter averages out, a clock that runs off does not.
  constexpr double kGain = 0.02;
  double due = r.servo_time[n - 1];
  for (std::size_t i = n - 1; i-- > 0;) {
    const long ticks = static_cast<long>(r.tick[i + 1] - r.tick[i]);
    const long periods = std::max(ticks, std::lround((due - r.servo_time[i]) / T));
    fit.index[i] = fit.index[i + 1] - periods;
    due -= static_cast<double>(periods) * T;
    due += kGain * std::clamp(r.servo_time[i] - due, -T / 2, T / 2);
  }
  const long first = fit.index[0];
  for (long& k : fit.index) k -= first;

  double mean_k = 0, mean_t = 0;
  for (std::size_t i = 0; i < n; ++i) {
    mean_k += static_cast<double>(fit.index[i]) / static_cast<double>(n);
    mean_t += r.servo_time[i] / static_cast<double>(n);
  }
  double kt = 0, kk = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double k = static_cast<double>(fit.index[i]) - mean_k;
    kt += k * (r.servo_time[i] - mean_t);
    kk += k * k;
  }
  fit.period = kk > 0 ? kt / kk : T;
  fit.start = mean_t - fit.period * mean_k;
  fit.residual.resize(n);
  for (std::size_t i = 0; i < n; ++i)
    fit.residual[i] = r.servo_time[i] - fit.start - fit.period * static_cast<double>(fit.index[i]);
  return fit;
}

Measured<ServoFigures> servo_figures(const SessionRecording& r, const RigMethod& method) {
  const std::size_t n = r.servo_time.size();
  if (n < 100) return Measured<ServoFigures>::no("fewer than 100 ticks");
  const double T = 1 / r.header.rate_hz;
  ServoFigures f;
  f.periods.reserve(n);
  for (std::size_t i = 1; i < n; ++i) {
    f.missed_by_device += r.missed[i];
    if (r.tick[i] == r.tick[i - 1] + 1) f.periods.push_back(r.servo_time[i] - r.servo_time[i - 1]);
  }
  if (f.periods.empty()) return Measured<ServoFigures>::no("no two ticks follow each other");
  std::vector<double> sorted = f.periods;
  f.median = quantile(sorted, 0.5);
  f.p999 = quantile(sorted, 0.999);
  f.worst = *std::max_element(sorted.begin(), sorted.end());
  // A hair of tolerance, so that a period of exactly 1.5 T isn't judged by its last bit.
  const double late = method.late_periods * T * (1 + 1e-9);
  f.late_share = static_cast<double>(std::count_if(sorted.begin(), sorted.end(),
                                                   [&](double p) { return p > late; })) /
                 static_cast<double>(sorted.size());

  const ClockFit clock = fit_clock(r);
  const long should = clock.index.back();
  f.missed_by_times = should - static_cast<long>(r.tick.back() - r.tick.front());
  f.missed_share = static_cast<double>(f.missed_by_times) / static_cast<double>(should);
  double sum = 0;
  for (const double e : clock.residual) sum += e * e;
  f.jitter_rms = std::sqrt(sum / static_cast<double>(n));
  const auto [least, most] = std::minmax_element(clock.residual.begin(), clock.residual.end());
  f.jitter_peak_to_peak = *most - *least;
  f.clock_error_ppm = (T / clock.period - 1) * 1e6;
  return f;
}

Measured<StepCostFigures> step_cost_figures(const SessionRecording& r) {
  StepCostFigures f;
  for (std::size_t i = 0; i < r.step_seconds.size(); ++i)
    if (r.tick[i] > 0) f.costs.push_back(r.step_seconds[i]);
  if (f.costs.size() < 100) return Measured<StepCostFigures>::no("fewer than 100 ticks");
  if (*std::max_element(f.costs.begin(), f.costs.end()) <= 0)
    return Measured<StepCostFigures>::no("the recording holds no step times");
  std::vector<double> sorted = f.costs;
  f.median = quantile(sorted, 0.5);
  f.p99 = quantile(sorted, 0.99);
  f.p999 = quantile(sorted, 0.999);
  f.worst = *std::max_element(sorted.begin(), sorted.end());
  f.p999_share = f.p999 * r.header.rate_hz;
  return f;
}

RecorderFigures recorder_figures(const SessionRecording& r) {
  RecorderFigures f;
  f.dropped = static_cast<long>(r.dropped_ticks);
  for (std::size_t i = 1; i < r.tick.size(); ++i)
    f.gaps_in_count += static_cast<long>(r.tick[i] - r.tick[i - 1]) - 1;
  return f;
}

}  // namespace toothprep
