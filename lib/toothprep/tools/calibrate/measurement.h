// A sensor that isn't there: true forces as an imperfect rig would record them. The truth is known,
// so that a calibration can be tested on it, and an experiment planned with it.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/core/step_record.h"

namespace toothprep {

struct SensorOptions {
  double noise = 0;              // standard deviation per axis, of the force's rms in contact
  double noise_correlation = 0;  // s; 0: white
  Vec3 bias = Vec3::Zero();      // N
  Vec3 drift = Vec3::Zero();     // N/s, about the middle of the recording
  double delay = 0;              // s, of the force behind the motion
  double outliers = 0;           // share of the samples
  double outlier_size = 10;      // of the force's rms in contact
  Vec3 rotation = Vec3::Zero();  // rotation vector, rad: takes sensor to W
  double lowpass_hz = 0;         // first-order corner; 0: none
  double speed_noise = 0;        // standard deviation of the recorded speed, relative
  double position_noise = 0;     // mm per axis, white
  std::uint64_t seed = 1;
};

// Root mean square of the forces that aren't zero, N.
double contact_rms(const std::vector<Vec3>& force);

// `force` (N, on the bur, W; a sample each `step` s) as the sensor gives it. Same seed, same
// numbers. Throws Error for options out of range.
std::vector<Vec3> measured_by(const SensorOptions& sensor, const std::vector<Vec3>& force,
                              double step);

// Puts noise on the recorded positions (bur and handle) and speeds. Same seed, same numbers.
void disturb_motion_and_speed(const SensorOptions& sensor, std::vector<StepRecord>& rows);

}  // namespace toothprep
