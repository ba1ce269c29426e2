#include "toothprep/tools/live/force_governor.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kCorner = 20;   // Hz: above it lies no voluntary motion
constexpr double kWindow = 0.1;  // s
constexpr double kWarm = 0.9;    // of the continuous limit

}  // namespace

void validate(const ForceLimits& limits) {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0)) throw Error(std::string("force limits: ") + name + " must be above 0");
  };
  positive(limits.period, "period");
  positive(limits.max_force, "max_force");
  positive(limits.max_force_rate, "max_force_rate");
  positive(limits.continuous_force, "continuous_force");
  positive(limits.thermal_time, "thermal_time");
  positive(limits.vibration_limit, "vibration_limit");
  positive(limits.fade, "fade");
  if (!(limits.ramp >= 0 && limits.vibration_time >= 0))
    throw Error("force limits: ramp and vibration_time must be 0 or more");
}

ForceGovernor::ForceGovernor(const ForceLimits& limits)
    : limits_(limits),
      high_pass_(1 - std::exp(-2 * units::kPi * kCorner * limits.period)),
      window_(1 - std::exp(-limits.period / kWindow)) {
  validate(limits);
}

void ForceGovernor::restart() noexcept {
  scale_ = 0;
  last_.setZero();
  low_.setZero();
}

double ForceGovernor::vibration_rms() const noexcept { return std::sqrt(mean_square_); }

double ForceGovernor::heat() const noexcept {
  return heat_ / (limits_.continuous_force * limits_.continuous_force);
}

void ForceGovernor::watch(const Vec3& force) noexcept {
  low_ += high_pass_ * (force - low_);
  mean_square_ += window_ * ((force - low_).squaredNorm() - mean_square_);
  const double most = limits_.vibration_limit * limits_.vibration_limit;
  above_ = mean_square_ > most ? above_ + limits_.period : 0;
  vibrates_ = vibrates_ || above_ > limits_.vibration_time;
}

Vec3 ForceGovernor::limit(const Vec3& force, std::uint32_t& flags) noexcept {
  Vec3 out = force;
  if (!out.allFinite()) {
    flags |= kForceNotFinite;
    out.setZero();
  }
  const auto at_most = [&out](double most) {
    const double norm = out.norm();
    if (norm <= most) return false;
    out *= most / norm;
    return true;
  };
  if (at_most(limits_.max_force)) flags |= kForceClamped;
  const double change_of_scale = fades_ ? -limits_.period / limits_.fade
                                        : (limits_.ramp > 0 ? limits_.period / limits_.ramp : 1.0);
  scale_ = std::clamp(scale_ + change_of_scale, 0.0, 1.0);
  if (scale_ < 1) {
    out *= scale_;
    flags |= kForceRamped;
  }
  if (heat() > kWarm) {
    const double cold = std::max(0.0, (1 - heat()) / (1 - kWarm));
    const double most = limits_.continuous_force +
                        cold * std::max(0.0, limits_.max_force - limits_.continuous_force);
    if (at_most(most)) flags |= kForceHeatLimited;
  }
  watch(out);
  const Vec3 change = out - last_;
  const double most_change = limits_.max_force_rate * limits_.period;
  if (change.norm() > most_change) {
    out = last_ + change * (most_change / change.norm());
    flags |= kForceRateLimited;
  }
  if (vibrates_) {
    out.setZero();
    flags |= kForceWithheld;
  }
  send(out);
  return out;
}

Vec3 ForceGovernor::withhold(std::uint32_t& flags) noexcept {
  restart();
  flags |= kForceWithheld;
  watch(Vec3::Zero());
  send(Vec3::Zero());
  return Vec3::Zero();
}

void ForceGovernor::send(const Vec3& force) noexcept {
  last_ = force;
  heat_ += (1 - std::exp(-limits_.period / limits_.thermal_time)) * (force.squaredNorm() - heat_);
}

}  // namespace toothprep
