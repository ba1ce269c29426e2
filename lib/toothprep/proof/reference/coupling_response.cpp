#include "toothprep/proof/reference/coupling_response.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using Complex = std::complex<double>;

constexpr double kConfluent = 1e-7;  // roots closer than this, of their size, count as one

// x(t) = c_1 e^(s_1 t) + c_2 e^(s_2 t), or with z^n for e^(s t).
struct Modes {
  Complex first, second;
};

Modes roots(double trace, double determinant) {
  const Complex half = trace / 2, root = std::sqrt(half * half - determinant);
  return {half + root, half - root};
}

Modes modes_of(const BurOnCoupling& c) {
  if (c.time_step == 0) return roots(-c.damping / c.mass, c.stiffness / c.mass);
  const double h = c.time_step, whole = c.mass + h * c.damping + h * h * c.stiffness;
  return roots(1 + (c.mass - h * h * c.stiffness) / whole, c.mass / whole);
}

double released_steps(const BurOnCoupling& c, const Modes& z, double n) {
  const double h = c.time_step;
  const double next = 1 - h * h * c.stiffness / (c.mass + h * c.damping + h * h * c.stiffness);
  if (std::abs(z.first - z.second) < kConfluent * std::abs(z.first)) {
    const double both = z.first.real();
    return std::pow(both, n) * (1 + n * (next / both - 1));
  }
  const Complex share = (next - z.second) / (z.first - z.second);
  return (share * std::pow(z.first, n) + (1.0 - share) * std::pow(z.second, n)).real();
}

double released_exactly(const Modes& s, double time) {
  if (std::abs(s.first - s.second) < kConfluent * std::abs(s.first)) {
    const double both = s.first.real();
    return std::exp(both * time) * (1 - both * time);
  }
  const Complex share = s.second / (s.second - s.first);
  return (share * std::exp(s.first * time) + (1.0 - share) * std::exp(s.second * time)).real();
}

}  // namespace

double free_air_frequency(const BurOnCoupling& c) {
  return std::sqrt(c.stiffness / c.mass) / (2 * units::kPi);
}

double released(const BurOnCoupling& c, double time) {
  const Modes modes = modes_of(c);
  return c.time_step == 0 ? released_exactly(modes, time)
                          : released_steps(c, modes, std::round(time / c.time_step));
}

double remaining(const BurOnCoupling& c, double time) {
  const Modes modes = modes_of(c);
  const double turn = std::abs(c.time_step == 0 ? modes.first.imag() : std::arg(modes.first));
  if (c.time_step == 0) {
    // Between turning points, t = j pi/w, |x| has no maximum.
    const double next = turn > 0 ? std::ceil(time * turn / units::kPi) * units::kPi / turn : time;
    return std::max(std::abs(released_exactly(modes, time)),
                    std::abs(released_exactly(modes, next)));
  }
  // Every half turn brings less than the one before.
  const double from = std::round(time / c.time_step);
  const double steps = turn > 0 ? std::ceil(units::kPi / turn) : 1;
  double most = 0;
  for (double n = from; n <= from + steps; ++n)
    most = std::max(most, std::abs(released_steps(c, modes, n)));
  return most;
}

double least_damping(double mass, double stiffness, const std::vector<double>& time_steps,
                     double time, double share) {
  constexpr double kResolution = 1e-6;  // N·s/mm
  const double most = 6 * std::sqrt(mass * stiffness);
  for (double b = 0; b <= most; b += kResolution)
    if (std::all_of(time_steps.begin(), time_steps.end(), [&](double h) {
          return remaining({mass, stiffness, b, h}, time) <= share;
        }))
      return b;
  return std::numeric_limits<double>::quiet_NaN();
}

Complex rendered_share(const BurOnCoupling& c, double resistance, double frequency) {
  const Complex turn(0, 2 * units::kPi * frequency);
  const Complex s = c.time_step == 0 ? turn : (1.0 - std::exp(-turn * c.time_step)) / c.time_step;
  return (c.stiffness + c.damping * s) * (c.mass * s + resistance) /
         (resistance * (c.mass * s * s + (c.damping + resistance) * s + c.stiffness));
}

}  // namespace toothprep::reference
