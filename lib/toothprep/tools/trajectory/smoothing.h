// The recorded motion as something that has a velocity.
//
// The force goes with the velocity, which is the difference of two positions: an encoder's step of
// 0.023 mm at 1 kHz is 23 mm/s, a hundred times a feed. A local quadratic over a window (Savitzky
// and Golay) has no phase, keeps a constant acceleration, and lowers the noise of the velocity by
// some n^1.5 for n samples.
#pragma once

#include <vector>

#include "toothprep/step/core/step_record.h"

namespace toothprep {

// Positions and orientations of `path` (equally spaced) after the local quadratic over `window` s;
// nearer to the ends the window is smaller. Less than five samples in the window: unchanged.
std::vector<HandleSample> smoothed(const std::vector<HandleSample>& path, double window);

// The same of vectors, over 2 half + 1 samples.
std::vector<Vec3> smoothed(const std::vector<Vec3>& values, int half);

struct VelocityNoise {
  double noise = 0;  // mm/s rms about the velocity over 50 ms, in the median 0.25 s
  double feed = 0;   // mm/s, median speed (over 50 ms) while it moves
};
VelocityNoise velocity_noise(const std::vector<HandleSample>& path);

}  // namespace toothprep
