#include "toothprep/step/session/split_step.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kLongWay = 0.5;     // voxels in a step, from which it goes in parts
constexpr double kPartOfWay = 0.33;  // voxels
constexpr double kMostParts = 64;
constexpr double kShareOfStep = 0.3;          // of the time step, for all parts together; removal
                                              // has a bound of its own (removal.cpp)
constexpr double kSecondsPerElement = 60e-9;  // of a part, at most (bench_step)

// Running mean, exact for a constant.
template <typename T>
void include(T& mean, const T& value, int count) noexcept {
  mean += (value - mean) / count;
}

}  // namespace

int wanted_parts(double way) noexcept {
  if (!(way > kLongWay)) return 1;
  return static_cast<int>(std::min(std::ceil(way / kPartOfWay), kMostParts));
}

int most_parts(std::size_t elements, double time_step) noexcept {
  const double cost = kSecondsPerElement * static_cast<double>(std::max<std::size_t>(elements, 1));
  return static_cast<int>(std::clamp(kShareOfStep * time_step / cost, 2.0, kMostParts));
}

double least_live_size(double size, std::size_t elements, double time_step) noexcept {
  // Elements go with the inverse square of their size.
  return size *
         std::sqrt(kSecondsPerElement * static_cast<double>(elements) / (kShareOfStep * time_step));
}

HandleSample handle_between(const HandleSample& from, const HandleSample& to, int part,
                            int parts) noexcept {
  if (part == parts) return to;
  const double t = static_cast<double>(part) / parts;
  HandleSample s = to;
  s.time = from.time + t * (to.time - from.time);
  s.pose.position = from.pose.position + t * (to.pose.position - from.pose.position);
  s.pose.orientation = from.pose.orientation.slerp(t, to.pose.orientation);
  return s;
}

void SplitStepRow::add(const StepRecord& part) noexcept {
  const StepRecord before = sum_;
  sum_ = part;
  if (++parts_ == 1) return;
  sum_.grinding_force = before.grinding_force;
  sum_.torque = before.torque;
  sum_.power = before.power;
  sum_.stalled_fraction = before.stalled_fraction;
  sum_.contact_area = before.contact_area;
  include(sum_.grinding_force, part.grinding_force, parts_);
  include(sum_.torque, part.torque, parts_);
  include(sum_.power, part.power, parts_);
  include(sum_.stalled_fraction, part.stalled_fraction, parts_);
  for (int k = 0; k < kTissueCount; ++k)
    include(sum_.contact_area[k], part.contact_area[k], parts_);
  sum_.torque_trial = std::max(before.torque_trial, part.torque_trial);
  sum_.stalled = before.stalled || part.stalled;
}

StepRecord SplitStepRow::row(const Vec3& start, double time_step) const noexcept {
  StepRecord row = sum_;
  if (parts_ == 1) return row;
  row.bur_velocity = (row.bur.position - start) / time_step;
  if (row.torque > 0) row.rotation_rate = row.power / (2 * units::kPi * row.torque);
  return row;
}

}  // namespace toothprep
