#include "toothprep/proof/reference/step_limits.h"

#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep::reference {

StableRange explicit_euler_range(double mass, double stiffness, double time_step) {
  return {stiffness * time_step, 2 * mass / time_step + stiffness * time_step / 2};
}

StableRange semi_implicit_euler_range(double mass, double stiffness, double time_step) {
  return {0, 2 * mass / time_step - stiffness * time_step / 2};
}

double filtered_rendering_limit(double mass, double time_step) { return 2 * mass / time_step; }

double filter_delay(double cutoff, double time_step) {
  return time_step / -std::expm1(-2 * units::kPi * cutoff * time_step);
}

}  // namespace toothprep::reference
