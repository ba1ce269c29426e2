#include "toothprep/proof/reference/closed_forms.h"

#include <algorithm>
#include <boost/math/quadrature/tanh_sinh.hpp>
#include <cmath>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using units::kPi;

void require_positive(double value, const char* name) {
  if (!(value > 0) || !std::isfinite(value))
    throw Error(std::string("closed form: ") + name + " must be positive and finite");
}
void require_not_negative(double value, const char* name) {
  if (!(value >= 0) || !std::isfinite(value))
    throw Error(std::string("closed form: ") + name + " must be finite and not negative");
}
void check(const Grinding& g) {
  require_not_negative(g.specific_energy, "the specific energy");
  require_positive(g.force_ratio, "the force ratio");
  require_positive(g.rotation_rate, "the rotation rate");
}

}  // namespace

SteadyLoad cylinder_side_feed(const Grinding& g, double radius, double length, double speed) {
  check(g);
  require_positive(radius, "the radius");
  require_not_negative(length, "the length");
  require_not_negative(speed, "the speed");
  const double per_length = g.specific_energy * speed * length / g.rotation_rate;
  return {per_length / (4 * g.force_ratio), per_length / 4, per_length * radius / kPi};
}

SteadyLoad ball_side_feed(const Grinding& g, double radius, double speed) {
  check(g);
  require_positive(radius, "the radius");
  require_not_negative(speed, "the speed");
  const double uvr = g.specific_energy * speed * radius / g.rotation_rate;
  return {kPi * uvr / (8 * g.force_ratio), uvr / 2, uvr * radius / 2};
}

SteadyLoad flat_end_plunge(const Grinding& g, double radius, double speed) {
  check(g);
  require_positive(radius, "the radius");
  require_not_negative(speed, "the speed");
  const double uvr = g.specific_energy * speed * radius / g.rotation_rate;
  return {uvr / g.force_ratio, 0, uvr * radius / 2};
}

SteadyLoad cylinder_by_law(const GrindingProperties& law, double rotation_rate, double radius,
                           double length, double speed, double from, double to) {
  check({law.specific_energy, law.force_ratio, rotation_rate});
  require_positive(radius, "the radius");
  require_not_negative(length, "the length");
  require_positive(speed, "the speed");
  require_positive(to - from, "the engaged angle");
  if (from < -kPi / 2 || to > kPi / 2)
    throw Error("closed form: only the front of a bur, a quarter turn either way, grinds");
  const double h0 = law.reference_chip > 0 ? law.reference_chip : 1;
  struct PerLength {
    double tangential, normal;
  };
  const auto force = [&](double phi) -> PerLength {
    const double h = speed * std::cos(phi) / rotation_rate, x = std::max(h / h0, 1e-3);
    const double cut = law.specific_energy / (2 * kPi) * (1 + law.up_cutting * std::sin(phi)) * h *
                       std::pow(x, -law.size_exponent);
    const double rub = law.rubbing_pressure * radius * h / (h + h0 / 100);
    return {cut + law.rubbing_friction * rub,
            cut / (law.force_ratio * std::pow(x, law.ratio_exponent)) + rub};
  };
  const auto integral = [&](const auto& f) {
    return length * boost::math::quadrature::tanh_sinh<double>().integrate(f, from, to);
  };
  const double against = integral([&](double phi) {
    const PerLength f = force(phi);
    return f.normal * std::cos(phi) + f.tangential * std::sin(phi);
  });
  const double across = integral([&](double phi) {
    const PerLength f = force(phi);
    return f.tangential * std::cos(phi) - f.normal * std::sin(phi);
  });
  return {against, across, radius * integral([&](double phi) { return force(phi).tangential; })};
}

double cylinder_stall_speed(const Grinding& g, double radius, double length, double stall_torque) {
  check(g);
  require_positive(g.specific_energy, "the specific energy");
  require_positive(radius, "the radius");
  require_positive(length, "the length");
  require_positive(stall_torque, "the stall torque");
  return stall_torque * kPi * g.rotation_rate / (g.specific_energy * radius * length);
}

SteadyLoad cylinder_at_stall(double force_ratio, double radius, double stall_torque) {
  require_positive(force_ratio, "the force ratio");
  require_positive(radius, "the radius");
  require_positive(stall_torque, "the stall torque");
  const double across = stall_torque * kPi / (4 * radius);
  return {across / force_ratio, across, stall_torque};
}

double droop_greatest_power(double idle_rate, double stall_torque) {
  require_positive(idle_rate, "the idle rotation rate");
  require_positive(stall_torque, "the stall torque");
  return kPi * idle_rate * stall_torque / 2;
}

std::optional<OperatingPoint> droop_imposed_feed(double idle_rate, double stall_torque,
                                                 double removal_power) {
  const double greatest = droop_greatest_power(idle_rate, stall_torque);
  require_not_negative(removal_power, "the removal power");
  if (removal_power > greatest) return std::nullopt;
  // tau/2 (1 - sqrt(1 - x)) without the cancellation at small x.
  const double x = removal_power / greatest;
  const double torque = stall_torque / 2 * x / (1 + std::sqrt(1 - x));
  return OperatingPoint{torque, idle_rate * (1 - torque / stall_torque)};
}

std::optional<OperatingPoint> droop_imposed_torque(double idle_rate, double stall_torque,
                                                   double torque) {
  require_positive(idle_rate, "the idle rotation rate");
  require_positive(stall_torque, "the stall torque");
  require_not_negative(torque, "the torque");
  if (torque >= stall_torque) return std::nullopt;
  return OperatingPoint{torque, idle_rate * (1 - torque / stall_torque)};
}

std::optional<FeedUnderForce> droop_cylinder_under_force(const Grinding& g, double stall_torque,
                                                         double radius, double length,
                                                         double against) {
  check(g);
  require_positive(g.specific_energy, "the specific energy");
  require_positive(radius, "the radius");
  require_positive(length, "the length");
  require_not_negative(against, "the force");
  const auto point = droop_imposed_torque(g.rotation_rate, stall_torque,
                                          4 * g.force_ratio * radius / kPi * against);
  if (!point) return std::nullopt;
  return FeedUnderForce{
      *point, 4 * g.force_ratio * point->rotation_rate * against / (g.specific_energy * length)};
}

}  // namespace toothprep::reference
