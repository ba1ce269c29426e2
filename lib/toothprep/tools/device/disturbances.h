// Known imperfections of a simulated device, so that what measures a rig can be measured itself.
// The same seed gives the same disturbances; times are those of tick n's start against n T.
#pragma once

#include <cmath>
#include <cstdint>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

struct Disturbances {
  double encoder_noise = 0;  // mm, standard deviation per axis, white, normal, before the counts
  double jitter = 0;         // s, every tick late by a uniform part of it, in [0, jitter)
  long late_every = 0;       // ticks; each such tick is late by `late`; 0: none
  double late = 0;           // s
  long missed_every = 0;     // ticks; each such tick doesn't come; 0: none, else >= 2
  std::uint64_t seed = 1;
};

// Throws Error that names the first violated condition.
inline void validate(const Disturbances& d) {
  const auto at_least_zero = [](double value, const char* name) {
    if (!(std::isfinite(value) && value >= 0))
      throw Error(std::string("disturbances: ") + name + " must be 0 or more");
  };
  at_least_zero(d.encoder_noise, "encoder_noise");
  at_least_zero(d.jitter, "jitter");
  at_least_zero(d.late, "late");
  at_least_zero(static_cast<double>(d.late_every), "late_every");
  if (d.missed_every < 0 || d.missed_every == 1)
    throw Error("disturbances: missed_every must be 0 (none) or 2 or more");
}

class DisturbanceSource {
 public:
  explicit DisturbanceSource(const Disturbances& settings)
      : settings_(settings), state_(settings.seed) {
    validate(settings);
  }

  bool misses(long tick) const noexcept { return falls_on(tick, settings_.missed_every); }
  double lateness(long tick) noexcept {
    const double late = falls_on(tick, settings_.late_every) ? settings_.late : 0;
    return settings_.jitter > 0 ? late + settings_.jitter * uniform() : late;
  }
  Vec3 encoder_noise() noexcept {
    if (!(settings_.encoder_noise > 0)) return Vec3::Zero();
    Vec3 noise;
    for (int axis = 0; axis < 3; ++axis) noise[axis] = settings_.encoder_noise * normal();
    return noise;
  }

 private:
  static bool falls_on(long tick, long every) noexcept {
    return every > 0 && tick % every == every - 1;
  }
  double uniform() noexcept {  // [0, 1), splitmix64
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }
  double normal() noexcept {  // Box and Muller; 1 - u isn't zero
    const double radius = std::sqrt(-2 * std::log(1 - uniform()));
    return radius * std::cos(2 * units::kPi * uniform());
  }

  Disturbances settings_;
  std::uint64_t state_;
};

}  // namespace toothprep
