// What was made of a scan, a segmentation or shells, as JSON: what `toothprep voxelize --json`
// prints.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {

// The program that did the work.
struct MadeBy {
  std::string version, build;
};

// Schema toothprep-voxelize: program, source and its hash, the tooth's file (null if `file` is empty) and
// hash, volumes in mm³, notes; of a grey scan, whose report is given, thresholds and greys.
std::string voxelize_json(const LayeredTooth& tooth, const std::string& file, double seconds,
                          const std::vector<std::string>& notes, const MadeBy& program,
                          const VoxelizeReport* grey_scan = nullptr);

}  // namespace toothprep
