#include "toothprep/tools/calibrate/calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/spindle.h"
#include "toothprep/tools/io/scan_uncertainty.h"
#include "toothprep/tools/recordings/rounding.h"
#include "toothprep/tools/trajectory/smoothing.h"

namespace toothprep {
namespace {

constexpr double kNoisyFeed = 0.3;  // velocity noise by feed, from which it is reported
constexpr double kTorqueOff = 0.1;  // of the modelled torque, likewise

void say(const CalibrationListener& l, const std::string& line) {
  if (l.say) l.say(line);
}
void warn(const CalibrationListener& l, const std::string& line) {
  if (l.warn) l.warn(line);
}

// Median of the speeds that were recorded while the bur turned; NaN if none was.
double typical_speed(const std::vector<MeasuredRecording>& recordings) {
  std::vector<double> speeds;
  for (const MeasuredRecording& r : recordings)
    for (std::size_t i = 0; i < r.rotation_rate.size(); ++i)
      if (r.rotation_rate[i] > 0 && !r.stalled[i]) speeds.push_back(r.rotation_rate[i]);
  return speeds.empty() ? std::nan("") : median(std::move(speeds));
}

// The rotation rate that the fit is for: stated, or as recorded. Whether the motions carry the
// recorded speed.
bool settle_rotation_rate(const std::vector<MeasuredRecording>& recordings,
                          const CalibrationSettings& settings, Parameters& parameters,
                          const CalibrationListener& listener) {
  // A coupled replay has a speed of its own.
  const double speed =
      settings.rotation_rate_stated || settings.coupled ? std::nan("") : typical_speed(recordings);
  if (std::isfinite(speed)) {
    parameters.handpiece.rotation_rate = speed;
    for (const MeasuredRecording& r : recordings)
      if (r.rotation_rate.empty())
        warn(listener,
             fmt::format("{}: has no speed; {:g} rev/s, the median of the others, is taken", r.name,
                         speed));
    return true;
  }
  if (settings.fits_droop())
    throw InputError(recordings.front().name, "/rotation_rate",
                     "is missing: --fit-droop needs the speed",
                     "record it (CSV: a column rotation_rate_rev_s)");
  if (!settings.coupled && parameters.handpiece.model == HandpieceModel::kDroop)
    warn(listener,
         fmt::format("the handpiece droops but no speed was recorded: u is fitted as though it "
                     "turned at {:g} rev/s throughout",
                     parameters.handpiece.rotation_rate));
  return false;
}

std::vector<RecordedMotion> motions_of(const std::vector<MeasuredRecording>& recordings,
                                       const CalibrationSettings& settings, bool speed,
                                       const CalibrationListener& listener) {
  std::vector<RecordedMotion> motions;
  for (const MeasuredRecording& r : recordings) {
    check_run_memory(r.name, r.motion, settings.parameters.time_step);
    motions.push_back(motion_of(r, settings.parameters.time_step, settings.allow_gaps, speed));
    auto& path = motions.back().path;
    path = smoothed(path, settings.motion_window);
    const VelocityNoise v = velocity_noise(path);
    if (v.noise > kNoisyFeed * v.feed)
      warn(listener,
           fmt::format("{}: the velocity's noise, {:.2g} mm/s, is large against the feed of {:.2g} "
                       "mm/s: the force goes with the velocity, so smooth the motion "
                       "(--smooth-motion-ms {:g})",
                       r.name, v.noise, v.feed,
                       settings.motion_window > 0 ? 2e3 * settings.motion_window : 30.0));
  }
  return motions;
}

// What is wrong with motions that are rounded and not smoothed, a sentence each.
std::vector<std::string> rounded_motions(const std::vector<MeasuredRecording>& recordings,
                                         const CalibrationSettings& settings) {
  std::vector<std::string> warnings;
  if (settings.motion_window > 0) return warnings;
  for (const MeasuredRecording& r : recordings) {
    std::vector<double> time;
    std::vector<Vec3> position;
    for (const HandleSample& s : r.motion.samples) {
      time.push_back(s.time);
      position.push_back(s.pose.position);
    }
    const auto rounding = rounding_of(time, position);
    if (rounding && rounding->matters())
      warnings.push_back(r.name + ": " + text_of(*rounding) +
                         "; without it u and alpha are off by more than their uncertainty says");
  }
  return warnings;
}

// The coupling and handpiece that a trace says it was made with, where they aren't the fit's.
void compare_with_recorded(const MeasuredRecording& r, const Parameters& p,
                           const CalibrationListener& listener) {
  if (r.parameters_toml.empty()) return;
  const Parameters recorded = parse_parameters(r.parameters_toml, r.name);
  const auto differ = [&](const char* what, double own, double used) {
    if (own != used)
      warn(listener, fmt::format("{}: was recorded with {} {:g}, the fit uses {:g}", r.name, what,
                                 own, used));
  };
  differ("a coupling of (N/mm)", recorded.coupling.stiffness, p.coupling.stiffness);
  differ("a damping of (N s/mm)", recorded.coupling.damping, p.coupling.damping);
  differ("a stall torque of (mN m)", recorded.handpiece.stall_torque, p.handpiece.stall_torque);
}

// A stalled bur would have removed nothing where the model has it cut on.
void warn_of_stalls(const std::vector<MeasuredRecording>& recordings, double stall_torque,
                    CalibrationResult& c) {
  double torque = 0;
  const auto fitted = modelled_tissue(c.fit);
  for (const ForceBasis& basis : c.bases)
    for (std::size_t i = 0; i < basis.size; ++i)
      torque = std::max(torque, torque_at(basis, i, fitted));
  const bool recorded = std::any_of(recordings.begin(), recordings.end(),
                                    [](const MeasuredRecording& r) { return !r.stalled.empty(); });
  if (!recorded && torque > stall_torque)
    c.fit.warnings.push_back(
        fmt::format("with the fitted values the torque reaches {:.2f} mN m, above the stall torque "
                    "of {:.2f} mN m: if the handpiece stalled, leave those spans out",
                    torque, stall_torque));
}

// Where the bur touches enamel and dentin at once, how much of each depends on where their border is,
// which a scan shows only so well. The intervals of u don't know of it.
void warn_of_uncertain_border(const LayeredTooth& tooth, CalibrationResult& c) {
  const auto widths = recorded_scan_half_widths(tooth.provenance);
  const double border = widths ? (*widths)[static_cast<int>(ScanSurface::kEnamelDentin)] : 0;
  if (!(border > 0)) return;
  constexpr double kShareToSay = 0.1;
  std::size_t contact = 0, both = 0;
  for (const ForceBasis& basis : c.bases) {
    const std::vector<double>&enamel = basis.tissue[0].torque, &dentin = basis.tissue[1].torque;
    for (std::size_t i = 0; i < basis.size; ++i) {
      const bool in_enamel = i < enamel.size() && enamel[i] > 0,
                 in_dentin = i < dentin.size() && dentin[i] > 0;
      contact += in_enamel || in_dentin;
      both += in_enamel && in_dentin;
    }
  }
  const double share = contact > 0 ? static_cast<double>(both) / static_cast<double>(contact) : 0;
  if (share > kShareToSay)
    c.fit.warnings.push_back(
        fmt::format("{:.0f} % of the contact is with enamel and dentin at once, and the scan shows "
                    "their border to +-{:.2g} mm only (95 %): the intervals of u and alpha leave "
                    "that out; cut in one tissue at a time, farther from the border than that",
                    100 * share, border));
}

void fit_imposed(const Bur& bur, const LayeredTooth& tooth,
                 const std::vector<MeasuredRecording>& recordings,
                 const std::vector<RecordedMotion>& motions, const CalibrationSettings& settings,
                 const CalibrationListener& listener, CalibrationResult& c) {
  c.bases = force_bases(bur, tooth, c.parameters, motions, listener.motion);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    check_unit_by_model(recordings[r], c.bases[r], settings.force);
    c.recordings.push_back(compare(recordings[r], c.bases[r], settings.fit.largest_delay,
                                   settings.fit.lowpass_hz, settings.fit.on_handpiece));
  }
  c.fit = fit(c.recordings, settings.fit);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    RecordingFit& own = c.fit.recordings[r];
    check_torque(recordings[r], c.bases[r], c.fit, own);
    if (std::abs(own.torque_factor - 1) > kTorqueOff)
      c.fit.warnings.push_back(
          fmt::format("{}: the recorded torque is {:.2f} of what the fitted u implies",
                      recordings[r].name, own.torque_factor));
  }
  if (settings.fits_droop())
    c.fit.droop = fit_droop(motions, c.bases, c.fit,
                            {settings.fit_droop_exponent, settings.fit_rotor,
                             settings.parameters.handpiece, settings.fit.seed});
  warn_of_stalls(recordings, c.parameters.handpiece.stall_torque, c);
  warn_of_uncertain_border(tooth, c);
  if (settings.laws.empty()) return;
  const auto compare_with = [&](const std::vector<ForceBasis>& bases) {
    std::vector<ComparedRecording> compared;
    for (std::size_t r = 0; r < recordings.size(); ++r)
      compared.push_back(compare(recordings[r], bases[r], settings.fit.largest_delay,
                                 settings.fit.lowpass_hz, settings.fit.on_handpiece));
    return compared;
  };
  c.laws = compare_laws(bur, tooth, c.parameters, motions, c.bases, compare_with, c.fit,
                        settings.fit, settings.laws, listener.say);
  // The spindle's torque is that of the paper's law, whichever is selected.
  for (LawFit& law : c.laws->laws) law.fit.droop = c.fit.droop;
}

void fit_handle(const Bur& bur, const LayeredTooth& tooth,
                const std::vector<MeasuredRecording>& recordings,
                const std::vector<RecordedMotion>& motions, const CalibrationSettings& settings,
                const CalibrationListener& listener, CalibrationResult& c) {
  for (const MeasuredRecording& r : recordings) compare_with_recorded(r, c.parameters, listener);
  int iteration = 0;
  c.coupled = fit_coupled(bur, tooth, c.parameters, recordings, motions, settings.fit, {},
                          [&](const CoupledIteration& i) {
                            say(listener, fmt::format("replays {}: u and alpha change by {:.2g} %",
                                                      ++iteration, 100 * i.change));
                          });
  c.fit = std::move(c.coupled.fit);
  c.fit.replays = iteration;
  c.recordings = c.coupled.recordings;
  if (c.coupled.stalled > 0)
    say(listener, fmt::format("the replayed bur stalls for {:.2f} s in all", c.coupled.stalled));
}

std::string tissue_line(const TissueFit& t, std::string_view name, double rotation_rate) {
  using units::to_joule_per_mm3;
  if (t.identifiable)
    return fmt::format(
        "{:<6}  u = {:.4g} +- {:.2g} J/mm^3 (95 %: {:.4g} to {:.4g}) at N = {:g} "
        "rev/s;  alpha = {:.4g} +- {:.2g} (95 %: {:.4g} to {:.4g})",
        name, to_joule_per_mm3(t.u.value), to_joule_per_mm3(t.u.std), to_joule_per_mm3(t.u.low),
        to_joule_per_mm3(t.u.high), rotation_rate, t.alpha.value, t.alpha.std, t.alpha.low,
        t.alpha.high);
  if (t.ratio_identifiable)
    return fmt::format(
        "{:<6}  not identifiable: {}.  u/alpha = {:.4g} +- {:.2g} J/mm^3 at N = {:g} rev/s", name,
        t.why_not.text, to_joule_per_mm3(t.u_over_alpha.value),
        to_joule_per_mm3(t.u_over_alpha.std), rotation_rate);
  return fmt::format("{:<6}  not identifiable: {}", name, t.why_not.text);
}

std::string lowpass_line(const Estimate& constant) {
  if (constant.value > 2 * constant.std)
    return fmt::format(
        "low-pass of the sensor: time constant {:.2f} +- {:.2g} ms (corner {:.3g} Hz)",
        1e3 * constant.value, 1e3 * constant.std, 1 / (2 * units::kPi * constant.value));
  return fmt::format("low-pass of the sensor: none seen (time constant {:.2f} +- {:.2g} ms)",
                     1e3 * constant.value, 1e3 * constant.std);
}

std::string droop_line(const DroopFit& droop) {
  if (!droop.identifiable) return "droop: not identifiable: " + droop.why_not;
  std::string line = fmt::format(
      "droop: N0 = {:.5g} +- {:.2g} rev/s, stall torque {:.4g} +- {:.2g} mN m", droop.rate.value,
      droop.rate.std, droop.stall_torque.value, droop.stall_torque.std);
  if (!droop.exponents_like_the_best.empty())
    line += fmt::format(", exponent {:g} (not distinguishable: {:g})", droop.exponent,
                        fmt::join(droop.exponents_like_the_best, ", "));
  if (droop.inertia)
    line += fmt::format(", inertia {:.4g} +- {:.2g} g mm2", units::to_gram(droop.inertia->value),
                        units::to_gram(droop.inertia->std));
  if (droop.run_down)
    line += fmt::format(", runs down in {:.4g} +- {:.2g} s", droop.run_down->value,
                        droop.run_down->std);
  if (!droop.inertia_why_not.empty())
    line += "; inertia not identifiable: " + droop.inertia_why_not;
  return line;
}

std::string adequacy_line(const FitResult& fit) {
  if (fit.constant_suffices)
    return "constant u and alpha suffice: no part of the recordings is off by more than 5 %";
  const auto worst = std::max_element(fit.adequacy.begin(), fit.adequacy.end(),
                                      [](const AdequacyBin& a, const AdequacyBin& b) {
                                        return std::abs(a.factor - 1) < std::abs(b.factor - 1);
                                      });
  return fmt::format(
      "constant u and alpha do not suffice: forces are {:.2f} of the model's for {} {:.3g} to "
      "{:.3g}",
      worst->factor, worst->of, worst->low, worst->high);
}

// What is implausible about the fitted values or the recorded speed; what the settings said of
// themselves was judged before.
void warn_of_implausible(const Parameters& before, CalibrationResult& c) {
  std::vector<std::string> known;
  for (const Finding& f : judge_parameters(before)) known.push_back(message_of(f));
  for (const Finding& f : judge_parameters(c.parameters))
    if (std::find(known.begin(), known.end(), message_of(f)) == known.end())
      c.fit.warnings.push_back("the fit: " + message_of(f));
}

}  // namespace

std::vector<MeasuredRecording> read_recordings(const std::vector<std::string>& files,
                                               const CalibrationSettings& settings,
                                               const std::string& tooth_sha256,
                                               const std::string& tooth, const std::string& bur,
                                               const CalibrationListener& listener) {
  std::vector<MeasuredRecording> recordings;
  for (const std::string& file : files) {
    recordings.push_back(
        read_recording(file, settings.force,
                       settings.coupled ? RecordedPose::kHandle : RecordedPose::kBurOrHandle));
    const MeasuredRecording& r = recordings.back();
    const std::vector<Finding> findings = judge_motion(r.motion.samples);
    // Of a path too small nothing that follows would name the cause.
    for (const Finding& f : findings)
      if (f.what == Implausible::kExtent)
        throw InputError(file, "position", f.text + "; likely cause: " + f.cause,
                         "read it with `toothprep import --length-unit m`");
    if (listener.judged) listener.judged(file, findings);
    check_same_tooth(r, tooth_sha256, tooth);
    if (!r.bur.empty() && r.bur != bur)
      warn(listener, file + ": was recorded with the bur " + r.bur + ", not " + bur);
    const auto stalled = std::count(r.stalled.begin(), r.stalled.end(), 1);
    if (stalled > 0)
      warn(listener, fmt::format("{}: the bur stood still in {} samples; they and what lies within "
                                 "{:g} ms of them are left out, since a stalled bur's force is not "
                                 "the cutting law's",
                                 file, stalled, 1e3 * settings.fit.largest_delay));
  }
  return recordings;
}

void check_settings(const CalibrationSettings& settings) {
  if (settings.fits_droop() && settings.rotation_rate_stated)
    throw Error(
        "--fit-droop takes the rotation rate from the recordings: leave --rotation-rate-rev-s "
        "away");
  if (!is_linear(settings.parameters))
    throw Error(
        "calibrate fits the paper's law: leave size_exponent, ratio_exponent, "
        "rubbing_pressure_n_per_mm2 and up_cutting out of --params");
  if (!settings.laws.empty() && settings.coupled)
    throw Error(
        "--law needs the bur's own motion (--drive direct): on a coupled rig the law changes the "
        "motion too");
  if (settings.fits_droop() && settings.coupled)
    throw Error(
        "--fit-droop needs the bur's own motion (--drive direct): on a coupled rig the droop "
        "changes the motion too");
  if (std::abs(settings.fit.delay) > settings.fit.largest_delay)
    throw InputError("--delay-ms", "", "lies beyond --largest-delay-ms");
}

CalibrationResult calibrate(const Bur& bur, const LayeredTooth& tooth,
                            const std::vector<MeasuredRecording>& recordings,
                            const CalibrationSettings& settings,
                            const CalibrationListener& listener) {
  check_settings(settings);
  if (recordings.empty()) throw Error("a calibration needs a recording at least");
  CalibrationResult c;
  c.parameters = settings.parameters;
  const bool speed = settle_rotation_rate(recordings, settings, c.parameters, listener);
  const auto motions = motions_of(recordings, settings, speed, listener);
  const std::vector<std::string> rounded = rounded_motions(recordings, settings);
  CalibrationSettings own = settings;
  own.fit.rough_motion = !rounded.empty();
  (settings.coupled ? fit_handle : fit_imposed)(bur, tooth, recordings, motions, own, listener, c);
  c.fit.warnings.insert(c.fit.warnings.begin(), rounded.begin(), rounded.end());
  warn_of_implausible(settings.parameters, c);
  if (settings.fit.estimate_lowpass)
    for (ComparedRecording& r : c.recordings) set_lowpass(r, c.fit.lowpass.value, false);
  return c;
}

std::vector<std::string> describe(const FitResult& fit) {
  std::vector<std::string> lines;
  for (int k = 0; k < kTissueCount; ++k)
    if (fit.tissue[k].touched > 0 || k <= 1)
      lines.push_back(tissue_line(fit.tissue[k], kTissueNames[k], fit.rotation_rate));
  lines.push_back(fmt::format(
      "residuals {:.3g} N rms (R2 {:.4f}, {:.2f} % outliers); predicted {:.3g} N rms ({})",
      fit.residual_rms, fit.residual_r2, 100 * fit.outlier_share, fit.validation_rms,
      fit.validation));
  if (fit.lowpass.std > 0) lines.push_back(lowpass_line(fit.lowpass));
  for (const RecordingFit& r : fit.recordings)
    if (std::isfinite(r.torque_factor))
      lines.push_back(
          fmt::format("{}: recorded torque {:.3f} of the modelled, {:.3g} mN m rms apart", r.name,
                      r.torque_factor, r.torque_rms));
  if (fit.droop) lines.push_back(droop_line(*fit.droop));
  if (fit.replays > 0)
    lines.push_back(fmt::format("coupled: converged after {} rounds of replays", fit.replays));
  lines.push_back(adequacy_line(fit));
  return lines;
}

}  // namespace toothprep
