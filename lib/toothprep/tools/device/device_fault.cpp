#include "toothprep/tools/device/device_fault.h"

namespace toothprep {

FaultSeverity severity_of(DeviceFault fault) noexcept {
  if (fault == DeviceFault::kNone) return FaultSeverity::kNone;
  return fault < DeviceFault::kNotCalibrated ? FaultSeverity::kTransient : FaultSeverity::kFinal;
}

const char* describe(DeviceFault fault) noexcept {
  switch (fault) {
    case DeviceFault::kNone:
      return "no fault";
    case DeviceFault::kBadReading:
      return "the driver gave a position that is not finite: the last good one is held, zero force";
    case DeviceFault::kBadForce:
      return "the computed force was not finite: zero force, then ramped up again";
    case DeviceFault::kWarmMotors:
      return "the device's motors are too warm: zero force until they have cooled down; press less "
             "or pause";
    case DeviceFault::kForceExceeded:
      return "the driver saw a force above the device's maximum: zero force, then ramped up again";
    case DeviceFault::kImpulseExceeded:
      return "the force changed faster than the driver allows: zero force, then ramped up again";
    case DeviceFault::kVelocityExceeded:
      return "the handle moved faster than the driver allows: zero force, then ramped up again";
    case DeviceFault::kNotCalibrated:
      return "the device is not calibrated: stopped; calibrate it with the vendor's program";
    case DeviceFault::kClient:
      return "the program's own servo tick failed: stopped";
    case DeviceFault::kRefused:
      return "the driver refused a call: stopped; this program and this driver do not fit together";
    case DeviceFault::kTimer:
      return "the driver's servo timer failed: stopped; close other programs that use the device";
    case DeviceFault::kCommunication:
      return "the device does not answer: stopped; check its cable and its power";
    case DeviceFault::kDevice:
      return "the device reports a fault: stopped; switch it off and on";
    case DeviceFault::kHangs:
      return "the driver does not come back from a call: it was given up; switch the device off";
    case DeviceFault::kUnplugged:
      return "the device is gone: stopped; plug it in and open it again";
  }
  return "an unknown fault";
}

DeviceFault worse_of(DeviceFault a, DeviceFault b) noexcept { return a < b ? b : a; }

}  // namespace toothprep
