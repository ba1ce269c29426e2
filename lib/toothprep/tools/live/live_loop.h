// The servo tick of a live session: reading -> handle -> session step -> limits -> force.
//
// One step of the model's time step per tick of the device, so that a recording can be replayed bit
// for bit; the device's own clock is recorded beside it. If a tick doesn't come, the step is not
// made up for: the bur's spring then sees a longer way in one step, as any program at a fixed step
// would.
//
// It starts in waiting: zero force, poses only, until begin() hands it a session that starts where
// the hand is. The tick allocates nothing, locks nothing and prints nothing.
//
// A reading that can't be true (reading_check.h) makes no step and no force. The motor starts only
// after the pedal was released once, so that a foot that rests on it doesn't start the bur; without
// a pedal, after the bur was clear of the tooth for kClearBefore. A stylus that nobody holds, by the
// device's safety switch, gets no force and its bur doesn't turn; after that the motor starts as
// at the beginning.
//
// A pause ends an interval of the session (core/session_event.h): the motor stops, the force is
// ramped out, then the session is finished and the tick touches neither it nor its workpiece until
// it is resumed with another one. Whatever takes time is done in between, on another thread:
//
//   main thread   post(pause) ... paused()   undo, another bur, the next session   post(resume)
//   servo thread        ramps out, finishes │ zero force, rows without a step     │ steps it
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/device/haptic_device.h"
#include "toothprep/tools/live/force_governor.h"
#include "toothprep/tools/live/reading_check.h"
#include "toothprep/tools/live/registration.h"
#include "toothprep/tools/live/status_board.h"

namespace toothprep {

// Takes ticks on the servo's thread: a recorder, a display.
class TickSink {
 public:
  virtual ~TickSink() = default;
  virtual void take(const LiveTick& tick) noexcept = 0;  // in order, on the servo's thread
};

// Which button does what, as a mask of DevicePose::buttons; 0: none.
struct LiveButtons {
  std::uint32_t pedal = 0;    // starts the bur; none: it always runs
  std::uint32_t clutch = 0;   // while held the handle stays where it is
  bool safety_switch = true;  // heeded, where the device has one
};

// What is done to the session at the boundary of a tick; its row records it.
struct LiveCommand {
  EventKind kind = EventKind::kNone;                // what is done
  std::array<double, kEventArguments> arguments{};  // as recorded; of a registration: filled in
  Session* session = nullptr;                       // resume: steps it from now on
  PerTissue<double> removed{};                      // undo, resume: mm³, of the intervals before
  Vec3 shift = Vec3::Zero();     // registration: mm, W, of the handle against the hand
  Quat turn = Quat::Identity();  // registration: of it in W, about where the handle is
};

constexpr double kClearBefore = 0.5;  // s, of the bur before its motor starts without a pedal

class LiveLoop final : public ServoClient {  // what the device calls in a session
 public:
  // `sink` may be nullptr. Throws Error as ForceGovernor and ReadingCheck do.
  LiveLoop(const ForceLimits& limits, const LiveButtons& buttons, TickSink* sink,
           const ReadingLimits& readings = {});

  // The device's latest good pose while it waits, without its buttons; empty until there is one.
  [[nodiscard]] std::optional<DevicePose> waiting_pose() const noexcept;

  // From the next tick on it steps `session`, which must live until the device has stopped. With
  // `start` (mm, W), the frame is laid so that the hand, wherever it is by then, starts there.
  void begin(Session& session, const HandleFrame& frame, const Registration& registration,
             const std::optional<Vec3>& start, double time_step) noexcept;

  Vec3 tick(const DeviceReading& reading) override;

  // From one thread: the command acts at the next tick; false if the one before hasn't yet. Only
  // `pause` and `end` while the session runs, all others while it is paused.
  bool post(const LiveCommand& command) noexcept;
  bool posted() const noexcept { return posted_.load(std::memory_order_acquire); }  // and waits
  // The session was finished: it, and its workpiece, are the caller's until `resume` is posted.
  bool paused() const noexcept { return phase_.load(std::memory_order_acquire) == Phase::kPaused; }
  [[nodiscard]] Pose paused_handle() const noexcept;  // W, while it is

  // Ramps the force out (or in again), from any thread; status().faded says when it is zero.
  void fade_out(bool wanted) noexcept { fade_wanted_.store(wanted, std::memory_order_relaxed); }

  // After the device has stopped: removes what is still due and hands on the last tick.
  void finish() noexcept;

  LiveStatus status() const noexcept { return status_.read(); }  // from any thread

 private:
  enum class Phase { kWaiting, kBeginning, kRunning, kPaused };

  bool let_go(const DevicePose& hand) const noexcept;
  void wait(const DeviceReading& reading, ReadingFault fault) noexcept;
  void step(const DeviceReading& reading, ReadingFault fault, LiveTick& out) noexcept;
  std::uint32_t motor_buttons(std::uint32_t pressed, LiveTick& out) noexcept;
  bool obey(ReadingFault fault, LiveTick& out) noexcept;
  void stand(const DeviceReading& reading, ReadingFault fault, LiveTick& out) noexcept;
  HandleSample next_handle(const DeviceReading& reading, ReadingFault fault,
                           LiveTick& out) noexcept;
  void complete(StepRecord& row) noexcept;
  void hand_on(const LiveTick& tick) noexcept;
  void store_pose(const Pose& pose) noexcept;

  LiveButtons buttons_;
  TickSink* sink_;
  ForceGovernor governor_;
  ReadingCheck check_;
  std::atomic<Phase> phase_ = Phase::kWaiting;
  std::atomic<bool> fade_wanted_ = false;
  std::atomic<bool> has_pose_ = false;
  std::array<std::atomic<double>, 7> pose_{};  // x, y, z, qx, qy, qz, qw; see store_pose()
  std::atomic<bool> posted_ = false;
  LiveCommand command_;  // the servo's while posted_

  // Set by begin(), then the servo thread's own.
  Session* session_ = nullptr;
  std::optional<HandleFrame> frame_;
  Registration registration_;
  std::optional<Vec3> start_;
  double time_step_ = 0;
  std::int64_t steps_ = 0;
  bool unlocked_ = false;  // the motor, by the pedal or by a clear bur
  double clear_ = 0;       // s that the bur has been clear of the tooth
  LiveTick last_;          // handed on a tick later, since the session's end completes it
  bool any_ = false;
  bool pausing_ = false;         // until the force is gone
  PerTissue<double> removed_{};  // mm³, before the session that it steps
  Pose stands_;                  // of the bur in a pause

  StatusBoard status_;
};

}  // namespace toothprep
