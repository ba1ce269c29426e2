// A live session on a haptic device, from its start to its record: what a program with a device of
// its own calls.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/step/session/plausibility.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/display/display_stats.h"
#include "toothprep/tools/live/force_governor.h"
#include "toothprep/tools/live/live_watch.h"
#include "toothprep/tools/live/registration.h"
#include "toothprep/tools/live_session/recorded_run.h"

namespace toothprep {

class DisplaySurface;
class SessionControl;

// Looks on while a session runs: a viewer.
class Onlooker {
 public:
  virtual ~Onlooker() = default;
  virtual void begin(const DisplaySurface& display) = 0;  // before the servo runs
  virtual void take(const LiveTick& tick) noexcept = 0;   // every tick, on the servo's thread
  virtual void end() noexcept = 0;                        // after which the display is gone
};

// One of those that a session can change to.
struct NamedBur {
  std::string text;  // as --bur takes it
  Bur bur;           // that it names
};

struct LiveSettings {             // what the options of `toothprep live` say
  Parameters parameters;          // of the model; time step: the device's period
  Drive drive = Drive::kCoupled;  // kDirect renders the grinding force itself
  Registration registration;      // D to W
  Vec3 start = Vec3::Zero();      // mm, W: where the hand starts, unless the registration says
  ForceLimits limits;             // the session's own
  LiveButtons buttons;            // pedal and clutch
  ReadingLimits readings;         // what a true reading of the hand can be
  double display_hz = 0;          // of a surface for a display; 0: none
  Onlooker* onlooker = nullptr;   // with a display; must outlive the session
  // Of a session that is controlled from outside, else nullptr; must outlive it. `burs`: what it can
  // change to, the first is the session's own.
  SessionControl* control = nullptr;
  std::vector<NamedBur> burs;                    // or none
  LiveWatch watch;                               // ends the session
  std::function<void(const std::string&)> warn;  // of a recording that stops early; may be empty
};

struct LiveOutcome {                    // of a session that is over
  RecordedRun run;                      // how it ended, ticks, recording
  std::optional<SessionTotals> totals;  // absent if the session never began
  Audit audit;                          // of the totals
  std::vector<Finding> findings;        // implausible parameters, forces, audit
  std::optional<DisplayStats> display;  // with a display
};

// The limits for a device's readings: its rate and workspace.
ReadingLimits reading_limits(const DeviceLimits& device);

// 3 mm above the solid of the tooth, in the direction that the registration calls up; mm, W.
[[nodiscard]] Vec3 start_above(const LayeredTooth& tooth, const Registration& registration);

// Steps a session of `bur` in `workpiece` on the device until the watch ends it, and records it. The
// workpiece has the cut when it returns. The session begins once the bur is clear of the tooth;
// until then there is no force, and a note. Throws Error if the device isn't calibrated, doesn't run at
// the model's time step, doesn't start or gives no pose, if `start` lies in the tooth, or if the record can't be created; a
// session that ends by a fault is no error here (see RecordedRun::end).
[[nodiscard]] LiveOutcome run_live_session(HapticDevice& device, const Bur& bur,
                                           const LayeredTooth& tooth, Workpiece& workpiece,
                                           const LiveSettings& settings, RecordTarget target);

}  // namespace toothprep
