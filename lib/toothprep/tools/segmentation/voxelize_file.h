// A scan or a segmentation on disk to a layered tooth: read, cut, voxelized, with its source named.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/scan_files/image_file.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {

struct BodyLabels {                   // which values of a segmentation are one body's
  Body body;                          // name and kind
  std::vector<std::uint16_t> values;  // in the segmentation
};

// A tooth that is kept beside the one that is prepared, chosen as VoxelizeOptions chooses that one.
struct NeighbourChoice {
  Body body;                     // name and kind
  int tooth = 1;                 // the n-th largest piece
  std::optional<Vec3> tooth_at;  // mm, W: the one at this place; wins over `tooth`
};

struct ScanJob {                            // what the options of `toothprep voxelize` say
  std::string path;                         // a file, or a folder with a DICOM series
  ScanReadOptions reading;                  // `labels` follows from the map below
  std::optional<Box> roi;                   // mm, W: only this part of the scan
  std::map<std::uint16_t, Tissue> tissues;  // of label values; empty for a grey scan
  // Of a segmentation of several teeth, each a body of its own; empty: all values are one tooth's.
  // Every value of `tissues` is in one of them, and one of them is the tooth that is prepared.
  std::vector<BodyLabels> bodies;
  // Of a scan or segmentation of several teeth: kept beside the one that `how` chooses, which is then
  // the body "tooth". Not with `bodies`.
  std::vector<NeighbourChoice> neighbours;
  VoxelizeOptions how;  // grey scans: thresholds, which tooth
};

struct VoxelizedScan {  // what came out
  LayeredTooth tooth;   // provenance: also source (the name) and source_sha256 (see sha256_of_scan)
  VoxelizeReport report;  // of a grey scan: thresholds, grey values
};

// Throws InputError that names the file.
[[nodiscard]] VoxelizedScan voxelize_file(const ScanJob& job);

}  // namespace toothprep
