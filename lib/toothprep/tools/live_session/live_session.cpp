#include "toothprep/tools/live_session/live_session.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <memory>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live_session/device_header.h"
#include "toothprep/tools/live_session/tick_sinks.h"

namespace toothprep {
namespace {

constexpr double kAbove = 3;  // mm over the tooth, where the bur starts if nothing says where

void check_rate(const HapticDevice& device, double time_step) {
  if (std::abs(device.limits().rate * time_step - 1) > 1e-6)
    throw Error(
        fmt::format("the device's servo runs at {:g} Hz, the model's step is {:g} s; give "
                    "--rate-hz or --time-step-s",
                    device.limits().rate, time_step));
}

EnergyAudit audit_of(const SessionTotals& t, const Parameters& parameters) {
  EnergyAudit audit{t.torque_work, 0, std::numeric_limits<double>::quiet_NaN()};
  for (int k = 0; k < kTissueCount; ++k)
    audit.removed_energy_mj += parameters.tissue[k].specific_energy * t.removed[k];
  if (audit.removed_energy_mj > 0)
    audit.energy_ratio = audit.torque_work_mj / audit.removed_energy_mj;
  return audit;
}

}  // namespace

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
  describe_device(device, settings.limits, settings.watch.real_time, header);
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
  TickSinks sinks(recorder, display.get());
  LiveLoop loop(settings.limits, settings.buttons, &sinks);
  std::unique_ptr<Session> session;
  std::optional<Vec3> laid;
  if (!settings.registration.translation) laid = settings.start;
  if (display) display->start();
  LiveEnd end = run_live(
      device, loop, settings.registration, laid, settings.parameters.time_step,
      [&](const Pose& pose) -> Session& {
        HandleSample first;
        first.pose = pose;
        session =
            std::make_unique<Session>(bur, workpiece, settings.parameters, settings.drive, first);
        return *session;
      },
      with_recorder_watched(settings.watch, recorder, settings.warn));

  LiveOutcome outcome;
  EnergyAudit audit;
  audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  if (session) {
    const SessionTotals& t = session->totals();
    audit = audit_of(t, settings.parameters);
    outcome.totals = t;
    outcome.audit =
        judge_audit(t.torque_work, audit.removed_energy_mj, t.removed, settings.parameters);
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
