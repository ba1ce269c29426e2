// Whether a reading of the hand can be true. Drivers, cables and encoders give glitches: a pose
// 20 mm away for one tick, a pose that doesn't change any more, an old one after a pause. None of
// them may move the bur.
//
//   not finite    the servo holds the last good pose, and says so
//   outside       of the workspace by more than half of its largest side
//   jump          |x - (x' + v T)| > slack + a T²       x', v: of the last good reading
//   too fast      |x - x'| > slack + speed T            T: time since then, by the device's clock
//   turned        angle > turn_slack + turn_rate T
//   frozen        the same bits for `frozen_after` although the hand moved just before; a hand that
//                 holds a stylus never does that, encoders count its tremor.
//   gap           no reading for longer than `gap`, and the hand is somewhere else by then
//
// A late reading, the first after a pause, may be as old as the one before it: the driver had it
// ready before the pause. How far the hand has come in how long is known only with the next one: T
// ends, and for the next one begins, at any moment of the pause; a gap is one for the next one too;
// and v is measured from before the pause.
//
// After a reading was rejected, the next one that counts is near the last good one,
// |x - x'| <= slack + 2 |v| T, whatever the time: a hand that was somewhere else meanwhile would
// drag the bur through the tooth. If none comes for `give_up`, the hand is lost for good; for
// `give_up_after_gap`, if only the hand is elsewhere: after a gap, a frozen pose, or readings that
// became numbers again or jumped once more and then went on as a hand's. In these times, and in
// `frozen_after`, a pause counts as `gap`: nobody can bring the hand back in it.
#pragma once

#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

// Why a reading is rejected; the words of the table above.
enum class ReadingFault {
  kNone,       // it is not
  kNotFinite,  // numbers
  kOutside,    // of the workspace
  kJump,       // of the position
  kTooFast,    // for a hand
  kTurned,     // jump of the orientation
  kFrozen,     // pose
  kGap         // without readings
};

// One line for the user. Static text.
[[nodiscard]] const char* describe(ReadingFault fault) noexcept;

struct ReadingLimits {            // what a true reading of the hand can be; the table above
  double period = 1e-3;           // s, of the servo
  double speed = 2000;            // mm/s: a fast hand in the air has 1000
  double acceleration = 1e5;      // mm/s²: ten times a hand's
  double slack = 0.5;             // mm: encoder counts, late ticks
  double turn_rate = 60;          // rad/s
  double turn_slack = 0.3;        // rad
  double frozen_after = 0.25;     // s; infinity: not judged
  double gap = 0.05;              // s
  double give_up = 0.1;           // s
  double give_up_after_gap = 10;  // s, after a gap or a frozen pose: the hand may come back
  Eigen::AlignedBox3d workspace;  // mm, D; empty: not judged
};

// Throws Error that names the first violated condition.
void validate(const ReadingLimits& limits);

class ReadingCheck {  // of one device
 public:
  explicit ReadingCheck(const ReadingLimits& limits);  // throws as validate()

  // One tick's reading. Allocates nothing.
  [[nodiscard]] ReadingFault judge(const DeviceReading& reading) noexcept;

  // Whether the last reading is the first good one after rejected ones or a gap.
  [[nodiscard]] bool resumed() const noexcept { return resumed_; }
  // Whether readings have been rejected for so long that the session has to end.
  [[nodiscard]] bool lost() const noexcept { return lost_; }

 private:
  ReadingFault fault_of(const DeviceReading& reading, double since, double age) const noexcept;
  bool jumps(const DevicePose& hand, double dt) const noexcept;
  void reject(const DeviceReading& reading, ReadingFault& fault, bool jumped, double dt) noexcept;
  bool near_last(const DevicePose& hand, double since) const noexcept;
  bool after_gap(double since) const noexcept;
  double aside(const Vec3& way, double least, double most) const noexcept;
  bool frozen(const DevicePose& hand, double dt) noexcept;
  void accept(const DeviceReading& reading, double age) noexcept;

  ReadingLimits limits_;
  bool any_ = false, resumed_ = false, lost_ = false;
  bool knows_velocity_ = false;               // from two good readings in a row
  ReadingFault fault_ = ReadingFault::kNone;  // of the last reading
  ReadingFault cause_ = ReadingFault::kNone;  // of the first rejected one
  double last_time_ = 0;                      // s, of the last reading
  double good_time_ = 0;                      // s, of the last good one
  double rejected_from_ = 0;                  // s, of readings in a row; later by pauses
  double last_bad_ = -1e9;                    // s, of the last one that can't be a hand's at all
  double bad_from_ = 0;                       // s, since when these come again and again
  double good_age_ = 0;                       // s that it may have been old by then
  double timely_time_ = 0;                    // s, of the last good one that wasn't late
  DevicePose good_, raw_;
  Vec3 timely_ = Vec3::Zero();    // mm, D
  Vec3 velocity_ = Vec3::Zero();  // mm/s, D: mean over some 10 ms
  double speed_ = 0;              // mm/s: mean over frozen_after
  double speed_before_ = 0;       // mm/s: of the last change of the pose
  double still_ = 0;              // s: since then
};

}  // namespace toothprep
