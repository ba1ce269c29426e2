// A haptic device: reads where the hand is and pushes back. The one virtual interface of the
// toolkit, so that a session runs on a Phantom and on the simulated one alike.
//
// The device owns the clock. Once started it calls its client at its servo rate, on a thread of its
// own (or of the driver's), with a reading, and sends the force that the client returns:
//
//   reading n (at the tick's start) -> client.tick() -> limits, ramp -> motors, until tick n + 1
//
// Frame D of the device: right-handed, +x right, +y up, +z out toward the user; mm, N. Its origin
// is the driver's. Orientation takes the stylus' frame to D.
//
// Zero force is guaranteed on every way out: stop(), the destructor (so also an exception), a fault
// (device_fault.h), a client that throws or returns what isn't finite.
//
// Two devices (the grinding hand's and the mirror hand's) are opened as one HapticDevice, since
// drivers have one servo loop for all: the second one is read in the same tick and gets no force.
//
// Threads: construct, start, stop and destroy from one thread; status() from any; client.tick() is
// called on the servo's thread only.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/device/device_fault.h"

namespace toothprep {

struct DeviceIdentity {  // what a recording says of its device
  std::string name;      // as it was opened; "default" for the driver's first
  std::string model;     // "PHANTOM Desktop", "Touch", ...
  std::string vendor;    // the maker
  std::string driver;    // driver and library, with versions
  std::string serial;    // empty: unknown
  std::string firmware;  // empty: unknown
};

// As the device reports them. A limit that is missing or absurd is assumed, with a note.
struct DeviceLimits {
  double rate = 0;                  // Hz, of the servo loop
  double max_force = 0;             // N, for short; what is above is clamped, keeping direction
  double max_continuous_force = 0;  // N, that the motors can hold
  double max_stiffness = 0;         // N/mm, of a stable spring
  double max_damping = 0;           // N·s/mm, of a stable damper
  Eigen::AlignedBox3d workspace;    // mm, frame D
  bool has_orientation = false;     // else the orientation is the identity
  std::vector<std::string> notes;   // a line per limit that was assumed or refused
};

struct DevicePose {                        // of one device, as read
  Vec3 position = Vec3::Zero();            // mm, frame D
  Quat orientation = Quat::Identity();     // stylus to D, unit
  std::uint32_t buttons = 0;               // bit 0 = the first button
  std::optional<bool> safety_switch = {};  // held or not; empty: the device has none
};

struct DeviceReading {    // what the client is given each tick
  std::int64_t tick = 0;  // 0, 1, ... since start, of the ticks that came
  double time = 0;        // s since start, monotonic, once the hand was read: not older than it
  // Periods without a tick since the last one: the time between them in periods, rounded, less one.
  int missed = 0;
  DevicePose hand;                   // the device that pushes back
  std::optional<DevicePose> mirror;  // the second device, if there is one
  // Transient, in this tick: the client's force is not sent.
  DeviceFault fault = DeviceFault::kNone;
  double force_scale = 0;              // 0 to 1, of the ramp: what this tick's force is sent with
  Vec3 previous_force = Vec3::Zero();  // N, what the last tick sent
};

// What the device calls. It should be noexcept, allocate nothing, lock nothing, print nothing, and
// be done in a fraction of the period. What it throws is caught: zero force, and kClient.
class ServoClient {
 public:
  virtual ~ServoClient() = default;
  // The force on the hand, N, frame D, until the next tick. Tick 0 is the place to ask for a
  // priority for the thread.
  virtual Vec3 tick(const DeviceReading& reading) = 0;
};

enum class Calibration {  // of the encoders, as the driver says
  kOk,
  kNeedsUpdate,      // the driver has better values but couldn't take them
  kNeedsManualInput  // the user must do something: stylus into the inkwell, arm into its rest
};

enum class ServoState {  // of the loop that calls the client
  kIdle,                 // never started
  kRunning,              //
  kStopped,              // by stop()
  kFaulted               // by a final fault; stop() not called yet
};

// A look at the servo from another thread; each figure is whole, together they may be of two ticks.
struct DeviceStatus {
  ServoState state = ServoState::kIdle;         // as it is now
  std::int64_t ticks = 0;                       // of the client, since start
  double time = 0;                              // s since start, of the last tick
  double age = 0;                               // s since the last tick ended, now: a watchdog's
  Vec3 force = Vec3::Zero();                    // N, last sent
  DeviceFault last_fault = DeviceFault::kNone;  // since start; the final one if there is one
  std::uint32_t driver_code = 0;                // the driver's own number for it, 0: none
  std::int64_t faults = 0;                      // onsets
  std::int64_t clamped_ticks = 0;               // |force| above the limit
  std::int64_t missed_ticks = 0;                // sum of DeviceReading::missed
};

class HapticDevice {  // the interface that every back end implements
 public:
  HapticDevice() = default;
  HapticDevice(const HapticDevice&) = delete;
  HapticDevice& operator=(const HapticDevice&) = delete;
  virtual ~HapticDevice() = default;  // stops

  [[nodiscard]] virtual const DeviceIdentity& identity()
      const noexcept = 0;  // of the hand's device
  [[nodiscard]] virtual const DeviceIdentity* mirror_identity()
      const noexcept = 0;                                                 // nullptr: none
  [[nodiscard]] virtual const DeviceLimits& limits() const noexcept = 0;  // of the hand's device

  // The worse of both devices'. While the servo runs, as it was at its start.
  virtual Calibration calibration() = 0;

  // Calls `client` each tick from now on; it must live until stop() has returned. May be called
  // again after stop(). Throws Error if it runs already, isn't calibrated, or doesn't start.
  virtual void start(ServoClient& client) = 0;

  // Zero force, then no more ticks. Returns when the last tick is over; may be called at any time
  // and any number of times. From within a tick it only makes the force zero for good: the owner
  // still has to call it.
  virtual void stop() noexcept = 0;

  // Zero force from the next tick on, without waiting for it. From any thread, and from a signal
  // handler. A device that can't do it does nothing.
  virtual void zero_force_soon() noexcept {}

  [[nodiscard]] virtual DeviceStatus status() const noexcept = 0;  // from any thread
};

}  // namespace toothprep
