// Motions of the simulated device's hand (frame D) for sessions and checks.
#pragma once

#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/tools/device/hand_motion.h"
#include "toothprep/tools/live/registration.h"
#include "toothprep/tools/rig_check/protocol.h"

namespace toothprep {

// Along a path given in W, from its first sample on. Without a translation in the registration the
// device's origin lies at `start` (mm, W). Throws Error as hand_along().
HandMotion hand_along_world_path(std::vector<HandleSample> path, const Registration& registration,
                                 const Vec3& start);

// Slow loops of 2 mm about `start` (mm, W), the bur's axis along the device's vertical, the first
// button held.
HandMotion hand_in_loops(const Registration& registration, const Vec3& start);

// What a check needs of its hand: rest, a slow swing about the springs' centre, or a slow steady
// pull against dampers or into the wall.
HandMotion hand_for(const Protocol& protocol);

}  // namespace toothprep
