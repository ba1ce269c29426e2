#include "toothprep/tools/rig_check/rig_report.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <map>

#include "toothprep/step/core/errors.h"

namespace toothprep {

const std::vector<RigFigure>& rig_catalogue() {
  static const std::vector<RigFigure> all = {
      // Time.
      {"servo_period_median_us", "servo", "us", "median time between two ticks"},
      {"servo_period_p999_us", "servo", "us", "99.9 % of the periods are shorter"},
      {"servo_period_worst_us", "servo", "us", "longest period"},
      {"servo_period_median_over_nominal", "servo", "1", "median period over the nominal one"},
      {"servo_period_p999_over_nominal", "servo", "1", "99.9 % period over the nominal one"},
      {"servo_late_share", "servo", "1", "share of late periods (above 1.5 T)"},
      {"servo_missed_ticks", "servo", "1", "missed ticks, by the times"},
      {"servo_missed_ticks_by_device", "servo", "1", "missed ticks, by the device's count"},
      {"servo_missed_share", "servo", "1", "share of missed ticks"},
      {"servo_jitter_rms_us", "servo", "us", "jitter: starts against a fitted clock, rms"},
      {"servo_jitter_peak_to_peak_us", "servo", "us", "jitter, earliest to latest"},
      {"servo_clock_error_ppm", "servo", "ppm", "clock rate error; positive: fast"},
      {"step_cost_median_us", "step", "us", "CPU time of a tick's work, median"},
      {"step_cost_p99_us", "step", "us", "99 % of the ticks cost less"},
      {"step_cost_p999_us", "step", "us", "99.9 % of the ticks cost less"},
      {"step_cost_worst_us", "step", "us", "costliest tick"},
      {"step_cost_p999_share", "step", "1", "99.9 % step cost over the period"},
      {"recorder_dropped_ticks", "recorder", "1", "ticks that the recording lacks"},
      {"recording_closed", "recorder", "1", "1: the recording was closed in order"},
      // Encoders.
      {"encoder_quantum_mm", "encoders", "mm", "encoder count, coarsest axis"},
      {"rest_seconds", "encoders", "s", "time at rest"},
      {"encoder_noise_rms_mm", "encoders", "mm", "noise at rest, rms, worst axis"},
      {"encoder_noise_above_quantum_mm", "encoders", "mm", "of it beyond the counts"},
      {"velocity_noise_rms_mm_s", "encoders", "mm/s", "velocity noise at rest, rms"},
      {"velocity_quantum_mm_s", "encoders", "mm/s", "one count per period as a speed"},
      // What was done to the force.
      {"force_clamped_share", "forces", "1", "share of ticks at the force limit"},
      {"force_clamped_longest_s", "forces", "s", "longest time at the force limit"},
      {"force_rate_limited_share", "forces", "1", "share of ticks limited in rate"},
      {"force_heat_limited_share", "forces", "1", "share of ticks limited by heat"},
      {"force_not_finite_ticks", "forces", "1", "ticks whose force was no number"},
      {"force_ramped_share", "forces", "1", "share of ticks on the device's ramp"},
      {"force_withheld_ticks", "forces", "1", "ticks whose force was taken away"},
      {"fault_onsets", "forces", "1", "faults that the device reported"},
      {"final_faults", "forces", "1", "of these, faults that ended the session"},
      // The coupling and energy.
      {"lag_mean_mm", "coupling", "mm", "bur behind the handle, mean"},
      {"lag_largest_mm", "coupling", "mm", "bur behind the handle, largest"},
      {"lag_force_over_k_mm", "coupling", "mm", "largest force over k: the lag by theory"},
      {"lag_law_residual_mm", "coupling", "mm", "force against the coupling's law, over k"},
      {"device_port_minimum_mj", "energy", "mJ", "passivity observer, minimum"},
      {"device_port_absorbed_mj", "energy", "mJ", "energy taken from the hand"},
      {"device_port_return_mj", "energy", "mJ", "largest energy given back"},
      {"device_port_return_over_store", "energy", "1", "that over the spring's store"},
      {"device_port_sampling_mj", "energy", "mJ", "what sampling and counts explain, at most"},
      {"device_port_unexplained_minimum_mj", "energy", "mJ", "observer with that, minimum"},
      {"device_port_unexplained_return_over_store", "energy", "1",
       "given back beyond that, over spring and bur"},
      {"bur_torque_work_mj", "energy", "mJ", "work of the torque on the bur"},
      {"bur_removed_energy_mj", "energy", "mJ", "energy of the removed tissue"},
      {"bur_energy_ratio", "energy", "1", "ratio of the two"},
      {"bur_port_minimum_mj", "energy", "mJ", "feed work on the tissue, minimum"},
      // Theory.
      {"coupling_stiffness_n_per_mm", "stability", "N/mm", "k of the coupling as it ran"},
      {"coupling_limit_device_n_per_mm", "stability", "N/mm", "limit of k, 2 b/T of the device"},
      {"coupling_limit_hand_n_per_mm", "stability", "N/mm", "limit of k, with a light grip"},
      {"coupling_limit_friction_n_per_mm", "stability", "N/mm", "limit of k, friction 2 f_c/D"},
      {"coupling_margin", "stability", "1", "margin: larger of these two over k"},
      {"device_stiffness_margin", "stability", "1", "limit that the device states over k"},
      {"tooth_damping_n_s_per_m", "stability", "N s/m", "damping of the tooth, median"},
      {"direct_limit_linear_n_s_per_m", "stability", "N s/m", "direct limit, mass and delay"},
      {"direct_limit_counts_n_s_per_m", "stability", "N s/m", "direct limit, counts m v/D"},
      {"direct_limit_friction_n_s_per_m", "stability", "N s/m", "direct limit, friction 2 f_c T/D"},
      {"direct_margin", "stability", "1", "margin: direct limit over the tooth's"},
      // Motors.
      {"force_peak_n", "motors", "N", "largest force sent"},
      {"force_rms_n", "motors", "N", "rms force over the recording"},
      {"force_rms_window_n", "motors", "N", "rms force, worst window"},
      {"thermal_force_n", "motors", "N", "steady force that heats as much"},
      {"thermal_load", "motors", "1", "that over the continuous force"},
      // Replay.
      {"replay_differing_rows", "replay", "1", "rows that differ in any bit"},
      {"replay_first_difference_s", "replay", "s", "time of the first of them"},
      {"replay_force_difference_n", "replay", "N", "largest difference of the device's force"},
      // Active checks.
      {"step_force_error_percent", "step response", "%", "force sent against the protocol's"},
      {"step_latency_ticks", "step response", "1", "from command to sent force"},
      {"step_displacement_mm", "step response", "mm", "how far the handle gave way"},
      {"step_rise_time_ms", "step response", "ms", "10 to 90 % of that"},
      {"step_overshoot_percent", "step response", "%", "beyond where it came to rest"},
      {"stiffness_last_stable_n_per_mm", "sweeps", "N/mm", "last stable level"},
      {"stiffness_first_unstable_n_per_mm", "sweeps", "N/mm", "first unstable level"},
      {"damping_last_stable_n_s_per_m", "sweeps", "N s/m", "last stable level"},
      {"damping_first_unstable_n_s_per_m", "sweeps", "N s/m", "first unstable level"},
      {"wall_stiffness_ratio", "wall", "1", "stiffness measured over that commanded"},
      {"wall_penetration_mm", "wall", "mm", "largest penetration"},
      {"wall_penetration_theory_mm", "wall", "mm", "the force there over k"},
      {"wall_vibration_rms_n", "wall", "N", "force above 20 Hz in contact, rms"},
  };
  return all;
}

const char* name_of(RigVerdict verdict) noexcept {
  switch (verdict) {
    case RigVerdict::kPass:
      return "pass";
    case RigVerdict::kFail:
      return "fail";
    case RigVerdict::kNotMeasured:
      return "not measured";
    case RigVerdict::kNoLimit:
      return "no limit";
  }
  return "";
}

namespace {

// Values by figure, on their way to the lines.
class Values {
 public:
  void set(const char* key, double value, const std::string& note = {}) {
    if (std::isfinite(value))
      values_[key] = {value, {}, note};
    else
      values_[key] = {{}, note.empty() ? "not defined here" : note, {}};
  }
  void no(const std::string& why, std::initializer_list<const char*> keys) {
    for (const char* key : keys) values_[key] = {{}, why, {}};
  }
  struct Entry {
    std::optional<double> value;
    std::string why_not, note;
  };
  const Entry& at(const char* key) const {
    const auto found = values_.find(key);
    if (found == values_.end()) throw Error(std::string("rig check: nobody measured ") + key);
    return found->second;
  }

 private:
  std::map<std::string, Entry> values_;
};

void put_time(const SessionRecording& r, const RigMethod& method, Values& v, RigReport& report) {
  if (const auto f = servo_figures(r, method)) {
    const double us = 1e6, rate = r.header.rate_hz;
    v.set("servo_period_median_us", f->median * us);
    v.set("servo_period_p999_us", f->p999 * us);
    v.set("servo_period_worst_us", f->worst * us);
    v.set("servo_period_median_over_nominal", f->median * rate);
    v.set("servo_period_p999_over_nominal", f->p999 * rate);
    v.set("servo_late_share", f->late_share);
    v.set("servo_missed_ticks", static_cast<double>(f->missed_by_times));
    v.set("servo_missed_ticks_by_device", static_cast<double>(f->missed_by_device));
    v.set("servo_missed_share", f->missed_share);
    v.set("servo_jitter_rms_us", f->jitter_rms * us);
    v.set("servo_jitter_peak_to_peak_us", f->jitter_peak_to_peak * us);
    v.set("servo_clock_error_ppm", f->clock_error_ppm);
    report.servo = f.value;
  } else {
    v.no(f.why_not,
         {"servo_period_median_us", "servo_period_p999_us", "servo_period_worst_us",
          "servo_period_median_over_nominal", "servo_period_p999_over_nominal", "servo_late_share",
          "servo_missed_ticks", "servo_missed_ticks_by_device", "servo_missed_share",
          "servo_jitter_rms_us", "servo_jitter_peak_to_peak_us", "servo_clock_error_ppm"});
  }
  if (const auto f = step_cost_figures(r)) {
    v.set("step_cost_median_us", f->median * 1e6);
    v.set("step_cost_p99_us", f->p99 * 1e6);
    v.set("step_cost_p999_us", f->p999 * 1e6);
    v.set("step_cost_worst_us", f->worst * 1e6);
    v.set("step_cost_p999_share", f->p999_share);
    report.step_cost = f.value;
  } else {
    v.no(f.why_not, {"step_cost_median_us", "step_cost_p99_us", "step_cost_p999_us",
                     "step_cost_worst_us", "step_cost_p999_share"});
  }
  const RecorderFigures recorder = recorder_figures(r);
  v.set("recorder_dropped_ticks",
        static_cast<double>(std::max(recorder.dropped, recorder.gaps_in_count)));
  v.set("recording_closed", r.complete ? 1 : 0, r.end_reason);
}

void put_encoders(const SessionRecording& r, const RigMethod& method, Values& v) {
  if (const auto f = quantum_figures(r, method)) {
    const std::string note = f->at_rest ? "from readings at rest" : "from readings in motion";
    v.set("encoder_quantum_mm", f->largest, note);
    v.set("velocity_quantum_mm_s", f->largest * r.header.rate_hz, note);
  } else {
    v.no(f.why_not, {"encoder_quantum_mm", "velocity_quantum_mm_s"});
  }
  if (const auto f = rest_figures(r, method)) {
    v.set("rest_seconds", f->seconds);
    v.set("encoder_noise_rms_mm", f->worst_noise);
    v.set("encoder_noise_above_quantum_mm", f->noise_above_quantum);
    v.set("velocity_noise_rms_mm_s", f->worst_velocity_noise);
  } else {
    v.no(f.why_not, {"rest_seconds", "encoder_noise_rms_mm", "encoder_noise_above_quantum_mm",
                     "velocity_noise_rms_mm_s"});
  }
}

void put_events(const SessionRecording& r, Values& v, RigReport& report) {
  report.events = force_events(r);
  report.faults = fault_events(r);
  for (const EventFigures& e : report.events) {
    if (e.flag == kForceClamped) {
      v.set("force_clamped_share", e.share);
      v.set("force_clamped_longest_s", e.longest);
    }
    if (e.flag == kForceRateLimited) v.set("force_rate_limited_share", e.share);
    if (e.flag == kForceHeatLimited) v.set("force_heat_limited_share", e.share);
    if (e.flag == kForceNotFinite) v.set("force_not_finite_ticks", static_cast<double>(e.ticks));
    if (e.flag == kForceRamped) v.set("force_ramped_share", e.share);
    if (e.flag == kForceWithheld) v.set("force_withheld_ticks", static_cast<double>(e.ticks));
  }
  long onsets = 0, final_ones = 0;
  std::string names;
  for (const FaultFigures& f : report.faults) {
    onsets += f.onsets;
    if (f.final) ++final_ones;
    names += (names.empty() ? "" : ", ") + f.name;
  }
  v.set("fault_onsets", static_cast<double>(onsets), names);
  v.set("final_faults", static_cast<double>(final_ones));
}

void put_device_port(const SessionRecording& r, const Parameters& p, Values& v, RigReport& report) {
  const PortSpring spring = port_spring(r, p);
  const auto f = device_port_figures(r, spring);
  if (!f)
    return v.no(f.why_not, {"device_port_minimum_mj", "device_port_absorbed_mj",
                            "device_port_return_mj", "device_port_return_over_store",
                            "device_port_sampling_mj", "device_port_unexplained_minimum_mj",
                            "device_port_unexplained_return_over_store"});
  const auto span = [](double from, double to) {
    return fmt::format("from {:.3f} s to {:.3f} s", from, to);
  };
  v.set("device_port_minimum_mj", f->minimum, fmt::format("at {:.3f} s", f->minimum_at));
  v.set("device_port_absorbed_mj", f->last);
  v.set("device_port_return_mj", f->largest_return, span(f->return_from, f->return_to));
  v.set("device_port_sampling_mj", f->sampling,
        spring.stiffness > 0 ? "" : "no spring is known, so nothing is allowed for");
  v.set("device_port_unexplained_minimum_mj", f->unexplained_minimum,
        fmt::format("at {:.3f} s", f->unexplained_at));
  report.device_port = f.value;
  if (r.header.trace.drive != "coupled")
    return v.no("the session was not coupled: there is no spring",
                {"device_port_return_over_store", "device_port_unexplained_return_over_store"});
  v.set("device_port_return_over_store",
        f->largest_return * 2 * p.coupling.stiffness / (f->peak_force * f->peak_force));
  v.set("device_port_unexplained_return_over_store", f->unexplained_return / f->store,
        span(f->unexplained_from, f->unexplained_to));
}

void put_coupling(const SessionRecording& r, const Parameters& p, Values& v, RigReport& report) {
  if (const auto f = lag_figures(r, p)) {
    v.set("lag_mean_mm", f->mean);
    v.set("lag_largest_mm", f->largest, fmt::format("at {:.3f} s", f->largest_at));
    v.set("lag_force_over_k_mm", f->largest_force_over_k);
    v.set("lag_law_residual_mm", f->law_residual);
  } else {
    v.no(f.why_not,
         {"lag_mean_mm", "lag_largest_mm", "lag_force_over_k_mm", "lag_law_residual_mm"});
  }
  put_device_port(r, p, v, report);
  if (const auto f = bur_port_figures(r, p)) {
    const std::string note = f->audited ? "the session's audit" : "summed over the rows";
    v.set("bur_torque_work_mj", f->torque_work, note);
    v.set("bur_removed_energy_mj", f->removed_energy, note);
    v.set("bur_energy_ratio", f->ratio, std::isfinite(f->ratio) ? "" : "nothing was removed");
    v.set("bur_port_minimum_mj", f->feed_minimum);
  } else {
    v.no(f.why_not, {"bur_torque_work_mj", "bur_removed_energy_mj", "bur_energy_ratio",
                     "bur_port_minimum_mj"});
  }
}

void put_stability(const SessionRecording& r, const Parameters& p, const RigLimits& limits,
                   Values& v, RigReport& report) {
  const DeviceTraits* const device = find_device(limits, r.header.device_model);
  if (device) report.device = *device;
  const bool coupled = r.header.trace.drive == "coupled";
  const std::string not_coupled = "the session was not coupled";
  v.set("coupling_stiffness_n_per_mm", p.coupling.stiffness);
  if (!coupled)
    v.no(not_coupled, {"coupling_stiffness_n_per_mm", "device_stiffness_margin"});
  else if (r.header.max_stiffness_n_per_mm > 0)
    v.set("device_stiffness_margin", r.header.max_stiffness_n_per_mm / p.coupling.stiffness);
  else
    v.no("the device states no limit of stiffness", {"device_stiffness_margin"});
  const auto f = stability_figures(r, p, device, limits.method);
  if (!f) {
    v.no(f.why_not,
         {"coupling_limit_device_n_per_mm", "coupling_limit_hand_n_per_mm",
          "coupling_limit_friction_n_per_mm", "coupling_margin", "tooth_damping_n_s_per_m",
          "direct_limit_linear_n_s_per_m", "direct_limit_counts_n_s_per_m",
          "direct_limit_friction_n_s_per_m", "direct_margin"});
    return;
  }
  const std::string count = fmt::format("D = {:.4g} mm", f->count) +
                            (f->count_measured ? ", measured here" : ", from the table of devices");
  v.set("coupling_limit_device_n_per_mm", f->limit_device);
  v.set("coupling_limit_hand_n_per_mm", f->limit_hand);
  v.set("coupling_limit_friction_n_per_mm", f->limit_friction, count);
  if (coupled)
    v.set("coupling_margin", f->coupling_margin);
  else
    v.no(not_coupled, {"coupling_margin"});
  v.set("direct_limit_linear_n_s_per_m", f->limit_linear * 1e3);
  v.set("direct_limit_counts_n_s_per_m", f->limit_counts * 1e3,
        fmt::format("at {:.3g} mm/s; ", f->speed) + count);
  v.set("direct_limit_friction_n_s_per_m", f->limit_count_friction * 1e3, count);
  if (f->tooth_damping)
    v.set("tooth_damping_n_s_per_m", *f->tooth_damping * 1e3);
  else
    v.no("the bur ground nothing", {"tooth_damping_n_s_per_m"});
  if (coupled)
    v.no("the session was coupled: the spring stands between" +
             (f->direct_margin
                  ? fmt::format(" (direct rendering would have {:.2g})", *f->direct_margin)
                  : std::string()),
         {"direct_margin"});
  else if (f->direct_margin)
    v.set("direct_margin", *f->direct_margin);
  else
    v.no("the bur ground nothing", {"direct_margin"});
}

void put_motors(const SessionRecording& r, const RigMethod& method, Values& v) {
  if (const auto f = thermal_figures(r, method)) {
    v.set("force_peak_n", f->peak_force);
    v.set("force_rms_n", f->rms);
    v.set("force_rms_window_n", f->worst_window_rms);
    v.set("thermal_force_n", f->model_force,
          fmt::format("time constant {:.3g} s", method.thermal_time_constant_s));
    v.set("thermal_load", f->load,
          std::isfinite(f->load) ? "" : "the device states no continuous force");
  } else {
    v.no(f.why_not,
         {"force_peak_n", "force_rms_n", "force_rms_window_n", "thermal_force_n", "thermal_load"});
  }
}

void put_replay(const SessionRecording& r, const Measured<std::vector<StepRecord>>& replayed,
                Values& v) {
  const auto f =
      replayed ? compare_replay(r, *replayed) : Measured<ReplayFigures>::no(replayed.why_not);
  if (!f) {
    v.no(f.why_not,
         {"replay_differing_rows", "replay_first_difference_s", "replay_force_difference_n"});
    return;
  }
  v.set("replay_differing_rows", static_cast<double>(f->differing),
        "of " + std::to_string(f->rows));
  v.set("replay_force_difference_n", f->largest_force);
  if (f->differing > 0)
    v.set("replay_first_difference_s", f->first_at, f->first_what);
  else
    v.no("no row differs", {"replay_first_difference_s"});
}

void put_protocol(const SessionRecording& r, const RigMethod& method, Values& v,
                  RigReport& report) {
  if (!r.header.protocol.empty()) report.protocol = parse_protocol(r.header.protocol);
  const auto ran = [&](ProtocolKind kind) {
    return report.protocol && report.protocol->kind == kind;
  };
  const auto other = [](ProtocolKind kind) {
    return std::string("needs a recording of the protocol ") + name_of(kind);
  };
  const auto step = ran(ProtocolKind::kStep)
                        ? step_figures(r, *report.protocol)
                        : Measured<StepFigures>::no(other(ProtocolKind::kStep));
  if (step) {
    v.set("step_force_error_percent", step->force_error_percent);
    v.set("step_latency_ticks", step->latency_ticks);
    v.set("step_displacement_mm", step->displacement);
    v.set("step_rise_time_ms", step->rise_time * 1e3);
    v.set("step_overshoot_percent", step->overshoot_percent);
    report.step = step.value;
  } else {
    v.no(step.why_not, {"step_force_error_percent", "step_latency_ticks", "step_displacement_mm",
                        "step_rise_time_ms", "step_overshoot_percent"});
  }
  const auto quantum = quantum_figures(r, method);
  double count = report.device ? report.device->encoder_count : 0;
  if (quantum) count = quantum->largest;
  const auto put_sweep = [&](ProtocolKind kind, const char* stable, const char* unstable) {
    const auto sweep = ran(kind) ? sweep_figures(r, *report.protocol, method, count)
                                 : Measured<SweepFigures>::no(other(kind));
    if (!sweep) return v.no(sweep.why_not, {stable, unstable});
    report.sweep = sweep.value;
    // Not one level stable counts as the limit 0.
    v.set(stable, sweep->last_stable.value_or(0),
          sweep->first_vibrating ? fmt::format("vibrates from {:.4g} on", *sweep->first_vibrating)
                                 : "");
    if (sweep->first_unstable)
      v.set(unstable, *sweep->first_unstable);
    else
      v.no("no level was unstable", {unstable});
  };
  put_sweep(ProtocolKind::kStiffnessSweep, "stiffness_last_stable_n_per_mm",
            "stiffness_first_unstable_n_per_mm");
  put_sweep(ProtocolKind::kDampingSweep, "damping_last_stable_n_s_per_m",
            "damping_first_unstable_n_s_per_m");
  const auto wall = ran(ProtocolKind::kWall)
                        ? wall_figures(r, *report.protocol)
                        : Measured<WallFigures>::no(other(ProtocolKind::kWall));
  if (wall) {
    v.set("wall_stiffness_ratio", wall->stiffness_ratio);
    v.set("wall_penetration_mm", wall->penetration);
    v.set("wall_penetration_theory_mm", wall->penetration_theory);
    if (wall->contact_seconds >= 0.2)
      v.set("wall_vibration_rms_n", wall->vibration_rms);
    else
      v.no("no contact lasted 0.2 s", {"wall_vibration_rms_n"});
    report.wall = wall.value;
  } else {
    v.no(wall.why_not, {"wall_stiffness_ratio", "wall_penetration_mm", "wall_penetration_theory_mm",
                        "wall_vibration_rms_n"});
  }
}

// What a check brings about on purpose is reported, not judged: a step pushes the hand, and a sweep
// goes on until the device vibrates.
bool provoked(const std::optional<Protocol>& protocol, const std::string& key) {
  if (!protocol || protocol->kind == ProtocolKind::kRest || protocol->kind == ProtocolKind::kWall)
    return false;
  for (const char* figure :
       {"device_port_minimum_mj", "device_port_unexplained_minimum_mj", "force_rate_limited_share"})
    if (key == figure) return true;
  if (protocol->kind == ProtocolKind::kStep) return false;
  for (const char* figure : {"force_clamped_share", "force_heat_limited_share", "thermal_load"})
    if (key == figure) return true;
  return false;
}

}  // namespace

RigReport check_rig(const SessionRecording& r, const RigLimits& limits,
                    const Measured<std::vector<StepRecord>>& replayed) {
  check_recording(r);
  const Parameters p =
      parse_parameters(r.header.trace.parameters_toml, "the recording's parameters");
  RigReport report;
  Values v;
  put_time(r, limits.method, v, report);
  put_encoders(r, limits.method, v);
  put_events(r, v, report);
  put_stability(r, p, limits, v, report);
  put_motors(r, limits.method, v);
  put_protocol(r, limits.method, v, report);
  put_coupling(r, p, v, report);
  put_replay(r, replayed, v);
  // An active check renders no tooth: what it does to the device is judged by its own lines.
  if (report.protocol)
    v.no("an active check renders no tooth",
         {"lag_mean_mm", "lag_largest_mm", "lag_force_over_k_mm", "lag_law_residual_mm",
          "device_port_return_over_store", "device_port_unexplained_return_over_store",
          "bur_torque_work_mj", "bur_removed_energy_mj", "bur_energy_ratio", "bur_port_minimum_mj",
          "coupling_stiffness_n_per_mm", "coupling_margin", "device_stiffness_margin",
          "tooth_damping_n_s_per_m", "direct_margin", "replay_differing_rows",
          "replay_first_difference_s", "replay_force_difference_n"});

  for (const RigFigure& figure : rig_catalogue()) {
    const Values::Entry& entry = v.at(figure.key);
    RigLine line{&figure, entry.value, entry.why_not, entry.note, {}, RigVerdict::kNoLimit};
    const auto limit = limits.limits.find(figure.key);
    if (line.value && limit != limits.limits.end() && provoked(report.protocol, figure.key)) {
      line.note = "not judged: the check provokes it";
    } else if (limit != limits.limits.end()) {
      line.limit = limit->second;
      if (!line.value)
        line.verdict = RigVerdict::kNotMeasured;
      else if ((line.limit->min && *line.value < *line.limit->min) ||
               (line.limit->max && *line.value > *line.limit->max))
        line.verdict = RigVerdict::kFail;
      else
        line.verdict = RigVerdict::kPass;
    } else if (!line.value) {
      line.verdict = RigVerdict::kNotMeasured;
    }
    if (line.limit) {
      report.passed += line.verdict == RigVerdict::kPass;
      report.failed += line.verdict == RigVerdict::kFail;
      report.not_measured += line.verdict == RigVerdict::kNotMeasured;
    }
    report.lines.push_back(line);
  }
  report.overall = report.failed > 0   ? RigVerdict::kFail
                   : report.passed > 0 ? RigVerdict::kPass
                                       : RigVerdict::kNotMeasured;
  return report;
}

}  // namespace toothprep
