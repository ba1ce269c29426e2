#include "toothprep/tools/device/stability_map.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

double linear_damping_limit(double mass, double time_step, int delay_ticks) {
  return 2 * mass / time_step * std::tan(units::kPi / (4.0 * (delay_ticks + 1)));
}

double quantisation_damping_limit(double mass, double speed, double encoder_count) {
  return mass * speed / encoder_count;
}

double friction_damping_limit(double friction, double time_step, double encoder_count) {
  return 2 * friction * time_step / encoder_count;
}

double coupling_stiffness_limit(double damping, double time_step) {
  return 2 * damping / time_step;
}

double friction_stiffness_limit(double friction, double encoder_count) {
  return 2 * friction / encoder_count;
}

StabilityMap stability_map(const LinearDamperExperiment& base, const std::vector<double>& dampings,
                           MapAxis axis, const std::vector<double>& others) {
  if (dampings.empty() || others.empty()) throw Error("stability map: an axis has no values");
  if (axis == MapAxis::kCouplingStiffness && base.rendering == Rendering::kDirect)
    throw Error("stability map: direct rendering has no coupling stiffness to vary");
  StabilityMap map{dampings, axis, others, {}};
  map.figures.resize(dampings.size() * others.size());
  tbb::parallel_for(std::size_t{0}, map.figures.size(), [&](std::size_t cell) {
    LinearDamperExperiment e = base;
    e.damping = dampings[cell % dampings.size()];
    const double other = others[cell / dampings.size()];
    (axis == MapAxis::kApparentMass ? e.phantom.apparent_mass : e.coupling.stiffness) = other;
    map.figures[cell] = run_linear_damper(e).figures;
  });
  return map;
}

}  // namespace toothprep
