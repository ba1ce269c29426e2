#include "toothprep/tools/calibrate/measurement.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/lowpass.h"

namespace toothprep {
namespace {

// Uniform in (0, 1) and normal, the same on every platform.
class Random {
 public:
  explicit Random(std::uint64_t seed) : bits_(seed) {}
  double uniform() { return (static_cast<double>(bits_() >> 11) + 0.5) / 9007199254740992.0; }
  double normal() {
    const double r = std::sqrt(-2 * std::log(uniform()));
    return r * std::cos(2 * units::kPi * uniform());
  }

 private:
  std::mt19937_64 bits_;
};

void check(const SensorOptions& s, double step) {
  if (!(step > 0)) throw Error("the measurement's step must be positive");
  const auto not_negative = [](double x, const char* name) {
    if (!(x >= 0) || !std::isfinite(x))
      throw Error(std::string(name) + " must be finite and not negative");
  };
  not_negative(s.noise, "the noise");
  not_negative(s.noise_correlation, "the noise's correlation time");
  not_negative(s.outliers, "the share of outliers");
  not_negative(s.outlier_size, "the outliers' size");
  not_negative(s.lowpass_hz, "the low-pass");
  if (s.outliers > 1) throw Error("the share of outliers must be at most 1");
  if (!s.bias.allFinite() || !s.drift.allFinite() || !s.rotation.allFinite() ||
      !std::isfinite(s.delay))
    throw Error("bias, drift, rotation and delay must be finite");
}

}  // namespace

double contact_rms(const std::vector<Vec3>& force) {
  double square = 0, count = 0;
  for (const Vec3& f : force)
    if (f.squaredNorm() > 0) square += f.squaredNorm(), ++count;
  return count > 0 ? std::sqrt(square / count) : 0;
}

std::vector<Vec3> measured_by(const SensorOptions& s, const std::vector<Vec3>& force, double step) {
  check(s, step);
  const double rms = contact_rms(force), sigma = s.noise * rms;
  const double angle = s.rotation.norm();
  const Mat3 to_sensor =
      angle == 0
          ? Mat3(Mat3::Identity())
          : Mat3(Eigen::AngleAxisd(angle, s.rotation / angle).toRotationMatrix().transpose());
  std::vector<Vec3> filtered = force;
  if (s.lowpass_hz > 0) {
    const LowpassStep a = lowpass_step(1 / (2 * units::kPi * s.lowpass_hz), step);
    for (std::size_t i = 1; i < force.size(); ++i)
      filtered[i] = a.keep * filtered[i - 1] + a.before * force[i - 1] + a.now * force[i];
  }
  Random random(s.seed);
  const double keep = s.noise_correlation > 0 ? std::exp(-step / s.noise_correlation) : 0;
  Vec3 noise(random.normal(), random.normal(), random.normal());
  std::vector<Vec3> measured(force.size());
  const double last = static_cast<double>(force.size()) - 1;
  for (std::size_t i = 0; i < force.size(); ++i) {
    const double place = std::clamp(static_cast<double>(i) - s.delay / step, 0.0, last);
    const auto low = static_cast<std::size_t>(place);
    const std::size_t high = std::min(low + 1, force.size() - 1);
    const double f = place - static_cast<double>(low);
    measured[i] = to_sensor * ((1 - f) * filtered[low] + f * filtered[high]) + s.bias +
                  s.drift * (static_cast<double>(i) - last / 2) * step + sigma * noise;
    const Vec3 fresh(random.normal(), random.normal(), random.normal());
    noise = keep * noise + std::sqrt(1 - keep * keep) * fresh;
    if (random.uniform() < s.outliers)
      measured[i] += s.outlier_size * rms *
                     Vec3(random.normal(), random.normal(), random.normal()).normalized();
  }
  return measured;
}

void disturb_motion_and_speed(const SensorOptions& sensor, std::vector<StepRecord>& rows) {
  Random random(sensor.seed + 0x9e3779b97f4a7c15ull);
  if (sensor.position_noise > 0)
    for (StepRecord& row : rows)
      for (Vec3* p : {&row.bur.position, &row.handle.pose.position})
        *p += sensor.position_noise * Vec3(random.normal(), random.normal(), random.normal());
  if (sensor.speed_noise > 0)
    for (StepRecord& row : rows)
      row.rotation_rate =
          std::max(0.0, row.rotation_rate * (1 + sensor.speed_noise * random.normal()));
}

}  // namespace toothprep
