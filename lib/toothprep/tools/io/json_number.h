// Numbers that may be missing, as JSON: null for what isn't finite or isn't there.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

namespace toothprep {

inline nlohmann::ordered_json number_or_null(const std::optional<double>& x) {
  if (x && std::isfinite(*x)) return *x;
  return nullptr;
}

}  // namespace toothprep
