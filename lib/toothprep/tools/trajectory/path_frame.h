// Scripts in the tooth's own frame.
#pragma once

#include <string>

#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

// In which frame a path is written: that of the tooth's file, or the tooth's own (occlusal, mesial,
// central fossa; placement/own_frame.h), in which it fits any tooth.
enum class PathFrame { kFile, kTooth };

// As read_script() and parse_script(), which refuse scripts in the tooth's own frame, for those who
// place the path on a tooth; `frame` is what the script says (key `frame`; absent: the file's).
[[nodiscard]] Trajectory read_script(const std::string& path, PathFrame& frame);
[[nodiscard]] Trajectory parse_script(const std::string& toml, const std::string& where,
                                      PathFrame& frame);

}  // namespace toothprep
