#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "../../support/phantom.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

using phantom::Anatomy;
using phantom::Distances;
using phantom::Scanner;

template <class Visit>  // visit(index, world position) for every voxel of the tooth's box
void for_each_voxel(const LayeredTooth& tooth, const Visit& visit) {
  for (std::size_t b = 0; b < tooth.tissue.table_size(); ++b) {
    const Index3 first = tooth.tissue.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
      visit(i, tooth.lattice.to_world(i));
    }
  }
}

template <class Grid>
auto value(const Grid& grid, const Index3& i) {
  return grid.value(i.x(), i.y(), i.z());
}

struct Overlap {
  std::array<double, 3> dice{};         // enamel, dentin, pulp
  std::array<std::size_t, 3> voxels{};  // of the truth
};

Overlap overlap(const LayeredTooth& tooth, const Anatomy& anatomy) {
  std::array<std::size_t, 3> both{}, truth{}, found{};
  for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
    const int t = static_cast<int>(phantom::label_at(anatomy(x))) - 1;
    const int f = static_cast<int>(value(tooth.tissue, i)) - 1;
    if (t >= 0) ++truth[t];
    if (f >= 0 && f < 3) ++found[f];
    if (t >= 0 && t == f) ++both[t];
  });
  Overlap o;
  for (int k = 0; k < 3; ++k)
    o.dice[k] = 2.0 * static_cast<double>(both[k]) / static_cast<double>(truth[k] + found[k]);
  o.voxels = truth;
  return o;
}

// Voxels that are wrong and farther than `slack` mm from every border of the truth: false skins,
// shells and islands, as opposed to a border that is a little off.
std::size_t misplaced(const LayeredTooth& tooth, const Anatomy& anatomy, double slack) {
  std::size_t count = 0;
  for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
    const Distances d = anatomy(x);
    if (std::min({std::abs(d.tooth), std::abs(d.core), std::abs(d.pulp)}) < slack) return;
    count += value(tooth.tissue, i) != static_cast<std::uint8_t>(phantom::label_at(d));
  });
  return count;
}

// Most tests need no finer lattice, and time grows with its voxels.
constexpr double kVoxel = 0.14;
VoxelizeOptions coarse() {
  VoxelizeOptions options;
  options.voxel = kVoxel;
  return options;
}

const Vec3 kPegLow(-4.5, -4.5, -10.5), kPegHigh(4.5, 4.5, 5.5);

LayeredTooth peg_tooth(const Scanner& scanner, double voxel = kVoxel,
                       const Anatomy& anatomy = phantom::peg()) {
  VoxelizeOptions options;
  options.voxel = voxel;
  return voxelize_scan(phantom::scan_of(anatomy, kPegLow, kPegHigh, scanner), options);
}

struct BallCase {
  const char* name;
  double pulp_grey, blur, noise, voxel;
  double tolerance;  // of surfaces, in scan voxels
};

class BlurredBall : public testing::TestWithParam<BallCase> {};

TEST_P(BlurredBall, HasItsThreeSurfacesInPlaceAsSignedDistances) {
  const BallCase& c = GetParam();
  Scanner scanner;
  scanner.blur = c.blur;
  scanner.noise = c.noise;
  scanner.grey.pulp = c.pulp_grey;
  const Vec3 centre(10.03, -20.07, 5.01);
  const double outer = 3.5, core = 2.3, pulp = 1.1;
  const auto scan =
      phantom::scan_of(phantom::balls(outer, core, pulp, centre), centre - Vec3::Constant(6),
                       centre + Vec3::Constant(6), scanner);
  VoxelizeOptions options;
  options.voxel = c.voxel;
  VoxelizeReport report;
  const LayeredTooth tooth = voxelize_scan(scan, options, &report);
  EXPECT_NEAR(report.dentin, 160, 5);
  EXPECT_NEAR(report.enamel, 235, 5);
  EXPECT_NEAR(report.surroundings, 80, 5);

  const double band = 0.9 * tooth.band(), tolerance = c.tolerance * scanner.spacing;
  double worst_slope = 0;
  std::array<double, 4> worst{}, sum{};
  std::array<std::size_t, 4> count{};
  for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
    const double r = (x - centre).norm();
    const std::array<double, 4> truth = {r - outer, std::max(r - outer, core - r),
                                         std::max(r - core, pulp - r), r - pulp};
    for (int g = 0; g < 4; ++g) {
      if (std::abs(truth[g]) > band) continue;
      const double error =
          (g == 0 ? value(tooth.solid, i) : value(tooth.remains[g - 1], i)) - truth[g];
      worst[g] = std::max(worst[g], std::abs(error));
      sum[g] += error;
      ++count[g];
    }
    if (std::abs(truth[0]) < 0.6 * tooth.band()) {
      Vec3 gradient;
      for (int a = 0; a < 3; ++a)
        gradient[a] =
            (value(tooth.solid, i + Index3::Unit(a)) - value(tooth.solid, i - Index3::Unit(a))) /
            (2 * c.voxel);
      worst_slope = std::max(worst_slope, std::abs(gradient.norm() - 1));
    }
  });
  for (int g = 0; g < 4; ++g) {
    EXPECT_GT(count[g], 500u);
    EXPECT_LT(worst[g], tolerance) << "level set " << g;
    // On average borders are placed far better than in the worst voxel. What remains is curvature:
    // a blur of sigma moves the half-way surface of a ball of radius R by about sigma^2 / R.
    EXPECT_LT(std::abs(sum[g]) / static_cast<double>(count[g]),
              0.3 * tolerance + scanner.blur * scanner.blur / pulp)
        << "level set " << g;
  }
  // Central differences of a distance across two voxels: 1 but for the facets, plus the noise.
  EXPECT_LT(worst_slope, c.noise > 0 ? 0.25 : 0.08);
}

INSTANTIATE_TEST_SUITE_P(
    Cases, BlurredBall,
    testing::Values(BallCase{"PulpDarkerThanSurroundings", 20, 0.14, 0, 0.14, 0.15},
                    BallCase{"PulpAsSurroundings", 80, 0.14, 0, 0.14, 0.15},
                    BallCase{"PulpBrighterThanSurroundings", 115, 0.14, 0, 0.14, 0.15},
                    BallCase{"SharpScan", 20, 0.08, 0, 0.14, 0.2},
                    BallCase{"BlurOverTwoVoxels", 20, 0.2, 0, 0.14, 0.15},
                    BallCase{"FineLattice", 20, 0.14, 0, 0.1, 0.15},
                    BallCase{"MuchFinerThanTheScan", 20, 0.14, 0, 0.05, 0.15},
                    BallCase{"MuchFinerThanASharpScan", 20, 0.08, 0, 0.05, 0.2},
                    BallCase{"CoarseLattice", 20, 0.14, 0, 0.3, 0.3},
                    BallCase{"Noise", 20, 0.14, 6, 0.14, 0.5}),
    [](const auto& test) { return std::string(test.param.name); });

struct PegCase {
  const char* name;
  double pulp_grey, noise, voxel, spacing;
  double dice;
};

class PegTooth : public testing::TestWithParam<PegCase> {};

TEST_P(PegTooth, IsACapOverDentinWithPulpInside) {
  const PegCase& c = GetParam();
  Scanner scanner;
  scanner.grey.pulp = c.pulp_grey;
  scanner.noise = c.noise;
  scanner.spacing = c.spacing;
  scanner.blur = 0.7 * c.spacing;
  const LayeredTooth tooth = peg_tooth(scanner, c.voxel);
  const Overlap o = overlap(tooth, phantom::peg());
  for (int k = 0; k < 3; ++k) {
    EXPECT_GT(o.dice[k], k == 2 ? c.dice - 0.03 : c.dice) << kTissueNames[k];
    // Volumes by level set against the truth's voxels.
    const double truth = static_cast<double>(o.voxels[k]) * std::pow(c.voxel, 3);
    EXPECT_NEAR(remaining_volumes_mm3(tooth)[k] / truth, 1, k == 2 ? 0.08 : 0.025)
        << kTissueNames[k];
  }
  EXPECT_EQ(misplaced(tooth, phantom::peg(), 1.5 * std::max(c.voxel, c.spacing)), 0u);

  const auto volumes = remaining_volumes_mm3(tooth);
  const double solid = volume_mm3(tooth.solid, c.voxel);
  EXPECT_NEAR((volumes[0] + volumes[1] + volumes[2]) / solid, 1, 0.005);
  EXPECT_EQ(volumes[3], 0);
}

INSTANTIATE_TEST_SUITE_P(
    Cases, PegTooth,
    testing::Values(PegCase{"PulpDarkerThanSurroundings", 20, 0, kVoxel, 0.2, 0.97},
                    PegCase{"PulpAsSurroundings", 80, 0, kVoxel, 0.2, 0.97},
                    PegCase{"PulpBrighterThanSurroundings", 110, 0, kVoxel, 0.2, 0.97},
                    PegCase{"Noise", 20, 8, kVoxel, 0.2, 0.96},
                    PegCase{"StrongNoise", 20, 16, kVoxel, 0.2, 0.95},
                    PegCase{"FineLattice", 20, 3, 0.1, 0.2, 0.97},
                    PegCase{"MuchFinerThanTheScan", 20, 3, 0.06, 0.2, 0.97},
                    PegCase{"CoarseLattice", 20, 3, 0.25, 0.12, 0.94}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(Voxelize, LabelsAgreeWithTheSignsOfTheLevelSets) {
  Scanner scanner;
  scanner.noise = 5;
  for (const double voxel : {kVoxel, 0.06}) {
    const LayeredTooth tooth = peg_tooth(scanner, voxel);
    for_each_voxel(tooth, [&](const Index3& i, const Vec3&) {
      const auto label = value(tooth.tissue, i);
      ASSERT_EQ(label != 0, value(tooth.solid, i) < 0);
      for (std::uint8_t k = 1; k <= 3; ++k)
        ASSERT_EQ(label == k, value(tooth.remains[k - 1], i) < 0) << int{k};
    });
  }
}

TEST(Voxelize, NoDentinSkinLiesOnTheEnamelNorEnamelOnTheRoot) {
  // Where the blurred border of enamel and air passes through dentin's grey: everything just below
  // the cap's surface, away from the cervix, must be enamel; just below the root's surface, dentin.
  Scanner scanner;
  scanner.noise = 4;
  for (const double blur : {0.08, 0.14, 0.2, 0.25}) {
    scanner.blur = blur;
    const LayeredTooth tooth = peg_tooth(scanner);
    std::size_t skin = 0;
    for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
      const Distances d = phantom::peg()(x);
      const auto label = static_cast<Tissue>(value(tooth.tissue, i));
      if (d.tooth > -0.5 && label != Tissue::kAir) {
        if (x.z() > 0.5) skin += label != Tissue::kEnamel;
        if (x.z() < -0.5) skin += label != Tissue::kDentin;
      }
      // And no shell of enamel around the pulp.
      if (d.pulp < 0.5) skin += label == Tissue::kEnamel;
    });
    EXPECT_EQ(skin, 0u) << "blur " << blur;
  }
}

TEST(Voxelize, TheSurfaceLiesAtTheHalfWayGreyOfTheTissueUnderIt) {
  // One threshold for both would lie sigma * 0.57 outside enamel (80 + 40 of 155: Phi^-1(0.26) =
  // -0.65 sigma).
  Scanner scanner;
  scanner.blur = 0.2;
  const LayeredTooth tooth = peg_tooth(scanner);
  double enamel = 0, dentin = 0;
  std::size_t enamel_count = 0, dentin_count = 0;
  for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
    const double d = phantom::peg()(x).tooth;
    if (std::abs(d) > 0.14) return;
    const double error = value(tooth.solid, i) - d;
    if (x.z() > 0.6) enamel += error, ++enamel_count;
    if (x.z() < -0.6) dentin += error, ++dentin_count;
  });
  EXPECT_NEAR(enamel / static_cast<double>(enamel_count), 0, 0.015);
  EXPECT_NEAR(dentin / static_cast<double>(dentin_count), 0, 0.015);
}

TEST(Voxelize, AnOpenApexDoesNotEmptyTheChamber) {
  Scanner scanner;
  scanner.spacing = 0.12;
  for (const double pulp_grey : {20.0, 80.0}) {
    scanner.grey.pulp = pulp_grey;
    const Anatomy open = phantom::peg(-12);
    const LayeredTooth tooth = peg_tooth(scanner, 0.1, open);
    const Overlap o = overlap(tooth, open);
    EXPECT_GT(o.dice[2], 0.9) << pulp_grey;
    EXPECT_GT(o.dice[1], 0.97) << pulp_grey;
  }
}

TEST(Voxelize, AFissureIsOutsideAndNotPulp) {
  // A slot of 0.4 mm, 1.5 mm deep, across the top of the cap (narrower than the canal that is
  // bridged).
  const auto slotted = [](const Vec3& x) {
    Distances d = phantom::peg()(x);
    const double slot = std::max(std::abs(x.x()) - 0.2, 2.7 - x.z());
    d.tooth = std::max(d.tooth, -slot);
    d.core = std::max(d.core, d.tooth);
    return d;
  };
  Scanner scanner;
  scanner.spacing = 0.1;
  scanner.blur = 0.06;
  const LayeredTooth tooth = peg_tooth(scanner, 0.1, slotted);
  std::size_t open = 0;
  for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
    if (x.z() < 2) return;
    const auto label = static_cast<Tissue>(value(tooth.tissue, i));
    EXPECT_NE(label, Tissue::kPulp) << x.transpose();
    if (std::abs(x.x()) < 0.06 && x.z() > 3 && x.z() < 3.7 && std::abs(x.y()) < 1)
      open += label == Tissue::kAir;
  });
  EXPECT_GT(open, 50u);
}

TEST(Voxelize, KeepsOnlyTheToothAmongOtherThings) {
  // A smaller bright crumb beside the tooth.
  Scanner scanner;
  auto scan = phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, scanner);
  for (int k = 60; k < 66; ++k)
    for (int j = 2; j < 8; ++j)
      for (int i = 2; i < 8; ++i) scan.at(i, j, k) = 230;
  const LayeredTooth with = voxelize_scan(scan, coarse());
  EXPECT_EQ(misplaced(with, phantom::peg(), 0.3), 0u);
}

TEST(Voxelize, StandsInTheSamePlaceWhateverTheAxesOfTheScan) {
  Scanner scanner;
  const auto scan = phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, scanner);
  const LayeredTooth tooth = voxelize_scan(scan, coarse());
  // The same voxels stored with x and z exchanged and y backwards.
  ImageVolume<float> turned;
  turned.size = Index3(scan.size.z(), scan.size.y(), scan.size.x());
  turned.spacing = scan.spacing;
  turned.direction.col(0) = Vec3::UnitZ();
  turned.direction.col(1) = -Vec3::UnitY();
  turned.direction.col(2) = Vec3::UnitX();
  turned.origin = scan.to_world(Vec3(0, scan.size.y() - 1, 0));
  turned.data.resize(scan.data.size());
  for (int k = 0; k < turned.size.z(); ++k)
    for (int j = 0; j < turned.size.y(); ++j)
      for (int i = 0; i < turned.size.x(); ++i)
        turned.at(i, j, k) = scan.at(k, scan.size.y() - 1 - j, i);
  const LayeredTooth again = voxelize_scan(turned, coarse());
  double worst = 0;
  for_each_voxel(tooth, [&](const Index3& i, const Vec3&) {
    worst = std::max<double>(worst, std::abs(value(tooth.solid, i) - value(again.solid, i)));
  });
  EXPECT_LT(worst, 0.002);  // mm; rounding only

  // A scan with oblique axes samples other points: equal to within its accuracy.
  scanner.direction = (Eigen::AngleAxisd(0.5, Vec3(1, 2, -1).normalized())).toRotationMatrix();
  const LayeredTooth oblique = peg_tooth(scanner);
  const Overlap o = overlap(oblique, phantom::peg());
  EXPECT_GT(o.dice[0], 0.97);
  EXPECT_GT(o.dice[1], 0.97);
  EXPECT_EQ(misplaced(oblique, phantom::peg(), 0.3), 0u);
}

TEST(Voxelize, GivesTheSameBitsWhateverTheThreads) {
  Scanner scanner;
  scanner.noise = 8;
  const auto scan = phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, scanner);
  for (const double voxel : {kVoxel, 0.06}) {
    VoxelizeOptions options;
    options.voxel = voxel;
    std::vector<std::string> hashes;
    for (const std::size_t threads : {1, 3, 4}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      hashes.push_back(tooth_sha256(voxelize_scan(scan, options)));
    }
    EXPECT_EQ(hashes[0], hashes[1]);
    EXPECT_EQ(hashes[0], hashes[2]);
  }
}

TEST(Voxelize, TakesGivenThresholdsAsTheyAre) {
  Scanner scanner;
  scanner.blur = 0.2;
  const auto scan = phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, scanner);
  const double automatic = volume_mm3(voxelize_scan(scan, coarse()).solid, kVoxel);
  VoxelizeOptions options = coarse();
  options.thresholds = {100, 197.5};
  const LayeredTooth low = voxelize_scan(scan, options);
  EXPECT_EQ(low.provenance.at("threshold_dentin"), "100");
  EXPECT_EQ(low.provenance.at("threshold_enamel"), "197.5");
  // At a quarter of the contrast over dentin the surface moves out by 0.674 sigma there (root of
  // radius 3.2 from -9.2 to 0); over enamel it stays at its own half-way grey.
  const double root_area = 2 * M_PI * 3.2 * 3.2 + 2 * M_PI * 3.2 * 6;
  EXPECT_NEAR(volume_mm3(low.solid, kVoxel) - automatic, 0.674 * 0.2 * root_area,
              0.15 * 0.2 * root_area);
}

TEST(Voxelize, AToothCutOffByTheScanEndsThereAndSaysSo) {
  Scanner scanner;
  VoxelizeReport report;
  const auto cut = phantom::scan_of(phantom::peg(-12), Vec3(-4.5, -4.5, -4), kPegHigh, scanner);
  for (const double voxel : {kVoxel, 0.05}) {
    VoxelizeOptions options;
    options.voxel = voxel;
    const LayeredTooth tooth = voxelize_scan(cut, options, &report);
    EXPECT_THAT(report.notes, testing::Contains(testing::HasSubstr("border of the scan")));
    // The last slice's voxels end half a voxel below their centres.
    EXPECT_NEAR(bounds_of_solid(tooth).min.z(), cut.origin.z() - 0.1, std::max(voxel, 0.12));
    EXPECT_GT(remaining_volumes_mm3(tooth)[tissue_index(Tissue::kPulp)], 5);
  }
}

std::string refusal(const ImageVolume<float>& scan, const VoxelizeOptions& options = {}) {
  try {
    static_cast<void>(voxelize_scan(scan, options));
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(Voxelize, RefusesWhatIsNoTooth) {
  ImageVolume<float> scan;
  scan.size = Index3(48, 48, 48);
  scan.spacing = Vec3::Constant(0.15);
  scan.data.assign(48 * 48 * 48, 80.0f);
  EXPECT_THAT(refusal(scan), testing::HasSubstr("the image is flat"));

  std::mt19937 random(3);
  std::normal_distribution<float> normal(80, 10);
  for (float& v : scan.data) v = normal(random);
  EXPECT_THAT(refusal(scan),
              testing::HasSubstr("no tooth can be distinguished from its surroundings"));

  for (std::size_t v = 0; v < scan.data.size(); ++v) scan.data[v] = static_cast<float>(v % 48);
  EXPECT_THAT(refusal(scan), testing::HasSubstr("no tooth can be distinguished"));

  // Labels where greys are expected.
  for (std::size_t v = 0; v < scan.data.size(); ++v) scan.data[v] = static_cast<float>(v / 30000);
  EXPECT_THAT(refusal(scan), testing::HasSubstr("0, 1, 2, 3, which looks like a segmentation"));

  // One material only.
  Scanner one;
  one.grey.enamel = one.grey.pulp = one.grey.dentin;
  EXPECT_THAT(refusal(phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, one)),
              testing::HasSubstr("--thresholds"));
}

TEST(Voxelize, RefusesOptionsThatCannotBe) {
  const auto scan = phantom::scan_of(phantom::peg(), kPegLow, kPegHigh, {});
  VoxelizeOptions options;
  options.thresholds = {200, 100};
  EXPECT_THAT(refusal(scan, options), testing::HasSubstr("DENTIN must be below ENAMEL"));
  options.thresholds = {1000, 2000};
  EXPECT_THAT(refusal(scan, options), testing::HasSubstr("the scan's grey values lie in"));
  options.thresholds = {NAN, 100};
  EXPECT_THAT(refusal(scan, options), testing::HasSubstr("DENTIN must be below ENAMEL"));
  options = {};
  options.voxel = 0.002;
  EXPECT_THAT(refusal(scan, options), testing::AllOf(testing::HasSubstr("more than 2^29"),
                                                     testing::HasSubstr("--voxel-mm")));
  options.voxel = 0;
  EXPECT_THAT(refusal(scan, options), testing::HasSubstr("voxel size must lie in"));
  // Placeholder spacing makes a tooth of 90 mm.
  auto wrong = scan;
  wrong.spacing = Vec3::Ones();
  options.voxel = 0.05;
  EXPECT_THAT(refusal(wrong, options), testing::HasSubstr("--spacing-mm"));
}

// ---- Labels

ImageVolume<std::uint16_t> labels_of(const Anatomy& anatomy, const Vec3& low, const Vec3& high,
                                     double spacing, const Mat3& direction = Mat3::Identity()) {
  Scanner grid;
  grid.spacing = spacing;
  grid.direction = direction;
  const auto scan = phantom::scan_of(anatomy, low, high, grid);
  ImageVolume<std::uint16_t> labels;
  labels.size = scan.size;
  labels.spacing = scan.spacing;
  labels.origin = scan.origin;
  labels.direction = scan.direction;
  labels.data.resize(scan.data.size());
  constexpr std::array<std::uint16_t, 4> kValues = {0, 20, 30, 7};  // air, enamel, dentin, pulp
  for (int k = 0; k < scan.size.z(); ++k)
    for (int j = 0; j < scan.size.y(); ++j)
      for (int i = 0; i < scan.size.x(); ++i)
        labels.at(i, j, k) = kValues[static_cast<std::size_t>(
            phantom::label_at(anatomy(scan.to_world(Vec3(i, j, k)))))];
  return labels;
}

const std::map<std::uint16_t, Tissue> kLabelMap = {
    {20, Tissue::kEnamel}, {30, Tissue::kDentin}, {7, Tissue::kPulp}};

TEST(VoxelizeLabels, KeepsTheVolumeOfEachLabel) {
  // Finer, equal, coarser and incommensurable lattices.
  for (const auto& [spacing, voxel] :
       std::vector<std::pair<double, double>>{{0.07, 0.14}, {0.1, 0.1}, {0.15, 0.1}, {0.17, 0.2}}) {
    const auto labels = labels_of(phantom::peg(), kPegLow, kPegHigh, spacing);
    VoxelizeOptions options;
    options.voxel = voxel;
    const LayeredTooth tooth = voxelize_labels(labels, kLabelMap, options);
    for (const auto& [label, tissue] : kLabelMap) {
      const double input =
          static_cast<double>(std::count(labels.data.begin(), labels.data.end(), label)) *
          std::pow(spacing, 3);
      // The canal is 0.7 mm wide: a few voxels, over which a level set's volume is less exact.
      EXPECT_NEAR(remaining_volumes_mm3(tooth)[tissue_index(tissue)] / input, 1,
                  tissue == Tissue::kPulp ? 0.03 : 0.01)
          << label << " spacing " << spacing << " voxel " << voxel;
    }
  }
}

TEST(VoxelizeLabels, GivesSmoothSurfacesFromSteps) {
  // A ball of labels, oblique axes: the surface is the ball's to a fraction of the segmentation's
  // voxel.
  const double spacing = 0.15, radius = 4;
  const Mat3 turn = Eigen::AngleAxisd(0.7, Vec3(1, 1, 3).normalized()).toRotationMatrix();
  for (const Mat3& direction : {Mat3(Mat3::Identity()), turn}) {
    const auto labels = labels_of(phantom::balls(radius, 2.8, 1.2), Vec3::Constant(-5.5),
                                  Vec3::Constant(5.5), spacing, direction);
    const LayeredTooth tooth = voxelize_labels(labels, kLabelMap, coarse());
    double worst = 0, sum = 0;
    std::size_t count = 0;
    for_each_voxel(tooth, [&](const Index3& i, const Vec3& x) {
      const double d = x.norm() - radius;
      if (std::abs(d) > 0.2) return;
      const double error = value(tooth.solid, i) - d;
      worst = std::max(worst, std::abs(error));
      sum += error;
      ++count;
    });
    EXPECT_LT(worst, 0.6 * spacing);  // half a voxel is what the labels themselves lose
    EXPECT_LT(std::abs(sum) / static_cast<double>(count), 0.03 * spacing);
  }
}

TEST(VoxelizeLabels, LeavesUnnamedValuesEmptyAndTakesOther) {
  const auto labels = labels_of(phantom::peg(), kPegLow, kPegHigh, 0.15);
  const LayeredTooth hollow =
      voxelize_labels(labels, {{20, Tissue::kEnamel}, {30, Tissue::kDentin}}, coarse());
  EXPECT_EQ(remaining_volumes_mm3(hollow)[tissue_index(Tissue::kPulp)], 0);
  const Index3 chamber = hollow.lattice.to_index(Vec3::Zero()).array().round().cast<int>();
  EXPECT_EQ(value(hollow.tissue, chamber), 0);
  const LayeredTooth filled = voxelize_labels(
      labels, {{20, Tissue::kEnamel}, {30, Tissue::kDentin}, {7, Tissue::kOther}}, coarse());
  EXPECT_EQ(value(filled.tissue, chamber), static_cast<std::uint8_t>(Tissue::kOther));
  EXPECT_LT(value(filled.solid, chamber), 0);
  EXPECT_GT(value(filled.remains[tissue_index(Tissue::kDentin)], chamber), 0);
  EXPECT_GT(remaining_volumes_mm3(filled)[tissue_index(Tissue::kOther)], 5);
}

TEST(VoxelizeLabels, RefusesALabelThatDoesNotOccur) {
  const auto labels = labels_of(phantom::peg(), kPegLow, kPegHigh, 0.3);
  try {
    static_cast<void>(voxelize_labels(labels, {{20, Tissue::kEnamel}, {3, Tissue::kDentin}}, {}));
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("the value 3 for dentin does not occur"));
    EXPECT_THAT(e.what(), testing::HasSubstr("0, 7, 20, 30"));
  }
  EXPECT_THROW(static_cast<void>(voxelize_labels(labels, {}, {})), Error);
}

}  // namespace
}  // namespace toothprep
