// What a person looks at before trusting a layered tooth: the histogram with the thresholds, three
// mid-slices with the tissues, volumes, and how thick the enamel is.
#pragma once

#include <string>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {

// How thick the enamel is, mm: at every voxel of its outer surface the distance to the nearest
// surface of dentin or pulp, from the level sets. Along the cervical edge that is the edge's own
// thinning out.
struct EnamelThickness {
  double mean = 0, median = 0, p95 = 0, thinnest = 0;  // thinnest: the 1st percentile
  std::size_t points = 0;                              // 0: no enamel, or nothing under it
};
EnamelThickness enamel_thickness(const LayeredTooth& tooth);

// Writes into the existing folder: report.json (schema toothprep-scan-report: volumes, thresholds,
// greys, half widths of the surfaces, thickness, notes), histogram.csv (grey,count: of the scan within the tooth's box and 2 mm
// around it), and slice-x.csv, slice-y.csv, slice-z.csv (u_mm,v_mm,grey,tissue,half_width_mm: the planes through
// the middle of the solid's box, across that axis). Greys are those kept in the report, averaged
// where the scan is finer than the tooth; a segmentation has none. scripts/plot-scan-report draws
// them. `version` and `build` are the program's. Throws Error if a file can't be written.
void write_scan_report(const std::string& folder, const LayeredTooth& tooth,
                       const VoxelizeReport& report, const std::string& version,
                       const std::string& build);

}  // namespace toothprep
