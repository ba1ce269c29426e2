// Positions that a recording rounds: the velocity jumps from sample to sample, and the force of the
// model goes with it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

struct MotionRounding {
  double step = 0;           // mm, of which all differences of positions are multiples
  double velocity_jump = 0;  // mm/s, standard deviation of what the rounding adds to a velocity
  double feed = 0;           // mm/s, median while it moves; 0 if it doesn't
  double window = 0;         // s, of a local quadratic that leaves 3 % of the feed

  // Whether the jumps are above 3 % of the feed.
  [[nodiscard]] bool matters() const;
};

// None if positions are not rounded, or by less than a double shows.
[[nodiscard]] std::optional<MotionRounding> rounding_of(const std::vector<double>& time,
                                                        const std::vector<Vec3>& position);

// "positions are rounded to 0.01 mm, which makes the velocity jump by 2 mm/s at a feed of 1 mm/s;
// --smooth-motion-ms 34 takes that away"
[[nodiscard]] std::string text_of(const MotionRounding& rounding);

}  // namespace toothprep
