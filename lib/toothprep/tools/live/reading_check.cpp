#include "toothprep/tools/live/reading_check.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

constexpr double kVelocityWindow = 0.01;  // s
constexpr double kSettled = 0.02;         // s of readings that go on as a hand's
constexpr double kLate = 2;               // periods since the last reading
constexpr double kMoved = 0.1;            // mm within frozen_after: the hand was moving

}  // namespace

const char* describe(ReadingFault fault) noexcept {
  switch (fault) {
    case ReadingFault::kNone:
      return "the readings are good";
    case ReadingFault::kNotFinite:
      return "the device's readings are not finite numbers";
    case ReadingFault::kOutside:
      return "the device's position lies far outside of its workspace";
    case ReadingFault::kJump:
      return "the device's position jumped as no hand does";
    case ReadingFault::kTooFast:
      return "the device's position changed faster than a hand can move";
    case ReadingFault::kTurned:
      return "the device's orientation jumped as no hand does";
    case ReadingFault::kFrozen:
      return "the device's position does not change any more, to the last bit, although the hand "
             "was moving";
    case ReadingFault::kGap:
      return "no good reading came for a while, and the hand is not where it was; bring it back";
  }
  return "an unknown fault";
}

void validate(const ReadingLimits& limits) {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0)) throw Error(std::string("reading limits: ") + name + " must be above 0");
  };
  positive(limits.period, "period");
  positive(limits.speed, "speed");
  positive(limits.acceleration, "acceleration");
  positive(limits.slack, "slack");
  positive(limits.turn_rate, "turn_rate");
  positive(limits.turn_slack, "turn_slack");
  positive(limits.frozen_after, "frozen_after");
  positive(limits.gap, "gap");
  positive(limits.give_up, "give_up");
  positive(limits.give_up_after_gap, "give_up_after_gap");
}

ReadingCheck::ReadingCheck(const ReadingLimits& limits) : limits_(limits) { validate(limits); }

// Against the reading before, good or not.
bool ReadingCheck::jumps(const DevicePose& hand, double dt) const noexcept {
  return (hand.position - raw_.position).norm() > limits_.slack + limits_.speed * dt ||
         hand.orientation.angularDistance(raw_.orientation) >
             limits_.turn_slack + limits_.turn_rate * dt;
}

bool ReadingCheck::near_last(const DevicePose& hand, double since) const noexcept {
  const double way = limits_.slack + 2 * velocity_.norm() * std::min(since, limits_.give_up);
  return (hand.position - good_.position).norm() <= way &&
         hand.orientation.angularDistance(good_.orientation) <= limits_.turn_slack;
}

bool ReadingCheck::frozen(const DevicePose& hand, double dt) noexcept {
  const bool same =
      hand.position == raw_.position && hand.orientation.coeffs() == raw_.orientation.coeffs();
  raw_ = hand;
  still_ = same ? still_ + std::min(dt, limits_.gap) : 0;
  return still_ >= limits_.frozen_after && speed_before_ * limits_.frozen_after > kMoved;
}

bool ReadingCheck::after_gap(double since) const noexcept {
  return std::max(since, good_age_) > limits_.gap;
}

// From where the hand was going: the nearest of the places that it may have got to.
double ReadingCheck::aside(const Vec3& way, double least, double most) const noexcept {
  const double square = velocity_.squaredNorm();
  const double time = square > 0 ? std::clamp(way.dot(velocity_) / square, least, most) : most;
  return (way - time * velocity_).norm();
}

ReadingFault ReadingCheck::fault_of(const DeviceReading& reading, double since,
                                    double age) const noexcept {
  const DevicePose& hand = reading.hand;
  if (!limits_.workspace.isEmpty() &&
      limits_.workspace.exteriorDistance(hand.position) > limits_.workspace.sizes().maxCoeff() / 2)
    return ReadingFault::kOutside;
  if (!any_) return ReadingFault::kNone;
  const double most = since + good_age_;
  if (fault_ != ReadingFault::kNone) return near_last(hand, most) ? ReadingFault::kNone : cause_;
  if (after_gap(since)) return near_last(hand, most) ? ReadingFault::kNone : ReadingFault::kGap;
  const Vec3 way = hand.position - good_.position;
  if (knows_velocity_ &&
      aside(way, since - age, most) > limits_.slack + limits_.acceleration * most * most)
    return ReadingFault::kJump;
  if (way.norm() > limits_.slack + limits_.speed * most) return ReadingFault::kTooFast;
  if (hand.orientation.angularDistance(good_.orientation) >
      limits_.turn_slack + limits_.turn_rate * most)
    return ReadingFault::kTurned;
  return ReadingFault::kNone;
}

void ReadingCheck::accept(const DeviceReading& reading, double age) noexcept {
  const bool goes_on = any_ && !resumed_;
  good_ = reading.hand;
  good_time_ = reading.time;
  good_age_ = age;
  any_ = true;
  const double span = reading.time - timely_time_;
  if (age > 0 || span < limits_.period / 2) {  // how fast the hand is says the next one
    knows_velocity_ = knows_velocity_ && goes_on;
    return;
  }
  const Vec3 velocity = (reading.hand.position - timely_) / span;
  const double share = knows_velocity_ ? 1 - std::exp(-span / kVelocityWindow) : 1.0;
  if (goes_on) speed_ += (1 - std::exp(-span / limits_.frozen_after)) * (velocity.norm() - speed_);
  if (still_ == 0) speed_before_ = speed_;
  velocity_ += share * (velocity - velocity_);
  knows_velocity_ = goes_on;
  timely_ = reading.hand.position;
  timely_time_ = reading.time;
}

ReadingFault ReadingCheck::judge(const DeviceReading& reading) noexcept {
  const double least = limits_.period / 2;
  if (!any_) {
    last_time_ = good_time_ = timely_time_ = reading.time;
    raw_ = reading.hand;
    timely_ = reading.hand.position;
  }
  const double dt = std::max(reading.time - last_time_, least);
  const double since = std::max(reading.time - good_time_, least);
  const double age = dt > kLate * limits_.period ? dt : 0;  // at most
  last_time_ = reading.time;
  const bool jumped = any_ && jumps(reading.hand, dt);
  const bool stands = frozen(reading.hand, dt);
  ReadingFault fault = ReadingFault::kNone;
  if (reading.fault == DeviceFault::kBadReading)
    fault = ReadingFault::kNotFinite;
  else if (stands)
    fault = ReadingFault::kFrozen;
  else
    fault = fault_of(reading, since, age);

  resumed_ =
      fault == ReadingFault::kNone && any_ && (fault_ != ReadingFault::kNone || after_gap(since));
  if (fault == ReadingFault::kNone) {
    accept(reading, age);
  } else {
    reject(reading, fault, jumped, dt);
  }
  fault_ = fault;
  return fault;
}

void ReadingCheck::reject(const DeviceReading& reading, ReadingFault& fault, bool jumped,
                          double dt) noexcept {
  const bool finite = reading.fault != DeviceFault::kBadReading;
  if (fault_ == ReadingFault::kNone) {
    cause_ = fault;
    rejected_from_ = good_time_;
  } else if (finite && (jumped || cause_ == ReadingFault::kNotFinite)) {
    cause_ = fault = ReadingFault::kGap;  // that is over; the hand is elsewhere
  }
  if (!finite || jumped) {
    if (reading.time - last_bad_ > kSettled) bad_from_ = reading.time;
    last_bad_ = reading.time;
  }
  rejected_from_ += std::max(0.0, dt - limits_.gap);
  const bool may_return = cause_ == ReadingFault::kGap || cause_ == ReadingFault::kFrozen;
  const bool stays_bad =
      reading.time - last_bad_ <= kSettled && reading.time - bad_from_ > limits_.give_up;
  const double patience = may_return ? limits_.give_up_after_gap : limits_.give_up;
  lost_ = lost_ || (any_ && (reading.time - rejected_from_ > patience || stays_bad));
}

}  // namespace toothprep
