// toothprep calibrate: u and alpha per tissue from measured forces.
#include <unistd.h>

#include <algorithm>
#include <memory>

#include "command.h"
#include "numeric_options.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/calibration.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, bur, params, preset = "paper", output, report, params_out;
  std::vector<std::string> measured;
  std::optional<double> rotation_rate, time_step, range, noise;
  double lowpass_hz = 0, delay_ms = 0, largest_delay_ms = 50, block_s = 0, smooth_motion_ms = 0;
  std::optional<double> stiffness, stall_torque;
  std::string drive = "direct";
  std::string bias, unit = "N", force_on = "bur", sensor_on = "tooth", loss = "huber";
  std::vector<double> drift = {0, 0, 0}, rotation_deg = {0, 0, 0}, weight = {0, 0, 0};
  std::vector<std::string> estimate, laws;
  int bootstrap = 1000, folds = 5;
  std::uint64_t seed = 1;
  bool fit_droop = false, fit_droop_exponent = false, fit_rotor = false;
  bool force = false, allow_gaps = false, no_plots = false, json = false, strict = false;
};

Vec3 three(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

std::optional<Vec3> bias_of(const std::string& text) {
  if (text.empty()) return {};
  if (text == "zero") return Vec3(Vec3::Zero());
  const auto parts = CLI::detail::split(text, ',');
  Vec3 bias = Vec3::Zero();
  bool good = parts.size() == 3;
  for (std::size_t a = 0; a < 3 && good; ++a) {
    const auto value = decimal_number(parts[a]);
    good = value.has_value();
    bias[static_cast<int>(a)] = value.value_or(0);
  }
  if (!good)
    throw CLI::ValidationError("--bias",
                               "'" + text + "' is neither 'zero' nor three numbers x,y,z in N");
  return bias;
}

FitOptions fit_options(const Options& o, const Parameters& parameters) {
  FitOptions f;
  const auto asked = [&](const char* name) {
    return std::find(o.estimate.begin(), o.estimate.end(), name) != o.estimate.end();
  };
  f.bias = bias_of(o.bias);
  f.estimate_drift = asked("drift");
  f.estimate_delay = asked("delay");
  f.estimate_lowpass = asked("lowpass");
  f.estimate_rotation = asked("rotation");
  f.estimate_weight = asked("weight");
  f.drift = three(o.drift);
  f.delay = o.delay_ms * 1e-3;
  f.largest_delay = o.largest_delay_ms * 1e-3;
  f.rotation = three(o.rotation_deg) * units::from_degree(1);
  f.weight = three(o.weight);
  f.on_handpiece = o.sensor_on == "handpiece";
  f.lowpass_hz = o.lowpass_hz;
  f.noise = o.noise;
  f.loss = o.loss == "none"    ? RobustLoss::kNone
           : o.loss == "huber" ? RobustLoss::kHuber
                               : RobustLoss::kCauchy;
  f.bootstrap = o.bootstrap;
  f.block = o.block_s;
  f.folds = o.folds;
  f.seed = o.seed;
  f.start = parameters.tissue;
  return f;
}

ForceReading force_reading(const Options& o) {
  ForceReading r;
  r.unit_stated = o.unit != "auto";
  r.newton_per_unit = o.unit == "gf" ? 0.00980665 : o.unit == "mN" ? 1e-3 : 1;
  r.on_tooth = o.force_on == "tooth";
  r.range = o.range;
  return r;
}

std::function<void(double)> percent_on(bool terminal) {
  if (!terminal) return {};
  return [last = -1](double done) mutable {
    if (static_cast<int>(done * 100) == last) return;
    last = static_cast<int>(done * 100);
    std::fprintf(stderr, last < 100 ? "\rmotion %3d %%" : "\r            \r", last);
  };
}

CalibrationSettings calibration_settings(const Options& o) {
  SessionOptions session;
  session.params = o.params;
  session.preset = o.preset;
  session.rotation_rate = o.rotation_rate;
  session.time_step = o.time_step;
  session.stiffness = o.stiffness;
  session.stall_torque = o.stall_torque;
  CalibrationSettings s;
  s.parameters = load_parameters(session);
  s.fit = fit_options(o, s.parameters);
  s.force = force_reading(o);
  s.coupled = o.drive == "coupled";
  s.rotation_rate_stated = o.rotation_rate.has_value();
  s.fit_droop = o.fit_droop;
  s.fit_droop_exponent = o.fit_droop_exponent;
  s.fit_rotor = o.fit_rotor;
  s.laws = laws_named(o.laws);
  s.allow_gaps = o.allow_gaps;
  s.motion_window = o.smooth_motion_ms * 1e-3;
  check_settings(s);
  return s;
}

// Whether the plots of the report can be drawn; a warning if they are wanted and can't.
bool can_plot(const Options& o) {
  if (o.report.empty() || o.no_plots) return false;
  if (run_script("plot-calibration", {"--check"})) return true;
  warn("plot-calibration cannot run (python3-numpy, python3-matplotlib): " + o.report +
       " gets the tables only");
  return false;
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.tooth, o.bur, o.params});
  outputs.reads(o.measured);
  const std::string output = outputs.file(o.output, {".json"});
  const std::string report = outputs.optional_folder(o.report);
  const std::string params_out = outputs.optional_file(o.params_out, {".toml"});
  outputs.begin();
  const bool plots = can_plot(o);
  const CalibrationSettings settings = calibration_settings(o);
  warn_or_refuse(o.params.empty() ? "parameters" : o.params, judge_parameters(settings.parameters),
                 o.strict);
  const Bur bur = make_bur(o.bur, data_folder() + "/burs");
  const LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  FitSources sources{kVersion, o.tooth, tooth_sha256(tooth), o.bur, {}, build_text()};
  for (const std::string& path : o.measured)
    sources.recording_sha256.push_back(sha256_of_file(path));

  CalibrationListener listener;
  listener.say = [&](const std::string& line) { say(common, line); };
  listener.warn = warn;
  listener.judged = [&](const std::string& file, const std::vector<Finding>& findings) {
    warn_or_refuse(file, findings, o.strict);
  };
  listener.motion = percent_on(!common.quiet && isatty(STDERR_FILENO) != 0);
  const auto recordings =
      read_recordings(o.measured, settings, sources.tooth_sha256, o.tooth, o.bur, listener);
  const CalibrationResult c = calibrate(bur, tooth, recordings, settings, listener);

  const std::string json = fit_json(c.fit, sources, c.laws ? &*c.laws : nullptr);
  write_file(output, json);
  if (!params_out.empty())
    write_file(params_out, c.laws ? fitted_parameters_toml(*c.laws, c.parameters, sources)
                                  : fitted_parameters_toml(c.fit, c.parameters, sources));
  if (!report.empty()) {
    write_file(report + "/fit.json", json);
    write_plot_tables(c.fit, c.recordings, report);
    if (plots && !run_script("plot-calibration", {report})) throw Error("plot-calibration failed");
  }
  outputs.publish();
  for (const std::string& line : describe(c.fit)) say(common, line);
  if (c.laws)
    for (const std::string& line : describe(*c.laws)) say(common, line);
  for (const std::string& line : c.fit.warnings) warn(line);
  if (o.json) std::fputs(json.c_str(), stdout);
}

void add_droop(CLI::App& sub, Options& o) {
  sub.add_flag("--fit-droop", o.fit_droop,
               "Also N0 and stall torque of N = N0 (1 - T/T_stall), from the recorded speed");
  sub.add_flag("--fit-droop-exponent", o.fit_droop_exponent,
               "The same, and k of T = T_stall (1 - (N/N0)^k)");
  sub.add_flag("--fit-rotor", o.fit_rotor,
               "The same as --fit-droop, and the rotor's inertia and run-down time");
}

void add_law(CLI::App& sub, Options& o) {
  sub.add_option("--law", o.laws,
                 "Laws beyond the paper's to fit and compare: size, ratio, rubbing, size-rubbing, "
                 "up-cutting, comma-separated, or all; --params-out then writes the best")
      ->delimiter(',')
      ->check(CLI::IsMember(
          {"paper", "size", "ratio", "rubbing", "size-rubbing", "up-cutting", "all"}));
}

}  // namespace

void add_calibrate(CLI::App& app, const Common& common) {
  auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "calibrate", "Fits u and alpha per tissue to measured forces, with their uncertainty");
  sub->add_option("--tooth", o->tooth, "Layered tooth (.vdb) as it was before the recordings")
      ->required();
  sub->add_option("--measured", o->measured,
                  "Recordings: .h5 with /force/measured, or .csv with fx_N, fy_N, fz_N; used where "
                  "there: /rotation_rate, /torque, /stalled (rotation_rate_rev_s, torque_mNm, "
                  "stalled)")
      ->required();
  sub->add_option("--bur", o->bur, "As for replay")->required();
  sub->add_option("-o,--output", o->output, "Fit to write (.json)")->required();
  sub->add_option("--report", o->report, "Folder for plots and their tables");
  sub->add_option("--params-out", o->params_out, "Parameter file (.toml) for replay --params");
  sub->add_option("--params", o->params, "Parameter file: rotation rate, step, start values");
  sub->add_option("--preset", o->preset, "paper, physical or literature, under the parameter file")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kPresets), std::end(kPresets))))
      ->capture_default_str();
  sub->add_option("--drive", o->drive,
                  "direct: the bur's motion was recorded; coupled: the handle's, which the bur "
                  "follows through the coupling")
      ->check(CLI::IsMember({"direct", "coupled"}))
      ->capture_default_str();
  sub->add_option("--stiffness-n-per-mm", o->stiffness,
                  "Coupling of a coupled rig, over the file's");
  or_infinity(sub->add_option("--stall-torque-mnm", o->stall_torque,
                              "Stall torque (inf: none), over the file's"));
  sub->add_option("--rotation-rate-rev-s", o->rotation_rate,
                  "N of the recordings, over a recorded speed: only u/N is then determined");
  add_droop(*sub, *o);
  add_law(*sub, *o);
  sub->add_option("--smooth-motion-ms", o->smooth_motion_ms,
                  "Window of a local quadratic through the motion, for noisy positions; 0: none")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  sub->add_option("--time-step-s", o->time_step, "Step of the motion (default 0.001)");
  sub->add_option("--estimate", o->estimate,
                  "What else to estimate: delay, drift, lowpass, rotation, weight; comma-separated")
      ->delimiter(',')
      ->check(CLI::IsMember({"delay", "drift", "lowpass", "rotation", "weight"}));
  sub->add_option("--bias", o->bias, "zero, or x,y,z in N (default: estimated per recording)");
  sub->add_option("--delay-ms", o->delay_ms, "Force behind motion")->capture_default_str();
  sub->add_option("--largest-delay-ms", o->largest_delay_ms, "Range of an estimated delay")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  sub->add_option("--drift-n-per-s", o->drift, "Drift of the sensor, x,y,z")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--sensor-rotation-deg", o->rotation_deg,
                  "Rotation vector x,y,z that takes the sensor's frame to W (or the bur's)")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--handpiece-weight-n", o->weight, "Weight on the sensor, x,y,z in W")
      ->delimiter(',')
      ->expected(3);
  sub->add_option("--sensor-on", o->sensor_on, "tooth: fixed in W; handpiece: turns with the bur")
      ->check(CLI::IsMember({"tooth", "handpiece"}))
      ->capture_default_str();
  sub->add_option("--force-on", o->force_on, "Whose force was measured: on the bur or on the tooth")
      ->check(CLI::IsMember({"bur", "tooth"}))
      ->capture_default_str();
  o->unit = "auto";
  sub->add_option("--force-unit", o->unit,
                  "N, gf or mN; auto: N, refused where the magnitude is implausible")
      ->check(CLI::IsMember({"auto", "N", "gf", "mN"}))
      ->capture_default_str();
  sub->add_option("--range-n", o->range, "Range of the sensor: samples beyond are left out")
      ->check(CLI::PositiveNumber);
  sub->add_option("--lowpass-hz", o->lowpass_hz, "First-order corner of the sensor; 0: none")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  sub->add_option("--noise-n", o->noise, "Noise per axis (default: from spans without contact)")
      ->check(CLI::PositiveNumber);
  sub->add_option("--loss", o->loss, "none, huber or cauchy")
      ->check(CLI::IsMember({"none", "huber", "cauchy"}))
      ->capture_default_str();
  sub->add_option("--bootstrap", o->bootstrap, "Replicates")
      ->check(CLI::Range(50, 100000))
      ->capture_default_str();
  sub->add_option(
         "--block-s", o->block_s,
         "Length of the bootstrap's blocks (default: ten times the residuals' correlation)")
      ->check(CLI::NonNegativeNumber);
  sub->add_option("--folds", o->folds, "Parts of time, for a single recording")
      ->check(CLI::Range(2, 100))
      ->capture_default_str();
  sub->add_option("--seed", o->seed, "Of the bootstrap")->capture_default_str();
  sub->add_flag("--allow-gaps", o->allow_gaps, "Interpolate gaps above 0.1 s in the motion");
  sub->add_flag("--no-plots", o->no_plots, "Only the tables in --report");
  add_strict(*sub, o->strict, "a tooth that another program changed, or implausible inputs");
  sub->add_flag("--json", o->json, "The fit on stdout too");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Example: toothprep calibrate --tooth tooth.vdb --measured rig.h5 --bur cylinder:D1.2xL3.0\n"
      "         --estimate delay -o fit.json --params-out fit.toml --report fit-report");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
