// The law of force of an active check (protocol.h): safe by construction, since every law is
// bounded by its own numbers, and the governor's and the device's limits lie over it.
//
//   step     F = f along +y (up), while it is on
//   springs  F = -k (x - x_0), x_0 the handle's place when the lead ends
//   dampers  F = -B dx/T, dx the handle's way since the last tick (backward difference)
//   wall     F = k min(d, travel) along +y, d = y_0 - y, the plane y_0 0.5 mm below the place at
//            the lead's end
#pragma once

#include "toothprep/tools/live/probe_loop.h"
#include "toothprep/tools/rig_check/protocol.h"

namespace toothprep {

// `period` in s. The law has a state (x_0): one law, one run.
ForceLaw protocol_force(const Protocol& protocol, double period);

}  // namespace toothprep
