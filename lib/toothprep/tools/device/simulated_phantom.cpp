#include "toothprep/tools/device/simulated_phantom.h"

#include <fmt/format.h>

#include <cmath>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

void require(bool condition, const std::string& name, const std::string& what, double value) {
  if (!condition) throw Error(fmt::format("{}: must be {}, not {:g}", name, what, value));
}

void require_positive(const std::string& name, double value) {
  require(std::isfinite(value) && value > 0, name, "a finite number above 0", value);
}

void require_not_negative(const std::string& name, double value) {
  require(std::isfinite(value) && value >= 0, name, "a finite number, 0 or above", value);
}

}  // namespace

void validate(const PhantomModel& m) {
  require_positive("phantom.apparent_mass (N·s²/mm)", m.apparent_mass);
  require_not_negative("phantom.damping (N·s/mm)", m.damping);
  require_not_negative("phantom.friction (N)", m.friction);
  require_not_negative("phantom.encoder_count (mm)", m.encoder_count);
  require_positive("phantom.force_limit (N)", m.force_limit);
  require_positive("phantom.rate (Hz)", m.rate);
  require(m.delay_ticks >= 0 && m.delay_ticks <= kLargestDelayTicks, "phantom.delay_ticks",
          "from 0 to " + std::to_string(kLargestDelayTicks), m.delay_ticks);
  require(m.sub_steps >= 1 && m.sub_steps <= 10000, "phantom.sub_steps", "from 1 to 10000",
          m.sub_steps);
}

void validate(const HandModel& h) {
  require_not_negative("hand.mass (N·s²/mm)", h.mass);
  require_not_negative("hand.stiffness (N/mm)", h.stiffness);
  require_not_negative("hand.damping (N·s/mm)", h.damping);
}

SimulatedPhantom::SimulatedPhantom(const PhantomModel& model, const HandModel& hand,
                                   const Vec3& start)
    : model_(model), hand_(hand), position_(start), intended_(start) {
  validate(model);
  validate(hand);
  if (!start.allFinite()) throw Error("phantom: the start position (mm) must be finite");
  on_the_way_.fill(Vec3::Zero());
}

Vec3 SimulatedPhantom::encoder_position() const noexcept {
  const double count = model_.encoder_count;
  if (count == 0) return position_;
  return position_.unaryExpr([count](double x) { return count * std::floor(x / count + 0.5); });
}

void SimulatedPhantom::tick(const Vec3& commanded_force, const Vec3& intended_end) noexcept {
  Vec3 force = commanded_force;
  if (!force.allFinite()) {
    force.setZero();
    ++rejected_inputs_;
  }
  const double norm = force.stableNorm();
  if (norm > model_.force_limit) {
    force *= model_.force_limit / norm;
    ++clamped_ticks_;
  }
  constexpr long kRing = kLargestDelayTicks + 1;
  on_the_way_[(ticks_ + model_.delay_ticks) % kRing] = force;
  motor_force_ = on_the_way_[ticks_ % kRing];

  Vec3 end = intended_end;
  if (!end.allFinite()) {
    end = intended_;
    ++rejected_inputs_;
  }
  for (int axis = 0; axis < 3; ++axis)
    advance_axis(axis, (end[axis] - intended_[axis]) * model_.rate);
  intended_ = end;
  ++ticks_;
}

// Over a time h the midpoint rule reads, with means x + h (v + v')/4 and p + p' h/2 of the
// positions and (v + v')/2 of the velocity, and s = sign of the motion,
//
//   M (v' - v)/h = F - s f_c + k_h (p + p' h/2 - x - h (v + v')/4) + b_h p' - (b + b_h) (v + v')/2
//
// If v' came out with the other sign, the handle stops at the time h where v' = 0, the root of a
// quadratic; from there it sticks, or goes back if what pushes it exceeds the friction.
void SimulatedPhantom::advance_axis(int axis, double intended_speed) noexcept {
  const double mass = model_.apparent_mass + hand_.mass, friction = model_.friction;
  const double damping = model_.damping + hand_.damping, stiffness = hand_.stiffness;
  const double step = model_.time_step() / model_.sub_steps;
  const double push = motor_force_[axis] + hand_.damping * intended_speed;
  const double before = mass / step - damping / 2 - stiffness * step / 4;
  const double after = mass / step + damping / 2 + stiffness * step / 4;

  double x = position_[axis], v = velocity_[axis];
  for (int i = 0; i < model_.sub_steps; ++i) {
    double p = intended_[axis] + intended_speed * (i * step);
    double h = step;
    if (v != 0) {
      const double sign = v > 0 ? 1 : -1;
      const double force = push - sign * friction + stiffness * (p - x);
      const double v_end = (before * v + force + stiffness * intended_speed * step / 2) / after;
      if (v_end * sign >= 0 || friction == 0) {
        x += step * (v + v_end) / 2;
        v = v_end;
        continue;
      }
      // a h² + b h + c = 0 with c > 0, negative at h = step: exactly one root in between.
      const double a = sign * stiffness * (intended_speed / 2 - v / 4);
      const double b = sign * (force - damping * v / 2);
      const double c = sign * mass * v;
      const double until_stop = 2 * c / (std::sqrt(b * b - 4 * a * c) - b);
      x += until_stop * v / 2;
      v = 0;
      p += intended_speed * until_stop;
      h = step - until_stop;
      if (!(h > 0)) continue;  // by rounding
    }
    const double force = push + stiffness * (p + intended_speed * h / 2 - x);
    if (std::abs(force) <= friction) {  // sticks
      if (intended_speed == 0) break;   // and does so under the same force
      continue;
    }
    v = (force - std::copysign(friction, force)) / (mass / h + damping / 2 + stiffness * h / 4);
    x += h * v / 2;
  }
  position_[axis] = x;
  velocity_[axis] = v;
}

}  // namespace toothprep
