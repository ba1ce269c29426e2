// A commanded motion with the frame that it is written in.
#pragma once

#include <string>

#include "toothprep/tools/trajectory/path_frame.h"

namespace toothprep {

// As read_trajectory(), which refuses scripts in the tooth's own frame, for those who place the path
// on a tooth; `frame` is what a script says, of other files the file's.
Trajectory read_trajectory(const std::string& path, PathFrame& frame);

}  // namespace toothprep
