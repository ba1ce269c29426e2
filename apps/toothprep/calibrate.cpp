// toothprep calibrate: u and alpha per tissue from measured forces.
#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <memory>

#include "command.h"
#include "numeric_options.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/coupled.h"
#include "toothprep/tools/calibrate/fit.h"
#include "toothprep/tools/calibrate/fit_files.h"
#include "toothprep/tools/calibrate/motion.h"
#include "toothprep/tools/calibrate/spindle.h"
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
  std::vector<std::string> estimate;
  int bootstrap = 1000, folds = 5;
  std::uint64_t seed = 1;
  bool fit_droop = false;
  bool force = false, allow_gaps = false, no_plots = false, json = false, strict = false;
};

constexpr double kNoisyFeed = 0.3;  // velocity noise by feed, from which it is said
constexpr double kTorqueOff = 0.1;  // of the modelled torque, likewise

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
  if (std::abs(f.delay) > f.largest_delay)
    throw InputError("--delay-ms", "", "lies beyond --largest-delay-ms");
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

void print(const FitResult& fit, const Common& common) {
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueFit& t = fit.tissue[k];
    if (t.touched == 0 && k > 1) continue;
    const char* name = kTissueNames[k].data();
    if (t.identifiable)
      say(common,
          fmt::format("{:<6}  u = {:.4g} +- {:.2g} J/mm^3 (95 %: {:.4g} to {:.4g}) at N = {:g} "
                      "rev/s;  alpha = {:.4g} +- {:.2g} (95 %: {:.4g} to {:.4g})",
                      name, units::to_joule_per_mm3(t.u.value), units::to_joule_per_mm3(t.u.std),
                      units::to_joule_per_mm3(t.u.low), units::to_joule_per_mm3(t.u.high),
                      fit.rotation_rate, t.alpha.value, t.alpha.std, t.alpha.low, t.alpha.high));
    else if (t.ratio_identifiable)
      say(common,
          fmt::format(
              "{:<6}  not identifiable: {}.  u/alpha = {:.4g} +- {:.2g} J/mm^3 at N = {:g} rev/s",
              name, t.why_not.text, units::to_joule_per_mm3(t.u_over_alpha.value),
              units::to_joule_per_mm3(t.u_over_alpha.std), fit.rotation_rate));
    else
      say(common, fmt::format("{:<6}  not identifiable: {}", name, t.why_not.text));
  }
  say(common,
      fmt::format(
          "residuals {:.3g} N rms (R2 {:.4f}, {:.2f} % outliers); predicted {:.3g} N rms ({})",
          fit.residual_rms, fit.residual_r2, 100 * fit.outlier_share, fit.validation_rms,
          fit.validation));
  if (fit.lowpass.std > 0 && fit.lowpass.value > 2 * fit.lowpass.std)
    say(common,
        fmt::format("low-pass of the sensor: time constant {:.2f} +- {:.2g} ms (corner {:.3g} Hz)",
                    1e3 * fit.lowpass.value, 1e3 * fit.lowpass.std,
                    1 / (2 * units::kPi * fit.lowpass.value)));
  else if (fit.lowpass.std > 0)
    say(common, fmt::format("low-pass of the sensor: none seen (time constant {:.2f} +- {:.2g} ms)",
                            1e3 * fit.lowpass.value, 1e3 * fit.lowpass.std));
  for (const RecordingFit& r : fit.recordings)
    if (std::isfinite(r.torque_factor))
      say(common, fmt::format("{}: recorded torque {:.3f} of the modelled, {:.3g} mN m rms apart",
                              r.name, r.torque_factor, r.torque_rms));
  if (fit.droop && fit.droop->identifiable)
    say(common,
        fmt::format("droop: N0 = {:.5g} +- {:.2g} rev/s, stall torque {:.4g} +- {:.2g} mN m",
                    fit.droop->rate.value, fit.droop->rate.std, fit.droop->stall_torque.value,
                    fit.droop->stall_torque.std));
  else if (fit.droop)
    say(common, "droop: not identifiable: " + fit.droop->why_not);
  if (fit.replays > 0)
    say(common, fmt::format("coupled: converged after {} rounds of replays", fit.replays));
  if (fit.constant_suffices) {
    say(common, "constant u and alpha suffice: no part of the recordings is off by more than 5 %");
  } else {
    const AdequacyBin* worst = &fit.adequacy.front();
    for (const AdequacyBin& b : fit.adequacy)
      if (std::abs(b.factor - 1) > std::abs(worst->factor - 1)) worst = &b;
    say(common, fmt::format("constant u and alpha do not suffice: forces are {:.2f} of the model's "
                            "for {} {:.3g} to {:.3g}",
                            worst->factor, worst->of, worst->low, worst->high));
  }
  for (const std::string& w : fit.warnings) warn(w);
}

std::function<void(double)> percent_on(bool terminal) {
  if (!terminal) return {};
  return [last = -1](double done) mutable {
    if (static_cast<int>(done * 100) == last) return;
    last = static_cast<int>(done * 100);
    std::fprintf(stderr, "\rmotion %3d %%", last);
  };
}

std::vector<MeasuredRecording> read_all(const Options& o, const std::string& tooth_hash) {
  std::vector<MeasuredRecording> recordings;
  for (const std::string& path : o.measured) {
    recordings.push_back(
        read_recording(path, force_reading(o),
                       o.drive == "coupled" ? RecordedPose::kHandle : RecordedPose::kBurOrHandle));
    const MeasuredRecording& r = recordings.back();
    warn_or_refuse(path, judge_motion(r.motion.samples), o.strict);
    check_same_tooth(r, tooth_hash, o.tooth);
    if (!r.bur.empty() && r.bur != o.bur)
      warn(path + ": was recorded with the bur " + r.bur + ", not " + o.bur);
    const auto stalled = std::count(r.stalled.begin(), r.stalled.end(), 1);
    if (stalled > 0)
      warn(
          fmt::format("{}: the bur stood still in {} samples; they and what lies within {:g} ms of "
                      "them are left out, since a stalled bur's force is not the cutting law's",
                      path, stalled, o.largest_delay_ms));
  }
  return recordings;
}

// Median of the speeds that were recorded while the bur turned; NaN if none was.
double typical_speed(const std::vector<MeasuredRecording>& recordings) {
  std::vector<double> speeds;
  for (const MeasuredRecording& r : recordings)
    for (std::size_t i = 0; i < r.rotation_rate.size(); ++i)
      if (r.rotation_rate[i] > 0 && !r.stalled[i]) speeds.push_back(r.rotation_rate[i]);
  return speeds.empty() ? std::nan("") : median(std::move(speeds));
}

std::vector<RecordedMotion> motions_of(const std::vector<MeasuredRecording>& recordings,
                                       const Options& o, double time_step, bool speed) {
  std::vector<RecordedMotion> motions;
  for (const MeasuredRecording& r : recordings) {
    check_run_memory(r.name, r.motion, time_step);
    motions.push_back(motion_of(r, time_step, o.allow_gaps, speed));
    auto& path = motions.back().path;
    path = smoothed(path, o.smooth_motion_ms * 1e-3);
    const VelocityNoise v = velocity_noise(path);
    if (v.noise > kNoisyFeed * v.feed)
      warn(fmt::format(
          "{}: the velocity's noise, {:.2g} mm/s, is large against the feed of {:.2g} mm/s: the "
          "force goes with the velocity, so smooth the motion (--smooth-motion-ms {:g})",
          r.name, v.noise, v.feed, o.smooth_motion_ms > 0 ? 2 * o.smooth_motion_ms : 30.0));
  }
  return motions;
}

// The coupling and handpiece that a trace says it was made with, where they aren't the fit's.
void compare_with_recorded(const MeasuredRecording& r, const Parameters& p) {
  if (r.parameters_toml.empty()) return;
  const Parameters recorded = parse_parameters(r.parameters_toml, r.name);
  const auto differ = [&](const char* what, double own, double used) {
    if (own != used)
      warn(
          fmt::format("{}: was recorded with {} {:g}, the fit uses {:g}", r.name, what, own, used));
  };
  differ("a coupling of (N/mm)", recorded.coupling.stiffness, p.coupling.stiffness);
  differ("a damping of (N s/mm)", recorded.coupling.damping, p.coupling.damping);
  differ("a stall torque of (mN m)", recorded.handpiece.stall_torque, p.handpiece.stall_torque);
}

struct Fitted {
  FitResult result;
  std::vector<ComparedRecording> recordings;
  std::vector<ForceBasis> bases;  // of the imposed motion
  CoupledFit coupled;
};

void fit_imposed(const std::vector<MeasuredRecording>& recordings,
                 const std::vector<RecordedMotion>& motions, const Bur& bur,
                 const LayeredTooth& tooth, const Parameters& parameters, const FitOptions& options,
                 const Options& o, bool terminal, Fitted& f) {
  f.bases = force_bases(bur, tooth, parameters, motions, percent_on(terminal));
  if (terminal) std::fprintf(stderr, "\r            \r");
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    check_unit_by_model(recordings[r], f.bases[r], force_reading(o));
    f.recordings.push_back(compare(recordings[r], f.bases[r], options.largest_delay,
                                   options.lowpass_hz, options.on_handpiece));
  }
  f.result = fit(f.recordings, options);
  for (ComparedRecording& r : f.recordings)
    if (options.estimate_lowpass) set_lowpass(r, f.result.lowpass.value, false);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    RecordingFit& own = f.result.recordings[r];
    check_torque(recordings[r], f.bases[r], f.result, own);
    if (std::abs(own.torque_factor - 1) > kTorqueOff)
      f.result.warnings.push_back(
          fmt::format("{}: the recorded torque is {:.2f} of what the fitted u implies",
                      recordings[r].name, own.torque_factor));
  }
  if (o.fit_droop) f.result.droop = fit_droop(motions, f.bases, f.result, o.seed);

  // A stalled bur would have removed nothing where the model has it cut on.
  double torque = 0;
  const auto fitted = modelled_tissue(f.result);
  for (const ForceBasis& basis : f.bases)
    for (std::size_t i = 0; i < basis.size; ++i)
      torque = std::max(torque, torque_at(basis, i, fitted));
  const bool recorded = std::any_of(recordings.begin(), recordings.end(),
                                    [](const MeasuredRecording& r) { return !r.stalled.empty(); });
  if (!recorded && torque > parameters.handpiece.stall_torque)
    f.result.warnings.push_back(
        fmt::format("with the fitted values the torque reaches {:.2f} mN m, above the stall torque "
                    "of {:.2f} mN m: if the handpiece stalled, leave those spans out",
                    torque, parameters.handpiece.stall_torque));
}

void fit_handle(const std::vector<MeasuredRecording>& recordings,
                const std::vector<RecordedMotion>& motions, const Bur& bur,
                const LayeredTooth& tooth, const Parameters& parameters, const FitOptions& options,
                const Common& common, Fitted& f) {
  for (const MeasuredRecording& r : recordings) compare_with_recorded(r, parameters);
  int iteration = 0;
  f.coupled = fit_coupled(
      bur, tooth, parameters, recordings, motions, options, {}, [&](const CoupledIteration& i) {
        say(common,
            fmt::format("replays {}: u and alpha change by {:.2g} %", ++iteration, 100 * i.change));
      });
  f.result = std::move(f.coupled.fit);
  f.result.replays = iteration;
  f.recordings = f.coupled.recordings;
  for (ComparedRecording& r : f.recordings)
    if (options.estimate_lowpass) set_lowpass(r, f.result.lowpass.value, false);
  if (f.coupled.stalled > 0)
    say(common, fmt::format("the replayed bur stalls for {:.2f} s in all", f.coupled.stalled));
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.tooth, o.bur, o.params});
  outputs.reads(o.measured);
  const std::string output = outputs.file(o.output, {".json"});
  const std::string report = outputs.optional_folder(o.report);
  const std::string params_out = outputs.optional_file(o.params_out, {".toml"});
  outputs.begin();
  const bool plots = !report.empty() && !o.no_plots && run_script("plot-calibration", {"--check"});
  if (!report.empty() && !o.no_plots && !plots)
    warn("plot-calibration cannot run (python3-numpy, python3-matplotlib): " + o.report +
         " gets the tables only");
  const bool coupled = o.drive == "coupled";
  if (o.fit_droop && o.rotation_rate)
    throw Error(
        "--fit-droop takes the rotation rate from the recordings: leave "
        "--rotation-rate-rev-s away");
  if (o.fit_droop && coupled)
    throw Error(
        "--fit-droop needs the bur's own motion (--drive direct): on a coupled rig the "
        "droop changes the motion too");

  SessionOptions session;
  session.params = o.params;
  session.preset = o.preset;
  session.rotation_rate = o.rotation_rate;
  session.time_step = o.time_step;
  session.stiffness = o.stiffness;
  session.stall_torque = o.stall_torque;
  Parameters parameters = load_parameters(session);
  const FitOptions options = fit_options(o, parameters);
  warn_or_refuse(o.params.empty() ? "parameters" : o.params, judge_parameters(parameters),
                 o.strict);

  const Bur bur = make_bur(o.bur, data_folder() + "/burs");
  const LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  FitSources sources{kVersion, o.tooth, tooth_sha256(tooth), o.bur, {}};
  for (const std::string& path : o.measured)
    sources.recording_sha256.push_back(sha256_of_file(path));

  const auto recordings = read_all(o, sources.tooth_sha256);
  // A rate on the command line wins over the recorded speed; a coupled replay has its own.
  const double speed = o.rotation_rate || coupled ? std::nan("") : typical_speed(recordings);
  const bool speed_recorded = std::isfinite(speed);
  if (o.fit_droop && !speed_recorded)
    throw InputError(o.measured.front(), "/rotation_rate",
                     "is missing: --fit-droop needs the speed",
                     "record it (CSV: a column rotation_rate_rev_s)");
  if (speed_recorded) {
    parameters.handpiece.rotation_rate = speed;
    for (const MeasuredRecording& r : recordings)
      if (r.rotation_rate.empty())
        warn(fmt::format("{}: has no speed; {:g} rev/s, the median of the others, is taken", r.name,
                         speed));
  } else if (!coupled && parameters.handpiece.model == HandpieceModel::kDroop) {
    warn(
        fmt::format("the handpiece droops but no speed was recorded: u is fitted as though it "
                    "turned at {:g} rev/s throughout",
                    parameters.handpiece.rotation_rate));
  }
  const auto motions = motions_of(recordings, o, parameters.time_step, speed_recorded);

  Fitted f;
  if (coupled)
    fit_handle(recordings, motions, bur, tooth, parameters, options, common, f);
  else
    fit_imposed(recordings, motions, bur, tooth, parameters, options, o, !common.quiet && isatty(2),
                f);

  const std::string json = fit_json(f.result, sources);
  write_file(output, json);
  if (!params_out.empty())
    write_file(params_out, fitted_parameters_toml(f.result, parameters, sources));
  if (!report.empty()) {
    write_file(report + "/fit.json", json);
    write_plot_tables(f.result, f.recordings, report);
    if (plots && !run_script("plot-calibration", {report})) throw Error("plot-calibration failed");
  }
  outputs.publish();
  print(f.result, common);
  if (o.json) std::fputs(json.c_str(), stdout);
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
  sub->add_option("--preset", o->preset, "paper or physical, under the parameter file")
      ->check(CLI::IsMember({"paper", "physical"}))
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
  sub->add_flag("--fit-droop", o->fit_droop,
                "Also N0 and stall torque of N = N0 (1 - T/T_stall), from the recorded speed");
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
  add_strict(*sub, o->strict,
             "a tooth that another program changed, or inputs that can't be meant");
  sub->add_flag("--json", o->json, "The fit on stdout too");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Example: toothprep calibrate --tooth tooth.vdb --measured rig.h5 --bur cylinder:D1.2xL3.0\n"
      "         --estimate delay -o fit.json --params-out fit.toml --report fit-report");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
