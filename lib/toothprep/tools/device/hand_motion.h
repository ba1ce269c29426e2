// Where the user of a simulated device intends to be, as a function of time: what the hand's spring
// pulls the handle to. Orientation and buttons are taken as they are: the simulated arm has no
// inertia about its wrist.
#pragma once

#include <functional>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

// Time in s since the servo's start, >= 0; pose in frame D. Called on the servo's thread: it must
// not throw, and should neither allocate nor lock.
using HandMotion = std::function<DevicePose(double time)>;

// Stays there.
HandMotion resting_hand(const DevicePose& pose);

// Slow loops about `center`: sines of 1, 3/2 and 1/2 times `frequency` (Hz) along x, y, z, of the
// given amplitudes (mm); they start at the centre. Throws Error for what isn't finite.
HandMotion gentle_hand(const DevicePose& center, const Vec3& amplitude = Vec3(10, 5, 10),
                       double frequency = 0.25);

// Along a recorded path (frame D), whose first sample is at time 0: positions linear, orientations
// slerp, buttons of the latest sample; it stays at the end. Throws Error for no samples, times that
// don't increase or what isn't finite.
HandMotion hand_along(std::vector<HandleSample> path);

}  // namespace toothprep
