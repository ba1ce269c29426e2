#include "toothprep/tools/device/linear_damper_loop.h"

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/session/implicit_step.h"

namespace toothprep {
namespace {

bool positive(double x) { return std::isfinite(x) && x > 0; }

constexpr double kLongest = 3600;  // s: bounds the memory of a series

}  // namespace

LinearDamper::LinearDamper(Rendering rendering, double damping, double time_step,
                           const Coupling& coupling, const Vec3& start)
    : rendering_(rendering),
      damping_(damping),
      time_step_(time_step),
      coupling_(coupling),
      reading_(start),
      bur_(start) {
  if (!(std::isfinite(damping) && damping >= 0))
    throw Error("linear damper: B (N·s/mm) must be finite and not below 0");
  if (!positive(time_step)) throw Error("linear damper: the time step (s) must be above 0");
  if (!start.allFinite()) throw Error("linear damper: the first reading (mm) must be finite");
  if (rendering == Rendering::kDirect) return;
  if (!positive(coupling.stiffness))
    throw Error("linear damper: the coupling's stiffness (N/mm) must be above 0");
  if (!positive(coupling.bur_mass))
    throw Error("linear damper: the bur's mass (N·s²/mm) must be above 0");
  if (!(std::isfinite(coupling.damping) && coupling.damping >= 0))
    throw Error("linear damper: the coupling's damping (N·s/mm) must not be below 0");
}

Vec3 LinearDamper::operator()(std::size_t, const Vec3& encoder_position) noexcept {
  const Vec3 speed = (encoder_position - reading_) / time_step_;
  reading_ = encoder_position;
  if (rendering_ == Rendering::kDirect) {
    bur_ = reading_;
    return -damping_ * speed;
  }
  CouplingState state{bur_, bur_velocity_, reading_, speed};
  bur_velocity_ =
      implicit_velocity(coupling_, time_step_, state, -damping_ * Mat3::Identity(), Vec3::Zero());
  bur_ += time_step_ * bur_velocity_;
  state.position = bur_;
  state.velocity = bur_velocity_;
  return -coupling_force(coupling_, state);
}

LinearDamperResult run_linear_damper(const LinearDamperExperiment& e) {
  if (!positive(e.speed)) throw Error("linear damper: the speed (mm/s) must be above 0");
  if (!(positive(e.duration) && e.duration <= kLongest))
    throw Error("linear damper: the duration (s) must be above 0 and at most an hour");
  if (!(e.settling >= 0 && e.settling < e.duration))
    throw Error("linear damper: the settling time (s) must lie within the duration");
  SimulatedPhantom phantom(e.phantom, e.hand, e.start);
  LinearDamper render(e.rendering, e.damping, e.phantom.time_step(), e.coupling,
                      phantom.encoder_position());

  const auto ticks = static_cast<std::size_t>(std::llround(e.duration * e.phantom.rate));
  std::vector<Vec3> path(ticks + 1);
  for (std::size_t n = 0; n <= ticks; ++n)
    path[n] = e.start + Vec3(e.speed * static_cast<double>(n) / e.phantom.rate, 0, 0);

  LinearDamperResult result;
  result.series = run_closed_loop(phantom, path, render);
  result.figures = closed_loop_figures(result.series, e.phantom, Vec3::UnitX(), e.settling);
  return result;
}

}  // namespace toothprep
