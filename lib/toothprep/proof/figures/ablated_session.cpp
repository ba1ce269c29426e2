#include "toothprep/proof/figures/ablated_session.h"

#include <cmath>

#include "toothprep/proof/figures/equal_area_engine.h"
#include "toothprep/proof/figures/one_layer_engine.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/stages.h"

namespace toothprep::figures {
namespace {

constexpr double kLost = 50;  // mm behind the handle: diverged

}  // namespace

Vec3 explicit_velocity(const Coupling& c, double h, const CouplingState& s, const Mat3& resistance,
                       const Vec3& f0) noexcept {
  return s.velocity + h / c.bur_mass * (coupling_force(c, s) + resistance * s.velocity + f0);
}

AblatedSession::AblatedSession(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                               Drive drive, const Ablation& ablation, const HandleSample& first)
    : model_{parameters, drive, {}, {}}, ablation_(ablation) {
  if (ablation.equal_area > 0)
    engine_ = std::make_unique<EqualAreaEngine>(bur, workpiece, parameters, first.pose,
                                                ablation.equal_area);
  else if (ablation.layers == Layers::kTwo)
    engine_ = make_engine(bur, workpiece, parameters, first.pose);
  else
    engine_ =
        std::make_unique<OneLayerEngine>(bur, workpiece, parameters, first.pose, ablation.layers);
  engine_->clear(first.pose);
  state_.pose = first.pose;
  state_.handle = first;
}

// Force and torque are those at the velocity v of the step's start, v+ the trial's velocity.
void AblatedSession::explicit_trial(StepPart& part) noexcept {
  const double rate = model_.parameters.handpiece.rotation_rate;
  const Vec3& v = part.coupling.velocity;
  Trial& trial = part.trial;
  trial.rotation_rate = rate;
  if (part.moves) trial.response = engine_->contact().response(v, part.omega, rate);
  trial.torque = (trial.response.b.dot(v) + trial.response.t0) / rate;
  trial.velocity = explicit_velocity(model_.parameters.coupling, part.h, part.coupling,
                                     trial.response.B / rate, trial.response.f0 / rate);
}

StepRecord AblatedSession::step(const HandleSample& next) noexcept {
  if (diverged_) {
    StepRecord row;
    row.handle = next;
    row.bur = state_.pose;
    return row;
  }
  const double h = model_.parameters.time_step;
  StepPart part = sense(model_, state_, next, h);
  if (ablation_.filter_hz > 0 && model_.drive == Drive::kDirect) {
    const double share = -std::expm1(-2 * units::kPi * ablation_.filter_hz * h);
    filtered_ += share * (part.handle_velocity - filtered_);
    part.handle_velocity = filtered_;
    part.guess = part.before.orientation.conjugate() * filtered_;
    part.moves = part.guess.squaredNorm() > 0;
  }
  const bool from_start =
      ablation_.integrator != Integrator::kBackward && model_.drive == Drive::kCoupled;
  const Vec3 v = state_.velocity;
  // With one layer what was found in contact goes, so it is looked for where it is removed: in
  // direct drive at the step's end, which is known.
  const bool one_layer = ablation_.layers != Layers::kTwo;
  StepPart sampled = part;
  if (one_layer && model_.drive == Drive::kDirect) sampled.before.position = next.pose.position;
  find_contact(model_, *engine_, sampled);
  if (from_start)
    explicit_trial(part);
  else
    find_trial(model_, *engine_, part);
  integrate(model_, part, state_);
  if (from_start && ablation_.integrator == Integrator::kExplicit)
    state_.pose.position = part.before.position + h * v;
  const double lag = (state_.pose.position - next.pose.position).norm();
  diverged_ = !(lag < kLost) || !state_.velocity.allFinite();
  if (diverged_) state_.pose = part.before;
  if (!diverged_) {
    BurState at = state_;
    if (one_layer) at.pose = sampled.before;
    remove_tissue(model_, part, at, *engine_);
  }
  if (from_start) part.trial.velocity = part.coupling.velocity;
  StepRecord row = record(model_, part, state_, *engine_);
  engine_->carve();
  row.removed_volume = engine_->removed();
  torque_work_ += row.power * h;
  return row;
}

}  // namespace toothprep::figures
