// What the main thread does while a live session runs: it starts the device, begins the session
// where the hand is, watches, and ends it. Whatever happens, the device has zero force when this
// returns or throws.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "toothprep/tools/live/live_loop.h"

namespace toothprep {

struct LiveWatch {             // of the main thread while the servo runs
  double duration = 0;         // s; 0: until it is stopped
  double stale = 0.1;          // s without a tick: the servo hangs
  double first_pose_wait = 5;  // s
  // Asks the system to run the servo's thread before all others (SCHED_FIFO) and to keep the
  // program in memory; the result goes to report_scheduling.
  bool real_time = false;
  std::function<void(const std::string&)> report_scheduling;  // a sentence
  std::function<bool()> stop_asked;  // looked at every few ms: a signal, a key
  // Called every few ms, for whoever controls the session; the reason to end it, else empty.
  std::function<std::string()> attend;
  // The same for a pause of the whole program (Ctrl-Z): the force is ramped out, then the program
  // stops itself (SIGSTOP); the force is ramped in once it goes on. May be empty.
  std::function<bool()> pause_asked;
  std::function<void(const LiveStatus&, const DeviceStatus&)> report;  // a few times a second
  // A line as soon as something happens; may be empty.
  std::function<void(const std::string&)> note;
};

struct LiveEnd {        // how it ended
  std::string reason;   // "duration", "asked to stop", or the fault's line
  bool fault = false;   // not a normal end
  DeviceStatus device;  // as it was when it ended
};

// `make_session` gets the pose of the handle in W and gives the session that starts there, or
// nullptr as long as none can start there. `start`: see LiveLoop::begin(). At its end the force is
// ramped out. Throws Error if the device doesn't start or gives no pose.
[[nodiscard]] LiveEnd run_live(HapticDevice& device, LiveLoop& loop,
                               const Registration& registration, const std::optional<Vec3>& start,
                               double time_step,
                               const std::function<Session*(const Pose&)>& make_session,
                               const LiveWatch& watch);

}  // namespace toothprep
