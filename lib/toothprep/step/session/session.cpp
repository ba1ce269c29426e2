#include "toothprep/step/session/session.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/contact.h"

namespace toothprep {
namespace {

constexpr double kShankElementSize = 0.4;  // mm
constexpr int kMaxPasses = 8;              // fixed-point passes for the advancing set
constexpr int kMaxSamples = 3;             // contact samples of one step, when the motion turns
constexpr int kMaxDirectIterations = 12;   // operating point of the droop model, before bisection
constexpr double kRateTolerance = 1e-9;    // of N0
constexpr double kTinyRate = 1e-6;         // of N0: stands for N -> 0
constexpr double kLongWay = 0.5;           // voxels in a step, from which it goes in parts
constexpr double kPartOfWay = 0.33;        // voxels
constexpr double kMostParts = 64;

// The handle part/parts of the way between two samples.
HandleSample between(const HandleSample& from, const HandleSample& to, int part, int parts) {
  const double t = static_cast<double>(part) / parts;
  HandleSample s = to;
  s.time = from.time + t * (to.time - from.time);
  s.pose.position = from.pose.position + t * (to.pose.position - from.pose.position);
  s.pose.orientation = from.pose.orientation.slerp(t, to.pose.orientation);
  return s;
}

}  // namespace

Session::Session(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                 const HandleSample& first, double element_size)
    : bur_(bur),
      workpiece_(workpiece),
      parameters_(parameters),
      drive_(drive),
      shank_(bur.shank_elements(kShankElementSize)),
      pose_(first.pose),
      handle_(first) {
  if (!first.pose.position.allFinite() || !first.pose.orientation.coeffs().allFinite())
    throw Error("the first handle pose is not finite");
  engine_ = make_engine(bur, workpiece, parameters, first.pose, element_size);
  totals_.initial_overlap = engine_->clear(first.pose);
  record_.handle = first;
  record_.bur = first.pose;
}

// The paper's section 5.2, one stage a line; the drives differ in who sets the velocity.
StepRecord Session::step(const HandleSample& next) noexcept {
  const HandleSample from = handle_;
  const bool was_stalled = stalled_;
  const int parts = drive_ == Drive::kCoupled ? parts_of_step() : 1;
  h_ = parameters_.time_step / parts;
  double torque = 0, power = 0;
  for (int part = 1; part <= parts; ++part) {
    const HandleSample handle = part == parts ? next : between(from, next, part, parts);
    record_ = StepRecord{};
    record_.handle = handle;
    turn_to(handle.pose.orientation);
    if (drive_ == Drive::kCoupled) {
      step_coupled(handle);
    } else {
      step_direct(handle);
    }
    handle_ = handle;
    torque += record_.torque / parts;
    power += record_.power / parts;
  }
  if (parts > 1) {
    record_.torque = torque;
    record_.power = power;
  }

  record_.bur = pose_;
  record_.bur_velocity = velocity_;
  record_.removed_volume = engine_->removed();
  record_.shank_contact_area = shank_contact_area(shank_, workpiece_, pose_);
  totals_.removed = engine_->removed();
  totals_.stalled_steps += record_.stalled;
  totals_.stall_onsets += record_.stalled && !was_stalled;
  totals_.shank_contact_steps += record_.shank_contact_area > 0;
  totals_.contact_steps +=
      record_.stalled || record_.torque > 0 || record_.grinding_force.squaredNorm() > 0;
  totals_.largest_lag = std::max(totals_.largest_lag, (next.pose.position - pose_.position).norm());
  totals_.peak_device_force = std::max(totals_.peak_device_force, record_.device_force.norm());
  return record_;
}

// A bur that flies freely (out of a stretched spring, say) covers several voxels in a step. It then
// goes in parts of about a third of a voxel at its present speed, so that it can't enter tissue
// without having met it.
int Session::parts_of_step() const noexcept {
  const double way = velocity_.norm() * parameters_.time_step / workpiece_.voxel();
  if (!(way > kLongWay)) return 1;
  return static_cast<int>(std::min(std::ceil(way / kPartOfWay), kMostParts));
}

void Session::finish(StepRecord& last) noexcept {
  engine_->finish(pose_);
  totals_.removed = engine_->removed();
  last.removed_volume = engine_->removed();
}

// The orientation is the handle's; after a stall that held it, it catches up at a limited rate.
void Session::turn_to(const Quat& handle) noexcept {
  turned_ = handle;
  const double angle = pose_.orientation.angularDistance(handle);
  const double most = kCatchUpRate * h_;
  if (catching_up_ && angle > most) turned_ = pose_.orientation.slerp(most / angle, handle);
  if (angle == 0) {
    turn_rate_.setZero();
    return;
  }
  Quat turn = pose_.orientation.conjugate() * turned_;
  if (turn.w() < 0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  turn_rate_ = sine > 1e-12 ? Vec3(turn.vec() * (2 * std::atan2(sine, turn.w()) / sine / h_))
                            : Vec3(Vec3::Zero());
}

// What Eq. 11 is judged on: the torque of this step's trial or, read literally, the torque that the
// step before ended with.
double Session::judged_torque(double trial) const noexcept {
  return parameters_.handpiece.stall_rule == StallRule::kLastStep ? last_torque_ : trial;
}

void Session::record_work(double torque, double rotation_rate) noexcept {
  record_.torque = torque;
  record_.rotation_rate = rotation_rate;
  record_.power = 2 * units::kPi * rotation_rate * torque;
  totals_.torque_work += record_.power * h_;
}

void Session::step_direct(const HandleSample& next) noexcept {
  const Handpiece& handpiece = parameters_.handpiece;
  const Pose before = pose_;
  const Quat to_b = pose_.orientation.conjugate();
  const Vec3 velocity = (next.pose.position - handle_.pose.position) / h_;
  const Vec3 v = to_b * velocity;
  const Vec3 omega = parameters_.rotation_feed ? turn_rate_ : Vec3(Vec3::Zero());
  const bool motor_on = next.buttons & kPedalButton;
  const bool moves = v.squaredNorm() > 0 || omega.squaredNorm() > 0;

  // Contact and force at the imposed velocity.
  GrindingResponse response;
  if (motor_on && moves) {
    engine_->sample(pose_, v, omega);
    response = contact().response(v, omega);
    record_.contact_area = contact().advancing_area(v, omega);
  }
  const double unit_torque = response.b.dot(v) + response.t0;  // at 1 rev/s
  const Vec3 unit_force = response.B * v + response.f0;

  // Stall, or the operating point.
  double rate = motor_on ? handpiece.rotation_rate : 0;
  bool stalls = false;
  if (unit_torque > 0) {
    if (handpiece.model == HandpieceModel::kDroop && std::isfinite(handpiece.stall_torque)) {
      // Imposed feed: power u Q = 2 pi T N is given, so T = (tau_s/2)(1 - sqrt(1 - uQ/P_max)).
      const double p_max = units::kPi * handpiece.rotation_rate * handpiece.stall_torque / 2;
      const double rest = 1 - 2 * units::kPi * unit_torque / p_max;
      stalls = rest < 0;
      rate *= (1 + std::sqrt(std::max(rest, 0.0))) / 2;
      record_.torque_trial = unit_torque / rate;
    } else {
      record_.torque_trial = judged_torque(unit_torque / rate);
      stalls = record_.torque_trial > handpiece.stall_torque;
    }
  }

  // The bur follows the handle in any case; it removes only what it has the torque for.
  pose_ = Pose{next.pose.position, turned_};
  velocity_ = velocity;
  if (stalls) {
    // The contact's direction, scaled to the torque that the spindle has.
    record_.stalled = true;
    record_.torque = handpiece.stall_torque;
    record_.grinding_force =
        before.orientation * unit_force * (handpiece.stall_torque / unit_torque);
  } else if (motor_on) {
    record_work(unit_torque / rate, rate);
    record_.grinding_force = before.orientation * unit_force / rate;
  }
  stalled_ = stalls;
  last_torque_ = stalls ? 0 : record_.torque;
  record_.device_force = record_.grinding_force;
  if (motor_on && !stalls) {
    engine_->advance(pose_);
  } else {
    engine_->pause(before);
  }
}

// Velocity, advancing set and torque that agree with one another at a given rotation rate: a few
// passes of [force from the set -> implicit velocity -> set].
Session::Trial Session::converge(const CouplingState& state, Vec3 guess, const Vec3& omega,
                                 double rotation_rate) const noexcept {
  Trial trial;
  trial.rotation_rate = rotation_rate;
  for (int pass = 0; pass < kMaxPasses; ++pass) {
    trial.response = contact().response(guess, omega);
    guess = implicit_velocity(parameters_.coupling, h_, state, trial.response.B / rotation_rate,
                              trial.response.f0 / rotation_rate);
    if (contact().advancing_set(guess, omega) == trial.response.set) break;
  }
  trial.velocity = guess;
  trial.torque = (trial.response.b.dot(guess) + trial.response.t0) / rotation_rate;
  return trial;
}

Session::Trial Session::coupled_trial(const CouplingState& state, const Vec3& first_guess,
                                      const Vec3& omega) noexcept {
  const Handpiece& handpiece = parameters_.handpiece;
  Vec3 guess = first_guess;
  Trial trial;
  for (int attempt = 0; attempt < kMaxSamples; ++attempt) {
    engine_->sample(pose_, guess, omega);
    trial = converge(state, guess, omega, handpiece.rotation_rate);
    if (engine_->covers(trial.velocity)) break;
    guess = trial.velocity;
  }
  if (handpiece.model == HandpieceModel::kFixed || !std::isfinite(handpiece.stall_torque)) {
    trial.stalls = judged_torque(trial.torque) > handpiece.stall_torque;
    return trial;
  }

  // Droop with an imposed force: N = N0 (1 - T(N)/tau_s), with v(N) from the step; stalled if even
  // N -> 0 takes more than tau_s. The torque hardly depends on N, so inserting settles in a few
  // turns; bisection of (0, N0] is there for when it doesn't.
  if (trial.torque <= 0) return trial;
  const double n0 = handpiece.rotation_rate;
  const Trial slow = converge(state, trial.velocity, omega, kTinyRate * n0);
  if (slow.torque > handpiece.stall_torque) {
    trial = slow;
    trial.stalls = true;
    return trial;
  }
  const auto rate_for = [&](double torque) {
    return std::max(kTinyRate * n0, n0 * (1 - torque / handpiece.stall_torque));
  };
  double rate = rate_for(trial.torque);
  for (int i = 0; i < kMaxDirectIterations; ++i) {
    trial = converge(state, trial.velocity, omega, rate);
    const double next = rate_for(trial.torque);
    if (std::abs(next - rate) <= kRateTolerance * n0) return trial;
    rate = next;
  }
  double low = kTinyRate * n0, high = n0;
  while (high - low > kRateTolerance * n0) {
    const double middle = (low + high) / 2;
    trial = converge(state, trial.velocity, omega, middle);
    (rate_for(trial.torque) > middle ? low : high) = middle;
  }
  return trial;
}

void Session::step_coupled(const HandleSample& next) noexcept {
  const Coupling& coupling = parameters_.coupling;
  const double h = h_;
  const Quat to_b = pose_.orientation.conjugate();
  const bool motor_on = next.buttons & kPedalButton;

  // State in B, relative to the bur's tip. While stalled the trial goes on from the motion it was
  // last judged on, so that the lost momentum m v (a thousandth of the force) can't make it
  // flicker.
  CouplingState state;
  state.position = Vec3::Zero();
  const bool goes_on = stalled_ && parameters_.handpiece.stall_rule == StallRule::kTrial;
  state.velocity = to_b * (goes_on ? judged_velocity_ : velocity_);
  state.handle_position = to_b * (next.pose.position - pose_.position);
  state.handle_velocity = to_b * (next.pose.position - handle_.pose.position) / h;
  Vec3 omega = parameters_.rotation_feed ? turn_rate_ : Vec3(Vec3::Zero());

  // Where the motion will go: on as before, or along the spring when at rest.
  Vec3 guess = state.velocity;
  if (guess.norm() < 1e-9) guess = coupling_force(coupling, state);
  const bool moves = guess.squaredNorm() > 0 || omega.squaredNorm() > 0;

  bool holds = false;  // stalled, or resting on tissue with the motor off
  Trial trial;
  if (!motor_on) {
    // T = 0: the bur moves freely unless an element in contact would advance.
    trial.velocity = implicit_velocity(coupling, h, state, Mat3::Zero(), Vec3::Zero());
    if (trial.velocity.squaredNorm() > 0 || omega.squaredNorm() > 0) {
      engine_->sample(pose_, trial.velocity, omega);
      holds = contact().any_advances(trial.velocity, omega);
    }
    stalled_ = false;
  } else if (moves) {
    trial = coupled_trial(state, guess, omega);
    if (trial.stalls && catching_up_ && omega.squaredNorm() > 0) {
      // Turning back to the handle is what it has no torque for: advance without turning.
      omega.setZero();
      turned_ = pose_.orientation;
      trial = coupled_trial(state, guess, omega);
    }
    record_.torque_trial = judged_torque(trial.torque);
    judged_velocity_ = pose_.orientation * trial.velocity;
    stalled_ = trial.stalls;
    holds = trial.stalls;
  } else {
    trial.rotation_rate = parameters_.handpiece.rotation_rate;
    stalled_ = false;
  }

  const Pose before = pose_;
  const bool attached =
      coupling.attached_without_contact && motor_on && !holds && trial.response.set.count == 0;
  if (holds) {
    velocity_.setZero();
    catching_up_ = true;
  } else if (attached) {
    pose_ = Pose{next.pose.position, turned_};
    velocity_ = (next.pose.position - handle_.pose.position) / h;
  } else {
    velocity_ = before.orientation * trial.velocity;
    pose_.position += h * velocity_;
    pose_.orientation = turned_;
    catching_up_ = catching_up_ && pose_.orientation.angularDistance(next.pose.orientation) > 1e-12;
  }

  // Forces at the end of the step.
  CouplingState end;
  end.position = pose_.position;
  end.velocity = velocity_;
  end.handle_position = next.pose.position;
  end.handle_velocity = (next.pose.position - handle_.pose.position) / h;
  const Vec3 f_vc = coupling_force(coupling, end);
  record_.device_force = -f_vc;
  record_.stalled = stalled_;
  if (holds) {
    record_.grinding_force = -f_vc;
    record_.torque = stalled_ ? parameters_.handpiece.stall_torque : 0;
  } else if (motor_on) {
    record_.grinding_force = before.orientation *
                             (trial.response.B * trial.velocity + trial.response.f0) /
                             trial.rotation_rate;
    record_work(trial.torque, trial.rotation_rate);
  }
  if (motor_on && (moves || stalled_))
    record_.contact_area = contact().advancing_area(trial.velocity, omega);

  last_torque_ = stalled_ ? 0 : record_.torque;
  if (!motor_on || attached) {
    engine_->pause(before);
  } else if (!stalled_) {
    engine_->advance(pose_);
  }
}

}  // namespace toothprep
