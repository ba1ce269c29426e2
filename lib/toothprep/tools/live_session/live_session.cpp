#include "toothprep/tools/live_session/live_session.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live_session/controller.h"
#include "toothprep/tools/live_session/device_header.h"
#include "toothprep/tools/live_session/start_rule.h"
#include "toothprep/tools/live_session/tick_sinks.h"

namespace toothprep {
namespace {

constexpr double kAbove = 3;       // mm over the tooth, where the bur starts if nothing says where
constexpr double kNear = 5;        // mm
constexpr double kNearWithin = 5;  // s

void check_rate(const HapticDevice& device, double time_step) {
  if (std::abs(device.limits().rate * time_step - 1) > 1e-6)
    throw Error(
        fmt::format("the device's servo runs at {:g} Hz, the model's step is {:g} s; give "
                    "--rate-hz or --time-step-s",
                    device.limits().rate, time_step));
}

// With a note if the hand doesn't come near the tooth: then the registration is wrong.
LiveWatch with_nearness_watched(LiveWatch watch, const Box& tooth) {
  watch.report = [tooth, note = watch.note, report = std::move(watch.report), was_near = false,
                  noted = false](const LiveStatus& s, const DeviceStatus& d) mutable {
    const Vec3 outside = (tooth.min - s.handle).cwiseMax(s.handle - tooth.max).cwiseMax(0.0);
    was_near = was_near || outside.norm() < kNear;
    if (!was_near && !noted && d.time > kNearWithin && note) {
      noted = true;
      note(
          fmt::format("the bur has not come within {:g} mm of the tooth yet, it is {:.0f} mm away: "
                      "is the registration right?",
                      kNear, outside.norm()));
    }
    if (report) report(s, d);
  };
  return watch;
}

// An onlooker's session, however it ends.
class Looking {
 public:
  Looking(Onlooker* onlooker, const DisplaySurface* display) : onlooker_(onlooker) {
    if (onlooker_) onlooker_->begin(*display);
  }
  ~Looking() {
    if (onlooker_) onlooker_->end();
  }
  Looking(const Looking&) = delete;
  Looking& operator=(const Looking&) = delete;

 private:
  Onlooker* onlooker_;
};

// `ground`: removed in all intervals, mm³.
EnergyAudit audit_of(const SessionTotals& totals, const PerTissue<double>& ground,
                     const Parameters& parameters) {
  EnergyAudit audit{totals.torque_work, energy_of_removal(parameters, totals, ground),
                    std::numeric_limits<double>::quiet_NaN()};
  if (audit.removed_energy_mj > 0)
    audit.energy_ratio = audit.torque_work_mj / audit.removed_energy_mj;
  return audit;
}

}  // namespace

ReadingLimits reading_limits(const DeviceLimits& device) {
  ReadingLimits limits;
  limits.period = 1 / device.rate;
  limits.workspace = device.workspace;
  return limits;
}

Vec3 start_above(const LayeredTooth& tooth, const Registration& registration) {
  const Box box = bounds_of_solid(tooth);
  const Vec3 up = registration.rotation * Vec3::UnitY(), centre = 0.5 * (box.min + box.max);
  return centre + up * (0.5 * up.cwiseAbs().dot(box.max - box.min) + kAbove);
}

LiveOutcome run_live_session(HapticDevice& device, const Bur& bur, const LayeredTooth& tooth,
                             Workpiece& workpiece, const LiveSettings& settings,
                             RecordTarget target) {
  check_calibration(device);
  check_rate(device, settings.parameters.time_step);
  SessionHeader& header = target.header;
  header.trace.parameters_toml = to_toml(settings.parameters);
  header.trace.tooth_sha256 = tooth_sha256(tooth);
  header.trace.drive = name_of(settings.drive);
  header.trace.engine = name_of(settings.parameters.engine);
  if (tooth.bodies) header.trace.bodies = tooth.bodies->list;
  describe_device(device, settings.limits, settings.readings, settings.buttons.safety_switch,
                  settings.watch, header);
  for (const NamedBur& named : settings.burs) header.trace.events.burs.push_back(named.text);
  header.laid_at_start = !settings.registration.translation;
  header.registration =
      HandleFrame(settings.registration, Vec3::Zero(), settings.start).device_to_world();

  std::unique_ptr<DisplaySurface> display;
  if (settings.display_hz > 0) {
    DisplayOptions options;
    options.rate = settings.display_hz;
    display = std::make_unique<DisplaySurface>(workpiece, options);
  }
  RecorderOptions recording;
  recording.replace = target.replace;
  SessionRecorder recorder(target.path, header, recording);
  Onlooker* const onlooker = display ? settings.onlooker : nullptr;
  TickSinks sinks(recorder, display.get(), onlooker);
  LiveLoop loop(settings.limits, settings.buttons, &sinks, settings.readings);
  Controller controller(settings.control, loop, workpiece, settings.parameters, settings.drive,
                        settings.burs, display.get(), settings.watch.note);
  bool began = false;
  std::optional<Vec3> laid;
  if (!settings.registration.translation) laid = settings.start;
  StartRule starts(bur, workpiece, laid.has_value(), settings.watch.note);
  if (display) display->start();
  const Looking looking(onlooker, display.get());
  LiveWatch watch = settings.watch;
  if (settings.control) watch.attend = [&controller] { return controller.attend(); };
  LiveEnd end = run_live(
      device, loop, settings.registration, laid, settings.parameters.time_step,
      [&](const Pose& pose) -> Session* {
        if (!starts.may_start(pose)) return nullptr;
        began = true;
        return &controller.begin(bur, pose);
      },
      with_recorder_watched(with_nearness_watched(std::move(watch), bounds_of_solid(tooth)),
                            recorder, settings.warn));

  LiveOutcome outcome;
  EnergyAudit audit;
  audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  if (began) {
    const SessionTotals t = controller.intervals().totals();
    const PerTissue<double> ground = controller.intervals().ground();
    audit = audit_of(t, ground, settings.parameters);
    outcome.totals = t;
    outcome.audit =
        judge_audit(t.torque_work, audit.removed_energy_mj, ground, settings.parameters);
    outcome.findings = judge_run(judge_parameters(settings.parameters), outcome.audit,
                                 t.peak_device_force, t.largest_lag, settings.drive);
  }
  if (display) {
    display->finish();
    outcome.display = display->stats();
  }
  outcome.run = close_recording(recorder, audit, std::move(end), sinks.statistics);
  return outcome;
}

}  // namespace toothprep
