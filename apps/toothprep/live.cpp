// toothprep live: a session on a haptic device, recorded.
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>
#include <utility>

#include "body_figures.h"
#include "command.h"
#include "numeric_options.h"
#include "opened_page.h"
#include "session_options.h"
#include "strictness.h"
#include "talk.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/body_warnings.h"
#include "toothprep/step/session/split_step.h"
#include "toothprep/tools/device/openhaptics_device.h"
#include "toothprep/tools/device/simulated_device.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trajectory_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/live/session_control.h"
#include "toothprep/tools/live_session/active_check.h"
#include "toothprep/tools/live_session/live_session.h"
#include "toothprep/tools/live_session/simulated_hand.h"
#include "toothprep/tools/view/live_scene.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

constexpr auto kLastWords = std::chrono::seconds(2);
constexpr double kManyMissed = 0.01, kTooManyMissed = 0.1;  // of the ticks
constexpr double kShortest = 0.1, kFarthest = 1e4;          // mm, of a registration's translation

struct Options {
  SessionOptions session;
  std::string output, prepared, device = "simulated", device_name, mirror_name, mirror_hand,
                                library;
  std::string registration, hand, protocol, pedal = "none", clutch = "none";
  std::vector<double> start;  // mm, W
  double duration = 0, display_hz = 0;
  std::optional<double> force_limit, force_rate, vibration_limit, vibration_time, heat_time,
      speed_limit, frozen;
  double ramp = ForceLimits().ramp, stale = LiveWatch().stale;
  double driver_wait = OpenHapticsSettings().open_wait;
  bool ignore_safety_switch = false;
  std::optional<long> rate;
  bool force = false, json = false, no_real_time = false, strict = false, view = false,
       no_open = false, control = false;
  int port = 0;
};

// ---- Signals: held back everywhere, looked at by the main thread.

class Signals {
 public:
  Signals() {
    sigemptyset(&set_);
    for (const int signal :
         {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2, SIGALRM, SIGPIPE, SIGTSTP})
      sigaddset(&set_, signal);
    sigset_t blocked = set_;
    sigaddset(&blocked, SIGCONT);  // seen by a pause that it overtakes; it works all the same
    pthread_sigmask(SIG_BLOCK, &blocked, &before_);
  }
  ~Signals() { release(); }
  // Those that came have had their answer. After a moment for what is left to say they end the
  // program as usual, if it hasn't ended yet: nobody may read what it says. Not SIGPIPE: that is no
  // reason to end otherwise than it did.
  void release() {
    if (std::exchange(released_, true)) return;
    came();
    sigset_t after = before_;
    sigaddset(&after, SIGPIPE);
    const auto take_them = [after] { pthread_sigmask(SIG_SETMASK, &after, nullptr); };
    try {
      std::thread([take_them] {
        std::this_thread::sleep_for(kLastWords);
        take_them();
        for (;;) ::pause();
      }).detach();
    } catch (const std::system_error&) {  // no thread to be had
      take_them();
    }
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  bool came() {
    const timespec now{};
    for (int signal = 0; (signal = sigtimedwait(&set_, nullptr, &now)) > 0;) {
      pause_ = pause_ || signal == SIGTSTP;
      // SIGPIPE: whoever read the output is gone, which is no reason to end.
      came_ = came_ || (signal != SIGPIPE && signal != SIGTSTP);
    }
    return came_;
  }
  bool pause_asked() { return std::exchange(pause_, false); }

 private:
  sigset_t set_{}, before_{};
  bool came_ = false, pause_ = false, released_ = false;
};

// ---- The device

std::uint32_t button_mask(const std::string& text) {
  return text == "none" ? 0u : 1u << (std::stoul(text) - 1);
}

std::unique_ptr<HapticDevice> open_device(const Options& o, Signals& signals,
                                          const std::function<HandMotion()>& hand) {
  if (o.device == "openhaptics") {
    OpenHapticsSettings settings;
    settings.name = o.device_name;
    if (!o.mirror_name.empty()) settings.mirror_name = o.mirror_name;
    settings.library = o.library;
    settings.rate = o.rate;
    settings.ramp = o.ramp;
    settings.open_wait = o.driver_wait;
    settings.start_wait = std::min(settings.start_wait, o.driver_wait);
    settings.stop_asked = [&signals] { return signals.came(); };
    return open_openhaptics(settings);
  }
  SimulatedSettings settings;
  settings.motion = hand();
  settings.ramp = o.ramp;
  if (!o.mirror_hand.empty())
    settings.mirror_motion = hand_along(read_trajectory(o.mirror_hand).samples);
  if (o.rate) settings.phantom.rate = static_cast<double>(*o.rate);
  return std::make_unique<SimulatedDevice>(settings);
}

ForceLimits limits_of(const Options& o, const DeviceLimits& device) {
  ForceLimits limits;
  limits.period = 1 / device.rate;
  limits.max_force = std::min(o.force_limit.value_or(device.max_force), device.max_force);
  limits.continuous_force = device.max_continuous_force;
  if (o.force_rate) limits.max_force_rate = *o.force_rate;
  if (o.vibration_limit) limits.vibration_limit = *o.vibration_limit;
  if (o.vibration_time) limits.vibration_time = *o.vibration_time;
  if (o.heat_time) limits.thermal_time = *o.heat_time;
  limits.ramp = o.ramp;
  return limits;
}

ReadingLimits readings_of(const Options& o, const DeviceLimits& device) {
  ReadingLimits limits = reading_limits(device);
  if (o.speed_limit) limits.speed = *o.speed_limit;
  if (o.device == "simulated") {  // its hand may rest to the bit, and be anywhere
    limits.frozen_after = std::numeric_limits<double>::infinity();
    limits.workspace.setEmpty();
  }
  if (o.frozen) limits.frozen_after = *o.frozen;
  return limits;
}

// Options that mean nothing together.
void check_options(const Options& o) {
  const bool simulated = o.device == "simulated";
  if (o.pedal != "none" && o.pedal == o.clutch)
    throw Error("--pedal and --clutch are the same button; give two");
  if (!simulated && !o.hand.empty())
    throw Error("--hand moves the simulated device only; the hand of a real one is yours");
  if (!simulated && !o.mirror_hand.empty())
    throw Error("--mirror-hand moves the simulated device's mirror only; give --mirror");
  if (simulated && !o.mirror_name.empty())
    throw Error("--mirror names a second real device; the simulated one's moves by --mirror-hand");
  if (o.control && !o.view) throw Error("--control is of the page: give --view too");
  if (o.view && !o.protocol.empty()) throw Error("--view shows a session, and --protocol is none");
}

// Elements so small that a step may not be done when the next is due.
void warn_of_small_elements(const Bur& bur, const Parameters& parameters) {
  if (parameters.engine != EngineKind::kLevelset) return;
  const auto least = [&](double size) {
    return least_live_size(size, bur.elements(kPiecesAcross * size).size(), parameters.time_step);
  };
  const double size = element_size(bur, parameters);
  // Elements fit a bur in whole numbers, so that the least size moves when it is taken.
  double enough = size;
  while (enough < least(enough))
    enough = std::max(std::ceil(1e4 * least(enough)), std::round(1e4 * enough) + 1) / 1e4;
  if (enough > size)
    warn(
        fmt::format("engine.element_mm: with {:g} mm the steps may take longer than the {:g} ms "
                    "that they have; use at least {:.4f} mm",
                    size, 1e3 * parameters.time_step, enough));
}

void check_translation(const std::string& file, const Registration& registration) {
  if (!registration.translation) return;
  const double length = registration.translation->norm();
  if (length > kFarthest)
    throw InputError(file, "translation_mm", fmt::format("is {:g} mm long", length),
                     "a device stands within metres of its tooth");
  if (length > 0 && length < kShortest)
    warn(fmt::format("{}: translation_mm is {:g} mm long; is it in metres?", file, length));
}

// ---- Progress and figures

// At most 79 columns, so that a terminal of 80 doesn't break it.
std::string status_line(const LiveStatus& s, double time, std::int64_t ticks_per_second) {
  return fmt::format(
      "{:6.1f} s {:5d} Hz  {:5.2f} N  lag {:5.2f} mm  removed {:7.2f} mm3  {:<10}{:>4}", time,
      ticks_per_second, s.force, s.lag, s.removed[0] + s.removed[1] + s.removed[2] + s.removed[3],
      s.reading != ReadingFault::kNone ? "NO READING"
      : s.stalled                      ? "STALLED"
      : s.locked                       ? "locked"
      : s.running                      ? "turning"
                                       : "stands",
      s.heat > 0.9 ? "HOT" : "");
}

LiveWatch watch_for(const Options& o, const Common& common, Signals& signals, Talk& talk) {
  LiveWatch watch;
  watch.duration = o.duration;
  watch.stale = o.stale;
  watch.stop_asked = [&signals] { return signals.came(); };
  watch.pause_asked = [&signals] { return signals.pause_asked(); };
  watch.real_time = !o.no_real_time;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  watch.report_scheduling = [&common, &talk](const std::string& line) {
    if (!common.quiet) talk.line(line);
  };
  watch.note = [&talk](const std::string& line) { talk.line("warning: " + line); };
  if (common.quiet || !terminal) return watch;
  watch.report = [&talk, steps = std::int64_t{0}](const LiveStatus& s,
                                                  const DeviceStatus& d) mutable {
    talk.status(status_line(s, d.time, (s.steps - steps) * 4));
    steps = s.steps;
  };
  return watch;
}

nlohmann::ordered_json report_json(const RecordedRun& run, const Options& o,
                                   const HapticDevice& device, const LiveOutcome* session,
                                   const std::vector<Body>& bodies) {
  const TickStatistics& t = run.ticks;
  nlohmann::ordered_json j;
  j["schema"] = "toothprep-live";
  j["toothprep_version"] = kVersion;
  j["build"] = build_text();
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
  j["rejected_readings"] = t.rejected;
  j["faults"] = run.end.device.faults;
  j["end_reason"] = run.end.reason;
  j["fault"] = run.end.fault;
  if (session && session->totals) {
    put_bodies(j, bodies, *session->totals);
    put_judgement(j, session->audit, session->findings);
  }
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

// ---- The two kinds of run

RecordTarget record_target(const Options& o) {
  RecordTarget target;
  target.path = o.output;
  target.replace = o.force;
  target.header.device_kind = o.device;
  target.header.pedal = o.pedal;
  target.header.trace.bur = o.session.bur;
  target.header.trace.toothprep_version = kVersion;
  return target;
}

// Prints the run's figures; throws Error if it ended by a fault or its recording isn't whole.
void report(const Options& o, const Common& common, const HapticDevice& device,
            const RecordedRun& run, const LiveOutcome* session,
            const std::vector<Body>& bodies = {}) {
  report_ticks(common, run.ticks);
  if (run.dropped > 0) warn(fmt::format("{} ticks could not be recorded", run.dropped));
  if (run.rows > 0)
    say(common, fmt::format("{}: {} rows; ended by: {}", o.output, run.rows, run.end.reason));
  if (o.json) std::cout << json_text(report_json(run, o, device, session, bodies));
  const double missed = run.ticks.missed_share();
  const std::string missing = fmt::format(
      "{:.1f} % of the servo's ticks were missed: the machine is too busy, or the servo "
      "runs without real-time priority",
      100 * missed);
  if (run.ticks.rejected > 0)
    warn(fmt::format("{} readings of the hand could not be believed: no step was made there",
                     run.ticks.rejected));
  if (run.end.fault)
    throw Error(run.end.reason + (run.rows > 0 ? " (recorded in " + o.output + ")"
                                               : "; " + o.output + " was not written"));
  if (!run.failure.empty()) throw Error(run.failure);
  if (run.rows == 0)
    throw Error(o.output + ": was not written, since the session had not begun when it ended (" +
                run.end.reason + ")");
  if (missed > kTooManyMissed && o.device != "simulated") throw Error(missing);
  if (missed > kManyMissed) warn(missing);
}

void report_session(const Common& common, const LiveOutcome& outcome,
                    const std::vector<Body>& bodies) {
  if (outcome.totals) {
    const SessionTotals& t = *outcome.totals;
    say(common, fmt::format("removed: enamel {:.3f}, dentin {:.3f}, pulp {:.3f}, other {:.3f} "
                            "mm^3; peak force {:.2f} N; stalled in {} steps",
                            t.removed[0], t.removed[1], t.removed[2], t.removed[3],
                            t.peak_device_force, t.stalled_steps));
    for (const std::string& line : body_lines(bodies, t)) say(common, line);
    say(common, audit_text(outcome.audit));
    for (const std::string& text : body_warnings(t, bodies)) warn(text);
  }
  if (outcome.display) {
    const DisplayStats& d = *outcome.display;
    say(common,
        fmt::format(
            "display: {:.1f} passes/s, {} blocks redone, latency {:.0f} ms median, {:.0f} ms worst",
            d.rate, d.blocks, 1e3 * d.latency_median, 1e3 * d.latency_worst));
  }
}

// The session's own, then the library's.
std::vector<NamedBur> burs_to_choose(const std::string& text, const Bur& bur) {
  const std::string library = data_folder() + "/burs";
  std::vector<NamedBur> burs = {{text, bur}};
  for (const LibraryEntry& entry : list_library(library))
    if (entry.name != text) burs.push_back({entry.name, make_bur(entry.name, library)});
  return burs;
}

// The page of a running session.
class PageOfSession final : public Onlooker {
 public:
  PageOfSession(const Options& o, const Bur& bur, const LayeredTooth& tooth,
                const Parameters& parameters, const LiveSettings& settings)
      : scene_(bur, tooth, parameters, std::filesystem::path(o.session.tooth).filename().string(),
               kVersion, settings.control, burs_of(settings)),
        server_(settings_of(o), scene_) {
    std::cerr << "view: " << server_.address() << '\n';
    server_.start();
    if (!o.no_open) opened_.emplace(server_.address());
  }
  void begin(const DisplaySurface& display) override { scene_.begin(display); }
  void take(const LiveTick& tick) noexcept override { scene_.take(tick); }
  void end() noexcept override { scene_.end(); }

 private:
  static std::vector<const Bur*> burs_of(const LiveSettings& settings) {
    std::vector<const Bur*> burs;
    for (const NamedBur& named : settings.burs) burs.push_back(&named.bur);
    return burs;
  }
  static PageServerSettings settings_of(const Options& o) {
    PageServerSettings settings;
    settings.port = static_cast<unsigned short>(o.port);
    return settings;
  }

  LiveScene scene_;
  PageServer server_;
  std::optional<OpenedPage> opened_;
};

Vec3 start_of(const Options& o, const LayeredTooth& tooth, const Registration& registration) {
  if (!o.start.empty()) return {o.start[0], o.start[1], o.start[2]};
  if (!o.hand.empty()) return read_trajectory(o.hand).samples.front().pose.position;
  return start_above(tooth, registration);
}

void run_session(const Options& o, const Common& common, Signals& signals, Outputs& outputs) {
  const std::string prepared = outputs.optional_file(o.prepared, {".vdb"});
  outputs.begin();
  LiveSettings settings;
  settings.parameters = load_parameters(o.session);
  settings.drive = drive_of(o.session);
  const Bur bur = make_bur(o.session.bur, data_folder() + "/burs");
  if (!o.registration.empty()) settings.registration = read_registration(o.registration);
  check_translation(o.registration, settings.registration);
  if (settings.registration.translation && !o.start.empty())
    throw Error(o.registration +
                ": has a translation, so --start-mm can't say where the hand starts");
  LayeredTooth tooth = load_tooth(o.session.tooth, o.strict);
  settings.start = start_of(o, tooth, settings.registration);

  const auto device = open_device(o, signals, [&] {
    if (!o.hand.empty())
      return hand_along_world_path(read_trajectory(o.hand).samples, settings.registration,
                                   settings.start);
    say(common, "the simulated hand moves in slow loops; --hand gives it a path");
    return hand_in_loops(settings.registration, settings.start);
  });
  const DeviceLimits& limits = device->limits();
  for (const auto& note : limits.notes) warn(note);
  const double stiffness = settings.parameters.coupling.stiffness;
  if (stiffness > limits.max_stiffness && settings.drive == Drive::kCoupled)
    warn(
        fmt::format("the coupling's {:.2f} N/mm is above the {:.2f} N/mm that the device is said "
                    "to render stably; --stiffness-n-per-mm sets it",
                    stiffness, limits.max_stiffness));
  warn_of_small_elements(bur, settings.parameters);
  settings.limits = limits_of(o, limits);
  settings.buttons = {button_mask(o.pedal), button_mask(o.clutch), !o.ignore_safety_switch};
  settings.readings = readings_of(o, limits);
  settings.display_hz = o.display_hz;
  Workpiece workpiece(tooth);
  SessionControl control;
  if (o.control) {
    settings.control = &control;
    settings.burs = burs_to_choose(o.session.bur, bur);
  }
  std::optional<PageOfSession> page;
  if (o.view) {
    if (o.display_hz == 0) settings.display_hz = DisplayOptions().rate;
    settings.onlooker = &page.emplace(o, bur, tooth, settings.parameters, settings);
  }
  const LiveOutcome outcome = [&] {
    Talk talk;
    settings.watch = watch_for(o, common, signals, talk);
    settings.warn = settings.watch.note;
    return run_live_session(*device, bur, tooth, workpiece, settings, record_target(o));
  }();
  std::string failure;
  if (!prepared.empty()) {
    apply_cut(tooth, workpiece);
    try {
      write_tooth(tooth, prepared);
      outputs.publish();
    } catch (const Error& e) {  // the session's figures are printed all the same
      failure = e.what();
    }
  }
  signals.release();  // whatever can be lost is written
  const std::vector<Body> bodies = tooth.bodies ? tooth.bodies->list : std::vector<Body>();
  report_session(common, outcome, bodies);
  report(o, common, *device, outcome.run, &outcome, bodies);
  warn_or_refuse(o.output, outcome.findings, o.strict);
  if (!failure.empty()) throw Error(failure);
}

void run_protocol(const Options& o, const Common& common, Signals& signals, Outputs& outputs) {
  outputs.begin();
  const Protocol protocol = parse_protocol(o.protocol);
  const auto device = open_device(o, signals, [&] { return hand_for(protocol); });
  for (const auto& note : device->limits().notes) warn(note);
  say(common,
      "active check: " + print_protocol(protocol) + "; hold the stylus lightly (rest: not at all)");
  const RecordedRun run = [&] {
    Talk talk;
    const LiveWatch watch = watch_for(o, common, signals, talk);
    return run_active_check(*device, protocol, limits_of(o, device->limits()),
                            readings_of(o, device->limits()), !o.ignore_safety_switch, watch,
                            watch.note, record_target(o));
  }();
  signals.release();
  report(o, common, *device, run, nullptr);
}

void run(const Options& o, const Common& common) {
  if (o.output.empty()) throw CLI::RequiredError("--output");
  if (o.protocol.empty()) {
    if (o.session.bur.empty()) throw CLI::RequiredError("--bur");
    if (o.session.tooth.empty()) throw CLI::RequiredError("--tooth");
  }
  check_options(o);
  Outputs outputs(o.force);
  outputs.reads(
      {o.session.tooth, o.session.bur, o.session.params, o.registration, o.hand, o.mirror_hand});
  outputs.growing(o.output, {".h5", ".hdf5"});
  Signals signals;
  if (o.protocol.empty())
    run_session(o, common, signals, outputs);
  else
    run_protocol(o, common, signals, outputs);
}

// False if the driver was given up: whatever libraries do at exit may hang then, too.
bool run_to_the_end(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& e) {
    if (!driver_was_given_up()) throw;
    std::cerr << "toothprep: " << e.what() << '\n';
  }
  std::cout.flush();
  std::cerr.flush();
  return !driver_was_given_up();
}

// What keeps the hand safe; data/rig/README.md explains each.
void add_limits(CLI::App& sub, const std::shared_ptr<Options>& o) {
  sub.add_option("--force-limit-n", o->force_limit, "At most so much force (absent: the device's)")
      ->check(CLI::Range(0.01, 100.0));
  sub.add_option("--force-rate-n-per-s", o->force_rate, "At most so fast a change (3000)")
      ->check(CLI::Range(1.0, 1e6));
  or_infinity(sub.add_option("--vibration-limit-n", o->vibration_limit,
                             "RMS above 20 Hz at which the force is switched off (1); inf: never"));
  sub.add_option("--vibration-time-s", o->vibration_time, "After so long above it (0.05)")
      ->check(CLI::Range(0.0, 10.0));
  sub.add_option("--ramp-s", o->ramp,
                 "The force comes in within this time, from the start and after every fault")
      ->check(CLI::Range(0.01, 10.0))
      ->capture_default_str();
  sub.add_option("--heat-time-s", o->heat_time,
                 "Time constant of the motors' heat, of which no data sheet speaks (10)")
      ->check(CLI::Range(0.1, 1000.0));
  sub.add_option("--stale-s", o->stale, "Without a tick of the servo for so long it ends")
      ->check(CLI::Range(0.02, 10.0))
      ->capture_default_str();
  or_infinity(sub.add_option("--frozen-s", o->frozen,
                             "A pose that is the same to the bit for so long, while the hand was "
                             "moving, is rejected (0.25; inf: never, as with --device simulated)"))
      ->check(CLI::Range(0.02, std::numeric_limits<double>::infinity()));
  sub.add_flag("--ignore-safety-switch", o->ignore_safety_switch,
               "Force also while nobody holds the stylus, by its switch: it doesn't feel a hand "
               "in a glove");
  sub.add_option("--driver-wait-s", o->driver_wait,
                 "A driver that has not opened the device after so long is given up")
      ->check(CLI::Range(0.1, 600.0))
      ->capture_default_str();
  sub.add_option("--speed-limit-mm-per-s", o->speed_limit,
                 "A reading that is faster is rejected: no step, no force (2000)")
      ->check(CLI::Range(10.0, 1e5));
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
  sub->add_option("--mirror-hand", o->mirror_hand,
                  "Simulated device: a second one, along this path in its own frame");
  sub->add_option(
         "--pedal", o->pedal,
         "Button that starts the bur, once it was released: 1, 2, 3, 4; none: it runs as soon as "
         "it was clear of the tooth for half a second")
      ->check(CLI::IsMember({"none", "1", "2", "3", "4"}))
      ->capture_default_str();
  sub->add_option("--clutch", o->clutch,
                  "Button that, while held, moves and turns the hand without the handle")
      ->check(CLI::IsMember({"none", "1", "2", "3", "4"}))
      ->capture_default_str();
  add_limits(*sub, o);
  sub->add_option("--prepared", o->prepared, "Also write the prepared tooth (.vdb)");
  sub->add_option("--display-hz", o->display_hz,
                  "Keep the surface for a display up to date at this rate (0: not)")
      ->check(CLI::Range(0.0, 1000.0));
  sub->add_flag("--view", o->view, "Show tooth, bur and force in the browser while it runs");
  sub->add_flag("--control", o->control,
                "With --view: the page can pause and resume the session, undo what was done since "
                "the last pause, change the bur, move the tooth under the hand, and end it");
  sub->add_option("--port", o->port, "Of the page's address with --view; 0: any that is free")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  sub->add_flag("--no-open", o->no_open, "With --view: only print the address");
  sub->add_option(
      "--protocol", o->protocol,
      "An active check of the device instead of a session: rest, step, stiffness-sweep, "
      "damping-sweep, wall, with their figures if you like (see toothprep rig-check)");
  sub->add_flag("--no-real-time", o->no_real_time, "Without SCHED_FIFO and locked memory");
  sub->add_flag("--strict", o->strict,
                "Exit 1 for a tooth that another program changed (before the session), implausible "
                "parameters or an energy audit out of range (the recording stays)");
  sub->add_flag("--json", o->json, "Figures of the ticks as JSON on stdout");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Examples:\n"
      "  toothprep live --tooth block.vdb --bur cylinder:D1.2xL3.0 --hand path.toml --duration-s "
      "60 "
      "-o session.h5\n"
      "  toothprep live --tooth molar.vdb --bur 330 --device openhaptics --pedal 1 --clutch 2 -o "
      "session.h5\n"
      "  toothprep live --tooth molar.vdb --bur 330 --device openhaptics --pedal 1 --view -o s.h5\n"
      "  toothprep live --device openhaptics --protocol rest -o rest.h5");
  sub->callback([o, &common] {
    if (o->session.bur == "list") return print_bur_library();
    if (!run_to_the_end([&] { run(*o, common); })) std::_Exit(1);
  });
}

}  // namespace toothprep::app
