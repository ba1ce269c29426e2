#include "toothprep/tools/live_session/active_check.h"

#include <limits>

#include "toothprep/tools/live_session/device_header.h"
#include "toothprep/tools/live_session/tick_sinks.h"
#include "toothprep/tools/rig_check/protocol_force.h"

namespace toothprep {

RecordedRun run_active_check(HapticDevice& device, const Protocol& protocol,
                             const ForceLimits& limits, const ReadingLimits& readings,
                             bool safety_switch, LiveWatch watch,
                             const std::function<void(const std::string&)>& warn,
                             RecordTarget target) {
  check_calibration(device);
  Parameters parameters = preset_parameters("paper");
  parameters.time_step = limits.period;
  SessionHeader& header = target.header;
  header.trace.parameters_toml = to_toml(parameters);
  header.trace.drive = "direct";
  header.trace.engine = name_of(parameters.engine);
  header.protocol = print_protocol(protocol);
  describe_device(device, limits, readings, safety_switch, watch, header);

  RecorderOptions recording;
  recording.replace = target.replace;
  SessionRecorder recorder(target.path, header, recording);
  TickSinks sinks(recorder, nullptr, nullptr);
  // At rest nobody holds the stylus.
  const bool heeds_switch = safety_switch && protocol.kind != ProtocolKind::kRest;
  ProbeLoop loop(limits, protocol_force(protocol, limits.period), &sinks, readings, heeds_switch);
  watch.duration = protocol_duration(protocol);
  LiveEnd end = run_probe(device, loop, with_recorder_watched(std::move(watch), recorder, warn));
  EnergyAudit audit;
  audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  return close_recording(recorder, audit, std::move(end), sinks.statistics);
}

}  // namespace toothprep
