// A criterion at a glance, as inline SVG: bands of what is ideal, tolerated and failed, and where
// the value lies, with its uncertainty.
#pragma once

#include <string>

#include "toothprep/tools/score/rubric.h"

namespace toothprep {

// Empty for what is yes or no, and for a criterion without a value.
std::string gauge_svg(const CriterionResult& result);

}  // namespace toothprep
