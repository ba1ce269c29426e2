// What can go wrong with a haptic device while it runs, and what follows from it.
//
//   transient  zero force while it lasts, then the force is ramped up again; the loop goes on
//   final      zero force from then on and until stop(); the client isn't called any more
#pragma once

namespace toothprep {

enum class DeviceFault {  // what can go wrong; `Final` ones end the session
  kNone,
  // Transient.
  kBadReading,        // the driver gave a position that isn't finite
  kBadForce,          // the client returned a force that isn't finite
  kWarmMotors,        // the driver's model of the motors' temperature
  kForceExceeded,     // above the device's maximum force
  kImpulseExceeded,   // the force changed too fast for the driver's limit
  kVelocityExceeded,  // the handle moved faster than the driver allows
  // Final.
  kNotCalibrated,  // found only once the device was running
  kClient,         // the client's tick threw
  kRefused,        // the driver refused a call: a wrong use of it, or a parameter that it lacks
  kTimer,          // the servo's timer
  kCommunication,  // no answer from the device
  kDevice,         // the device reports a fault
  kUnplugged,      // the driver doesn't know the device any more
  kHangs           // the driver doesn't come back from a call: it was given up
};

enum class FaultSeverity { kNone, kTransient, kFinal };  // of a fault

[[nodiscard]] FaultSeverity severity_of(DeviceFault fault) noexcept;  // by the list above

// One line for the user: what happened and what to do. Static text.
[[nodiscard]] const char* describe(DeviceFault fault) noexcept;

// Which of two counts when both happen in a tick: the final one; of equals, the later in the list.
[[nodiscard]] DeviceFault worse_of(DeviceFault a, DeviceFault b) noexcept;

}  // namespace toothprep
