// A Phantom Desktop and the hand that holds it, simulated one servo tick at a time. It stands
// behind closed-loop experiments (as fast as it computes, the same bits every time) and behind a
// live mode without hardware.
//
// Per axis (x, y, z alike and independent of each other), between two ticks:
//
//   (m + m_h) x'' = F - b x' - f(x') + k_h (p - x) + b_h (p' - x')
//   f = f_c sign(x') while it moves; at rest, whatever balances the rest up to f_c (stick)
//   encoder = D floor(x/D + 1/2)      so it is off by half a count at most
//
//   symbol    here                       unit      value             status
//   m         apparent_mass              N·s²/mm   45 g              data sheet (a)
//   b         damping                    N·s/mm    0.05 N·s/m        assumed
//   f_c       friction                   N         0.06 N            data sheet (a), backdrive
//   D         encoder_count              mm        0.023 mm          data sheet (a), 1100 dpi
//   |F| <=    force_limit                N         7.9 N             CHAI3D's table of devices
//   1/T       rate                       Hz        1000              the driver's usual rate
//   -         delay_ticks                1         0                 assumed
//   m_h       mass (of the hand)         N·s²/mm   20 g              assumed
//   k_h       stiffness (of the hand)    N/mm      300 N/m           assumed (a light grip)
//   b_h       damping (of the hand)      N·s/mm    2 N·s/m           assumed
//   p         intended position          mm        given each tick, linear in between
//   F         commanded force            N         held for a tick (zero-order hold)
//
//   (a) as usually quoted for this device; the sheet itself wasn't available for checking.
//
// Solved by the implicit midpoint rule in `sub_steps` parts of a tick, split where the velocity
// reaches zero. It is of second order, and by construction the energy
// (m + m_h) x'^2/2 + k_h (p - x)^2/2 changes only by the work of F, of p', of damping and of
// friction: a device left alone cannot gain energy at any step size.
//
// Where it stops being valid: the mass and friction of the real arm vary over the workspace and
// couple the axes; friction acts here on each axis by itself, so that its norm may reach sqrt(3)
// f_c; static and sliding friction are equal; the structure is rigid and the amplifiers are
// instantaneous; gravity is taken as compensated; the workspace has no end.
#pragma once

#include <array>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

constexpr int kLargestDelayTicks = 15;

struct PhantomModel {
  double apparent_mass = units::from_gram(45);  // N·s²/mm, > 0
  double damping = 0.05e-3;                     // N·s/mm, >= 0
  double friction = 0.06;                       // N, >= 0
  double encoder_count = 0.023;                 // mm, >= 0; 0 = exact position
  double force_limit = 7.9;                     // N, > 0
  double rate = 1000;                           // Hz, > 0
  int delay_ticks = 0;  // 0 to kLargestDelayTicks: from command to motor, whole ticks
  int sub_steps = 50;   // per tick, 1 to 10000

  double time_step() const { return 1 / rate; }  // T, s
};

struct HandModel {
  double mass = units::from_gram(20);  // N·s²/mm, >= 0, moves with the handle
  double stiffness = 0.3;              // N/mm, >= 0
  double damping = 2e-3;               // N·s/mm, >= 0
};

// Throw Error that names the first violated condition.
void validate(const PhantomModel& model);
void validate(const HandModel& hand);

class SimulatedPhantom {
 public:
  // At rest at `start` (mm), which is also where the hand intends to be. Throws Error as validate()
  // does, and if `start` is not finite.
  SimulatedPhantom(const PhantomModel& model, const HandModel& hand, const Vec3& start);

  // One tick of 1/rate: the motors hold `commanded_force` (N, on the handle; of delay_ticks ago
  // with a delay) while the intended position moves to `intended_end` (mm). A force above the limit
  // keeps its direction. What isn't finite is not obeyed: the force counts as zero, the intended
  // position stays. Allocates nothing.
  void tick(const Vec3& commanded_force, const Vec3& intended_end) noexcept;

  Vec3 encoder_position() const noexcept;                               // mm, whole counts
  const Vec3& true_position() const noexcept { return position_; }      // mm
  const Vec3& true_velocity() const noexcept { return velocity_; }      // mm/s
  const Vec3& intended_position() const noexcept { return intended_; }  // mm
  const Vec3& motor_force() const noexcept { return motor_force_; }     // N, during the last tick
  long ticks() const noexcept { return ticks_; }
  long clamped_ticks() const noexcept { return clamped_ticks_; }      // commands above the limit
  long rejected_inputs() const noexcept { return rejected_inputs_; }  // not finite

  const PhantomModel& model() const noexcept { return model_; }
  const HandModel& hand() const noexcept { return hand_; }

 private:
  void advance_axis(int axis, double intended_speed) noexcept;

  PhantomModel model_;
  HandModel hand_;

  // State.
  Vec3 position_, velocity_ = Vec3::Zero(), intended_, motor_force_ = Vec3::Zero();
  std::array<Vec3, kLargestDelayTicks + 1> on_the_way_;  // commands, a ring
  long ticks_ = 0, clamped_ticks_ = 0, rejected_inputs_ = 0;
};

}  // namespace toothprep
