#include "toothprep/tools/calibrate/fit_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/units.h"
#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/io/json_number.h"
#include "toothprep/tools/io/json_text.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostRows = 4000;

Json vector(const Vec3& v) { return Json::array({v.x(), v.y(), v.z()}); }
Json interval(const Estimate& e, double factor = 1) {
  return std::isfinite(e.low) ? Json::array({e.low * factor, e.high * factor}) : Json(nullptr);
}

Json tissue_json(const TissueFit& t, double rotation_rate) {
  const double unit = units::to_joule_per_mm3(1);
  Json out;
  out["identifiable"] = t.identifiable;
  out["why_not"] = t.identifiable ? Json(nullptr) : Json(t.why_not.text);
  out["u_j_per_mm3"] = number_or_null(t.u.value * unit);
  out["u_std_j_per_mm3"] = number_or_null(t.u.std * unit);
  out["u_ci95_j_per_mm3"] = interval(t.u, unit);
  out["alpha"] = number_or_null(t.alpha.value);
  out["alpha_std"] = number_or_null(t.alpha.std);
  out["alpha_ci95"] = interval(t.alpha);
  out["u_per_n_j_s_per_mm3"] = number_or_null(t.u.value * unit / rotation_rate);
  out["u_over_alpha_j_per_mm3"] = number_or_null(t.u_over_alpha.value * unit);
  out["u_over_alpha_std_j_per_mm3"] = number_or_null(t.u_over_alpha.std * unit);
  out["u_over_alpha_ci95_j_per_mm3"] = interval(t.u_over_alpha, unit);
  out["touched_s"] = t.touched;
  out["removed_mm3"] = t.removed;
  return out;
}

void put_sensor(const FitResult& fit, Json& j) {
  Vec3 bias = Vec3::Zero();
  for (const RecordingFit& r : fit.recordings)
    bias += r.bias / static_cast<double>(fit.recordings.size());
  j["bias_n"] = vector(bias);  // mean over the recordings
  j["delay_s"] = fit.delay.value;
  j["delay_std_s"] = fit.delay.std;
  j["sensor_rotation_deg"] = vector(fit.rotation * units::to_degree(1));
  j["sensor_rotation_std_deg"] = vector(fit.rotation_std * units::to_degree(1));
  j["handpiece_weight_n"] = fit.weight_why_not.empty() ? vector(fit.weight) : Json(nullptr);
  j["handpiece_weight_why_not"] =
      fit.weight_why_not.empty() ? Json(nullptr) : Json(fit.weight_why_not);
  j["lowpass_time_constant_s"] = fit.lowpass.value;
  j["lowpass_time_constant_std_s"] = fit.lowpass.std;
  j["delay_lowpass_correlation"] = fit.delay_lowpass_correlation;
}

Estimate in_gram(const Estimate& inertia) {
  return {units::to_gram(inertia.value), units::to_gram(inertia.std), units::to_gram(inertia.low),
          units::to_gram(inertia.high)};
}

void put_rotor(const DroopFit& d, Json& j) {
  if (!d.inertia_why_not.empty()) j["rotor_inertia_why_not"] = d.inertia_why_not;
  if (d.inertia) {
    const Estimate inertia = in_gram(*d.inertia);
    j["rotor_inertia_g_mm2"] = number_or_null(inertia.value);
    j["rotor_inertia_std_g_mm2"] = number_or_null(inertia.std);
    j["rotor_inertia_ci95_g_mm2"] = interval(inertia);
  }
  if (d.run_down) {
    j["run_down_s"] = number_or_null(d.run_down->value);
    j["run_down_std_s"] = number_or_null(d.run_down->std);
    j["run_down_ci95_s"] = interval(*d.run_down);
  }
}

Json droop_json(const DroopFit& d) {
  Json j = {{"identifiable", d.identifiable},
            {"why_not", d.identifiable ? Json(nullptr) : Json(d.why_not)},
            {"rotation_rate_rev_s", number_or_null(d.rate.value)},
            {"rotation_rate_std_rev_s", number_or_null(d.rate.std)},
            {"rotation_rate_ci95_rev_s", interval(d.rate)},
            {"stall_torque_mnm", number_or_null(d.stall_torque.value)},
            {"stall_torque_std_mnm", number_or_null(d.stall_torque.std)},
            {"stall_torque_ci95_mnm", interval(d.stall_torque)},
            {"correlation", d.correlation},
            {"residual_rms_rev_s", d.residual_rms},
            {"largest_fall", d.largest_fall},
            {"droop_exponent", d.exponent}};
  if (!d.exponents_like_the_best.empty())
    j["droop_exponents_like_the_best"] = d.exponents_like_the_best;
  put_rotor(d, j);
  return j;
}

void put_quality(const FitResult& fit, Json& j) {
  j["residual_rms_n"] = fit.residual_rms;
  j["residual_r2"] = fit.residual_r2;
  j["outlier_share"] = fit.outlier_share;
  j["validation_rms_n"] = number_or_null(fit.validation_rms);
  j["validation"] = fit.validation;
  j["constant_u_and_alpha_suffice"] = fit.constant_suffices;
  j["residual_correlation_s"] = fit.correlation_time;
  j["bootstrap_block_s"] = fit.block;
  j["bootstrap_blocks"] = fit.blocks;
  j["correlation_of"] = fit.names;
  j["correlation"] = Json::array();
  for (Eigen::Index a = 0; a < fit.correlation.rows(); ++a) {
    Json row = Json::array();
    for (Eigen::Index b = 0; b < fit.correlation.cols(); ++b) row.push_back(fit.correlation(a, b));
    j["correlation"].push_back(row);
  }
  j["singular_values"] = fit.singular_values;
  j["start_spread"] = fit.start_spread;
}

Json recording_json(const RecordingFit& own, const std::string* sha256, bool several) {
  Json out;
  out["file"] = own.name;
  if (sha256) out["sha256"] = *sha256;
  out["samples"] = own.samples;
  out["samples_stalled"] = own.stalled;
  out["bias_n"] = vector(own.bias);
  out["bias_std_n"] = vector(own.bias_std);
  out["drift_n_per_s"] = vector(own.drift);
  out["drift_std_n_per_s"] = vector(own.drift_std);
  out["noise_n"] = number_or_null(own.noise);
  out["noise_without_contact_n"] = number_or_null(own.quiet_noise);
  out["residual_rms_n"] = own.residual_rms;
  if (std::isfinite(own.torque_factor)) {
    out["torque_factor"] = own.torque_factor;  // measured by modelled
    out["torque_residual_rms_mnm"] = own.torque_rms;
  }
  if (several) out["validation_rms_n"] = number_or_null(own.validation_rms);
  return out;
}

Json law_json(const LawFit& l) {
  const double unit = units::to_joule_per_mm3(1);
  Json out;
  out["law"] = name_of(l.law);
  out["residual_rms_n"] = l.fit.residual_rms;
  out["validation_rms_n"] = number_or_null(l.fit.validation_rms);
  out["criterion"] = l.criterion;
  out["suffices"] = l.fit.constant_suffices;
  out["settled"] = l.settled;
  out["replays"] = l.rounds;
  out["tissues"] = Json::object();
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueFit& t = l.fit.tissue[k];
    if (!t.ratio_identifiable) continue;
    Json tissue;
    tissue["u_j_per_mm3"] = number_or_null(t.u.value * unit);
    tissue["u_ci95_j_per_mm3"] = interval(t.u, unit);
    tissue["alpha"] = number_or_null(t.alpha.value);
    tissue["alpha_ci95"] = interval(t.alpha);
    if (l.law != LawKind::kPaper) tissue["reference_chip_um"] = 1e3 * l.tissue[k].reference_chip;
    for (const LawParameter& p : l.parameters) {
      if (p.tissue != k) continue;
      tissue[p.name] = number_or_null(p.estimate.value);
      tissue[p.name + "_std"] = number_or_null(p.estimate.std);
      tissue[p.name + "_ci95"] = interval(p.estimate);
      tissue[p.name + "_identifiable"] = p.identifiable;
    }
    out["tissues"][std::string(kTissueNames[k])] = tissue;
  }
  return out;
}

}  // namespace

std::string fit_json(const FitResult& fit, const FitSources& sources, const LawComparison* laws) {
  Json j;
  j["schema"] = "toothprep-fit";
  j["schema_version"] = 1;
  j["toothprep_version"] = sources.toothprep_version;
  j["build"] = sources.build;
  j["tooth"] = sources.tooth;
  j["tooth_sha256"] = sources.tooth_sha256;
  j["bur"] = sources.bur;
  j["rotation_rate_rev_s"] = fit.rotation_rate;
  j["rotation_rate_recorded"] = fit.speed_recorded;
  j["rotation_rate_note"] =
      fit.speed_recorded
          ? "the speed was recorded: u holds as it is; this rate is the recordings' median"
          : "forces determine u/N only: u is for this rotation rate and scales with it";
  for (int k = 0; k < kTissueCount; ++k)
    j["tissues"][std::string(kTissueNames[k])] = tissue_json(fit.tissue[k], fit.rotation_rate);
  put_sensor(fit, j);
  if (fit.droop) j["droop"] = droop_json(*fit.droop);
  j["drive"] = fit.replays > 0 ? "coupled" : "direct";
  if (fit.replays > 0) j["replay_iterations"] = fit.replays;
  put_quality(fit, j);
  j["recordings"] = Json::array();
  for (std::size_t r = 0; r < fit.recordings.size(); ++r)
    j["recordings"].push_back(
        recording_json(fit.recordings[r],
                       r < sources.recording_sha256.size() ? &sources.recording_sha256[r] : nullptr,
                       fit.recordings.size() > 1));
  j["adequacy"] = Json::array();
  for (const AdequacyBin& b : fit.adequacy)
    j["adequacy"].push_back({{"of", b.of},
                             {"low", b.low},
                             {"high", b.high},
                             {"force_factor", b.factor},
                             {"force_factor_std", b.std}});
  if (laws) {
    for (const LawFit& l : laws->laws) j["laws"].push_back(law_json(l));
    j["best_law"] = name_of(laws->laws[laws->best].law);
    j["laws_like_the_best"] = laws->like_the_best;
    j["law_verdict"] = laws->verdict;
  }
  j["warnings"] = fit.warnings;
  return json_text(j);
}

std::string fitted_parameters_toml(const FitResult& fit, const Parameters& base,
                                   const FitSources& sources) {
  Parameters p = base;
  // With a recorded speed u holds as it is; a drooping handpiece's N0 is then not the median speed.
  if (!(fit.speed_recorded && p.handpiece.model == HandpieceModel::kDroop))
    p.handpiece.rotation_rate = fit.rotation_rate;
  std::string text =
      "# Fitted by toothprep calibrate " + sources.toothprep_version + " to measured forces.\n";
  text +=
      fit.speed_recorded
          ? "# The rotation rate was recorded, so the specific energies hold as they are.\n"
          : "# Forces determine u/N: the specific energies hold for the rotation rate below and "
            "scale with it.\n";
  if (fit.droop && fit.droop->identifiable) {
    p.handpiece.model = HandpieceModel::kDroop;
    p.handpiece.droop_exponent = fit.droop->exponent;
    if (fit.droop->inertia) p.handpiece.rotor_inertia = fit.droop->inertia->value;
    if (fit.droop->run_down) p.handpiece.run_down = fit.droop->run_down->value;
    p.handpiece.stall_rule = StallRule::kTrial;
    p.handpiece.rotation_rate = fit.droop->rate.value;
    p.handpiece.stall_torque = fit.droop->stall_torque.value;
    text += fmt::format(
        "# handpiece: N0 = {:.5g} +- {:.2g} rev/s, stall torque {:.4g} +- {:.2g} mN m, from the "
        "recorded speed\n",
        fit.droop->rate.value, fit.droop->rate.std, fit.droop->stall_torque.value,
        fit.droop->stall_torque.std);
  }
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueFit& t = fit.tissue[k];
    const std::string name(kTissueNames[k]);
    if (t.identifiable) {
      p.tissue[k].specific_energy = t.u.value;
      p.tissue[k].force_ratio = t.alpha.value;
      text += fmt::format(
          "# {}: u = {:.5g} +- {:.2g} J/mm3, alpha = {:.4g} +- {:.2g} (standard deviations)\n",
          name, units::to_joule_per_mm3(t.u.value), units::to_joule_per_mm3(t.u.std), t.alpha.value,
          t.alpha.std);
    } else if (t.ratio_identifiable) {
      // The force along n is what was measured; alpha stays the preset's.
      p.tissue[k].specific_energy = t.u_over_alpha.value * p.tissue[k].force_ratio;
      text += fmt::format("# {}: only u/alpha = {:.5g} J/mm3 was measured, alpha is the preset's\n",
                          name, units::to_joule_per_mm3(t.u_over_alpha.value));
    } else {
      text +=
          "# " + name + ": not measured (" + t.why_not.text + "), the values are the preset's\n";
    }
  }
  return text + to_toml(p);
}

std::string fitted_parameters_toml(const LawComparison& laws, const Parameters& base,
                                   const FitSources& sources) {
  const LawFit& best = laws.laws[laws.best];
  if (best.law == LawKind::kPaper) return fitted_parameters_toml(best.fit, base, sources);
  Parameters p = base;
  std::string text = fmt::format("# Law {}: {}.\n", name_of(best.law), laws.verdict);
  for (const LawParameter& own : best.parameters) {
    const auto k = static_cast<std::size_t>(own.tissue);
    const GrindingProperties& t = best.tissue[k];
    p.tissue[k].size_exponent = t.size_exponent;
    p.tissue[k].ratio_exponent = t.ratio_exponent;
    p.tissue[k].rubbing_pressure = t.rubbing_pressure;
    p.tissue[k].rubbing_friction = t.rubbing_friction;
    p.tissue[k].up_cutting = t.up_cutting;
    p.tissue[k].reference_chip = t.reference_chip;
    text += fmt::format("# {}: {} = {:.4g} +- {:.2g}{}\n", kTissueNames[k], own.name,
                        own.estimate.value, own.estimate.std,
                        own.identifiable ? "" : ", not identifiable");
  }
  return text + fitted_parameters_toml(best.fit, p, sources);
}

void write_plot_tables(const FitResult& fit, const std::vector<ComparedRecording>& recordings,
                       const std::string& folder) {
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const ComparedRecording& rec = recordings[r];
    const auto modelled = modelled_force(rec, fit.state.own[r], fit.state);
    CsvWriter csv(folder + "/force-" + std::to_string(r + 1) + ".csv");
    for (const char* name :
         {"time_s", "measured_x_N", "measured_y_N", "measured_z_N", "fitted_x_N", "fitted_y_N",
          "fitted_z_N", "removal_rate_mm3_s", "contact_area_mm2", "axial_feed_cosine"})
      csv.text(name);
    csv.end_row();
    const std::size_t n = rec.time.size(), group = (n + kMostRows - 1) / kMostRows;
    for (std::size_t begin = 0; begin < n; begin += group) {
      const std::size_t end = std::min(begin + group, n);
      Eigen::Matrix<double, 10, 1> row = Eigen::Matrix<double, 10, 1>::Zero();
      for (std::size_t j = begin; j < end; ++j) {
        const double place =
            (rec.time[j] - fit.delay.value - rec.basis->start) / rec.basis->step + 0.5;
        const auto i = static_cast<std::size_t>(
            std::clamp(place, 0.0, static_cast<double>(rec.basis->size - 1)));
        Eigen::Matrix<double, 10, 1> one;
        one << rec.time[j], rec.force[j], modelled[j], static_cast<double>(rec.basis->removal[i]),
            static_cast<double>(rec.basis->area[i]), static_cast<double>(rec.basis->axial[i]);
        row += one / static_cast<double>(end - begin);
      }
      for (const double v : row) csv.number(v);
      csv.end_row();
    }
    csv.close();
  }
  if (!fit.names.empty()) {
    CsvWriter csv(folder + "/draws.csv");
    for (const std::string& name : fit.names) csv.text(name);
    csv.end_row();
    for (Eigen::Index i = 0; i < fit.draws.cols(); ++i) {
      for (Eigen::Index k = 0; k < fit.draws.rows(); ++k)
        csv.number(k % 2 == 0 ? units::to_joule_per_mm3(fit.draws(k, i)) : fit.draws(k, i));
      csv.end_row();
    }
    csv.close();
  }
  CsvWriter csv(folder + "/adequacy.csv");
  for (const char* name : {"of", "low", "high", "force_factor", "force_factor_std"}) csv.text(name);
  csv.end_row();
  for (const AdequacyBin& b : fit.adequacy) {
    csv.text(b.of);
    for (const double v : {b.low, b.high, b.factor, b.std}) csv.number(v);
    csv.end_row();
  }
  csv.close();
}

}  // namespace toothprep
