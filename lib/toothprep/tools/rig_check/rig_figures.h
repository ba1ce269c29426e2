// The figures of a recording and of its rig: pure functions, a struct of figures each.
//
//   symbol   meaning                                                  unit
//   T        nominal period, 1/header.rate_hz                         s
//   t_n      start of the tick of row n                               s
//   x_n      the handle as the device read it in that tick, frame D   mm
//   f_n      the force that the motors held from row n to row n + 1, frame D: what the device says
//            in row n + 1 that it sent                                N
//
// A quantile q of n values is the smallest value that at least q n of them do not exceed.
//
// Units mm, s, N unless a name says otherwise. Rows that the recorder dropped are seen by the
// device's count: periods across them are left out, and the last force stands for all of them.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/rig_check/rig_limits.h"

namespace toothprep {

// A result, or in words why there is none.
template <class T>
struct Measured {
  Measured(T result) : value(std::move(result)) {}
  static Measured no(std::string reason) {
    Measured m;
    m.why_not = std::move(reason);
    return m;
  }
  explicit operator bool() const { return value.has_value(); }
  const T& operator*() const { return *value; }
  const T* operator->() const { return &*value; }

  std::optional<T> value;
  std::string why_not;

 private:
  Measured() = default;
};

// Throws Error unless there is a row, every column has a value per row, times and counts increase,
// the rate is > 0, and positions, forces and times are finite.
void check_recording(const SessionRecording& recording);

// The nearest to a uniform clock, by least squares: t_n = start + k_n period, where k_n counts
// periods. k_n follows from the times alone, from the end of the recording backward, so that a late
// tick before one that comes on time is late and not another period's.
struct ClockFit {
  double start = 0, period = 0;  // s
  std::vector<long> index;       // k_n
  std::vector<double> residual;  // s, of t_n
};
ClockFit fit_clock(const SessionRecording& recording);

struct ServoFigures {
  std::vector<double> periods;  // s, t_n - t_n-1, rows without a dropped one between
  double median = 0, p999 = 0, worst = 0;
  double late_share = 0;      // of the periods: above late_periods T
  long missed_by_device = 0;  // sum of the device's own count
  // By the times: periods of the fitted clock without a tick. The device rounds each period, so
  // that it counts a tick late by more than T/2 as a missed one; this doesn't.
  long missed_by_times = 0;
  double missed_share = 0;  // of the periods that there should have been, by the times
  double jitter_rms = 0, jitter_peak_to_peak = 0;  // s, of the residuals of the clock
  double clock_error_ppm = 0;  // (T / fitted period - 1) 1e6: positive, it runs fast
};
Measured<ServoFigures> servo_figures(const SessionRecording& recording, const RigMethod& method);

// CPU time of the tick's work, without the first tick, which also sets its thread up.
struct StepCostFigures {
  std::vector<double> costs;  // s
  double median = 0, p99 = 0, p999 = 0, worst = 0;
  double p999_share = 0;  // of the period
};
Measured<StepCostFigures> step_cost_figures(const SessionRecording& recording);

// Rows that lack: what the recorder says, and what the device's count says.
struct RecorderFigures {
  long dropped = 0, gaps_in_count = 0;
};
RecorderFigures recorder_figures(const SessionRecording& recording);

// Spans at rest: all windows of a recording of the protocol `rest`; of others, windows that pass
// the method's three conditions. First row and the one after the last.
std::vector<std::pair<std::size_t, std::size_t>> rest_windows(const SessionRecording& recording,
                                                              const RigMethod& method);

// Resolution of the encoders, per axis.
//
//   at rest   the lower quartile of the gaps between the distinct readings, sorted, of all rest
//             windows: on a grid of counts most gaps are one count, however large the noise
//   moving    (without two distinct readings at rest) the 5 % quantile of the differences that
//             aren't zero between one tick's reading and the next's
//
// Readings closer than kSameReading are the same. A real arm counts joint angles: its quantum
// varies over the workspace, and this is its value where the recording was made.
constexpr double kSameReading = 1e-4;  // mm
struct QuantumFigures {
  std::array<double, 3> axis{};  // mm; 0: that axis never changed
  double largest = 0;            // mm
  bool at_rest = false;          // else moving
};
Measured<QuantumFigures> quantum_figures(const SessionRecording& recording,
                                         const RigMethod& method);

// Noise at rest about the straight line of each window, per axis and the worst of them. The
// encoder's counts alone make D/sqrt(12) while the reading moves between several of them; what is
// above is root(rms² - D²/12). Velocity: (x_n - x_n-1)/T; one count is D/T.
struct RestFigures {
  double seconds = 0;
  std::array<double, 3> noise{};           // mm rms
  double worst_noise = 0;                  // mm rms
  double noise_above_quantum = 0;          // mm rms
  std::array<double, 3> velocity_noise{};  // mm/s rms
  double worst_velocity_noise = 0;         // mm/s rms
};
Measured<RestFigures> rest_figures(const SessionRecording& recording, const RigMethod& method);

// What was done to the force, and how often: a run of consecutive rows is one event.
struct EventFigures {
  std::string name;
  std::uint32_t flag = 0;
  long ticks = 0, events = 0;
  double share = 0;    // of the rows
  double longest = 0;  // s
};
std::vector<EventFigures> force_events(const SessionRecording& recording);  // one per LiveFlag

struct FaultFigures {
  std::string name, description;
  long ticks = 0, onsets = 0;
  bool final = false;
  double first = 0;  // s
};
std::vector<FaultFigures> fault_events(const SessionRecording& recording);  // those that happened

// The bur behind the handle, |P_H - P|, in coupled drive. By the coupling's law
// F_VC = k (P_H - P) + b (v_H - v) the recorded force gives it once more; the residual is the
// largest norm of the difference over k. Without b the lag is F/k.
struct LagFigures {
  double mean = 0, largest = 0, largest_at = 0;  // mm, mm, s
  double largest_force_over_k = 0;               // mm
  double law_residual = 0;                       // mm
};
Measured<LagFigures> lag_figures(const SessionRecording& recording, const Parameters& parameters);

// Passivity observer at the device's port (Hannaford and Ryu, IEEE Trans. Robotics and Automation
// 18 (2002) 1-10): E_n = -sum f_j . dx_j+1, j < n, dx_j = x_j - x_j-1: the energy that the rendered
// world took from the hand, less what it gave. Rejected readings moved nothing and are left out.
//
// A passive world behind a sampled and held spring gives a little: the force answers a step dx only
// afterwards, so that the spring (k, b) is stretched by it for nothing. A step of the coupled bur
// with stretch s, mass m and velocity v (backward Euler, v' and s' after it) changes what spring and
// bur store, H = k s²/2 + m v²/2, by
//
//   H' - H = k s . dx + k dx²/2 - k (v' T)²/2 - m (v' - v)²/2 + F_G . v' T
//
// where k s . dx is the observer's term and all that stands behind k dx²/2 takes energy. The damper b
// adds as much as b dx²/T. So, whatever the motion and however coarse the counts,
//
//   E_n + A_n >= 0,   A_n = (k/2 + b/T) sum dx_j²,   j <= n
//
// and what comes back of E + A is at most the largest H. Slow motion in counts of q has a dx of q
// per count: k q²/2 each, so that A grows with the path. A spring alone with its far end at rest,
// the wall of an active check, is the same without a bur. (k/2 + b/T) dx² a tick is the energy in
// the condition of Colgate and Schenkel, J. Robotic Systems 14 (1997) 37-47.
struct PortSpring {  // what is between the handle and the world; all zero: nothing is known, A = 0
  double stiffness = 0;  // k, N/mm
  double damping = 0;    // b, N·s/mm
  double mass = 0;       // m, of the bur, N·s²/mm
};
// The coupling of a session, the wall of an active check; of anything else nothing.
PortSpring port_spring(const SessionRecording& recording, const Parameters& parameters);

struct DevicePortFigures {
  std::vector<double> energy;                                 // E_n, mJ, per row
  double minimum = 0, minimum_at = 0;                         // mJ, s
  double last = 0;                                            // mJ
  double largest_return = 0, return_from = 0, return_to = 0;  // mJ, s, s; max (E_i - E_j), i < j
  double peak_force = 0;                                      // N
  double sampling = 0;                                        // A at the end, mJ
  double unexplained_minimum = 0, unexplained_at = 0;         // of E + A, mJ, s
  double unexplained_return = 0, unexplained_from = 0, unexplained_to = 0;  // likewise
  double store = 0;  // largest H, mJ; 0 without a spring
};
Measured<DevicePortFigures> device_port_figures(const SessionRecording& recording,
                                                const PortSpring& spring = {});

// At the bur's port: the work of the torque (2 pi N T_z) against the energy of what was removed
// (u per tissue); and the work that the feed does on the tissue, -sum F_G . v h, whose minimum is
// below zero only if the contact pushed energy into the bur.
struct BurPortFigures {
  double torque_work = 0, removed_energy = 0;  // mJ
  double ratio = 0;                            // NaN if nothing was removed
  bool audited = false;                    // by the session's own audit; else summed over the rows
  double feed_minimum = 0, feed_work = 0;  // mJ
};
Measured<BurPortFigures> bur_port_figures(const SessionRecording& recording,
                                          const Parameters& parameters);

// Heating of the motors goes with the square of the force. rms over all and over the worst window;
// and a first-order model from cold, dq/dt = (f² - q)/tau, whose largest sqrt(q) is the steady
// force that would heat as much. Load: that over the continuous force of the device.
struct ThermalFigures {
  double rms = 0, worst_window_rms = 0, model_force = 0, peak_force = 0;  // N
  double load = 0;  // 1; NaN if the device states no continuous force
};
Measured<ThermalFigures> thermal_figures(const SessionRecording& recording,
                                         const RigMethod& method);

// Limits of theory (tools/device/stability_map.h, where they come from) for this device, beside what was
// rendered. Stiffness in N/mm, damping in N·s/mm; d = delay_ticks.
//
//   k_b    b / (T/2 + d T)          the device alone: passive whoever holds it (d = 0: 2 b/T)
//   k_bh   (b + b_h) / (T/2 + d T)  with a light grip
//   k_f    2 f_c / D
//   margin of the coupling: max(k_bh, k_f) / k; above both limits an oscillation can go on
//   B_l    linear_damping_limit(m, T, d);  B_c = m v/D;  B_f = 2 f_c T/D
//   margin of direct rendering: min(B_l, max(B_c, B_f)) / B, B the tooth's own damping: the median
//   of |F_G|/|v| in contact
struct StabilityFigures {
  std::string device, status;
  double count = 0;  // D, mm, used
  bool count_measured = false;
  double stiffness = 0, limit_device = 0, limit_hand = 0, limit_friction = 0;
  double coupling_margin = 0;
  double speed = 0;  // v, mm/s, used: the median of the bur's in contact, or the method's
  std::optional<double> tooth_damping;
  double limit_linear = 0, limit_counts = 0, limit_count_friction = 0;
  std::optional<double> direct_margin;
};
Measured<StabilityFigures> stability_figures(const SessionRecording& recording,
                                             const Parameters& parameters,
                                             const DeviceTraits* device, const RigMethod& method);

// The recording's handle path through the same session again: `replayed`, one per row. Equal means
// the bits of the bur's position, orientation and velocity, both forces, both torques, rotation
// rate, stall, and removed volumes (the last row's only if the session was closed).
struct ReplayFigures {
  long rows = 0, differing = 0;
  double first_at = 0;          // s
  std::string first_what;       // of the first row that differs
  double largest_force = 0;     // N, difference of the device's force
  double largest_position = 0;  // mm, of the bur's
  double largest_torque = 0;    // N·mm
  double largest_removal = 0;   // mm³
};
// Why the path can't be replayed (rows that lack), or empty.
std::string unreplayable(const SessionRecording& recording);
Measured<ReplayFigures> compare_replay(const SessionRecording& recording,
                                       const std::vector<StepRecord>& replayed);

}  // namespace toothprep
