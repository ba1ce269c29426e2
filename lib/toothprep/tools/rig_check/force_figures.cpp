// Forces: what was done to them, the coupling's lag, energy at both ports, heat.
#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/tools/device/device_fault.h"
#include "toothprep/tools/rig_check/protocol.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

const char* name_of(DeviceFault fault) {
  switch (fault) {
    case DeviceFault::kNone:
      return "none";
    case DeviceFault::kBadReading:
      return "bad_reading";
    case DeviceFault::kBadForce:
      return "bad_force";
    case DeviceFault::kWarmMotors:
      return "warm_motors";
    case DeviceFault::kForceExceeded:
      return "force_exceeded";
    case DeviceFault::kImpulseExceeded:
      return "impulse_exceeded";
    case DeviceFault::kVelocityExceeded:
      return "velocity_exceeded";
    case DeviceFault::kNotCalibrated:
      return "not_calibrated";
    case DeviceFault::kClient:
      return "client";
    case DeviceFault::kRefused:
      return "refused";
    case DeviceFault::kTimer:
      return "timer";
    case DeviceFault::kCommunication:
      return "communication";
    case DeviceFault::kDevice:
      return "device";
    case DeviceFault::kUnplugged:
      return "unplugged";
    case DeviceFault::kHangs:
      return "hangs";
  }
  return "unknown";
}

// Time from row i to the next; a period for the last.
double held_for(const SessionRecording& r, std::size_t i) {
  return i + 1 < r.servo_time.size() ? r.servo_time[i + 1] - r.servo_time[i] : 1 / r.header.rate_hz;
}

// Least energy, and the largest that came back, of a series that begins at 0.
struct PortExtremes {
  explicit PortExtremes(double start)
      : minimum_at(start), return_from(start), return_to(start), highest_at(start) {}
  void add(double energy, double time) {
    if (energy < minimum) {
      minimum = energy;
      minimum_at = time;
    }
    if (energy > highest) {
      highest = energy;
      highest_at = time;
    }
    if (highest - energy > largest_return) {
      largest_return = highest - energy;
      return_from = highest_at;
      return_to = time;
    }
  }
  double minimum = 0, minimum_at, largest_return = 0, return_from, return_to;
  double highest = 0, highest_at;
};

// What spring and bur store in a row, mJ: by the force that was sent, or the model's where that was
// limited.
double stored_energy(const SessionRecording& r, std::size_t i, const PortSpring& spring) {
  if (!(spring.stiffness > 0)) return 0;
  const StepRecord& row = r.header.trace.rows[i];
  const double square = std::max(r.force_sent[i].squaredNorm(), row.device_force.squaredNorm());
  return square / (2 * spring.stiffness) + spring.mass * row.bur_velocity.squaredNorm() / 2;
}

}  // namespace

std::vector<EventFigures> force_events(const SessionRecording& r) {
  std::vector<EventFigures> all;
  for (const auto& [name, flag] : {std::pair<const char*, std::uint32_t>("clamped", kForceClamped),
                                   {"rate_limited", kForceRateLimited},
                                   {"heat_limited", kForceHeatLimited},
                                   {"not_finite", kForceNotFinite},
                                   {"ramped", kForceRamped},
                                   {"withheld", kForceWithheld},
                                   {"handle_held", kHandleHeld}}) {
    EventFigures e;
    e.name = name;
    e.flag = flag;
    double run = 0;
    for (std::size_t i = 0; i < r.flags.size(); ++i) {
      if (!(r.flags[i] & flag)) {
        run = 0;
        continue;
      }
      ++e.ticks;
      if (i == 0 || !(r.flags[i - 1] & flag)) ++e.events;
      run += held_for(r, i);
      e.longest = std::max(e.longest, run);
    }
    e.share = static_cast<double>(e.ticks) / static_cast<double>(r.flags.size());
    all.push_back(e);
  }
  return all;
}

std::vector<FaultFigures> fault_events(const SessionRecording& r) {
  std::vector<FaultFigures> all;
  for (std::size_t i = 0; i < r.fault.size(); ++i) {
    if (r.fault[i] == 0) continue;
    const auto fault = static_cast<DeviceFault>(r.fault[i]);
    const std::string name = name_of(fault);
    auto at =
        std::find_if(all.begin(), all.end(), [&](const FaultFigures& f) { return f.name == name; });
    if (at == all.end()) {
      all.push_back({name, describe(fault), 0, 0, severity_of(fault) == FaultSeverity::kFinal,
                     r.servo_time[i]});
      at = all.end() - 1;
    }
    ++at->ticks;
    if (i == 0 || r.fault[i - 1] != r.fault[i]) ++at->onsets;
  }
  return all;
}

Measured<LagFigures> lag_figures(const SessionRecording& r, const Parameters& p) {
  if (r.header.trace.drive != "coupled")
    return Measured<LagFigures>::no("the session was not coupled: the bur is where the handle is");
  const std::vector<StepRecord>& rows = r.header.trace.rows;
  LagFigures f;
  const auto paused = [&](std::size_t i) { return (r.flags[i] & kPaused) != 0; };
  std::size_t counted = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) counted += !paused(i);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (paused(i)) continue;
    const Vec3 spring = rows[i].handle.pose.position - rows[i].bur.position;
    const double lag = spring.norm();
    f.mean += lag / static_cast<double>(counted);
    if (lag > f.largest) {
      f.largest = lag;
      f.largest_at = rows[i].handle.time;
    }
    f.largest_force_over_k =
        std::max(f.largest_force_over_k, rows[i].device_force.norm() / p.coupling.stiffness);
    // The first row, and that of a resume, has no force by definition.
    if (i == 0 || paused(i - 1) || r.tick[i] != r.tick[i - 1] + 1) continue;
    const Vec3 handle_velocity =
        (rows[i].handle.pose.position - rows[i - 1].handle.pose.position) / p.time_step;
    const Vec3 law = p.coupling.stiffness * spring +
                     p.coupling.damping * (handle_velocity - rows[i].bur_velocity);
    f.law_residual =
        std::max(f.law_residual, (-rows[i].device_force - law).norm() / p.coupling.stiffness);
  }
  return f;
}

PortSpring port_spring(const SessionRecording& r, const Parameters& p) {
  PortSpring spring;
  if (!r.header.protocol.empty()) {
    const Protocol protocol = parse_protocol(r.header.protocol);
    if (protocol.kind == ProtocolKind::kWall) spring.stiffness = protocol.stiffness_n_per_mm;
  } else if (r.header.trace.drive == "coupled") {
    spring = {p.coupling.stiffness, p.coupling.damping, p.coupling.bur_mass};
  }
  return spring;
}

Measured<DevicePortFigures> device_port_figures(const SessionRecording& r,
                                                const PortSpring& spring) {
  const std::size_t n = r.force_sent.size();
  if (n < 2) return Measured<DevicePortFigures>::no("fewer than two ticks");
  const double per_square = spring.stiffness / 2 + spring.damping * r.header.rate_hz;
  DevicePortFigures f;
  f.energy.reserve(n);
  PortExtremes measured(r.servo_time[0]), unexplained(r.servo_time[0]);
  double energy = 0;
  std::size_t last = 0;  // the row of the last reading that counted
  for (std::size_t i = 0; i < n; ++i) {
    if (!(r.flags[i] & kReadingRejected)) {
      const Vec3 step = r.device_position[i] - r.device_position[last];
      energy -= r.force_sent[i].dot(step);
      if (!(r.flags[i] & kHandleHeld)) f.sampling += per_square * step.squaredNorm();
      last = i;
    }
    f.energy.push_back(energy);
    f.peak_force = std::max(f.peak_force, r.force_sent[i].norm());
    f.store = std::max(f.store, stored_energy(r, i, spring));
    measured.add(energy, r.servo_time[i]);
    unexplained.add(energy + f.sampling, r.servo_time[i]);
  }
  f.last = energy;
  f.minimum = measured.minimum;
  f.minimum_at = measured.minimum_at;
  f.largest_return = measured.largest_return;
  f.return_from = measured.return_from;
  f.return_to = measured.return_to;
  f.unexplained_minimum = unexplained.minimum;
  f.unexplained_at = unexplained.minimum_at;
  f.unexplained_return = unexplained.largest_return;
  f.unexplained_from = unexplained.return_from;
  f.unexplained_to = unexplained.return_to;
  if (!(f.peak_force > 0)) return Measured<DevicePortFigures>::no("the device never sent a force");
  return f;
}

Measured<BurPortFigures> bur_port_figures(const SessionRecording& r, const Parameters& p) {
  const std::vector<StepRecord>& rows = r.header.trace.rows;
  BurPortFigures f;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    f.torque_work += rows[i].power * p.time_step;
    f.feed_work -= rows[i].grinding_force.dot(rows[i].bur_velocity) * p.time_step;
    f.feed_minimum = std::min(f.feed_minimum, f.feed_work);
  }
  // By another law than the paper's only the session's own audit knows it.
  for (int k = 0; k < kTissueCount && is_linear(p); ++k)
    f.removed_energy += p.tissue[static_cast<std::size_t>(k)].specific_energy *
                        rows.back().removed_volume[static_cast<std::size_t>(k)];
  const EnergyAudit& audit = r.header.trace.audit;
  if (r.complete && audit.removed_energy_mj > 0) {
    f.torque_work = audit.torque_work_mj;
    f.removed_energy = audit.removed_energy_mj;
    f.audited = true;
  }
  if (f.torque_work == 0 && f.removed_energy == 0)
    return Measured<BurPortFigures>::no("nothing was ground");
  f.ratio = f.removed_energy > 0 ? f.torque_work / f.removed_energy
                                 : std::numeric_limits<double>::quiet_NaN();
  return f;
}

Measured<ThermalFigures> thermal_figures(const SessionRecording& r, const RigMethod& method) {
  const std::size_t n = r.force_sent.size();
  if (n < 2) return Measured<ThermalFigures>::no("fewer than two ticks");
  ThermalFigures f;
  // heat[i]: integral of f² up to row i; the force of row i + 1 was held from row i.
  std::vector<double> heat(n, 0.0);
  double state = 0, hottest = 0, worst = 0;
  for (std::size_t i = 1, from = 0; i < n; ++i) {
    const double dt = r.servo_time[i] - r.servo_time[i - 1];
    const double square = r.force_sent[i].squaredNorm();
    heat[i] = heat[i - 1] + square * dt;
    f.peak_force = std::max(f.peak_force, std::sqrt(square));
    state += (square - state) * -std::expm1(-dt / method.thermal_time_constant_s);
    hottest = std::max(hottest, state);
    while (r.servo_time[i] - r.servo_time[from + 1] >= method.thermal_window_s) ++from;
    const double span = r.servo_time[i] - r.servo_time[from];
    if (span >= method.thermal_window_s || from == 0)
      worst = std::max(worst, (heat[i] - heat[from]) / std::max(span, method.thermal_window_s));
  }
  const double all = r.servo_time[n - 1] - r.servo_time[0];
  f.rms = std::sqrt(heat[n - 1] / all);
  // A recording shorter than the window is judged by what it has.
  f.worst_window_rms = all < method.thermal_window_s ? f.rms : std::sqrt(worst);
  f.model_force = std::sqrt(hottest);
  const double continuous = r.header.max_continuous_force_n;
  f.load = continuous > 0 ? f.model_force / continuous : std::numeric_limits<double>::quiet_NaN();
  return f;
}

}  // namespace toothprep
