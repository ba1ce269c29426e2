// How often a surface lies within the 95 % half width that is stated for it, on synthetic scans of
// the molar, whose surfaces are known everywhere.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

struct Coverage {
  double places = 0, local = 0, figure = 0;
};

// The error of a surface at a voxel beside it: difference of found and true signed distance.
double error_at(const LayeredTooth& tooth, const SurfaceUncertainty::Place& place) {
  const Index3& v = place.voxel;
  const ToothSample s = sample_molar(tooth.lattice.to_world(v));
  const auto found = [&](const LevelSet& set) { return set.value(v.x(), v.y(), v.z()); };
  switch (place.surface) {
    case ScanSurface::kEnamelOutside:
    case ScanSurface::kDentinOutside:
      return found(tooth.solid) - s.solid;
    case ScanSurface::kEnamelDentin:
      // Inside the solid either tissue's distance is that of the border; the outer surface is
      // farther off.
      return s.label == Tissue::kEnamel ? found(tooth.remains[1]) - s.tissue[1]
                                        : found(tooth.remains[0]) - s.tissue[0];
    default:
      return found(tooth.remains[2]) - s.tissue[2];
  }
}

std::array<Coverage, kScanSurfaces> coverage_of(double spacing, double blur, double noise) {
  SyntheticScanOptions o;
  o.spacing = Vec3::Constant(spacing);
  o.blur_fwhm_voxels = blur;
  o.noise = noise * o.grey[2];
  const SyntheticScan scan = make_molar_scan(o);
  ImageVolume<float> image;
  image.size = scan.image.size;
  image.spacing = scan.image.spacing;
  image.origin = scan.image.origin;
  image.data.assign(scan.image.data.begin(), scan.image.data.end());
  VoxelizeReport report;
  const LayeredTooth tooth = voxelize_scan(image, {}, &report);
  EXPECT_EQ(recorded_scan_half_widths(tooth.provenance).has_value(), true);
  std::array<Coverage, kScanSurfaces> coverage;
  const double band = 0.99 * tooth.band();
  for (const auto& place : report.uncertainty.places) {
    const auto s = static_cast<std::size_t>(place.surface);
    const double error = std::min(std::abs(error_at(tooth, place)), band);
    coverage[s].places += 1;
    coverage[s].local += error <= place.half_width;
    coverage[s].figure += error <= report.uncertainty.figures[s].half_width;
  }
  for (std::size_t s = 0; s + 1 < coverage.size(); ++s)
    std::printf(
        "spacing %.2f mm, blur %.1f, noise %.0f %%: %-14s +-%.3f voxels, within its own %.3f, "
        "within the figure %.3f of %.0f\n",
        spacing, blur, 100 * noise, kScanSurfaceNames[s],
        report.uncertainty.figures[s].half_width / spacing, coverage[s].local / coverage[s].places,
        coverage[s].figure / coverage[s].places, coverage[s].places);
  std::fflush(stdout);
  return coverage;
}

class HalfWidths : public ::testing::TestWithParam<std::array<double, 3>> {};

TEST_P(HalfWidths, HoldTheSurfacesNineteenTimesOfTwenty) {
  const auto [spacing, blur, noise] = GetParam();
  const auto coverage = coverage_of(spacing, blur, noise);
  for (int s = 0; s < 4; ++s) {
    const Coverage& c = coverage[static_cast<std::size_t>(s)];
    EXPECT_GT(c.places, 500);
    EXPECT_GE(c.local, 0.95 * c.places) << kScanSurfaceNames[static_cast<std::size_t>(s)];
    EXPECT_GE(c.figure, 0.95 * c.places) << kScanSurfaceNames[static_cast<std::size_t>(s)];
  }
}

INSTANTIATE_TEST_SUITE_P(Molar, HalfWidths,
                         ::testing::Values(std::array{0.2, 1.0, 0.0}, std::array{0.2, 1.0, 0.03},
                                           std::array{0.2, 1.0, 0.1}, std::array{0.3, 1.0, 0.03}));

}  // namespace
}  // namespace toothprep
