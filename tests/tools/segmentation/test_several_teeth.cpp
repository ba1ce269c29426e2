// What else may be in a scan: other teeth, metal, greys beyond the scanner's range, Hounsfield
// units.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <vector>

#include "../../support/phantom.h"
#include "../../support/scan_files.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/hounsfield.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

using phantom::Anatomy;
using phantom::Distances;
using phantom::Scanner;

constexpr double kVoxel = 0.14;

VoxelizeOptions coarse() {
  VoxelizeOptions options;
  options.voxel = kVoxel;
  return options;
}

Anatomy moved(const Anatomy& anatomy, const Vec3& by) {
  return [=](const Vec3& x) { return anatomy(x - by); };
}

Anatomy both(const Anatomy& a, const Anatomy& b) {
  return [=](const Vec3& x) {
    const Distances d = a(x), e = b(x);
    return Distances{std::min(d.tooth, e.tooth), std::min(d.core, e.core),
                     std::min(d.pulp, e.pulp)};
  };
}

// Tissues that differ from the truth farther than `slack` mm from its borders, of all voxels.
std::size_t misplaced(const LayeredTooth& tooth, const Anatomy& truth, double slack) {
  std::size_t count = 0;
  for (std::size_t b = 0; b < tooth.tissue.table_size(); ++b)
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = tooth.tissue.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7);
      const Distances d = truth(tooth.lattice.to_world(i));
      if (std::min({std::abs(d.tooth), std::abs(d.core), std::abs(d.pulp)}) < slack) continue;
      count += tooth.tissue.value(i.x(), i.y(), i.z()) !=
               static_cast<std::uint8_t>(phantom::label_at(d));
    }
  return count;
}

TEST(SeveralTeeth, EachCanBeChosenBySizeOrPlaceAndIsThenAlone) {
  // Two crowns 0.9 mm apart, the second with a shorter root; its box holds much of the first.
  const Anatomy large = phantom::peg();
  const Anatomy small = moved(
      [](const Vec3& x) {
        Distances d = phantom::peg()(x);
        d.tooth = std::max(d.tooth, -4 - x.z());
        d.core = std::max(d.core, -4 - x.z());
        return d;
      },
      Vec3(5, 5.3, 0));
  const auto scan =
      phantom::scan_of(both(large, small), Vec3(-4.5, -4.5, -10.5), Vec3(9.5, 9.8, 5.5), Scanner());
  VoxelizeOptions options = coarse();
  VoxelizeReport report;
  EXPECT_EQ(misplaced(voxelize_scan(scan, options, &report), large, 0.3), 0u);
  ASSERT_FALSE(report.notes.empty());
  EXPECT_THAT(report.notes.front(), testing::HasSubstr("2 pieces could be teeth"));
  EXPECT_THAT(report.notes.front(), testing::HasSubstr("number 1 was taken"));
  options.tooth = 2;
  EXPECT_EQ(misplaced(voxelize_scan(scan, options), small, 0.3), 0u);
  options.tooth_at = Vec3(0, 0, 3.8);  // in the first one's enamel
  EXPECT_EQ(misplaced(voxelize_scan(scan, options), large, 0.3), 0u);

  const auto refused = [&](const char* why) {
    try {
      static_cast<void>(voxelize_scan(scan, options));
      FAIL() << "no error";
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), testing::HasSubstr(why));
    }
  };
  options.tooth_at = Vec3(0, 9, 0);
  refused("no tooth within 2 mm");
  options.tooth_at.reset();
  options.tooth = 3;
  refused("there is no tooth 3");
}

// Metal in the peg. Greys end at `clip`.
struct Filling {
  const char* name;
  std::function<double(const Vec3&)>
      distance;  // mm, negative inside; only the part in the tooth counts
  double clip = 0;
  double within = 0.1;    // of its volume
  double voxel = kVoxel;  // mm, of the tooth
};

// What the scanner sees: the greys of what is at each point, blurred; sampled at a fifth of a voxel. Where
// the anatomy's formula holds (away from metal) it is the same.
void put_metal(ImageVolume<float>& scan, const Anatomy& anatomy,
               const std::function<double(const Vec3&)>& metal, double grey,
               const Scanner& scanner) {
  const int fine = 5,
            reach = static_cast<int>(std::ceil(4 * scanner.blur / scanner.spacing * fine));
  std::vector<double> weight(static_cast<std::size_t>(2 * reach + 1));
  double total = 0;
  for (int n = -reach; n <= reach; ++n) {
    const double x = n * scanner.spacing / fine / scanner.blur;
    total += weight[static_cast<std::size_t>(n + reach)] = std::exp(-0.5 * x * x);
  }
  Index3 low = scan.size, high = Index3::Zero();  // voxels that see metal
  std::size_t v = 0;
  for (int k = 0; k < scan.size.z(); ++k)
    for (int j = 0; j < scan.size.y(); ++j)
      for (int i = 0; i < scan.size.x(); ++i, ++v)
        if (metal(scan.to_world(Vec3(i, j, k))) < 4.5 * scanner.blur)
          low = low.cwiseMin(Index3(i, j, k)), high = high.cwiseMax(Index3(i, j, k));
  Index3 size = (high - low) * fine + Index3::Constant(2 * reach + 1);
  const auto at = [&](int i, int j, int k) {
    return (static_cast<std::size_t>(k) * size.y() + j) * size.x() + i;
  };
  std::vector<double> values(static_cast<std::size_t>(size.prod()));
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i) {
        const Vec3 x =
            scan.to_world(low.cast<double>() + (Vec3(i, j, k) - Vec3::Constant(reach)) / fine);
        const Tissue tissue = phantom::label_at(anatomy(x));
        const phantom::Grey& g = scanner.grey;
        values[at(i, j, k)] = tissue == Tissue::kAir      ? g.surroundings
                              : metal(x) < 0              ? grey
                              : tissue == Tissue::kEnamel ? g.enamel
                              : tissue == Tissue::kDentin ? g.dentin
                                                          : g.pulp;
      }
  const Index3 count = high - low + Index3::Ones();
  for (int axis = 0; axis < 3; ++axis) {  // blurred along it, and left where voxels' centres are
    Index3 smaller = size;
    smaller[axis] = count[axis];
    std::vector<double> blurred(static_cast<std::size_t>(smaller.prod()));
    for (int k = 0; k < smaller.z(); ++k)
      for (int j = 0; j < smaller.y(); ++j)
        for (int i = 0; i < smaller.x(); ++i) {
          Index3 from(i, j, k);
          from[axis] *= fine;
          double sum = 0;
          for (const double w : weight) {
            sum += w * values[at(from.x(), from.y(), from.z())];
            ++from[axis];
          }
          blurred[(static_cast<std::size_t>(k) * smaller.y() + j) * smaller.x() + i] = sum / total;
        }
    values = std::move(blurred);
    size = smaller;
  }
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i)
        if (metal(scan.to_world((low + Index3(i, j, k)).cast<double>())) < 4.5 * scanner.blur)
          scan.data[(static_cast<std::size_t>(low.z() + k) * scan.size.y() + low.y() + j) *
                        scan.size.x() +
                    low.x() + i] = static_cast<float>(values[at(i, j, k)]);
}

class Metal : public ::testing::TestWithParam<Filling> {};

TEST_P(Metal, IsOtherOfItsSizeAndHasNoSkinOfEnamel) {
  const Filling& f = GetParam();
  const Anatomy peg = phantom::peg();
  const auto filling = [&](const Vec3& x) { return std::max(f.distance(x), peg(x).tooth); };
  Scanner scanner;
  auto scan = phantom::scan_of(peg, Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5), scanner);
  put_metal(scan, peg, filling, 900, scanner);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.03 * scanner.grey.dentin);
  for (float& grey : scan.data) grey = static_cast<float>(std::min(grey + noise(random), f.clip));
  VoxelizeOptions options;
  options.voxel = f.voxel;
  VoxelizeReport report;
  const LayeredTooth tooth = voxelize_scan(scan, options, &report);
  EXPECT_NEAR(report.dentin, 160, 5);   // not taken for what is below the metal
  EXPECT_NEAR(report.enamel, 235, 12);  // a bin of the wider histogram is 9
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("too bright for enamel")));

  constexpr double kStep = 0.04;  // mm
  std::size_t metal = 0;          // points in it
  for (double x = -3.5; x < 3.5; x += kStep)
    for (double y = -3.5; y < 3.5; y += kStep)
      for (double z = -3.99; z < 5; z += kStep) metal += filling(Vec3(x, y, z)) < 0;
  std::size_t skin = 0, near = 0;
  for (std::size_t b = 0; b < tooth.tissue.table_size(); ++b)
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Index3 i = tooth.tissue.brick_origin(b) + Index3(n >> 6, (n >> 3) & 7, n & 7);
      const Vec3 x = tooth.lattice.to_world(i);
      const double to_metal = filling(x);
      const auto label = static_cast<Tissue>(tooth.tissue.value(i.x(), i.y(), i.z()));
      // Around the filling, in dentin, away from the enamel's edge.
      if (to_metal > 0 && to_metal < 0.6 && peg(x).core < -0.4)
        ++near, skin += label == Tissue::kEnamel;
    }
  const double truth = static_cast<double>(metal) * kStep * kStep * kStep,
               found = remaining_volumes_mm3(
                   tooth)[static_cast<std::size_t>(tissue_index(Tissue::kOther))];
  std::printf("metal %s, %.2f mm3: found %.3f of it, %.4f of the dentin beside it enamel\n", f.name,
              truth, found / truth, static_cast<double>(skin) / static_cast<double>(near));
  std::fflush(stdout);
  EXPECT_NEAR(found, truth, f.within * truth);
  EXPECT_GT(near, 100u);
  EXPECT_LT(static_cast<double>(skin), 0.02 * static_cast<double>(near));
}

std::function<double(const Vec3&)> ball(const Vec3& centre, double radius) {
  return [=](const Vec3& x) { return (x - centre).norm() - radius; };
}

// Of a height from z on, in a shaft of a radius around the peg's axis.
std::function<double(const Vec3&)> disc(double z, double height, double radius) {
  return [=](const Vec3& x) {
    return std::max({x.head<2>().norm() - radius, z - x.z(), x.z() - z - height});
  };
}

INSTANTIATE_TEST_SUITE_P(
    Fillings, Metal,
    ::testing::Values(Filling{"open", ball(Vec3(0, 0, 3.6), 1.1), 1e9},
                      Filling{"open, clipped", ball(Vec3(0, 0, 3.6), 1.1), 500},
                      Filling{"in dentin", ball(Vec3(1.2, 0, -2.5), 1.0), 1e9},
                      Filling{"in dentin, clipped", ball(Vec3(1.2, 0, -2.5), 1.0), 500},
                      Filling{"inlay", disc(2.5, 3, 1.4), 1e9},
                      Filling{"inlay, much finer", disc(2.5, 3, 1.4), 1e9, 0.1, 0.06},
                      Filling{"inlay, clipped", disc(2.5, 3, 1.4), 500},
                      Filling{"disc of 0.6 mm", disc(2.0, 0.6, 1.4), 1e9},
                      Filling{"disc of 0.6 mm, clipped", disc(2.0, 0.6, 1.4), 500, 0.2},
                      Filling{"disc of 0.4 mm", disc(2.0, 0.4, 1.4), 1e9, 0.4}));

TEST(Clipping, IsToldWhereManyVoxelsHaveTheHighestValue) {
  Scanner scanner;
  scanner.noise = 4;
  auto scan =
      phantom::scan_of(phantom::peg(), Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5), scanner);
  VoxelizeReport report;
  static_cast<void>(voxelize_scan(scan, coarse(), &report));
  EXPECT_THAT(report.notes, testing::Not(testing::Contains(testing::HasSubstr("clipped"))));
  for (float& grey : scan.data) grey = std::min(grey, 236.0f);
  static_cast<void>(voxelize_scan(scan, coarse(), &report));
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("clipped")));
}

TEST(Hounsfield, APresetTellsTheClassesAndTheScanTheirBorders) {
  Scanner scanner;
  scanner.grey = {-1000, 1500, 2600, 250};
  const auto scan =
      phantom::scan_of(phantom::peg(), Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5), scanner);
  VoxelizeOptions options = coarse();
  options.typical = {870, 1985};
  VoxelizeReport report;
  EXPECT_EQ(misplaced(voxelize_scan(scan, options, &report), phantom::peg(), 0.3), 0u);
  // Half-way between the scan's own greys, not the preset's.
  EXPECT_NEAR(report.threshold_dentin, 250, 40);
  EXPECT_NEAR(report.threshold_enamel, 2050, 40);
  EXPECT_THAT(report.notes, testing::Not(testing::Contains(testing::HasSubstr("Hounsfield"))));
}

TEST(Hounsfield, GreysWithoutAirAtMinusThousandAreDoubted) {
  Scanner scanner;
  scanner.grey = {0, 1500, 2600, 250};
  const auto scan =
      phantom::scan_of(phantom::peg(), Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5), scanner);
  VoxelizeOptions options = coarse();
  options.typical = {870, 1985};
  VoxelizeReport report;
  static_cast<void>(voxelize_scan(scan, options, &report));
  EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("are these Hounsfield units?")));
}

using HounsfieldFile = ScanFiles;

TEST_F(HounsfieldFile, IsReadStrictly) {
  const std::string good =
      "[[preset]]\nname = \"a\"\npulp_dentin = 800\ndentin_enamel = 1900\ndescription = \"d\"\n"
      "source = \"s\"\n";
  const auto presets = read_hounsfield_presets(write("a.toml", good));
  ASSERT_EQ(presets.size(), 1u);
  EXPECT_EQ(preset_named(presets, "a").dentin_enamel, 1900);
  EXPECT_THROW(preset_named(presets, "b"), Error);
  EXPECT_THROW(read_hounsfield_presets(write("b.toml", good + "other = 1\n")), InputError);
  EXPECT_THROW(read_hounsfield_presets(write("c.toml", "[[preset]]\nname = \"a\"\n")), InputError);
  std::string swapped = good;
  swapped.replace(swapped.find("800"), 3, "2000");
  EXPECT_THROW(read_hounsfield_presets(write("d.toml", swapped)), InputError);
}

// A box of enamel (20) around dentin (30); of bone (5) a plate below.
void put_tooth(ImageVolume<std::uint16_t>& labels, const Index3& low, const Index3& high) {
  for (int k = low.z(); k <= high.z(); ++k)
    for (int j = low.y(); j <= high.y(); ++j)
      for (int i = low.x(); i <= high.x(); ++i) {
        const Index3 at(i, j, k);
        const bool inner =
            (at.array() > low.array() + 2).all() && (at.array() < high.array() - 2).all();
        labels.at(i, j, k) = inner ? 30 : 20;
      }
}

TEST(SeveralTeeth, OfLabelsEachCanBeChosenAndTheListSaysWhereTheyAre) {
  ImageVolume<std::uint16_t> labels;
  labels.size = Index3(60, 24, 30);
  labels.spacing = Vec3::Constant(0.2);
  labels.data.assign(60 * 24 * 30, 0);
  for (int j = 0; j < 24; ++j)
    for (int i = 0; i < 60; ++i) labels.at(i, j, 0) = 5;
  put_tooth(labels, {2, 2, 1}, {27, 21, 26});   // 26 x 20 x 26 voxels: 108 mm3
  put_tooth(labels, {32, 2, 1}, {51, 21, 20});  // 20 x 20 x 20: 64 mm3
  const std::map<std::uint16_t, Tissue> tissues = {
      {20, Tissue::kEnamel}, {30, Tissue::kDentin}, {5, Tissue::kOther}};
  VoxelizeOptions options;
  options.voxel = 0.2;
  const auto volume = [&](VoxelizeReport* report = nullptr) {
    const auto v = remaining_volumes_mm3(voxelize_labels(labels, tissues, options, report));
    return v[0] + v[1];
  };
  EXPECT_NEAR(volume(), 108.16 + 64, 2) << "all that is named, as ever";
  options.one_tooth = true;
  options.tooth = 2;
  VoxelizeReport report;
  EXPECT_NEAR(volume(&report), 64, 1);
  EXPECT_THAT(report.notes,
              ::testing::ElementsAre(::testing::AllOf(
                  ::testing::HasSubstr("took tooth 2 of 2"),
                  ::testing::HasSubstr("1: 108 mm3, centre 2.9,2.3,2.7"),
                  ::testing::HasSubstr("2: 64 mm3, centre 8.3,2.3,2.1, from 6.4,0.4,0.2 to"))));
  options.tooth_at = Vec3(3, 2, 3);
  EXPECT_NEAR(volume(), 108.16, 1.5);
  options.tooth_at = Vec3(3, 2, 90);
  EXPECT_THROW(volume(), Error);
  options.tooth_at.reset();
  options.tooth = 3;
  EXPECT_THROW(volume(), Error);
}

}  // namespace
}  // namespace toothprep
