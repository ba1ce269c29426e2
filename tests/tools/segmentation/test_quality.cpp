// How right the layers are: synthetic CTs of the molar over spacing, blur and noise, against the
// anatomy itself. The table is the figure to quote.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

struct Quality {
  std::array<double, 3> dice{};  // enamel, dentin, pulp
  double surface_error = 0;  // mean distance of the solid's surface to the true one, scan voxels
  // Of the outermost scan voxel of true enamel, the share that was called dentin: where the enamel
  // is two scan voxels thick or more, and wherever it is more than one.
  double false_dentin = 0, false_dentin_thin = 0;
};

// The true tissues at the tooth's voxel centres, and the true distance at its surface.
Quality compare(const LayeredTooth& tooth, double spacing) {
  std::array<double, 3> both{}, truth{}, found{};
  double error = 0, surface = 0, enamel = 0, skin = 0, thin_enamel = 0, thin_skin = 0;
  const double voxel = tooth.lattice.voxel;
  const LabelGrid& labels = tooth.tissue;
  for (std::size_t b = 0; b < labels.table_size(); ++b) {
    const Index3 first = labels.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 at = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
      const ToothSample s = sample_molar(tooth.lattice.to_world(at));
      const std::uint8_t label = labels.brick(b)[v];
      for (int k = 0; k < 3; ++k) {
        const bool is = s.label == tissue_at(k), was = label == k + 1;
        truth[k] += is;
        found[k] += was;
        both[k] += is && was;
      }
      // Near the found surface both distances are distances: their difference is the error there.
      const float phi = tooth.solid.brick(b)[v];
      if (std::abs(phi) < 0.5 * voxel) {
        error += std::abs(phi - s.solid);
        surface += 1;
      }
      if (s.label != Tissue::kEnamel || s.solid <= -spacing || s.tissue[1] <= spacing) continue;
      thin_enamel += 1;
      thin_skin += label == 2;
      if (s.tissue[1] - s.solid < 2 * spacing) continue;  // thickness: way out plus way to dentin
      enamel += 1;
      skin += label == 2;
    }
  }
  Quality q;
  for (int k = 0; k < 3; ++k) q.dice[k] = 2 * both[k] / (truth[k] + found[k]);
  q.surface_error = error / surface / spacing;
  q.false_dentin = skin / enamel;
  q.false_dentin_thin = thin_skin / thin_enamel;
  return q;
}

struct Case {
  double spacing, blur, noise;  // mm, voxels (FWHM), of the step from dentin to enamel
};
class ScanQuality : public ::testing::TestWithParam<Case> {};

std::string name_of(const ::testing::TestParamInfo<Case>& info) {
  const auto hundredths = [](double x) { return std::to_string(std::lround(100 * x)); };
  return "Spacing" + hundredths(info.param.spacing) + "Blur" + hundredths(info.param.blur) +
         "Noise" + hundredths(info.param.noise);
}

TEST_P(ScanQuality, LayersOfASyntheticScanAreRight) {
  const Case c = GetParam();
  SyntheticScanOptions o;
  o.spacing = Vec3::Constant(c.spacing);
  o.blur_fwhm_voxels = c.blur;
  o.noise = c.noise * (o.grey[1] - o.grey[2]);
  const SyntheticScan scan = make_molar_scan(o);
  ImageVolume<float> image;
  image.size = scan.image.size;
  image.spacing = scan.image.spacing;
  image.origin = scan.image.origin;
  image.direction = scan.image.direction;
  image.data.assign(scan.image.data.begin(), scan.image.data.end());
  VoxelizeOptions options;
  options.voxel = 0.1;
  const Quality q = compare(voxelize_scan(image, options), c.spacing);
  std::printf(
      "spacing %.2f mm, blur %.1f voxels, noise %2.0f %% of the step: Dice enamel %.4f, dentin "
      "%.4f, "
      "pulp %.4f; surface off by %.3f voxels; false dentin on enamel %.2f %% (%.2f %% with enamel "
      "of "
      "one to two voxels)\n",
      c.spacing, c.blur, 100 * c.noise, q.dice[0], q.dice[1], q.dice[2], q.surface_error,
      100 * q.false_dentin, 100 * q.false_dentin_thin);
  const double least = c.spacing <= 0.1 ? 0.98 : c.spacing <= 0.2 ? 0.95 : 0.90;
  EXPECT_GE(q.dice[0], least);
  EXPECT_GE(q.dice[1], least);
  if (c.spacing <= 0.1) {
    EXPECT_GE(q.dice[2], 0.95);
  }
  EXPECT_LE(q.surface_error, 0.15);
  EXPECT_LE(q.false_dentin, 0.005);
  EXPECT_LE(q.false_dentin_thin, 0.005);
}

INSTANTIATE_TEST_SUITE_P(Scans, ScanQuality,
                         ::testing::Values(Case{0.05, 1.5, 0.1}, Case{0.1, 0.5, 0},
                                           Case{0.1, 1.5, 0.1}, Case{0.2, 0.5, 0.1},
                                           Case{0.2, 1.0, 0.05}, Case{0.2, 1.5, 0.1},
                                           Case{0.3, 0.5, 0}, Case{0.3, 1.0, 0.1},
                                           Case{0.3, 1.5, 0.1}),
                         name_of);

}  // namespace
}  // namespace toothprep
