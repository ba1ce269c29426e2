// What a live session does to a force before the device gets it, tick by tick:
//
//   finite?  -> magnitude limit -> ramp-in -> heat limit -> rate limit -> device
//                                                        -> vibration watch
//
//   |F| <= F_max                       direction kept; first, so that no force, however large, is
//                                      ramped in faster than F_max over `ramp`
//   F' = s F                           s grows from 0 to 1 over `ramp` from the start, and falls
//                                      to 0 over `fade` where the force is not wanted
//   |F| <= F_hot                       while the heat is above the continuous limit
//   |F(n) - F(n-1)| <= R T             along the straight way to the new force
//
// Heat is the first-order model of a winding, h' = (|F|² - h)/tau with h in N²: at a constant force
// F it tends to F², so that h <= F_cont² is the continuous limit. From 90 % of that on
// the allowed force falls linearly to F_cont, at 100 %.
//
// The vibration watch separates an unstable loop from grinding: the running RMS, over about 0.1 s, of
// the force above 20 Hz (a first-order high-pass). A force that rises by 3 N within one tick and
// stays gives 0.6 N for a moment; a loop at its limit cycle gives several N throughout. Above
// `vibration_limit` for `vibration_time` the session has to stop: every later force is zero. It
// looks at the force before the rate limit, which would hide most of an unstable loop's amplitude.
//
//   symbol   here                  unit    default
//   F_max    max_force             N       the device's
//   R        max_force_rate        N/s     3000 (3 N per tick at 1 kHz)
//   F_cont   continuous_force      N       the device's
//   tau      thermal_time          s       10, assumed: no data sheet gives it
//   T        period                s       1/rate
#pragma once

#include <cstdint>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

struct ForceLimits {               // see the table above
  double period = 1e-3;            // T, s
  double max_force = 3.3;          // F_max, N
  double max_force_rate = 3000;    // R, N/s
  double continuous_force = 0.88;  // F_cont, N
  double thermal_time = 10;        // tau, s
  double ramp = 0.25;              // s, in
  double fade = 0.05;              // s, out: at the end, while the clutch is held
  double vibration_limit = 1.0;    // N rms above 20 Hz; infinity: no watch
  double vibration_time = 0.05;    // s
};

// Throws Error that names the first violated condition.
void validate(const ForceLimits& limits);

class ForceGovernor {  // of one device's force
 public:
  explicit ForceGovernor(const ForceLimits& limits);  // throws as validate()

  // One tick. Adds LiveFlag bits to `flags`. Allocates nothing.
  Vec3 limit(const Vec3& force, std::uint32_t& flags) noexcept;

  // A tick without a force, after which it is ramped in anew.
  Vec3 withhold(std::uint32_t& flags) noexcept;

  // Starts the ramp anew, from zero force (after a fault; heat stays).
  void restart() noexcept;

  // Ramps the force out within `fade`, and in again when it isn't wanted any more.
  void fade_out(bool wanted) noexcept { fades_ = wanted; }
  bool faded() const noexcept { return fades_ && scale_ == 0; }

  bool vibrates() const noexcept { return vibrates_; }  // and from then on all forces are zero
  [[nodiscard]] double vibration_rms() const noexcept;  // N
  [[nodiscard]] double heat() const noexcept;           // of the continuous limit: 1 is full

 private:
  void watch(const Vec3& force) noexcept;
  void send(const Vec3& force) noexcept;

  ForceLimits limits_;
  double high_pass_, window_;  // per tick
  double scale_ = 0;
  bool fades_ = false;
  Vec3 last_ = Vec3::Zero();
  double heat_ = 0;  // N²
  Vec3 low_ = Vec3::Zero();
  double mean_square_ = 0, above_ = 0;  // N², s
  bool vibrates_ = false;
};

}  // namespace toothprep
