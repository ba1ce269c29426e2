// The report's figures on shapes whose enamel thickness is known.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "../../support/phantom.h"
#include "toothprep/tools/segmentation/scan_report.h"

namespace toothprep {
namespace {

// A ball of dentin of radius 2 within a shell of enamel of radius 2 + thickness.
LayeredTooth shell(double thickness, double voxel) {
  const auto sample = [thickness](const Vec3& x) {
    const auto r = static_cast<float>(x.norm());
    const float outer = r - static_cast<float>(2 + thickness), inner = r - 2.0f;
    return ToothSample{outer,
                       {std::max(outer, -inner), inner, 100.f},
                       outer > 0    ? Tissue::kAir
                       : inner <= 0 ? Tissue::kDentin
                                    : Tissue::kEnamel};
  };
  const int half = static_cast<int>((2.5 + thickness) / voxel);
  return build_tooth({Vec3::Constant(voxel / 2), voxel}, Index3::Constant(-half),
                     Index3::Constant(half), sample, true);
}

TEST(ScanReport, EnamelThicknessOfAShellIsItsThickness) {
  for (const double thickness : {0.4, 1.0})
    for (const double voxel : {0.1, 0.05}) {
      const EnamelThickness t = enamel_thickness(shell(thickness, voxel));
      EXPECT_GT(t.points, 1000u);
      EXPECT_NEAR(t.mean, thickness, 0.15 * voxel) << voxel;
      EXPECT_NEAR(t.median, thickness, 0.15 * voxel) << voxel;
      EXPECT_NEAR(t.p95, thickness, 0.4 * voxel);
      EXPECT_NEAR(t.thinnest, thickness, 0.4 * voxel);
    }
}

TEST(ScanReport, WithoutDentinThereIsNoThickness) {
  EXPECT_EQ(
      enamel_thickness(
          build_tooth(
              {Vec3::Zero(), 0.1}, Index3::Constant(-10), Index3::Constant(10),
              [](const Vec3& x) {
                const auto d = static_cast<float>(x.norm() - 0.8);
                return ToothSample{d, {d, 100.f, 100.f}, d < 0 ? Tissue::kEnamel : Tissue::kAir};
              },
              true))
          .points,
      0u);
}

TEST(ScanReport, LeavesItsFilesWithAndWithoutGreys) {
  const LayeredTooth tooth = shell(0.6, 0.1);
  ImageVolume<float> scan;
  scan.size = Index3(40, 40, 40);
  scan.spacing = Vec3::Constant(0.2);
  scan.origin = Vec3::Constant(-4);
  scan.data.assign(64000, 7.f);
  for (const bool greys : {true, false}) {
    const auto folder = std::filesystem::path(TOOTHPREP_BINARY_DIR) / "tests" / "scan-report";
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    VoxelizeReport report;
    if (greys) report.greys = scan;
    write_scan_report(folder.string(), tooth, report, "1.2", "Release");
    EXPECT_EQ(std::filesystem::exists(folder / "histogram.csv"), greys);
    for (const char* file : {"report.json", "slice-x.csv", "slice-y.csv", "slice-z.csv"})
      EXPECT_GT(std::filesystem::file_size(folder / file), 100u) << file;
    std::filesystem::remove_all(folder);
  }
}

// Of a tooth much finer than its scan, the half widths are those of the voxels in which its surfaces were sought.
TEST(ScanReport, SlicesHaveAHalfWidthWhereASurfaceIs) {
  phantom::Scanner scanner;
  const auto scan = phantom::scan_of(phantom::balls(3.5, 2.3, 1.1, Vec3::Zero()),
                                     Vec3::Constant(-6), Vec3::Constant(6), scanner);
  const auto folder = std::filesystem::path(TOOTHPREP_BINARY_DIR) / "tests" / "scan-report-slices";
  for (const double voxel : {0.1, 0.05}) {
    VoxelizeOptions options;
    options.voxel = voxel;
    VoxelizeReport report;
    const LayeredTooth tooth = voxelize_scan(scan, options, &report);
    EXPECT_DOUBLE_EQ(report.uncertainty.voxel_mm, voxel < 0.1 ? 0.12 : 0.1);
    std::filesystem::create_directories(folder);
    write_scan_report(folder.string(), tooth, report, "1.2", "Release");
    std::ifstream slice(folder / "slice-z.csv");
    std::string line;
    std::getline(slice, line);
    EXPECT_EQ(line, "u_mm,v_mm,grey,tissue,half_width_mm");
    std::size_t on_surface = 0;
    while (std::getline(slice, line)) {
      std::array<double, 5> row{};
      std::istringstream fields(line);
      for (double& value : row) {
        std::string field;
        std::getline(fields, field, ',');
        value = std::stod(field);
      }
      const double r = std::hypot(row[0], row[1]), half_width = row[4];
      const double from_surface =
          std::min({std::abs(r - 3.5), std::abs(r - 2.3), std::abs(r - 1.1)});
      if (std::isnan(half_width)) {
        EXPECT_GT(from_surface, 0.3 * voxel);
        continue;
      }
      ++on_surface;
      EXPECT_LT(from_surface, 1.5 * voxel);
      EXPECT_GT(half_width, 0.03);
      EXPECT_LT(half_width, 0.2);
    }
    EXPECT_GT(on_surface, 2 * M_PI * (3.5 + 2.3 + 1.1) / voxel);
    std::filesystem::remove_all(folder);
  }
}

}  // namespace
}  // namespace toothprep
