// What a user ought to know of a run beside its figures.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/session/session.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// A sentence each: steps of direct drive beyond the stall torque, steps whose load nothing balanced, steps cut short, contact of the
// shank, tissue inside the bur at the start.
std::vector<std::string> run_warnings(const SessionTotals& totals, Drive drive);

// What a finished run did not do, or did to what nobody prepares, a sentence each: the motor was
// never on; the bur never touched the tooth (`tooth` as it was before; with its least distance);
// the bur was more than 25 mm from the tooth's grid; the pulp was opened, and when; tissue that is no tooth's ('other': a neighbour, gum) was cut
// (where the tooth has a list of bodies: body_warnings.h).
std::vector<std::string> outcome_warnings(const std::vector<StepRecord>& rows, const Bur& bur,
                                          const LayeredTooth& tooth);

// Least distance of the bur's head from what remains of the tooth, along the path, mm: by the
// voxels at the surface, and at most a few hundred of the poses.
[[nodiscard]] double least_distance(const std::vector<StepRecord>& rows, const Bur& bur,
                                    const LayeredTooth& tooth);

}  // namespace toothprep
