// A figure of a scored preparation: what it is called, how large it is, how well it is known.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

namespace toothprep {

// Keys are those of score.json. A dot makes a group: "removed_mm3.enamel" stands in score.json as
// the member `enamel` of the object `removed_mm3`. The unit is in the key; `unit` repeats it for
// tables ("mm", "mm^3", "deg", "1", "s", "N", "count" for what is counted, "yes/no" for what is 0
// or 1).
struct Quantity {
  std::string key;           // as in score.json
  double value = 0;          // in `unit`
  double uncertainty = NAN;  // half width of the 95 % interval; NaN: not stated
  std::string unit;          // as above
};

// In the order in which they are reported; keys are unique.
using Quantities = std::vector<Quantity>;
// The one of that key, or nullptr.
[[nodiscard]] inline const Quantity* find_quantity(const Quantities& quantities,
                                                   const std::string& key) {
  for (const Quantity& q : quantities)
    if (q.key == key) return &q;
  return nullptr;
}

// A quantity that is not defined for these inputs, such as the distance to a pulp that the tooth
// file does not contain.
struct AbsentQuantity {
  std::string key;     // as in score.json
  std::string reason;  // "the original has no pulp"
};

}  // namespace toothprep
