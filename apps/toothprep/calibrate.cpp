// toothprep calibrate: u and alpha per tissue from measured forces.
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>

#include "command.h"
#include "session_options.h"
#include "toothprep/bur/bur_library.h"
#include "toothprep/calibrate/fit.h"
#include "toothprep/calibrate/fit_files.h"
#include "toothprep/core/errors.h"
#include "toothprep/core/hash.h"
#include "toothprep/core/output_file.h"
#include "toothprep/core/units.h"
#include "toothprep/toothfile/tooth_file.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, bur, params, preset = "paper", output, report, params_out;
  std::vector<std::string> measured;
  std::optional<double> rotation_rate, time_step, range, noise;
  double lowpass_hz = 0, delay_ms = 0, largest_delay_ms = 50, block_s = 0;
  std::string bias, unit = "N", force_on = "bur", sensor_on = "tooth", loss = "huber";
  std::vector<double> drift = {0, 0, 0}, rotation_deg = {0, 0, 0}, weight = {0, 0, 0};
  std::vector<std::string> estimate;
  int bootstrap = 1000, folds = 5;
  std::uint64_t seed = 1;
  bool force = false, allow_gaps = false, no_plots = false, json = false;
};

Vec3 three(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

std::optional<Vec3> bias_of(const std::string& text) {
  if (text.empty()) return {};
  if (text == "zero") return Vec3(Vec3::Zero());
  Vec3 bias;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%c", &bias.x(), &bias.y(), &bias.z(), &rest) != 3 ||
      !bias.allFinite())
    throw InputError("--bias", text, "is neither 'zero' nor three numbers x,y,z in N");
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

void write_text(const std::string& text, const std::string& path) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(path + ": cannot be written");
}

void tell(const FitResult& fit, const Common& common) {
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueFit& t = fit.tissue[k];
    if (t.touched == 0 && k > 1) continue;
    const char* name = kTissueNames[k].data();
    if (t.identifiable)
      say(common, format("%-6s  u = %.4g +- %.2g J/mm^3 (95 %%: %.4g to %.4g) at N = %g rev/s;  "
                         "alpha = %.4g +- %.2g (95 %%: %.4g to %.4g)",
                         name, units::to_joule_per_mm3(t.u.value), units::to_joule_per_mm3(t.u.std),
                         units::to_joule_per_mm3(t.u.low), units::to_joule_per_mm3(t.u.high),
                         fit.rotation_rate, t.alpha.value, t.alpha.std, t.alpha.low, t.alpha.high));
    else if (t.ratio_identifiable)
      say(common,
          format("%-6s  not identifiable: %s.  u/alpha = %.4g +- %.2g J/mm^3 at N = %g rev/s", name,
                 t.why_not.c_str(), units::to_joule_per_mm3(t.u_over_alpha.value),
                 units::to_joule_per_mm3(t.u_over_alpha.std), fit.rotation_rate));
    else
      say(common, format("%-6s  not identifiable: %s", name, t.why_not.c_str()));
  }
  say(common, format("residuals %.3g N rms (R2 %.4f, %.2f %% outliers); predicted %.3g N rms (%s)",
                     fit.residual_rms, fit.residual_r2, 100 * fit.outlier_share, fit.validation_rms,
                     fit.validation.c_str()));
  if (fit.constant_suffices) {
    say(common, "constant u and alpha suffice: no part of the recordings is off by more than 5 %");
  } else {
    const AdequacyBin* worst = &fit.adequacy.front();
    for (const AdequacyBin& b : fit.adequacy)
      if (std::abs(b.factor - 1) > std::abs(worst->factor - 1)) worst = &b;
    say(common, format("constant u and alpha do not suffice: forces are %.2f of the model's for %s "
                       "%.3g to %.3g",
                       worst->factor, worst->of.c_str(), worst->low, worst->high));
  }
  for (const std::string& w : fit.warnings) warn(w);
}

void run(const Options& o, const Common& common) {
  OutputFile output(o.output, o.force);
  std::unique_ptr<OutputFile> report, params_out;
  if (!o.report.empty()) report = std::make_unique<OutputFile>(o.report, o.force, true, "fit.json");
  if (!o.params_out.empty()) params_out = std::make_unique<OutputFile>(o.params_out, o.force);

  SessionOptions session;
  session.params = o.params;
  session.preset = o.preset;
  session.rotation_rate = o.rotation_rate;
  session.time_step = o.time_step;
  const Parameters parameters = load_parameters(session);
  const FitOptions options = fit_options(o, parameters);

  const Bur bur = make_bur(o.bur, data_folder() + "/burs");
  const LayeredTooth tooth = read_tooth(o.tooth);
  FitSources sources{kVersion, o.tooth, tooth_sha256(tooth), o.bur, {}};

  const bool terminal = !common.quiet && isatty(2);
  std::vector<ForceBasis> bases;
  bases.reserve(o.measured.size());
  std::vector<ComparedRecording> recordings;
  for (const std::string& path : o.measured) {
    MeasuredRecording r = read_recording(path, force_reading(o));
    check_same_tooth(r, sources.tooth_sha256, o.tooth);
    if (!r.bur.empty() && r.bur != o.bur)
      warn(path + ": was recorded with the bur " + r.bur + ", not " + o.bur);
    const auto motion = resample(r.motion, parameters.time_step, o.allow_gaps, path);
    bases.push_back(force_basis(bur, tooth, parameters, motion,
                                terminal
                                    ? std::function<void(double)>([last = -1](double done) mutable {
                                        if (static_cast<int>(done * 100) == last) return;
                                        last = static_cast<int>(done * 100);
                                        std::fprintf(stderr, "\rmotion %3d %%", last);
                                      })
                                    : std::function<void(double)>()));
    if (terminal) std::fprintf(stderr, "\r            \r");
    recordings.push_back(
        compare(r, bases.back(), options.largest_delay, options.lowpass_hz, options.on_handpiece));
    sources.recording_sha256.push_back(sha256_of_file(path));
  }
  const FitResult result = fit(recordings, options);

  // A stalled bur would have removed nothing where the model has it cut on.
  double torque = 0;
  PerTissue<GrindingProperties> fitted = parameters.tissue;
  for (int k = 0; k < kTissueCount; ++k)
    if (result.tissue[k].identifiable)
      fitted[k] = {result.tissue[k].u.value, result.tissue[k].alpha.value};
  for (const ForceBasis& basis : bases)
    for (std::size_t i = 0; i < basis.size; ++i)
      torque = std::max(torque, torque_at(basis, i, fitted));
  if (torque > parameters.handpiece.stall_torque)
    warn(format(
        "with the fitted values the torque reaches %.2f mN m, above the stall torque of %.2f "
        "mN m: if the handpiece stalled, leave those spans out",
        torque, parameters.handpiece.stall_torque));

  const std::string json = fit_json(result, sources);
  write_text(json, output.temporary());
  if (params_out) {
    write_text(fitted_parameters_toml(result, parameters, sources), params_out->temporary());
    params_out->commit();
  }
  if (report) {
    write_text(json, report->temporary() + "/fit.json");
    write_plot_tables(result, recordings, report->temporary());
    if (!o.no_plots && !run_script("plot-calibration", {report->temporary()}))
      warn("the plots could not be drawn (scripts/plot-calibration); the tables are in " +
           o.report);
    report->commit();
  }
  output.commit();
  tell(result, common);
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
                  "Recordings: .h5 with /force/measured, or .csv with fx_N, fy_N, fz_N")
      ->required();
  sub->add_option("--bur", o->bur, "As for replay")->required();
  sub->add_option("-o,--output", o->output, "Fit to write (.json)")->required();
  sub->add_option("--report", o->report, "Folder for plots and their tables");
  sub->add_option("--params-out", o->params_out, "Parameter file (.toml) for replay --params");
  sub->add_option("--params", o->params, "Parameter file: rotation rate, step, start values");
  sub->add_option("--preset", o->preset, "paper or physical, under the parameter file")
      ->check(CLI::IsMember({"paper", "physical"}))
      ->capture_default_str();
  sub->add_option("--rotation-rate-rev-s", o->rotation_rate,
                  "N of the recordings: only u/N is determined");
  sub->add_option("--time-step-s", o->time_step, "Step of the motion (default 0.001)");
  sub->add_option("--estimate", o->estimate,
                  "What else to estimate: delay, drift, rotation, weight; comma-separated")
      ->delimiter(',')
      ->check(CLI::IsMember({"delay", "drift", "rotation", "weight"}));
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
  sub->add_option("--force-unit", o->unit, "N, gf or mN; auto: N, and doubted where it can't be")
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
  sub->add_flag("--json", o->json, "The fit on stdout too");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Example: toothprep calibrate --tooth tooth.vdb --measured rig.h5 --bur cylinder:D1.2xL3.0\n"
      "         --estimate delay -o fit.json --params-out fit.toml --report fit-report");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
