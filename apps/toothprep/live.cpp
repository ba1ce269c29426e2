// toothprep live: a session on a haptic device, recorded.
#include <fmt/format.h>
#include <signal.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "command.h"
#include "numeric_options.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/device/openhaptics_device.h"
#include "toothprep/tools/device/simulated_device.h"
#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/live/live_watch.h"
#include "toothprep/tools/live/tick_statistics.h"
#include "toothprep/tools/rig_check/protocol.h"
#include "toothprep/tools/rig_check/protocol_force.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

constexpr double kAbove = 3;  // mm over the tooth, where the bur starts if nothing says where

struct Options {
  SessionOptions session;
  std::string output, prepared, device = "simulated", device_name, mirror_name, library;
  std::string registration, hand, protocol, pedal = "none", clutch = "none";
  std::vector<double> start;  // mm, W
  double duration = 0, display_hz = 0;
  std::optional<double> force_limit, force_rate, vibration_limit;
  std::optional<long> rate;
  bool force = false, json = false, no_real_time = false, strict = false;
};

// ---- The device

std::uint32_t button_mask(const std::string& text) {
  return text == "none" ? 0u : 1u << (std::stoul(text) - 1);
}

// The hand of the simulated device: along a path given in W, or about the start.
HandMotion hand_motion(const Options& o, const Registration& r, const Vec3& start,
                       std::vector<std::string>& notes) {
  const Quat to_device = r.rotation.conjugate();
  const Vec3 origin = r.translation.value_or(start);  // of D, in W
  const auto pose_of = [&](const Pose& w) {
    return Pose{to_device * (w.position - origin),
                to_device * w.orientation * r.stylus_to_bur.conjugate()};
  };
  if (o.hand.empty()) {
    notes.push_back("the simulated hand moves in slow loops; --hand gives it a path");
    DevicePose centre;
    const Pose at = pose_of({start, orientation_of_axis(r.rotation * Vec3::UnitY())});
    centre.position = at.position;
    centre.orientation = at.orientation;
    centre.buttons = 1;
    return gentle_hand(centre, Vec3(2, 1, 2));
  }
  std::vector<HandleSample> path = load_trajectory(o.hand).samples;
  const double from = path.front().time;
  for (HandleSample& sample : path) {
    sample.time -= from;
    sample.pose = pose_of(sample.pose);
  }
  return hand_along(std::move(path));
}

// What a check needs of the simulated hand: rest, a slow swing about the springs' centre, or a slow
// steady pull against dampers or into the wall.
HandMotion hand_for(const Protocol& protocol) {
  constexpr double kSpeed = 0.5;                  // mm/s
  constexpr double kSwing = 1, kFrequency = 0.5;  // mm, Hz
  return [kind = protocol.kind](double time) {
    DevicePose pose;
    if (kind == ProtocolKind::kDampingSweep) pose.position.x() = kSpeed * time;
    if (kind == ProtocolKind::kWall) pose.position.y() = -kSpeed * time;
    if (kind == ProtocolKind::kStiffnessSweep)
      pose.position.x() = kSwing * std::sin(2 * units::kPi * kFrequency * time);
    return pose;
  };
}

std::unique_ptr<HapticDevice> open_device(const Options& o,
                                          const std::function<HandMotion()>& hand) {
  if (o.device == "openhaptics") {
    OpenHapticsSettings settings;
    settings.name = o.device_name;
    if (!o.mirror_name.empty()) settings.mirror_name = o.mirror_name;
    settings.library = o.library;
    settings.rate = o.rate;
    return open_openhaptics(settings);
  }
  SimulatedSettings settings;
  settings.motion = hand();
  if (o.rate) settings.phantom.rate = static_cast<double>(*o.rate);
  return std::make_unique<SimulatedDevice>(settings);
}

void check_calibration(HapticDevice& device) {
  switch (device.calibration()) {
    case Calibration::kOk:
      return;
    case Calibration::kNeedsUpdate:
      throw Error(
          "the device is not calibrated; move its arm through the whole workspace, then try again");
    case Calibration::kNeedsManualInput:
      throw Error(
          "the device is not calibrated; put the stylus into its inkwell or rest, then try again");
  }
}

ForceLimits limits_of(const Options& o, const DeviceLimits& device) {
  ForceLimits limits;
  limits.period = 1 / device.rate;
  limits.max_force = std::min(o.force_limit.value_or(device.max_force), device.max_force);
  limits.continuous_force = device.max_continuous_force;
  if (o.force_rate) limits.max_force_rate = *o.force_rate;
  if (o.vibration_limit) limits.vibration_limit = *o.vibration_limit;
  return limits;
}

// ---- What is recorded

std::string host_line(const std::string& scheduling) {
  utsname name{};
  uname(&name);
  return std::string(name.sysname) + " " + name.release + " " + name.machine + ", " +
         std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) + " processors; " + scheduling;
}

void describe_device(const HapticDevice& device, const Options& o, const ForceLimits& limits,
                     SessionHeader& header) {
  const DeviceIdentity& id = device.identity();
  const DeviceLimits& l = device.limits();
  header.device_kind = o.device;
  header.device_name = id.name;
  header.device_model = id.model;
  header.device_vendor = id.vendor;
  header.device_driver = id.driver;
  header.device_serial = id.serial;
  header.device_firmware = id.firmware;
  if (device.mirror_identity()) header.mirror_model = device.mirror_identity()->model;
  header.rate_hz = l.rate;
  header.max_force_n = l.max_force;
  header.max_continuous_force_n = l.max_continuous_force;
  header.max_stiffness_n_per_mm = l.max_stiffness;
  header.max_damping_n_s_per_mm = l.max_damping;
  header.workspace_min = l.workspace.min();
  header.workspace_max = l.workspace.max();
  header.limit_notes = l.notes;
  header.force_limit_n = limits.max_force;
  header.force_rate_limit_n_per_s = limits.max_force_rate;
  header.pedal = o.pedal;
  header.host = host_line(o.no_real_time ? "normal priority" : "real-time priority asked for");
}

// Every tick to the recorder, the display and the figures of the end.
class Sinks final : public TickSink {
 public:
  Sinks(SessionRecorder* recorder, DisplaySurface* display)
      : recorder_(recorder), display_(display) {}
  void take(const LiveTick& tick) noexcept override {
    statistics.add(tick);
    if (recorder_) recorder_->push(tick);
    if (display_) display_->tick();
  }
  TickStatistics statistics;

 private:
  SessionRecorder* recorder_;
  DisplaySurface* display_;
};

// ---- Signals: held back everywhere, looked at by the main thread.

class Signals {
 public:
  Signals() {
    sigemptyset(&set_);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&set_, signal);
    pthread_sigmask(SIG_BLOCK, &set_, &before_);
  }
  ~Signals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  bool came() {
    const timespec now{};
    came_ = came_ || sigtimedwait(&set_, nullptr, &now) > 0;
    return came_;
  }

 private:
  sigset_t set_{}, before_{};
  bool came_ = false;
};

// ---- Progress and figures

LiveWatch watch_for(const Options& o, const Common& common, Signals& signals,
                    const SessionRecorder* recorder) {
  LiveWatch watch;
  watch.duration = o.duration;
  watch.stop_asked = [&signals] { return signals.came(); };
  watch.real_time = !o.no_real_time;
  watch.report_scheduling = [&common](const std::string& line) { say(common, line); };
  const bool terminal = !common.quiet && isatty(STDERR_FILENO) != 0;
  watch.report = [terminal, recorder, warned = false, steps = std::int64_t{0}](
                     const LiveStatus& s, const DeviceStatus& d) mutable {
    if (recorder && recorder->failure() && !warned) {
      warned = true;
      warn("the recording stopped: " + *recorder->failure() + "; the session goes on");
    }
    if (!terminal) return;
    std::fprintf(
        stderr, "\r%6.1f s  %5lld ticks/s  force %5.2f N  lag %5.3f mm  removed %7.3f mm3  %s%s   ",
        d.time, static_cast<long long>((s.steps - steps) * 4), s.force, s.lag,
        s.removed[0] + s.removed[1] + s.removed[2] + s.removed[3],
        s.stalled   ? "STALLED"
        : s.running ? "turning"
                    : "stands",
        s.heat > 0.9 ? "  motors hot" : "");
    std::fflush(stderr);
    steps = s.steps;
  };
  return watch;
}

EnergyAudit audit_of(const SessionTotals& t, const Parameters& parameters) {
  EnergyAudit audit{t.torque_work, 0, std::numeric_limits<double>::quiet_NaN()};
  for (int k = 0; k < kTissueCount; ++k)
    audit.removed_energy_mj += parameters.tissue[k].specific_energy * t.removed[k];
  if (audit.removed_energy_mj > 0)
    audit.energy_ratio = audit.torque_work_mj / audit.removed_energy_mj;
  return audit;
}

// What the totals of a session say of it; nothing of an active check.
struct Judged {
  Audit audit;
  std::vector<Finding> findings;
};

Judged judged(const SessionTotals& t, const EnergyAudit& audit, const Parameters& parameters,
              Drive drive) {
  Judged j;
  j.audit = judge_audit(audit.torque_work_mj, audit.removed_energy_mj, t.removed, parameters);
  j.findings =
      judge_run(judge_parameters(parameters), j.audit, t.peak_device_force, t.largest_lag, drive);
  return j;
}

nlohmann::ordered_json report_json(const TickStatistics& t, const LiveEnd& end, const Options& o,
                                   const HapticDevice& device,
                                   const std::optional<Judged>& judged) {
  nlohmann::ordered_json j;
  j["schema"] = "toothprep-live";
  j["session"] = o.output;
  j["device"] = device.identity().model;
  j["ticks"] = t.ticks;
  j["missed_ticks"] = t.missed;
  j["period_us_p50"] = t.period.quantile(0.5);
  j["period_us_p99_9"] = t.period.quantile(0.999);
  j["period_us_max"] = t.period.worst();
  j["step_us_p50"] = t.step.quantile(0.5);
  j["step_us_p99"] = t.step.quantile(0.99);
  j["step_us_p99_9"] = t.step.quantile(0.999);
  j["step_us_max"] = t.step.worst();
  j["clamped_ticks"] = t.clamped;
  j["rate_limited_ticks"] = t.rate_limited;
  j["heat_limited_ticks"] = t.heat_limited;
  j["faults"] = end.device.faults;
  j["end_reason"] = end.reason;
  j["fault"] = end.fault;
  if (judged) put_judgement(j, judged->audit, judged->findings);
  return j;
}

void report_ticks(const Common& common, const TickStatistics& t) {
  say(common,
      fmt::format("{} ticks, {} missed; period {:.0f} us median, {:.0f} us 99.9 %, {:.0f} us worst",
                  t.ticks, t.missed, t.period.quantile(0.5), t.period.quantile(0.999),
                  t.period.worst()));
  say(common, fmt::format("tick's own CPU time {:.0f} us median, {:.0f} us 99.9 %, {:.0f} us worst",
                          t.step.quantile(0.5), t.step.quantile(0.999), t.step.worst()));
}

RecorderOptions recording_of(const Options& o) {
  RecorderOptions options;
  options.replace = o.force;
  return options;
}

// ---- The two kinds of run

Vec3 start_above(const LayeredTooth& tooth, const Registration& registration) {
  const Box box = bounds_of_solid(tooth);
  const Vec3 up = registration.rotation * Vec3::UnitY(), centre = 0.5 * (box.min + box.max);
  return centre + up * (0.5 * up.cwiseAbs().dot(box.max - box.min) + kAbove);
}

void check_rate(const HapticDevice& device, double time_step) {
  if (std::abs(device.limits().rate * time_step - 1) > 1e-6)
    throw Error(
        fmt::format("the device's servo runs at {:g} Hz, the model's step is {:g} s; give "
                    "--rate-hz or --time-step-s",
                    device.limits().rate, time_step));
}

void finish(const Options& o, const Common& common, const LiveEnd& end, SessionRecorder& recorder,
            const EnergyAudit& audit, const Sinks& sinks, const HapticDevice& device,
            const std::optional<Judged>& judged = {}) {
  if (!common.quiet && isatty(STDERR_FILENO) != 0) std::fputc('\n', stderr);
  std::string failure;
  try {
    recorder.finish({audit, end.reason});
  } catch (const Error& e) {
    failure = e.what();
  }
  report_ticks(common, sinks.statistics);
  if (recorder.dropped() > 0)
    warn(fmt::format("{} ticks could not be recorded", recorder.dropped()));
  say(common, o.output + ": " + std::to_string(recorder.rows()) + " rows; ended by: " + end.reason);
  if (o.json) std::cout << json_text(report_json(sinks.statistics, end, o, device, judged));
  if (end.fault) throw Error(end.reason + " (recorded in " + o.output + ")");
  if (!failure.empty()) throw Error(failure);
  if (judged) warn_or_refuse(o.output, judged->findings, o.strict);
}

void run_session(const Options& o, const Common& common, Signals& signals, Outputs& outputs) {
  const std::string prepared = outputs.optional_file(o.prepared, {".vdb"});
  outputs.begin();
  const Parameters parameters = load_parameters(o.session);
  const Bur bur = make_bur(o.session.bur, data_folder() + "/burs");
  const Registration registration =
      o.registration.empty() ? Registration() : read_registration(o.registration);
  if (registration.translation && !o.start.empty())
    throw Error(o.registration +
                ": has a translation, so --start-mm can't say where the hand starts");
  LayeredTooth tooth = load_tooth(o.session.tooth, o.strict);
  Vec3 start = start_above(tooth, registration);
  if (!o.start.empty())
    start = Vec3(o.start[0], o.start[1], o.start[2]);
  else if (!o.hand.empty())
    start = load_trajectory(o.hand).samples.front().pose.position;

  std::vector<std::string> notes;
  const auto device = open_device(o, [&] { return hand_motion(o, registration, start, notes); });
  for (const auto& note : notes) say(common, note);
  for (const auto& note : device->limits().notes) warn(note);
  check_calibration(*device);
  check_rate(*device, parameters.time_step);
  if (parameters.coupling.stiffness > device->limits().max_stiffness &&
      o.session.drive == "coupled")
    warn(
        fmt::format("the coupling's {:.2f} N/mm is above the {:.2f} N/mm that the device is said "
                    "to render stably; --stiffness-n-per-mm sets it",
                    parameters.coupling.stiffness, device->limits().max_stiffness));
  const ForceLimits limits = limits_of(o, device->limits());

  SessionHeader header;
  header.trace.parameters_toml = to_toml(parameters);
  header.trace.tooth_sha256 = tooth_sha256(tooth);
  header.trace.toothprep_version = kVersion;
  header.trace.bur = o.session.bur;
  header.trace.drive = o.session.drive;
  header.trace.engine = engine_name(parameters);
  describe_device(*device, o, limits, header);
  header.registration = HandleFrame(registration, Vec3::Zero(), start).device_to_world();

  Workpiece workpiece(tooth);
  std::unique_ptr<DisplaySurface> display;
  if (o.display_hz > 0) {
    DisplayOptions options;
    options.rate = o.display_hz;
    display = std::make_unique<DisplaySurface>(workpiece, options);
  }
  SessionRecorder recorder(o.output, header, recording_of(o));
  Sinks sinks(&recorder, display.get());
  LiveLoop loop(limits, {button_mask(o.pedal), button_mask(o.clutch)}, &sinks);
  std::unique_ptr<Session> session;
  const std::optional<Vec3> laid = registration.translation ? std::optional<Vec3>() : start;
  if (display) display->start();
  const LiveEnd end = run_live(
      *device, loop, registration, laid, parameters.time_step,
      [&](const Pose& pose) -> Session& {
        HandleSample first;
        first.pose = pose;
        session = std::make_unique<Session>(bur, workpiece, parameters, drive_of(o.session), first);
        return *session;
      },
      watch_for(o, common, signals, &recorder));

  EnergyAudit audit;
  audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  if (session) {
    const SessionTotals& t = session->totals();
    audit = audit_of(t, parameters);
    say(common, fmt::format("removed: enamel {:.3f}, dentin {:.3f}, pulp {:.3f}, other {:.3f} "
                            "mm^3; peak force {:.2f} N; stalled in {} steps",
                            t.removed[0], t.removed[1], t.removed[2], t.removed[3],
                            t.peak_device_force, t.stalled_steps));
  }
  if (display) {
    display->finish();
    const DisplayStats d = display->stats();
    say(common,
        fmt::format(
            "display: {:.1f} passes/s, {} blocks redone, latency {:.0f} ms median, {:.0f} ms worst",
            d.rate, d.blocks, 1e3 * d.latency_median, 1e3 * d.latency_worst));
  }
  std::string failure;
  if (!prepared.empty()) {
    apply_remaining_solid(tooth, workpiece.remaining_solid());
    try {
      write_tooth(tooth, prepared);
      outputs.publish();
    } catch (const Error& e) {  // the recording is finished all the same
      failure = e.what();
    }
  }
  std::optional<Judged> judgement;
  if (session) {
    judgement = judged(session->totals(), audit, parameters, drive_of(o.session));
    say(common, audit_text(judgement->audit));
  }
  finish(o, common, end, recorder, audit, sinks, *device, judgement);
  if (!failure.empty()) throw Error(failure);
}

void run_protocol(const Options& o, const Common& common, Signals& signals, Outputs& outputs) {
  outputs.begin();
  const Protocol protocol = parse_protocol(o.protocol);
  const auto device = open_device(o, [&] { return hand_for(protocol); });
  for (const auto& note : device->limits().notes) warn(note);
  check_calibration(*device);
  const ForceLimits limits = limits_of(o, device->limits());

  SessionHeader header;
  Parameters parameters = preset_parameters("paper");
  parameters.time_step = limits.period;
  header.trace.parameters_toml = to_toml(parameters);
  header.trace.toothprep_version = kVersion;
  header.trace.drive = "direct";
  header.trace.engine = engine_name(parameters);
  describe_device(*device, o, limits, header);
  header.protocol = print_protocol(protocol);

  say(common, "active check: " + header.protocol + "; hold the stylus lightly (rest: not at all)");
  SessionRecorder recorder(o.output, header, recording_of(o));
  Sinks sinks(&recorder, nullptr);
  ProbeLoop loop(limits, protocol_force(protocol, limits.period), &sinks);
  LiveWatch watch = watch_for(o, common, signals, &recorder);
  watch.duration = protocol_duration(protocol);
  const LiveEnd end = run_probe(*device, loop, watch);
  EnergyAudit audit;
  audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  finish(o, common, end, recorder, audit, sinks, *device);
}

void run(const Options& o, const Common& common) {
  if (o.output.empty()) throw CLI::RequiredError("--output");
  if (o.protocol.empty()) {
    if (o.session.bur.empty()) throw CLI::RequiredError("--bur");
    if (o.session.tooth.empty()) throw CLI::RequiredError("--tooth");
  }
  Outputs outputs(o.force);
  outputs.reads({o.session.tooth, o.session.bur, o.session.params, o.registration, o.hand});
  outputs.growing(o.output, {".h5", ".hdf5"});
  Signals signals;
  if (o.protocol.empty())
    run_session(o, common, signals, outputs);
  else
    run_protocol(o, common, signals, outputs);
}

}  // namespace

void add_live(CLI::App& app, const Common& common) {
  auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "live",
      "A session on a haptic device at its servo rate, recorded so that it can be replayed");
  add_session_options(*sub, o->session);
  sub->add_option("-o,--output", o->output,
                  "Recording to write (.h5); readable while it grows, required");
  sub->add_option("--device", o->device, "openhaptics (Phantom, Touch) or simulated")
      ->check(CLI::IsMember({"openhaptics", "simulated"}))
      ->capture_default_str();
  sub->add_option("--device-name", o->device_name,
                  "As configured in the driver (absent: its default device)");
  sub->add_option("--mirror", o->mirror_name, "A second device, whose pose is recorded");
  sub->add_option("--libhd", o->library,
                  "The vendor's library (absent: $TOOTHPREP_LIBHD, libHD.so)");
  sub->add_option("--rate-hz", o->rate, "Servo rate (absent: the driver's)")
      ->check(CLI::Range(100L, 10000L));
  sub->add_option("--duration-s", o->duration, "Ends after so long (absent: until Ctrl-C)")
      ->check(CLI::Range(0.01, 86400.0));
  sub->add_option("--registration", o->registration,
                  "Device frame to tooth frame (.toml; format in data/rig/FORMATS.md)");
  sub->add_option(
         "--start-mm", o->start,
         "Where in the tooth's frame the hand starts, X,Y,Z (absent: 3 mm above the tooth)")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--hand", o->hand,
                  "Simulated device: the hand's path in the tooth's frame (.toml, .csv or .h5)");
  sub->add_option("--pedal", o->pedal,
                  "Button that starts the bur: none (it always runs), 1, 2, 3, 4")
      ->check(CLI::IsMember({"none", "1", "2", "3", "4"}))
      ->capture_default_str();
  sub->add_option("--clutch", o->clutch,
                  "Button that, while held, moves the hand without the handle")
      ->check(CLI::IsMember({"none", "1", "2", "3", "4"}))
      ->capture_default_str();
  sub->add_option("--force-limit-n", o->force_limit, "At most so much force (absent: the device's)")
      ->check(CLI::Range(0.01, 100.0));
  sub->add_option("--force-rate-n-per-s", o->force_rate, "At most so fast a change (3000)")
      ->check(CLI::Range(1.0, 1e6));
  or_infinity(
      sub->add_option("--vibration-limit-n", o->vibration_limit,
                      "RMS above 20 Hz at which the force is switched off (1); inf: never"));
  sub->add_option("--prepared", o->prepared, "Also write the prepared tooth (.vdb)");
  sub->add_option("--display-hz", o->display_hz,
                  "Keep the surface for a display up to date at this rate (0: not)")
      ->check(CLI::Range(0.0, 1000.0));
  sub->add_option(
      "--protocol", o->protocol,
      "An active check of the device instead of a session: rest, step, stiffness-sweep, "
      "damping-sweep, wall, with their figures if you like (see toothprep rig-check)");
  sub->add_flag("--no-real-time", o->no_real_time, "Without SCHED_FIFO and locked memory");
  sub->add_flag("--strict", o->strict,
                "Exit 1 for a tooth that another program changed (before the session), parameters "
                "that can't be meant or an energy audit out of range (the recording stays)");
  sub->add_flag("--json", o->json, "Figures of the ticks as JSON on stdout");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Examples:\n"
      "  toothprep live --tooth block.vdb --bur cylinder:D1.2xL3.0 --hand path.toml --duration-s "
      "60 "
      "-o session.h5\n"
      "  toothprep live --tooth molar.vdb --bur 330 --device openhaptics --pedal 1 --clutch 2 -o "
      "session.h5\n"
      "  toothprep live --device openhaptics --protocol rest -o rest.h5");
  sub->callback([o, &common] {
    if (o->session.bur == "list") return print_bur_library();
    run(*o, common);
  });
}

}  // namespace toothprep::app
