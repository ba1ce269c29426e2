#include "toothprep/proof/figures/cut_simulation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/session.h"

namespace toothprep::figures {
namespace {

constexpr double kWay = 0.3;         // mm, that is simulated
constexpr double kMargin = 0.5;      // mm, of tissue around the cut
constexpr int kMostSteps = 2500;     // of a cut
constexpr int kStepsToStall = 3;     // a bur that stalls does so in the first
constexpr double kVoxel = 0.1;       // mm
constexpr double kThinVoxel = 0.05;  // mm, for depths of a few voxels
constexpr int kPowerPoints = 24;     // loads up to the stall

// The block that leaves the cut's depth in front of a bur whose axis is x = 0 and whose tip z = 0.
LayeredTooth block_for(const Cut& cut) {
  const double radius = cut.diameter / 2;
  const bool whole = cut.geometry == CutGeometry::kFullSlot || cut.geometry == CutGeometry::kFace;
  const double depth = cut.geometry == CutGeometry::kSkim ? cut.depth : radius;
  BlockOptions o;
  o.voxel = cut.depth > 0 && cut.depth < 4 * kVoxel ? kThinVoxel : kVoxel;
  const double width = whole ? cut.diameter + 2 * kMargin : depth + kMargin;
  o.size = Vec3(width, 2 * (radius + kMargin) + kWay, cut.length + kMargin);
  o.enamel = cut.tissue == Tissue::kEnamel ? o.size.y() : 0;
  // Seen from a bur that is fed along -y, the tissue comes along +y. So does the surface of a
  // clockwise bur on its -x side: down-cutting (climbing).
  const double aside = whole ? 0 : radius - depth + width / 2;
  o.pose.position = Vec3(cut.climb ? -aside : aside, 0, cut.length / 2 - kMargin / 2);
  return make_block(o);
}

CutResult simulate_in(const LayeredTooth& tooth, const Cut& cut, const Parameters& parameters) {
  const Parameters p = parameters_for(cut, parameters);
  const double radius = cut.diameter / 2;
  const Bur bur = make_bur(fmt::format("cylinder:D{}xL{}", cut.diameter, cut.length + 1), "");
  Workpiece workpiece(tooth);
  const bool face = cut.geometry == CutGeometry::kFace;
  HandleSample sample;
  sample.pose.position.y() = face ? radius : -radius - kMargin;
  sample.load = Vec3(0, -cut.load, 0);
  const double start = sample.pose.position.y(), way = face ? cut.depth : kWay;
  Session session(bur, workpiece, p, cut.load > 0 ? Drive::kLoad : Drive::kDirect, sample);
  CutResult r;
  r.free_rate = p.handpiece.rotation_rate;
  StepRecord row = session.initial();
  int steps = 0;
  while (steps < kMostSteps && start - row.bur.position.y() < way) {
    sample.time = ++steps * p.time_step;
    sample.pose.position.y() = start - cut.feed * sample.time;
    row = session.step(sample);
    r.force_along += row.grinding_force.y();
    r.tangential += row.torque / radius;
    r.normal += std::sqrt(std::max(
        0.0, row.grinding_force.squaredNorm() - row.torque * row.torque / (radius * radius)));
    r.torque += row.torque;
    r.rotation_rate += row.rotation_rate;
    if (row.stalled && steps >= kStepsToStall) break;
  }
  session.finish(row);
  r.stalled = row.stalled;
  if (r.stalled) return {true, 0, 0, 0, 0, 0, 0, 0, r.free_rate, 0};
  const double time = steps * p.time_step;
  r.feed = (start - row.bur.position.y()) / time;
  r.removal_rate = row.removed_volume[tissue_index(cut.tissue)] / time;
  for (double* sum : {&r.force_along, &r.tangential, &r.normal, &r.torque, &r.rotation_rate})
    *sum /= steps;
  const double energy = p.tissue[tissue_index(cut.tissue)].specific_energy * r.removal_rate * time;
  r.energy_ratio = session.totals().torque_work / energy;
  return r;
}

// The load above which the bur stalls, N; infinite without a stall torque.
double stall_load(const LayeredTooth& tooth, Cut cut, const Parameters& parameters) {
  if (!std::isfinite(parameters_for(cut, parameters).handpiece.stall_torque))
    return std::numeric_limits<double>::infinity();
  double low = 0, high = 64;
  for (int i = 0; i < 14; ++i) {
    cut.load = (low + high) / 2;
    (simulate_in(tooth, cut, parameters).stalled ? high : low) = cut.load;
  }
  return low;
}

// Over loads up to the stall: the speed at the greatest power, of the free one.
double peak_power_speed(Cut cut, const Parameters& parameters) {
  const LayeredTooth tooth = block_for(cut);  // whatever the load
  const double most = stall_load(tooth, cut, parameters);
  double power = 0, speed = 0;
  for (int i = 1; i < kPowerPoints; ++i) {
    cut.load = most * i / kPowerPoints;
    const CutResult r = simulate_in(tooth, cut, parameters);
    if (r.stalled || r.torque * r.rotation_rate <= power) continue;
    power = r.torque * r.rotation_rate;
    speed = r.rotation_rate / r.free_rate;
  }
  return speed;
}

double value_of(Quantity quantity, const Cut& cut, const CutResult& r) {
  switch (quantity) {
    case Quantity::kRemovalRate:
      return r.removal_rate;
    case Quantity::kMassRate:
      return r.removal_rate * cut.density;
    case Quantity::kCutTime:
      return cut.way / r.feed;
    case Quantity::kFeed:
      return r.feed;
    case Quantity::kForcePerFeed:
      return r.force_along / r.feed;
    case Quantity::kTangentialForce:
      return r.tangential;
    case Quantity::kNormalForce:
      return r.normal;
    case Quantity::kForceRatio:
      return r.tangential / r.normal;
    case Quantity::kSpeedLoss:
      return 100 * (1 - r.rotation_rate / r.free_rate);
    case Quantity::kSpecificEnergy:
      return units::to_joule_per_mm3(2 * units::kPi * r.rotation_rate * r.torque / r.removal_rate);
    default:
      return std::nan("");
  }
}

}  // namespace

Parameters parameters_for(const Cut& cut, const Parameters& parameters) {
  Parameters p = parameters;
  if (cut.electric_rate > 0 && p.handpiece.model == HandpieceModel::kDroop) {
    p.handpiece.model = HandpieceModel::kFixed;
    p.handpiece.rotation_rate = cut.electric_rate;
    p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  }
  p.handpiece.rotation_rate *= cut.rate_factor;
  p.handpiece.stall_torque *= cut.torque_factor;
  p.load.rail = {0, -1, 0};
  p.engine = EngineKind::kLevelset;
  return p;
}

CutResult simulate_cut(const Cut& cut, const Parameters& parameters) {
  return simulate_in(block_for(cut), cut, parameters);
}

CutResult KnownCuts::simulate(const Cut& cut, const Parameters& parameters) {
  const std::string key =
      fmt::format("{} {} {} {} {} {} {} {} {}", static_cast<int>(cut.geometry),
                  static_cast<int>(cut.tissue), cut.climb, cut.diameter, cut.length, cut.depth,
                  cut.load, cut.feed, to_toml(parameters_for(cut, parameters)));
  {
    const std::lock_guard lock(mutex_);
    const auto known = results_.find(key);
    if (known != results_.end()) return known->second;
  }
  const CutResult result = simulate_cut(cut, parameters);
  const std::lock_guard lock(mutex_);
  return results_.emplace(key, result).first->second;
}

Prediction predict(const CuttingTest& test, const std::vector<Cut>& cuts,
                   const Parameters& parameters, KnownCuts& known) {
  Prediction predicted;
  const auto take = [&](double value) {
    if (value > 0) predicted.values.push_back(value);
  };
  const auto simulate = [&](const Cut& cut) {
    const CutResult result = known.simulate(cut, parameters);
    predicted.stalled = predicted.stalled || result.stalled;
    return result;
  };
  if (test.quantity == Quantity::kLoadGain) {
    const double first = simulate(cuts.front()).removal_rate;
    if (first > 0) take(simulate(cuts.back()).removal_rate / first);
    return predicted;
  }
  for (const Cut& cut : cuts) {
    const bool droops = parameters_for(cut, parameters).handpiece.model == HandpieceModel::kDroop;
    if (test.quantity == Quantity::kStallLoad) {
      take(stall_load(block_for(cut), cut, parameters));
    } else if (test.quantity == Quantity::kPeakPowerSpeed) {
      if (droops) take(peak_power_speed(cut, parameters));
    } else if (test.quantity != Quantity::kSpeedLoss || droops) {
      const CutResult result = simulate(cut);
      if (!result.stalled) take(value_of(test.quantity, cut, result));
    }
  }
  return predicted;
}

}  // namespace toothprep::figures
