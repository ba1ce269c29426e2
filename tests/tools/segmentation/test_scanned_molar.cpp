// A synthetic scan of the molar, whose surfaces are known everywhere: how often a surface lies within
// the 95 % half width that is stated for it, and the enamel that thins out at the neck.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "../../support/level_set_at.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

constexpr double kSpacing = 0.2, kVoxel = 0.15;  // mm
constexpr double kOfDentinsGrey = 0.03;          // noise

struct Scanned {
  LayeredTooth tooth;
  VoxelizeReport report;
};

const Scanned& scanned() {
  static const Scanned result = [] {
    SyntheticScanOptions o;
    o.spacing = Vec3::Constant(kSpacing);
    o.blur_fwhm_voxels = 1;
    o.noise = kOfDentinsGrey * o.grey[2];
    const SyntheticScan scan = make_molar_scan(o);
    ImageVolume<float> image;
    static_cast<ImageFrame&>(image) = scan.image;
    image.data.assign(scan.image.data.begin(), scan.image.data.end());
    VoxelizeOptions options;
    options.voxel = kVoxel;
    Scanned s;
    s.tooth = voxelize_scan(image, options, &s.report);
    return s;
  }();
  return result;
}

// The error of a surface at a voxel beside it: difference of found and true signed distance.
double error_at(const LayeredTooth& tooth, const SurfaceUncertainty::Place& place, double voxel) {
  const Vec3 x = voxel * (place.voxel.cast<double>() + Vec3::Constant(0.5));
  const ToothSample s = sample_molar(x);
  const auto found = [&](const auto& set) { return at(set, tooth.lattice, x); };
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

TEST(HalfWidths, HoldTheSurfacesNineteenTimesOfTwenty) {
  const auto& [tooth, report] = scanned();
  EXPECT_TRUE(recorded_scan_half_widths(tooth.provenance).has_value());
  struct Coverage {
    double places = 0, local = 0, figure = 0;
  };
  std::array<Coverage, kScanSurfaces> coverage;
  const double band = 0.99 * tooth.band();
  for (const auto& place : report.uncertainty.places) {
    const auto s = static_cast<std::size_t>(place.surface);
    const double error =
        std::min(std::abs(error_at(tooth, place, report.uncertainty.voxel_mm)), band);
    coverage[s].places += 1;
    coverage[s].local += error <= place.half_width;
    coverage[s].figure += error <= report.uncertainty.figures[s].half_width;
  }
  for (std::size_t s = 0; s < 4; ++s) {
    const Coverage& c = coverage[s];
    std::printf("%-14s +-%.3f voxels, within its own %.3f, within the figure %.3f of %.0f\n",
                kScanSurfaceNames[s], report.uncertainty.figures[s].half_width / kSpacing,
                c.local / c.places, c.figure / c.places, c.places);
    EXPECT_GT(c.places, 500);
    EXPECT_GE(c.local, 0.95 * c.places) << kScanSurfaceNames[s];
    EXPECT_GE(c.figure, 0.95 * c.places) << kScanSurfaceNames[s];
  }
}

// True thickness there: from the outer surface along its normal to where the tissue is dentin.
TEST(EnamelOfTheMolarsNeck, IsKeptDownToAVoxel) {
  const LayeredTooth& tooth = scanned().tooth;
  double places = 0, kept = 0, within = 0, roots = 0, wrong = 0, ratio = 0;
  const Box box = molar_bounds();
  const auto is = [](const Vec3& x, Tissue tissue) { return sample_molar(x).label == tissue; };
  for (double z = box.min.z() + 1; z < 14; z += 0.25)
    for (int n = 0; n < 90; ++n) {
      // From outside towards the axis, to the surface.
      const double angle = n * M_PI / 45;
      const Vec3 axis(6.1, 5.5, z), out(std::cos(angle), std::sin(angle), 0);
      const auto solid_at = [&](double radius) { return sample_molar(axis + radius * out).solid; };
      constexpr double kStep = 0.05;
      double r = 8;
      while (r > 0 && solid_at(r) > 0) r -= kStep;
      if (r <= 0) continue;
      for (double step = kStep; step > 1e-3; step /= 2)
        if (solid_at(r + step / 2) <= 0) r += step / 2;
      const Vec3 place = axis + r * out;
      Vec3 inwards;
      for (int a = 0; a < 3; ++a)
        inwards[a] = sample_molar(place - 0.02 * Vec3::Unit(a)).solid -
                     sample_molar(place + 0.02 * Vec3::Unit(a)).solid;
      inwards.normalize();
      double t = 0;
      while (t < 1 && is(place + (t + 0.015) * inwards, Tissue::kEnamel)) t += 0.01;
      const double found = enamel_below(tooth, place, inwards);
      if (t < 0.01 && !is(place + 0.05 * inwards, Tissue::kEnamel) &&
          !is(place + 0.05 * inwards + Vec3(0, 0, 0.4), Tissue::kEnamel)) {
        roots += 1;
        wrong += found > 0.02;
      } else if (t >= kSpacing && t <= 2 * kSpacing) {
        places += 1;
        kept += found > 0.02;
        within += std::abs(found - t) <= 0.3 * t;
        ratio += found / t;
      }
    }
  std::printf(
      "%.0f places with 1 to 2 voxels: kept %.3f, thickness %.3f of the true, within 30 %% %.3f; "
      "%.0f on the roots: false %.4f; blur found %.2f voxels, thin enamel %.1f mm2\n",
      places, kept / places, ratio / places, within / places, roots, wrong / roots,
      scanned().report.blur_fwhm_mm / kSpacing, scanned().report.thin_enamel_mm2);
  EXPECT_GT(places, 100);
  EXPECT_GE(kept / places, 0.9);
  EXPECT_GE(within / places, 0.9);
  EXPECT_GT(roots, 500);
  EXPECT_LE(wrong / roots, 0.005);
}

}  // namespace
}  // namespace toothprep
