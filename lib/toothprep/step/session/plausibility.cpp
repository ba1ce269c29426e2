#include "toothprep/step/session/plausibility.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kLongestStep = 0.1;           // s, between samples
constexpr double kShortestStep = 5e-5;         // s, likewise: no device records faster
constexpr double kFarthest = 1e4;              // mm
constexpr double kSmallestExtent = 0.1;        // mm
constexpr double kLargestExtent = 500;         // mm, of what a hand reaches
constexpr double kFastest = 500;               // mm/s
constexpr double kFastestTurn = 30;            // rad/s
constexpr double kRare = 1e-3;                 // share of the samples that single faults make up
constexpr double kLeastU = 0.1, kMostU = 1e5;  // N/mm²: 1e-4 and 100 J/mm³
constexpr double kJoulePerCubicMetre = 1e9;    // N/mm²: from there u was given in J/m³
constexpr double kLeastAlpha = 0.01, kMostAlpha = 10;
constexpr double kFastestSpindle = 1e4;    // rev/s
constexpr double kStiffest = 200;          // N/mm
constexpr double kSlowestSpinUp = 10;      // s
constexpr double kLongestTimeStep = 0.02;  // s
constexpr double kMostForce = 50;          // N
constexpr double kLeastEnergy = 0.01;      // mJ, from which the audit is judged
constexpr double kLeastWork = 0.1;         // mJ, without removal

double median_step(const std::vector<HandleSample>& s) {
  std::vector<double> steps;
  steps.reserve(s.size());
  for (std::size_t i = 1; i < s.size(); ++i) steps.push_back(s[i].time - s[i - 1].time);
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

// What exceeds a limit: how often, where first, how much at most.
struct Excess {
  std::size_t count = 0, first = 0;
  double most = 0;
  void look(std::size_t i, double value, double limit) {
    most = std::max(most, value);
    if (value > limit && count++ == 0) first = i;
  }
  bool rare(std::size_t of) const {
    return static_cast<double>(count) <= std::max(2.0, kRare * static_cast<double>(of));
  }
};

struct Motion {
  Excess place, speed, turning;
  double step = 0;    // s, median
  double extent = 0;  // mm, the longest side of the box of all samples that aren't out of place
};

Motion survey(const std::vector<HandleSample>& s) {
  Motion m;
  m.step = median_step(s);
  const double most = std::numeric_limits<double>::infinity();
  Vec3 low = Vec3::Constant(most), high = Vec3::Constant(-most);
  for (std::size_t i = 0; i < s.size(); ++i) {
    const Vec3& p = s[i].pose.position;
    const double away = p.cwiseAbs().maxCoeff();
    m.place.look(i, away, kFarthest);
    if (away <= kFarthest) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    if (i == 0) continue;
    const double time = s[i].time - s[i - 1].time;
    m.speed.look(i, (p - s[i - 1].pose.position).stableNorm() / time, kFastest);
    m.turning.look(i, s[i - 1].pose.orientation.angularDistance(s[i].pose.orientation) / time,
                   kFastestTurn);
  }
  m.extent = low.x() <= high.x() ? (high - low).maxCoeff() : 0;
  return m;
}

std::string speed_cause(const Motion& m, std::size_t samples) {
  if (m.place.count > 0 || m.speed.rare(samples))
    return "single samples are damaged or were lost: cut them out of the recording";
  if (m.step < kShortestStep)
    return fmt::format("times in another unit read as seconds (samples {:.3g} s apart)", m.step);
  if (m.extent > kLargestExtent) return "positions in micrometres read as millimetres";
  return "times or positions in another unit, or another frame's motion";
}

void judge_u(int k, double u, std::vector<Finding>& findings) {
  if (u == 0 || (u >= kLeastU && u <= kMostU)) return;
  const double joule = units::to_joule_per_mm3(u);
  Finding f{Implausible::kSpecificEnergy, joule,
            fmt::format("the specific energy of {} is {:.4g} J/mm^3 (published: 0.01 to 20)",
                        kTissueNames[static_cast<std::size_t>(k)], joule),
            "its unit is J/mm^3"};
  if (u >= kJoulePerCubicMetre)
    f.cause = fmt::format("u in J/m^3: it would be {:.4g} J/mm^3", joule * 1e-9);
  else if (u > kMostU)
    f.cause = fmt::format("u in N/mm^2 or J/cm^3: it would be {:.4g} J/mm^3", joule * 1e-3);
  findings.push_back(std::move(f));
}

// Whether the model is read in a way in which work and removal agree.
bool work_is_removal(const Parameters& p) { return p.rotation_feed && !p.trailing_elements; }

}  // namespace

const char* name_of(Implausible what) {
  switch (what) {
    case Implausible::kTimeStep:
      return "time_step";
    case Implausible::kPosition:
      return "position";
    case Implausible::kExtent:
      return "extent";
    case Implausible::kSpeed:
      return "speed";
    case Implausible::kTurning:
      return "turning";
    case Implausible::kSpecificEnergy:
      return "specific_energy";
    case Implausible::kForceRatio:
      return "force_ratio";
    case Implausible::kRotationRate:
      return "rotation_rate";
    case Implausible::kRotorInertia:
      return "rotor_inertia";
    case Implausible::kStiffness:
      return "stiffness";
    case Implausible::kStep:
      return "step";
    case Implausible::kForce:
      return "force";
    case Implausible::kEnergyAudit:
      return "energy_audit";
  }
  return "";
}

const char* name_of(Audit::Verdict verdict) {
  switch (verdict) {
    case Audit::Verdict::kNotJudged:
      return "not judged";
    case Audit::Verdict::kWithin:
      return "within";
    case Audit::Verdict::kOutside:
      return "outside";
  }
  return "";
}

std::string message_of(const Finding& finding) {
  return finding.text + "; likely cause: " + finding.cause;
}

std::vector<Finding> judge_motion(const std::vector<HandleSample>& s, Drive drive) {
  std::vector<Finding> findings;
  if (s.size() < 2) return findings;
  const Motion m = survey(s);
  const bool moves = drive != Drive::kLoad;
  const auto time = [&](const Excess& e) { return s[e.first].time; };
  if (m.step > kLongestStep)
    findings.push_back({Implausible::kTimeStep, m.step,
                        fmt::format("the samples lie {:.3g} s apart (median)", m.step),
                        "times in milliseconds read as seconds"});
  if (m.place.count > 0)
    findings.push_back(
        {Implausible::kPosition, m.place.most,
         fmt::format("{} of {} samples lie more than 10 m from the origin, the first at {:.4g} s, "
                     "the farthest at {:.3g} mm",
                     m.place.count, s.size(), time(m.place), m.place.most),
         m.place.rare(s.size())
             ? "single samples are damaged: cut them out of the recording"
             : "positions in micrometres read as millimetres, or another frame"});
  if (moves && m.extent < kSmallestExtent)
    findings.push_back({Implausible::kExtent, m.extent,
                        fmt::format("the whole path lies within {:.3g} mm", m.extent),
                        m.extent > 0 ? "positions in metres read as millimetres"
                                     : "the device's position was not recorded"});
  if (moves && m.speed.count > 0)
    findings.push_back(
        {Implausible::kSpeed, m.speed.most,
         fmt::format("the handle moves at up to {:.3g} mm/s (above 500 mm/s in {} of {} steps, the "
                     "first at {:.4g} s)",
                     m.speed.most, m.speed.count, s.size() - 1, time(m.speed)),
         speed_cause(m, s.size())});
  if (m.turning.count > 0)
    findings.push_back(
        {Implausible::kTurning, m.turning.most,
         fmt::format("the handle turns at up to {:.3g} rad/s (above 30 rad/s in {} of {} steps, "
                     "the first at {:.4g} s)",
                     m.turning.most, m.turning.count, s.size() - 1, time(m.turning)),
         "the quaternion is in another order than x, y, z, w, or holds the bur's own rotation"});
  return findings;
}

std::vector<Finding> judge_parameters(const Parameters& p) {
  std::vector<Finding> findings;
  for (int k = 0; k < kTissueCount; ++k) {
    judge_u(k, p.tissue[k].specific_energy, findings);
    const double alpha = p.tissue[k].force_ratio;
    if (alpha < kLeastAlpha || alpha > kMostAlpha)
      findings.push_back(
          {Implausible::kForceRatio, alpha,
           fmt::format("the force ratio alpha of {} is {:.3g} (usual: 0.1 to 1), and the normal "
                       "force is F_t/alpha",
                       kTissueNames[static_cast<std::size_t>(k)], alpha),
           "alpha is not F_t/F_n, or lost its exponent"});
  }
  const double rate = p.handpiece.rotation_rate;
  if (rate > kFastestSpindle)
    findings.push_back({Implausible::kRotationRate, rate,
                        fmt::format("the rotation rate is {:.4g} rev/s", rate),
                        fmt::format("rpm: it would be {:.4g} rev/s", rate / 60)});
  const double spin_up =
      2 * units::kPi * p.handpiece.rotor_inertia * rate / p.handpiece.stall_torque;
  if (spin_up > kSlowestSpinUp)
    findings.push_back(
        {Implausible::kRotorInertia, spin_up,
         fmt::format("with a rotor of {:.4g} g mm2 the handpiece takes {:.3g} s to speed up",
                     units::to_gram(p.handpiece.rotor_inertia), spin_up),
         "an inertia in another unit: 1 g cm2 is 100 g mm2, 1 kg m2 is 1e9 g mm2"});
  if (p.coupling.stiffness >= kStiffest)
    findings.push_back(
        {Implausible::kStiffness, p.coupling.stiffness,
         fmt::format("the coupling's stiffness is {:.4g} N/mm", p.coupling.stiffness),
         fmt::format("N/m: it would be {:.4g} N/mm", p.coupling.stiffness * 1e-3)});
  if (p.time_step > kLongestTimeStep)
    findings.push_back({Implausible::kStep, p.time_step,
                        fmt::format("the time step is {:.4g} s", p.time_step),
                        "it was given in milliseconds"});
  return findings;
}

Audit judge_audit(double work, double removed_energy, const PerTissue<double>& removed,
                  const Parameters& parameters) {
  Audit a;
  a.work = work;
  a.removed_energy = removed_energy;
  a.low = 0.9;
  a.high = parameters.engine == EngineKind::kVoxel ? 1.8 : 1.1;
  a.ratio = removed_energy > 0 ? work / removed_energy : std::nan("");
  const bool any = std::any_of(removed.begin(), removed.end(), [](double v) { return v > 0; });
  if (!work_is_removal(parameters)) {
    a.why_not_judged = "the parameters ask for a reading in which work and removal need not agree";
  } else if (any && removed_energy == 0) {
    a.why_not_judged = "the specific energy of what was removed is 0";
  } else if (!(removed_energy > kLeastEnergy) && !(std::abs(work) > kLeastWork) &&
             std::isfinite(work) && std::isfinite(removed_energy)) {
    a.why_not_judged = any ? "less than 0.01 mJ was removed" : "nothing was removed";
  } else {
    a.verdict =
        a.ratio >= a.low && a.ratio <= a.high ? Audit::Verdict::kWithin : Audit::Verdict::kOutside;
  }
  return a;
}

std::string audit_text(const Audit& a) {
  std::string text = std::isnan(a.ratio)
                         ? fmt::format("energy audit: torque work {:.3f} mJ", a.work)
                         : fmt::format(
                               "energy audit: torque work {:.3f} mJ / removed energy {:.3f} "
                               "mJ = {:.4f}",
                               a.work, a.removed_energy, a.ratio);
  if (a.verdict == Audit::Verdict::kOutside)
    text += fmt::format(", outside {} to {}", a.low, a.high);
  if (a.verdict == Audit::Verdict::kNotJudged) text += "; not judged: " + a.why_not_judged;
  return text;
}

std::vector<Finding> judge_run(std::vector<Finding> findings, const Audit& audit, double peak_force,
                               double largest_lag, Drive drive) {
  // The inputs are judged, so what shows in the results comes from them.
  const std::string cause = findings.empty() ? "" : findings.front().cause;
  const auto or_else = [&](const std::string& own) { return cause.empty() ? own : cause; };
  if (!(peak_force <= kMostForce))
    findings.push_back(
        {Implausible::kForce, peak_force, fmt::format("the peak force is {:.4g} N", peak_force),
         or_else(drive == Drive::kCoupled
                     ? fmt::format("the bur falls {:.3g} mm behind the handle: the feed is faster "
                                   "than it can grind",
                                   largest_lag)
                 : drive == Drive::kLoad
                     ? "the load is not in N"
                     : "the imposed feed is faster than a hand could press the bur")});
  if (audit.verdict == Audit::Verdict::kOutside)
    findings.push_back(
        {Implausible::kEnergyAudit, audit.ratio, audit_text(audit),
         or_else("a step moves the bur further than force and removal can follow: repeat with half "
                 "the time step, or with smaller voxels")});
  return findings;
}

}  // namespace toothprep
