// A commanded motion out of a file of any of its formats.
#pragma once

#include <string>

#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

// A script (.toml), a table (.csv), or a trace or other recording (.h5, .hdf5), by the name's
// ending. Throws InputError for another, and as their readers do.
Trajectory read_trajectory(const std::string& path);

}  // namespace toothprep
