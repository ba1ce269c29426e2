#include "toothprep/tools/preparation_paths/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kStroke = 0.4;                   // mm
constexpr double kAirSpeed = 6, kEmptySpeed = 2;  // mm/s: outside; where a plan finds nothing left
constexpr double kSlowest = 0.03;                 // mm/s
constexpr double kAxialFactor = 2.5;              // of the force, for a way along the axis

struct Limits {
  double roughing, finishing;  // N against the feed
  double finishing_speed;      // mm/s
  double torque;               // N·mm
};

// On a spring the bur lags by F/k, and what it lags it leaves; without one force is all that counts.
Limits limits_of(const Parameters& p, Drive drive, double roughing_lag) {
  // Of a drooping one 0.6 of the torque at the greatest power, tau_s n/(n + 1).
  const double n = p.handpiece.droop_exponent;
  const double share = p.handpiece.model == HandpieceModel::kDroop ? 0.6 * (n / (n + 1)) : 0.5;
  const double torque = share * p.handpiece.stall_torque;
  if (drive == Drive::kDirect) return {3, 1, 2, torque};
  const double k = p.coupling.stiffness;
  return {std::min(2.0, roughing_lag * k), std::min(1.0, 0.12 * k), 0.4, torque};
}

// Per mm of way: energy, and energy over α.
struct Load {
  double energy = 0, pushed = 0;
};

Load load_of(const Milling::Bite& bite, double way, const Parameters& p) {
  Load load;
  for (int k = 0; k < kTissueCount; ++k) {
    const double e = p.tissue[k].specific_energy * bite.removed[k] / way;
    load.energy += e;
    load.pushed += e / p.tissue[k].force_ratio;
  }
  return load;
}

Quat upright(const Vec3& axis) { return orientation_of_axis(axis); }

// Speeds in steps of a quarter, so that neighbours share a segment.
double rounded_down(double speed) {
  const double ratio = std::log(1.25);
  return std::exp(ratio * std::floor(std::log(speed) / ratio + 1e-9));
}

std::string vector_text(const Vec3& v, int digits) {
  const double scale = std::pow(10.0, digits);
  const auto number = [&](double x) { return std::round(x * scale) / scale + 0.0; };
  return fmt::format("[{:g}, {:g}, {:g}]", number(v.x()), number(v.y()), number(v.z()));
}

}  // namespace

void Plan::go(const Vec3& to, Pace pace, const std::string& note) {
  const Vec3 kept = strokes.empty() ? axis : strokes.back().axis;  // the vector may move
  go(to, kept, pace, note);
}

void Plan::go(const Vec3& to, const Vec3& turned, Pace pace, const std::string& note) {
  const Vec3 from = strokes.empty() ? start : strokes.back().to;
  const double way = (to - from).norm();
  if (way < 1e-6) return;
  const Vec3 was = strokes.empty() ? axis : strokes.back().axis;
  const int parts =
      pace == Pace::kAir ? 1 : std::max(1, static_cast<int>(std::ceil(way / kStroke)));
  for (int i = 1; i <= parts; ++i) {
    const double t = static_cast<double>(i) / parts;
    Stroke stroke;
    stroke.to = from + t * (to - from);
    stroke.axis = ((1 - t) * was + t * turned).normalized();
    stroke.pace = pace;
    if (i == 1) stroke.note = note;
    strokes.push_back(stroke);
  }
}

void Plan::hold(double seconds) { strokes.back().hold += seconds; }

void choose_feeds(Plan& plan, const ToothGrid& grid, const Bur& bur, const Parameters& parameters,
                  Drive drive) {
  if (!is_linear(parameters))
    throw Error(
        "prepare chooses its feeds by the paper's law: leave size_exponent, ratio_exponent, "
        "rubbing_pressure_n_per_mm2 and up_cutting out of --params");
  const Limits limits = limits_of(parameters, drive, plan.roughing_lag);
  const double n = parameters.handpiece.rotation_rate;
  Milling milling(grid, bur);
  std::vector<Load> loads;
  Pose last{plan.start, upright(plan.axis)};
  milling.at(last);
  for (const Stroke& s : plan.strokes) {
    const Pose pose{s.to, upright(s.axis)};
    const double way = std::max(1e-3, (s.to - last.position).norm());
    Load load = load_of(milling.along(last, pose), way, parameters);
    const double axial = std::abs((s.to - last.position).dot(s.axis)) / way;
    load.pushed *= 1 + (kAxialFactor - 1) * axial;
    loads.push_back(load);
    last = pose;
  }
  for (std::size_t i = 0; i < plan.strokes.size(); ++i) {
    Stroke& s = plan.strokes[i];
    if (s.pace == Pace::kAir && loads[i].energy == 0) {
      s.speed = kAirSpeed;
      continue;
    }
    Load load = loads[i];  // at least the mean of the neighbours: a grid counts in cells
    if (i > 0 && i + 1 < loads.size()) {
      load.energy = std::max(load.energy, 0.5 * (loads[i - 1].energy + loads[i + 1].energy));
      load.pushed = std::max(load.pushed, 0.5 * (loads[i - 1].pushed + loads[i + 1].pushed));
    }
    const bool fine = s.pace == Pace::kFinishing;
    const double force = fine ? limits.finishing : limits.roughing;
    double speed = fine ? limits.finishing_speed : kEmptySpeed;
    if (load.pushed > 0) speed = std::min(speed, force * 8 * n * bur.max_radius() / load.pushed);
    if (load.energy > 0) speed = std::min(speed, limits.torque * 2 * units::kPi * n / load.energy);
    s.speed = rounded_down(std::max(kSlowest, speed));
  }
}

double duration(const Plan& plan) {
  double sum = 0;
  Vec3 last = plan.start;
  for (const Stroke& s : plan.strokes) {
    sum += (s.to - last).norm() / s.speed + s.hold;
    last = s.to;
  }
  return sum;
}

std::string script_of(const Plan& plan, const Pose& frame, const std::string& title) {
  std::string text = "# " + title + "\n#\n";
  for (const std::string& fact : plan.facts) text += "# " + fact + "\n";
  text += fmt::format("start_mm = {}\naxis = {}\nrate_hz = 1000\n",
                      vector_text(frame.to_world(plan.start), 4),
                      vector_text(frame.orientation * plan.axis, 6));
  Vec3 axis = plan.axis;
  for (std::size_t i = 0; i < plan.strokes.size();) {
    const Stroke& first = plan.strokes[i];
    const bool turns = (first.axis - axis).norm() > 1e-5;
    std::size_t end = i + 1;
    while (end < plan.strokes.size() && !turns && plan.strokes[end].speed == first.speed &&
           plan.strokes[end].note.empty() && plan.strokes[end - 1].hold == 0 &&
           (plan.strokes[end].axis - axis).norm() <= 1e-5)
      ++end;
    if (!first.note.empty()) text += "\n# " + first.note + "\n";
    text += "\n[[segment]]\nkind = \"waypoints\"\npoints_mm = [";
    for (std::size_t k = i; k < end; ++k)
      text += (k > i ? ", " : "") + vector_text(frame.to_world(plan.strokes[k].to), 4);
    text += fmt::format("]\nspeed_mm_s = {:.3g}\n", first.speed);
    if (turns) text += "axis = " + vector_text(frame.orientation * first.axis, 6) + "\n";
    axis = plan.strokes[end - 1].axis;
    if (plan.strokes[end - 1].hold > 0)
      text += fmt::format("\n[[segment]]\nkind = \"hold\"\nduration_s = {:g}\n",
                          plan.strokes[end - 1].hold);
    i = end;
  }
  return text;
}

std::vector<double> layer_floors(double top, double floor, double thickest) {
  const int count = std::max(1, static_cast<int>(std::ceil((top - floor) / thickest)));
  std::vector<double> floors;
  for (int k = 1; k <= count; ++k) floors.push_back(top + (floor - top) * k / count);
  return floors;
}

double flat_radius(const Bur& bur, double depth) {
  double radius = 0;
  for (const ProfilePiece& piece : bur.profile())
    for (int i = 0; i <= 20; ++i) {
      const ProfilePoint p = point_on(piece, i / 20.0);
      if (p.z <= depth) radius = std::max(radius, p.r);
    }
  return radius;
}

}  // namespace toothprep
