// Scans without enamel have two bright classes all the same: dentin and pulp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/scan_files/scan_source.h"
#include "toothprep/tools/segmentation/crop.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

using testing::AllOf;
using testing::HasSubstr;

SyntheticScanOptions scanner(double noise = 60) {
  SyntheticScanOptions options;
  options.spacing = Vec3::Constant(0.3);
  options.noise = noise;
  return options;
}

std::unique_ptr<ScanSource> source(const SyntheticScan& scan) {
  ImageVolume<float> image;
  static_cast<ImageFrame&>(image) = scan.image;
  image.data.assign(scan.image.data.begin(), scan.image.data.end());
  return owning_source(std::move(image), "scan");
}

// The molar, prepared to the dentin all around.
ToothSample stump(const Vec3& x) {
  ToothSample sample = sample_molar(x);
  if (sample.label == Tissue::kEnamel) sample.label = Tissue::kAir;
  sample.solid = std::max(sample.solid, -sample.tissue[0]);
  sample.tissue[0] = 3;
  return sample;
}

VoxelizeOptions coarse() {
  VoxelizeOptions options;
  options.voxel = 0.2;
  return options;
}

std::string refusal(ScanSource& scan, const VoxelizeOptions& options = coarse()) {
  try {
    static_cast<void>(voxelize_scan(scan, options));
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(Plausibility, AStumpIsRefusedWithTheThresholdsThatMakeItDentin) {
  const auto scan = source(make_synthetic_scan(stump, molar_bounds(), scanner()));
  EXPECT_THAT(refusal(*scan), AllOf(HasSubstr("can't be a tooth's dentin and enamel"),
                                    HasSubstr("--thresholds DENTIN,ENAMEL"),
                                    HasSubstr("a stump or a root: --thresholds 30")));
}

// By hand: the molar without its enamel has 606 mm3 of dentin and 39 mm3 of pulp.
TEST(Plausibility, WithThoseThresholdsItIsDentinAndPulp) {
  const auto scan = source(make_synthetic_scan(stump, molar_bounds(), scanner()));
  VoxelizeOptions options = coarse();
  options.thresholds = {300, 2880};
  const auto volume = remaining_volumes_mm3(voxelize_scan(*scan, options));
  EXPECT_EQ(volume[0], 0);
  EXPECT_NEAR(volume[1], 606, 12);
  EXPECT_NEAR(volume[2], 39, 6);
}

TEST(Plausibility, PulpOfAnyGreyIsNeverDentin) {
  for (const double pulp : {50.0, 800.0}) {
    SyntheticScanOptions how = scanner();
    how.grey[3] = pulp;
    const auto scan = source(make_synthetic_scan(stump, molar_bounds(), how));
    EXPECT_THAT(refusal(*scan), HasSubstr("can't be a tooth's dentin and enamel")) << pulp;
  }
}

TEST(Plausibility, ARegionWithoutEnamelIsRefused) {
  const SyntheticScan molar = make_molar_scan(scanner());
  for (const double top : {6.0, 8.0, 10.0}) {
    const auto root = crop(source(molar), {Vec3(-5, -5, -5), Vec3(30, 30, top)});
    EXPECT_THAT(refusal(*root), HasSubstr("--thresholds DENTIN,ENAMEL")) << top;
  }
}

// The limits leave what is a tooth alone: whole, as a crown, of little contrast, in water.
TEST(Plausibility, TeethPass) {
  const auto volume = [](ScanSource& scan) {
    return remaining_volumes_mm3(voxelize_scan(scan, coarse()));
  };
  const SyntheticScan molar = make_molar_scan(scanner());
  EXPECT_NEAR(volume(*source(molar))[0], 244, 8);
  for (const double bottom : {11.0, 14.0}) {
    const auto crown = crop(source(molar), {Vec3(-5, -5, bottom), Vec3(30, 30, 30)});
    EXPECT_GT(volume(*crown)[0], 200) << bottom;
  }
  SyntheticScanOptions how = scanner();
  how.grey = {-1000, 1900, 1500, 100, 1200};
  EXPECT_NEAR(volume(*source(make_molar_scan(how)))[0], 244, 8);
  how.grey = {0, 2500, 1500, 0, 1200};
  EXPECT_NEAR(volume(*source(make_molar_scan(how)))[0], 244, 8);
}

}  // namespace
}  // namespace toothprep
