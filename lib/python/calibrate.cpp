// u and alpha from measured forces.
#include <algorithm>

#include "bindings.h"
#include "long_work.h"
#include "options.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/calibration.h"
#include "toothprep/version.h"

namespace toothprep::python {
namespace {

FitOptions fit_options(const py::dict& o, const Parameters& parameters) {
  FitOptions f;
  const auto asked = taken<std::vector<std::string>>(o, "estimate");
  const std::vector<std::pair<std::string, bool*>> known = {{"delay", &f.estimate_delay},
                                                            {"drift", &f.estimate_drift},
                                                            {"lowpass", &f.estimate_lowpass},
                                                            {"rotation", &f.estimate_rotation},
                                                            {"weight", &f.estimate_weight}};
  for (const std::string& name : asked) {
    const auto found =
        std::find_if(known.begin(), known.end(), [&](const auto& k) { return k.first == name; });
    if (found == known.end())
      throw py::value_error("estimate: '" + name +
                            "' is none of delay, drift, lowpass, rotation and weight");
    *found->second = true;
  }
  f.bias = vector_taken(o, "bias_n");
  f.drift = vector_taken(o, "drift_n_per_s").value_or(Vec3::Zero());
  f.delay = taken<double>(o, "delay_ms") * 1e-3;
  f.largest_delay = taken<double>(o, "largest_delay_ms") * 1e-3;
  f.rotation =
      vector_taken(o, "sensor_rotation_deg").value_or(Vec3::Zero()) * units::from_degree(1);
  f.weight = vector_taken(o, "handpiece_weight_n").value_or(Vec3::Zero());
  using Sensor = std::array<std::pair<const char*, bool>, 2>;
  f.on_handpiece = choice_taken(o, "sensor_on", Sensor{{{"tooth", false}, {"handpiece", true}}});
  f.lowpass_hz = taken<double>(o, "lowpass_hz");
  f.noise = taken<std::optional<double>>(o, "noise_n");
  using Loss = std::array<std::pair<const char*, RobustLoss>, 3>;
  f.loss = choice_taken(o, "loss",
                        Loss{{{"huber", RobustLoss::kHuber},
                              {"cauchy", RobustLoss::kCauchy},
                              {"none", RobustLoss::kNone}}});
  f.bootstrap = taken<int>(o, "bootstrap");
  f.block = taken<double>(o, "block_s");
  f.folds = taken<int>(o, "folds");
  f.seed = taken<std::uint64_t>(o, "seed");
  f.start = parameters.tissue;
  return f;
}

ForceReading force_reading(const py::dict& o) {
  ForceReading r;
  using Unit = std::array<std::pair<const char*, double>, 4>;
  r.newton_per_unit = choice_taken(
      o, "force_unit", Unit{{{"auto", 1.0}, {"N", 1.0}, {"gf", 0.00980665}, {"mN", 1e-3}}});
  r.unit_stated = taken<std::string>(o, "force_unit") != "auto";
  using Side = std::array<std::pair<const char*, bool>, 2>;
  r.on_tooth = choice_taken(o, "force_on", Side{{{"bur", false}, {"tooth", true}}});
  r.range = taken<std::optional<double>>(o, "range_n");
  return r;
}

CalibrationSettings settings_of(const py::dict& o) {
  CalibrationSettings s;
  s.parameters = parameters_of(o["parameters"]);
  const auto rate = taken<std::optional<double>>(o, "rotation_rate_rev_s");
  if (rate) s.parameters.handpiece.rotation_rate = *rate;
  validate(s.parameters);
  s.rotation_rate_stated = rate.has_value();
  s.fit = fit_options(o, s.parameters);
  s.force = force_reading(o);
  using Motion = std::array<std::pair<const char*, bool>, 2>;
  s.coupled = choice_taken(o, "drive", Motion{{{"direct", false}, {"coupled", true}}});
  s.fit_droop_exponent = taken<bool>(o, "fit_droop_exponent");
  s.fit_rotor = taken<bool>(o, "fit_rotor");
  s.fit_droop = taken<bool>(o, "fit_droop");
  s.laws = laws_named(taken<std::vector<std::string>>(o, "law"));
  s.allow_gaps = taken<bool>(o, "allow_gaps");
  s.motion_window = taken<double>(o, "smooth_motion_ms") * 1e-3;
  check_settings(s);
  return s;
}

// The fit's JSON, and the parameter file with what was found.
py::tuple fitted(const std::shared_ptr<Tooth>& tooth, const std::string& tooth_name,
                 const std::vector<std::string>& files, const py::object& bur_given,
                 const py::dict& options, const py::object& progress) {
  const SharedBur bur = bur_of(bur_given);
  const CalibrationSettings settings = settings_of(options);
  std::vector<std::string> warnings;
  for (const Finding& f : judge_parameters(settings.parameters))
    warnings.push_back("parameters: " + message_of(f));
  std::string json, toml;
  run_long(progress, [&](Progress& p) {
    CalibrationListener listener;
    listener.say = [&](const std::string& line) { p.report(line, 0.5); };
    listener.warn = [&](const std::string& line) { warnings.push_back(line); };
    listener.judged = [&](const std::string& file, const std::vector<Finding>& findings) {
      for (const Finding& f : findings) warnings.push_back(file + ": " + message_of(f));
    };
    listener.motion = [&](double done) { p.report("motion", 0.5 * done); };
    FitSources sources{kVersion,  tooth_name, tooth_sha256(tooth->layers),
                       bur->spec, {},         build_text()};
    for (const std::string& file : files) sources.recording_sha256.push_back(sha256_of_file(file));
    const auto recordings =
        read_recordings(files, settings, sources.tooth_sha256, tooth_name, bur->spec, listener);
    const CalibrationResult c = calibrate(bur->bur, tooth->layers, recordings, settings, listener);
    json = fit_json(c.fit, sources, c.laws ? &*c.laws : nullptr);
    toml = c.laws ? fitted_parameters_toml(*c.laws, c.parameters, sources)
                  : fitted_parameters_toml(c.fit, c.parameters, sources);
    p.report("done", 1.0);
  });
  warn(warnings);
  return py::make_tuple(json, toml);
}

}  // namespace

void bind_calibrate(py::module_& m) {
  m.def("calibrate", &fitted, "(JSON, parameter file) of a fit.");
}

}  // namespace toothprep::python
