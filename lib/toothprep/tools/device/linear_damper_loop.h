// The reference experiment of stability: a hand pulls the simulated device at constant speed
// through a linear resistance F = -B v, which is what grinding looks like from the bur.
//
//   direct    F = -B (e_n - e_n-1)/T, e the encoder readings: each count is a pulse of B D/T
//   coupled   a bur of mass m on a spring k to e_n, resisted by B, one backward Euler step per tick
//             (step/session/implicit_step.h); the operator feels the spring
//
// With the handle moved at constant v from rest, the coupled force is F(t) = B v (1 - exp(-k t/B))
// once the bur's inertia (m/B) has died away; with the hand's own spring k_h between the intended
// path and the handle, k counts as k k_h/(k + k_h).
#pragma once

#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/device/closed_loop.h"

namespace toothprep {

enum class Rendering { kDirect, kCoupled };

// The rendering itself, as run_closed_loop() takes it. Isotropic: the same B along all axes.
class LinearDamper {
 public:
  // damping: B, N·s/mm, >= 0; `start` the first encoder reading, mm. Throws Error if a value makes
  // no sense. The coupling is unused in direct rendering.
  LinearDamper(Rendering rendering, double damping, double time_step, const Coupling& coupling,
               const Vec3& start);

  Vec3 operator()(std::size_t tick, const Vec3& encoder_position) noexcept;  // N, on the handle

  const Vec3& bur_position() const noexcept { return bur_; }  // mm; the reading when direct

 private:
  Rendering rendering_;
  double damping_, time_step_;
  Coupling coupling_;
  Vec3 reading_, bur_, bur_velocity_ = Vec3::Zero();
};

struct LinearDamperExperiment {
  PhantomModel phantom;
  HandModel hand;
  Rendering rendering = Rendering::kDirect;
  double damping = 5e-3;      // B, N·s/mm
  Coupling coupling;          // k, b and the bur's mass, when coupled
  double speed = 0.5;         // mm/s, > 0, along +x
  double duration = 2.0;      // s
  double settling = 0.5;      // s, left out of the figures
  Vec3 start = Vec3::Zero();  // mm: the phase within a count
};

struct LinearDamperResult {
  ClosedLoopSeries series;
  ClosedLoopFigures figures;
};

// Throws Error for parameters that make no sense.
LinearDamperResult run_linear_damper(const LinearDamperExperiment& experiment);

}  // namespace toothprep
