// What a user ought to know of a run beside its figures.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/session/session.h"

namespace toothprep {

// A sentence each: steps of direct drive beyond the stall torque, steps cut short, contact of the
// shank, tissue inside the bur at the start.
std::vector<std::string> run_warnings(const SessionTotals& totals, Drive drive);

}  // namespace toothprep
