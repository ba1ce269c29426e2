// What a tooth's file says of how well a scan shows its surfaces.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// The surfaces of a tooth from a scan, by what meets there.
enum class ScanSurface { kEnamelOutside, kDentinOutside, kEnamelDentin, kPulp, kOther };
constexpr int kScanSurfaces = 5;  // how many there are
// As files name them.
constexpr std::array<const char*, kScanSurfaces> kScanSurfaceNames = {
    "enamel_outside", "dentin_outside", "enamel_dentin", "pulp", "other"};

// Half widths of 95 % intervals of where each surface is, mm; 0: the tooth has no such surface.
using ScanHalfWidths = std::array<double, kScanSurfaces>;

// How far each surface could lie from where it was found, place by place.
struct SurfaceUncertainty {
  struct Place {                                // of a surface
    Index3 voxel;                               // of a lattice from the frame's zero: see voxel_mm
    ScanSurface surface = ScanSurface::kOther;  // beside it; of several the first
    float half_width = 0;                       // mm, of the 95 % interval
  };
  std::vector<Place> places;  // voxels on either side of a surface, by their offset
  // Those voxels' edge, mm: the tooth's, or larger where the tooth is much finer than its scan. They lie side by
  // side from the frame's zero.
  double voxel_mm = 0;

  // Per surface: root mean square of the places' half widths, which is the 95 % half width of a place
  // taken at random; half, and 95 %, of the places have at most the others. Zero where there is none.
  struct Figures {                               // as said above
    double half_width = 0, median = 0, p95 = 0;  // mm
    std::size_t places = 0;                      // that they are of
  };
  std::array<Figures, kScanSurfaces> figures{};  // by ScanSurface

  ScanHalfWidths half_widths() const;  // of the figures
};

// As `scan_half_width_NAME_mm`, each surface that there is.
void record_scan_half_widths(const ScanHalfWidths& widths,
                             std::map<std::string, std::string>& provenance);

// What was recorded; nothing of a tooth from another source, or of an older file.
[[nodiscard]] std::optional<ScanHalfWidths> recorded_scan_half_widths(
    const std::map<std::string, std::string>& provenance);

}  // namespace toothprep
