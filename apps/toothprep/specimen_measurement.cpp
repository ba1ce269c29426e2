// toothprep specimen measurement: recordings whose u and alpha are known.
#include <fmt/format.h>

#include <limits>
#include <memory>

#include "command.h"
#include "numeric_options.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/calibrate/measurement.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trajectory_file.h"
#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, bur, trajectory, output, params, preset = "paper", drive = "direct";
  std::vector<std::string> u, alpha;
  std::optional<double> rotation_rate, stiffness, stall_torque;
  double speed_noise_percent = 0, position_noise_um = 0;
  double noise_percent = 5, noise_correlation_ms = 0, delay_ms = 0, outliers_percent = 0;
  double outlier_size = 10, lowpass_hz = 0;
  std::vector<double> bias = {0, 0, 0}, drift = {0, 0, 0}, rotation_deg = {0, 0, 0};
  std::uint64_t seed = 1;
  bool force = false, allow_gaps = false, strict = false;
};

Vec3 three(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

// TISSUE=VALUE
std::pair<int, double> named_value(const std::string& text, const char* option) {
  const auto equals = text.find('=');
  const auto tissue = tissue_named(text.substr(0, equals));
  const auto value =
      equals == std::string::npos ? std::nullopt : decimal_number(text.substr(equals + 1));
  if (!tissue || *tissue == Tissue::kAir || !value)
    throw CLI::ValidationError(option, "'" + text + "' is not TISSUE=VALUE, e.g. enamel=0.3");
  return {tissue_index(*tissue), *value};
}

// A rig's table: of the bur's motion, or of the handle's on a coupled rig; the speed where it
// changes, and stalls where there are any.
void write_csv(const Trace& trace, bool coupled, bool droops, const std::string& path) {
  bool stalls = false;
  for (const StepRecord& row : trace.rows) stalls = stalls || row.stalled;
  CsvWriter csv(path);
  for (const char* name : {"time_s", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw", "buttons",
                           "fx_N", "fy_N", "fz_N"})
    csv.text(name);
  if (droops) csv.text("rotation_rate_rev_s");
  if (stalls) csv.text("stalled");
  csv.end_row();
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    const StepRecord& row = trace.rows[i];
    const Pose& pose = coupled ? row.handle.pose : row.bur;
    csv.number(row.handle.time);
    for (const double x : pose.position) csv.number(x);
    for (const double x : pose.orientation.coeffs()) csv.number(x);
    csv.number(row.handle.buttons);
    for (const double x : trace.measured_force[i]) csv.number(x);
    if (droops) csv.number(row.rotation_rate);
    if (stalls) csv.number(row.stalled ? 1 : 0);
    csv.end_row();
  }
  csv.close();
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.tooth, o.bur, o.trajectory, o.params});
  const std::string output = outputs.file(o.output, {".h5", ".csv"});
  outputs.begin();
  SessionOptions session;
  session.params = o.params;
  session.preset = o.preset;
  session.rotation_rate = o.rotation_rate;
  session.stiffness = o.stiffness;
  session.stall_torque = o.stall_torque;
  Parameters parameters = load_parameters(session);
  for (const std::string& text : o.u) {
    const auto [k, value] = named_value(text, "--u-j-per-mm3");
    parameters.tissue[k].specific_energy = units::from_joule_per_mm3(value);
  }
  for (const std::string& text : o.alpha) {
    const auto [k, value] = named_value(text, "--alpha");
    parameters.tissue[k].force_ratio = value;
  }
  const bool coupled = o.drive == "coupled";
  const bool droops = parameters.handpiece.model == HandpieceModel::kDroop;
  // Imposed motion of a fixed speed: an ideal feed that no torque stops.
  if (!coupled && !droops && parameters.handpiece.rotor_inertia == 0)
    parameters.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  validate(parameters);

  const Bur bur = make_bur(o.bur, data_folder() + "/burs");
  const Trajectory trajectory = read_trajectory(o.trajectory);
  if (!trajectory.events.events.empty())
    throw InputError(o.trajectory, "/events", "the session was paused, taken back or changed",
                     "give a path without events");
  check_run_memory(o.trajectory, trajectory, parameters.time_step);
  const auto path = resample(trajectory, parameters.time_step, o.allow_gaps, o.trajectory);
  const LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  Workpiece workpiece(tooth);
  const ReplayResult r =
      replay(bur, workpiece, parameters, coupled ? Drive::kCoupled : Drive::kDirect, path);

  std::vector<Finding> findings = judge_motion(trajectory.samples);
  for (Finding& f : judge_parameters(parameters)) findings.push_back(std::move(f));
  const Audit audit =
      judge_audit(r.totals.torque_work, r.removed_energy, r.totals.removed, parameters);
  warn_or_refuse(o.trajectory,
                 judge_run(std::move(findings), audit, r.totals.peak_device_force,
                           r.totals.largest_lag, coupled ? Drive::kCoupled : Drive::kDirect),
                 o.strict);

  std::vector<Vec3> force;
  force.reserve(r.rows.size());
  for (const StepRecord& row : r.rows) force.push_back(row.grinding_force);
  if (contact_rms(force) == 0)
    throw InputError(o.trajectory, "", "never touches the tooth: there is no force to measure");
  SensorOptions s;
  s.noise = o.noise_percent / 100;
  s.noise_correlation = o.noise_correlation_ms * 1e-3;
  s.bias = three(o.bias);
  s.drift = three(o.drift);
  s.delay = o.delay_ms * 1e-3;
  s.outliers = o.outliers_percent / 100;
  s.outlier_size = o.outlier_size;
  s.rotation = three(o.rotation_deg) * units::from_degree(1);
  s.lowpass_hz = o.lowpass_hz;
  s.seed = o.seed;
  s.speed_noise = o.speed_noise_percent / 100;
  s.position_noise = o.position_noise_um * 1e-3;

  Trace trace;
  trace.rows = r.rows;
  trace.measured_force = measured_by(s, force, parameters.time_step);
  disturb_motion_and_speed(s, trace.rows);
  trace.parameters_toml = to_toml(parameters);
  trace.tooth_sha256 = tooth_sha256(tooth);
  trace.toothprep_version = kVersion;
  trace.bur = o.bur;
  trace.drive = o.drive;
  trace.engine = name_of(parameters.engine);
  trace.audit = {r.totals.torque_work, r.removed_energy, r.energy_ratio};
  for (const double v : r.totals.initial_overlap) trace.initial_overlap_mm3 += v;
  if (has_extension(output, ".csv"))
    write_csv(trace, coupled, droops, output);
  else
    write_trace(trace, output);
  outputs.publish();
  if (r.totals.stalled_steps > 0)
    warn(fmt::format("{}: the bur stalled in {} steps", o.output, r.totals.stalled_steps));
  say(common,
      fmt::format("{}: {:.1f} s, {:.3g} N rms in contact, noise {:.3g} N per axis", o.output,
                  r.seconds_simulated, contact_rms(force), s.noise * contact_rms(force)));
}

}  // namespace

void add_measurement(CLI::App& specimen, const Common& common) {
  auto* sub = specimen.add_subcommand(
      "measurement",
      "A recording of a rig whose u and alpha are known, to plan an experiment with");
  const auto o = std::make_shared<Options>();
  sub->add_option("-o,--output", o->output, "Recording to write (.h5 or .csv)")->required();
  sub->add_option("--tooth", o->tooth, "Layered tooth (.vdb)")->required();
  sub->add_option("--bur", o->bur, "As for replay")->required();
  sub->add_option("--trajectory", o->trajectory,
                  "The bur's motion (the handle's with --drive coupled): .toml, .csv or .h5")
      ->required();
  sub->add_option("--drive", o->drive, "direct: imposed motion; coupled: of the handle")
      ->check(CLI::IsMember({"direct", "coupled"}))
      ->capture_default_str();
  sub->add_option("--stiffness-n-per-mm", o->stiffness, "Coupling stiffness, over the file's");
  or_infinity(sub->add_option("--stall-torque-mnm", o->stall_torque,
                              "Stall torque (inf: none), over the file's; plays a part when "
                              "coupled, or with a handpiece that droops"));
  sub->add_option("--u-j-per-mm3", o->u, "Truth, e.g. enamel=0.4,dentin=0.1")->delimiter(',');
  sub->add_option("--alpha", o->alpha, "Truth, e.g. enamel=0.3,dentin=0.2")->delimiter(',');
  sub->add_option("--params", o->params, "Parameter file");
  sub->add_option("--preset", o->preset, "paper, physical or literature, under the parameter file")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kPresets), std::end(kPresets))))
      ->capture_default_str();
  sub->add_option("--rotation-rate-rev-s", o->rotation_rate, "Rotation rate N, over the file's");
  sub->add_option("--noise-percent", o->noise_percent, "Of the force's rms in contact, per axis")
      ->capture_default_str();
  sub->add_option("--noise-correlation-ms", o->noise_correlation_ms, "0: white")
      ->capture_default_str();
  sub->add_option("--bias-n", o->bias, "x,y,z")->delimiter(',')->expected(3);
  sub->add_option("--drift-n-per-s", o->drift, "x,y,z")->delimiter(',')->expected(3);
  sub->add_option("--delay-ms", o->delay_ms, "Force behind motion")->capture_default_str();
  sub->add_option("--outliers-percent", o->outliers_percent, "Of the samples")
      ->capture_default_str();
  sub->add_option("--outlier-size", o->outlier_size, "Of the force's rms in contact")
      ->capture_default_str();
  sub->add_option("--sensor-rotation-deg", o->rotation_deg, "Rotation vector, sensor to W")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--lowpass-hz", o->lowpass_hz, "First-order corner; 0: none")
      ->capture_default_str();
  sub->add_option("--speed-noise-percent", o->speed_noise_percent, "Of the recorded speed")
      ->check(CLI::Range(0.0, 50.0))
      ->capture_default_str();
  sub->add_option("--position-noise-um", o->position_noise_um,
                  "Of the recorded positions, per axis, white")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  sub->add_option("--seed", o->seed, "Of noise and outliers")->capture_default_str();
  sub->add_flag("--allow-gaps", o->allow_gaps, "Interpolate gaps above 0.1 s");
  add_strict(*sub, o->strict, "implausible inputs, or an energy audit out of range");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "Example: toothprep specimen measurement --tooth block.vdb --bur cylinder:D1.2xL3.0\n"
      "         --trajectory data/trajectories/calibration.toml --delay-ms 3 -o rig.h5");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
