#include "toothprep/step/session/stages.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"
#include "toothprep/step/session/handpiece.h"
#include "toothprep/step/session/load_step.h"

namespace toothprep {
namespace {

constexpr int kMaxPasses = 8;            // fixed-point passes for the advancing set
constexpr int kMaxNonlinearPasses = 60;  // of a law that isn't linear
constexpr double kSettled = 1e-6;        // of the speed, likewise; the law is in single precision
constexpr double kStandstill = 1e-6;     // mm/s: what matters to nobody
constexpr double kExactRate = 1e-9;      // of N0, with the paper's law
constexpr double kNear = 0.2;            // of the speed: from there by the tangent
constexpr int kMostOvershoots = 3;       // of the tangent, from which on it isn't trusted
constexpr int kMaxSamples = 3;           // contact samples of one step, when the motion turns

// The bur's orientation at the end, if it turns: the handle's; after a stall that held it, it
// catches up at a limited rate.
Quat turned_towards(const BurState& state, const Quat& handle, double angle, double h) noexcept {
  const double most = kCatchUpRate * h;
  if (!state.catching_up || !(angle > most)) return handle;
  return state.pose.orientation.slerp(most / angle, handle);
}

// The constant rate that turns `from` into `to` within h, rad/s, in the frame of `from`.
Vec3 turn_rate(const Quat& from, const Quat& to, double h) noexcept {
  Quat turn = from.conjugate() * to;
  if (turn.w() < 0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  if (!(sine > 1e-12)) return Vec3::Zero();
  return turn.vec() * (2 * std::atan2(sine, turn.w()) / sine / h);
}

// Spring and bur in B, relative to the bur's tip. While stalled the trial goes on from the motion
// that it was last judged on, so that the lost momentum m v (a thousandth of the force) can't make
// the stall flicker.
CouplingState coupling_state(const StepModel& model, const BurState& state,
                             const StepPart& part) noexcept {
  const Quat to_b = part.before.orientation.conjugate();
  const bool goes_on = state.stalled && model.parameters.handpiece.stall_rule == StallRule::kTrial;
  CouplingState c;
  c.position = Vec3::Zero();
  c.velocity = to_b * (goes_on ? state.judged_velocity : state.velocity);
  c.handle_position = to_b * (part.handle.pose.position - part.before.position);
  c.handle_velocity = to_b * (part.handle.pose.position - state.handle.pose.position) / part.h;
  return c;
}

Vec3 rail_of(const StepModel& model) noexcept {
  const auto& rail = model.parameters.load.rail;
  const Vec3 along(rail[0], rail[1], rail[2]);
  return along.isZero(0) ? along : Vec3(along.stableNormalized());
}

// The velocity at the end of the part against a resistance B and a force f0, mm/s in B: what the
// drives that let the bur go differ in.
Vec3 velocity_against(const StepModel& model, const StepPart& part, const Mat3& resistance,
                      const Vec3& f0) noexcept {
  if (model.drive == Drive::kLoad)
    return load_velocity(model.parameters.load.max_speed, part.rail, part.load, resistance, f0);
  return implicit_velocity(model.parameters.coupling, part.h, part.coupling, resistance, f0);
}

// What pulls a bur at rest, N in B.
Vec3 pull(const StepModel& model, const StepPart& part) noexcept {
  if (model.drive == Drive::kCoupled)
    return coupling_force(model.parameters.coupling, part.coupling);
  return part.rail.isZero(0) ? part.load : Vec3(part.rail * part.rail.dot(part.load));
}

// Where the motion will go, mm/s in B. Direct: where the handle goes. Else on as before, or along
// the pull when at rest; with a bur that doesn't turn, as freely as in the air.
Vec3 first_guess(const StepModel& model, const StepPart& part) noexcept {
  if (model.drive == Drive::kDirect)
    return part.before.orientation.conjugate() * part.handle_velocity;
  if (!part.turns) return velocity_against(model, part, Mat3::Zero(), Vec3::Zero());
  if (part.coupling.velocity.norm() < 1e-9) return pull(model, part);
  return part.coupling.velocity;
}

// The trial's torque at N = 1 rev/s, N·mm.
double unit_torque(const Trial& trial) noexcept {
  return trial.response.b.dot(trial.velocity) + trial.response.t0;
}

// The same where the law isn't linear. By secants the error falls at least by the factor m of the
// size effect with each pass, whatever the guess; near the end tangents are quicker, unless they
// overshoot.
Trial converge_nonlinear(const StepModel& model, const ContactSet& contact, const StepPart& part,
                         Vec3 guess, double rotation_rate) noexcept {
  Trial trial;
  trial.rotation_rate = rotation_rate;
  bool tangent = false;
  int overshoots = 0;
  double last = 0;
  for (int pass = 0; pass < kMaxNonlinearPasses; ++pass) {
    trial.response = contact.response(guess, part.omega, rotation_rate,
                                      tangent ? LinearForm::kTangent : LinearForm::kSecant);
    trial.velocity = velocity_against(model, part, trial.response.B / rotation_rate,
                                      trial.response.f0 / rotation_rate);
    const double change = (trial.velocity - guess).norm();
    const double speed = std::max(trial.velocity.norm(), guess.norm());
    trial.settled = change <= std::max(kSettled * speed, kStandstill);
    if (trial.settled) break;
    const bool overshot = tangent && change > 0.5 * last;
    overshoots += overshot ? 1 : 0;
    tangent = change < kNear * speed && !overshot && overshoots < kMostOvershoots;
    last = change;
    guess = trial.velocity;
  }
  trial.torque = unit_torque(trial) / rotation_rate;
  return trial;
}

// Velocity, advancing set and torque that agree with one another at a given rotation rate: a few
// passes of [force from the set -> velocity against it -> set].
Trial converge(const StepModel& model, const ContactSet& contact, const StepPart& part, Vec3 guess,
               double rotation_rate) noexcept {
  if (!contact.is_linear()) return converge_nonlinear(model, contact, part, guess, rotation_rate);
  Trial trial;
  trial.rotation_rate = rotation_rate;
  for (int pass = 0; pass < kMaxPasses; ++pass) {
    trial.response = contact.response(guess, part.omega, rotation_rate);
    guess = velocity_against(model, part, trial.response.B / rotation_rate,
                             trial.response.f0 / rotation_rate);
    if (contact.advancing_set(guess, part.omega) == trial.response.set) break;
  }
  trial.velocity = guess;
  trial.torque = unit_torque(trial) / rotation_rate;
  return trial;
}

// The handle's velocity is imposed; the handpiece turns as fast as it can with that feed.
Trial direct_trial(const ContactSet& contact, const StepPart& part) noexcept {
  Trial trial;
  trial.velocity = part.guess;
  if (!part.turns) return trial;
  const auto respond = [&](double rotation_rate) {
    if (part.moves) trial.response = contact.response(trial.velocity, part.omega, rotation_rate);
    return unit_torque(trial);
  };
  if (contact.is_linear()) {
    turn_at_imposed_feed(part.spindle, respond(part.spindle.free_rate()), trial);
  } else {
    turn_at_imposed_feed_of(part.spindle, respond, trial);  // its last question is the rate's own
  }
  return trial;
}

// Spring or load pulls; the contact is sampled again where the motion turns away from the guess.
Trial pulled_trial(const StepModel& model, GrindingEngine& engine, const StepPart& part) noexcept {
  const double free_rate = part.spindle.free_rate();
  Trial trial;
  if (!part.turns || !part.moves) {
    trial.velocity = part.turns ? Vec3(Vec3::Zero()) : part.guess;
    trial.rotation_rate = free_rate;
    return trial;
  }
  Vec3 guess = part.guess;
  for (int samples = 1;; ++samples) {
    trial = converge(model, engine.contact(), part, guess, free_rate);
    if (samples == kMaxSamples || engine.covers(trial.velocity)) break;
    guess = trial.velocity;
    engine.sample(part.before, guess, part.omega);
  }
  const ContactSet& contact = engine.contact();
  double last_rate = free_rate;
  const auto trial_at = [&](double rate, const Vec3& from) {
    // Chips of the same thickness are a good guess; a linear law needs the direction alone.
    const Vec3 near = contact.is_linear() ? from : Vec3(from * (rate / last_rate));
    last_rate = rate;
    return converge(model, contact, part, near, rate);
  };
  return turn_at_imposed_force(part.spindle, trial, trial_at,
                               contact.is_linear() ? kExactRate : kSettled);
}

bool stalls_at(const StepModel& model, const BurState& state, StepPart& part) noexcept {
  const bool literally = model.parameters.handpiece.stall_rule == StallRule::kLastStep;
  part.judged_torque = literally ? state.last_torque : part.trial.torque;
  return stalls(model.parameters.handpiece, part.spindle, part.trial, part.judged_torque);
}

}  // namespace

StepPart sense(const StepModel& model, const BurState& state, const HandleSample& handle,
               double h) noexcept {
  StepPart part;
  part.h = h;
  part.handle = handle;
  part.before = state.pose;
  part.spindle =
      Spindle(model.parameters.handpiece, handle.buttons & kPedalButton, state.rotation_rate, h);
  part.turns = part.spindle.turns();
  part.handle_velocity = (handle.pose.position - state.handle.pose.position) / h;
  const double angle = state.pose.orientation.angularDistance(handle.pose.orientation);
  part.turned = turned_towards(state, handle.pose.orientation, angle, h);
  if (angle != 0 && model.parameters.rotation_feed)
    part.omega = turn_rate(state.pose.orientation, part.turned, h);
  if (model.drive != Drive::kDirect) part.coupling = coupling_state(model, state, part);
  if (model.drive == Drive::kLoad) {
    const Quat to_b = part.before.orientation.conjugate();
    part.load = to_b * handle.load;
    part.rail = to_b * rail_of(model);
  }
  part.guess = first_guess(model, part);
  part.moves = part.guess.squaredNorm() > 0 || part.omega.squaredNorm() > 0;
  return part;
}

void find_contact(const StepModel& model, GrindingEngine& engine, const StepPart& part) noexcept {
  const bool felt = part.turns || model.drive != Drive::kDirect;
  if (felt && part.moves) engine.sample(part.before, part.guess, part.omega);
}

void find_trial(const StepModel& model, GrindingEngine& engine, StepPart& part) noexcept {
  part.trial = model.drive == Drive::kDirect ? direct_trial(engine.contact(), part)
                                             : pulled_trial(model, engine, part);
}

void judge_stall(const StepModel& model, const BurState& state, GrindingEngine& engine,
                 StepPart& part) noexcept {
  const auto rests = [&] {
    return model.drive != Drive::kDirect && part.moves &&
           engine.contact().any_advances(part.trial.velocity, part.omega);
  };
  if (!part.turns) {
    part.rests = rests();
    return;
  }
  if (model.drive == Drive::kDirect ? !(part.trial.torque > 0) : !part.moves) return;
  part.stalls = stalls_at(model, state, part);
  if (part.stalls && !part.spindle.motor_on()) {
    // The tissue has stopped a rotor that was running down.
    part.stalls = part.turns = false;
    part.rests = rests();
    return;
  }
  if (part.stalls && state.catching_up && part.omega.squaredNorm() > 0) {
    part.omega.setZero();
    part.turned = part.before.orientation;
    find_contact(model, engine, part);
    find_trial(model, engine, part);
    part.stalls = stalls_at(model, state, part);
  }
}

void integrate(const StepModel& model, StepPart& part, BurState& state) noexcept {
  if (model.drive == Drive::kDirect) {
    // The bur follows the handle in any case; it removes only what it has the torque for.
    state.pose = Pose{part.handle.pose.position, part.turned};
    state.velocity = part.handle_velocity;
  } else if (part.holds()) {
    state.velocity.setZero();
    state.catching_up = true;
  } else {
    part.attached = model.drive == Drive::kCoupled && part.turns &&
                    model.parameters.coupling.attached_without_contact &&
                    part.trial.response.set.count == 0;
    if (part.attached) {
      state.pose = Pose{part.handle.pose.position, part.turned};
      state.velocity = part.handle_velocity;
    } else {
      state.velocity = part.before.orientation * part.trial.velocity;
      state.pose.position += part.h * state.velocity;
      state.pose.orientation = part.turned;
      state.catching_up = state.catching_up && state.pose.orientation.angularDistance(
                                                   part.handle.pose.orientation) > 1e-12;
    }
  }
  if (part.turns && part.moves)
    state.judged_velocity = part.before.orientation * part.trial.velocity;
  state.stalled = part.stalls;
  state.last_torque = part.turns && !part.stalls ? part.trial.torque : 0;
  state.rotation_rate = part.turns && !part.stalls ? part.trial.rotation_rate : 0;
  state.handle = part.handle;
}

void remove_tissue(const StepModel& model, const StepPart& part, const BurState& state,
                   GrindingEngine& engine) noexcept {
  const bool cuts = part.turns && !part.stalls && !part.attached;
  if (cuts) {
    engine.advance(state.pose);
  } else if (!part.stalls || model.drive == Drive::kDirect) {
    engine.pause(part.before);
  }
}

StepRecord record(const StepModel& model, const StepPart& part, const BurState& state,
                  const GrindingEngine& engine) noexcept {
  const Trial& trial = part.trial;
  const Handpiece& handpiece = model.parameters.handpiece;
  StepRecord row;
  row.handle = part.handle;
  row.bur = state.pose;
  row.bur_velocity = state.velocity;
  row.torque_trial = part.judged_torque;
  row.stalled = part.stalls;
  row.stalled_fraction = part.stalls ? 1 : 0;
  if (part.turns && part.moves)
    row.contact_area = engine.contact().advancing_area(trial.velocity, part.omega);

  const Vec3 unit_force =
      part.before.orientation * Vec3(trial.response.B * trial.velocity + trial.response.f0);
  if (part.stalls) {
    row.torque = handpiece.stall_torque;
    // Direct: the contact's direction, scaled to the torque that the spindle has.
    if (model.drive == Drive::kDirect)
      row.grinding_force = unit_force * (handpiece.stall_torque / unit_torque(trial));
  } else if (part.turns) {
    row.grinding_force = unit_force / trial.rotation_rate;
    row.torque = trial.torque;
    row.rotation_rate = trial.rotation_rate;
    row.power = 2 * units::kPi * trial.rotation_rate * trial.torque;
  }
  if (model.drive == Drive::kDirect) {
    row.device_force = row.grinding_force;
    return row;
  }
  if (model.drive == Drive::kLoad) {
    row.device_force = -part.handle.load;
    if (part.holds()) row.grinding_force = part.before.orientation * -pull(model, part);
    return row;
  }
  const CouplingState end{state.pose.position, state.velocity, part.handle.pose.position,
                          part.handle_velocity};
  row.device_force = -coupling_force(model.parameters.coupling, end);
  if (part.holds()) row.grinding_force = row.device_force;
  return row;
}

}  // namespace toothprep
