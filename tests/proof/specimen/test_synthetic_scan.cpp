// The synthetic scan: blur, noise and ground truth are what was asked for.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

constexpr double kFwhmPerSigma = 2.3548200450309493;  // 2 sqrt(2 ln 2)

// Dentin where x < face, air elsewhere.
std::function<ToothSample(const Vec3&)> half_space(double face) {
  return [face](const Vec3& x) {
    const auto d = static_cast<float>(x.x() - face);
    return ToothSample{d, {100.f, d, 100.f}, d < 0 ? Tissue::kDentin : Tissue::kAir};
  };
}

// A scan whose voxel centres lie at whole multiples of 0.1 mm.
SyntheticScanOptions bench_options() {
  SyntheticScanOptions o;
  o.spacing = Vec3::Constant(0.1);
  o.margin = 0;
  o.noise = 0;
  o.blur_fwhm_voxels = 0;
  return o;
}
const Box kBench{Vec3(-2, -0.5, -0.5), Vec3(2, 0.5, 0.5)};

TEST(SyntheticScan, SharpAndQuietItShowsTheGreyValuesThemselves) {
  const auto scan = make_synthetic_scan(half_space(0.05), kBench, bench_options());
  ASSERT_EQ(scan.image.size, Index3(41, 11, 11));
  EXPECT_NEAR((scan.image.to_world(Vec3(20, 5, 5))).norm(), 0, 1e-12);
  for (int i = 0; i < 41; ++i) {
    EXPECT_EQ(scan.image.at(i, 5, 5), i <= 20 ? 1600 : -1000) << i;
    EXPECT_EQ(scan.labels.at(i, 5, 5), i <= 20 ? 2 : 0) << i;
  }
}

TEST(SyntheticScan, MixesGreyValuesByPartialVolume) {
  auto o = bench_options();
  o.supersampling = 10;
  for (const double fraction : {0.2, 0.5, 0.9}) {
    const auto scan = make_synthetic_scan(half_space(-0.05 + 0.1 * fraction), kBench, o);
    // Ten samples across the voxel are right to half a sample of the step of 2600.
    EXPECT_NEAR(scan.image.at(20, 5, 5), -1000 + 2600 * fraction, 2600 / 20.0 + 1) << fraction;
    EXPECT_EQ(scan.image.at(19, 5, 5), 1600);
    EXPECT_EQ(scan.image.at(21, 5, 5), -1000);
  }
}

TEST(SyntheticScan, BlursAnEdgeByThePointSpreadFunction) {
  for (const double fwhm : {0.8, 1.5, 3.0}) {
    auto o = bench_options();
    o.blur_fwhm_voxels = fwhm;
    const auto scan = make_synthetic_scan(half_space(0.05), kBench, o);
    // The face lies between two voxels, so that the differences across it are the line spread
    // function itself. Rounding to integers leaves up to 1/2600 per difference.
    double sum = 0, first = 0, second = 0;
    for (int i = 8; i < 32; ++i) {
      const double w = scan.image.at(i, 5, 5) - scan.image.at(i + 1, 5, 5);
      sum += w;
      first += w * (i + 0.5);
      second += w * (i + 0.5) * (i + 0.5);
    }
    EXPECT_NEAR(sum, 2600, 1);
    EXPECT_NEAR(first / sum, 20.5, 0.01);
    const double sigma = std::sqrt(second / sum - first / sum * first / sum);
    EXPECT_NEAR(sigma * kFwhmPerSigma, fwhm, 0.02 * fwhm);
  }
}

TEST(SyntheticScan, HasWhiteNoiseOfTheDeviationAskedFor) {
  auto o = bench_options();
  o.noise = 50;
  const Box box{Vec3(-3, -3, -3), Vec3(3, 3, 3)};
  const auto scan = make_synthetic_scan(half_space(100), box, o);
  const auto& grey = scan.image.data;
  const double n = static_cast<double>(grey.size());  // 61³
  double mean = 0, variance = 0, beside = 0, above = 0;
  for (const double g : grey) mean += g / n;
  const std::size_t plane = 61 * 61;
  for (std::size_t v = 0; v < grey.size(); ++v) {
    const double d = grey[v] - mean;
    variance += d * d / n;
    if (v + 1 < grey.size()) beside += d * (grey[v + 1] - mean) / n;
    if (v + plane < grey.size()) above += d * (grey[v + plane] - mean) / n;
  }
  // Four standard errors; rounding to integers adds a variance of 1/12.
  EXPECT_NEAR(mean, 1600, 4 * 50 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(variance), std::sqrt(2500 + 1 / 12.0), 4 * 50 / std::sqrt(2 * n));
  EXPECT_NEAR(beside / variance, 0, 4 / std::sqrt(n));
  EXPECT_NEAR(above / variance, 0, 4 / std::sqrt(n));
}

TEST(SyntheticScan, ClipsAsATwelveBitScannerDoes) {
  auto o = bench_options();
  o.noise = 3000;
  const auto scan = make_synthetic_scan(half_space(0), kBench, o);
  const auto [low, high] = std::minmax_element(scan.image.data.begin(), scan.image.data.end());
  EXPECT_EQ(*low, -1024);
  EXPECT_EQ(*high, 3071);
}

TEST(SyntheticScan, RepeatsItselfForASeedAndAnyNumberOfThreads) {
  SyntheticScanOptions o;
  o.spacing = Vec3(0.5, 0.5, 0.6);
  const auto scanned_with = [&](int threads, std::uint64_t seed) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    o.seed = seed;
    return make_molar_scan(o);
  };
  const SyntheticScan one = scanned_with(1, 7), two = scanned_with(2, 7),
                      other = scanned_with(1, 8);
  EXPECT_EQ(one.image.data, two.image.data);
  EXPECT_EQ(one.labels.data, two.labels.data);
  EXPECT_EQ(one.labels.data, other.labels.data);
  EXPECT_NE(one.image.data, other.image.data);
}

TEST(SyntheticScan, ComesWithTheMolarsTrueLabelsInAMarginOfAir) {
  SyntheticScanOptions o;
  o.spacing = Vec3(0.3, 0.35, 0.4);
  o.noise = 0;
  o.blur_fwhm_voxels = 0;
  const SyntheticScan scan = make_molar_scan(o);
  const auto& l = scan.labels;
  EXPECT_EQ(l.origin, scan.image.origin);
  EXPECT_EQ(l.size, scan.image.size);
  std::array<int, 5> count{};
  for (int k = 0; k < l.size.z(); ++k)
    for (int j = 0; j < l.size.y(); ++j)
      for (int i = 0; i < l.size.x(); ++i) {
        const Tissue truth = sample_molar(l.to_world(Vec3(i, j, k))).label;
        ASSERT_EQ(static_cast<Tissue>(l.at(i, j, k)), truth) << i << ' ' << j << ' ' << k;
        ++count[l.at(i, j, k)];
        const Index3 from_end = l.size - Index3::Ones() - Index3(i, j, k);
        if (std::min({i, j, k, from_end.x(), from_end.y(), from_end.z()}) * 0.4 < 1.0) {
          ASSERT_EQ(truth, Tissue::kAir);
          ASSERT_EQ(scan.image.at(i, j, k), -1000);
        }
      }
  for (const int label : {0, 1, 2, 3}) EXPECT_GT(count[label], 100) << label;
}

TEST(SyntheticScan, KeepsTheMeanGreyValueWhatEverTheBlur) {
  SyntheticScanOptions o;
  o.spacing = Vec3::Constant(0.4);
  o.noise = 0;
  o.margin = 5;  // wider than the kernel
  const auto mean_with = [&](double fwhm) {
    o.blur_fwhm_voxels = fwhm;
    const SyntheticScan scan = make_molar_scan(o);
    double sum = 0;
    for (const double g : scan.image.data) sum += g;
    return sum / static_cast<double>(scan.image.data.size());
  };
  EXPECT_NEAR(mean_with(4), mean_with(0), 0.05);
}

TEST(SyntheticScan, RefusesOptionsOutOfRange) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto change) {
    SyntheticScanOptions o;
    change(o);
    EXPECT_THROW(make_molar_scan(o), Error);
  };
  for (const double bad : {0.0, -1.0, 0.001, 10.0, nan})
    refused([&](SyntheticScanOptions& o) { o.spacing.y() = bad; });
  refused([](SyntheticScanOptions& o) { o.spacing.setConstant(0.01); });  // too many voxels
  for (const double bad : {-1.0, 1e3, nan}) {
    refused([&](SyntheticScanOptions& o) { o.blur_fwhm_voxels = bad; });
    refused([&](SyntheticScanOptions& o) { o.margin = bad; });
  }
  for (const double bad : {-1.0, 1e9, nan})
    refused([&](SyntheticScanOptions& o) { o.noise = bad; });
  for (const int bad : {0, 1000}) refused([&](SyntheticScanOptions& o) { o.supersampling = bad; });
  refused([](SyntheticScanOptions& o) { o.highest = 1e6; });
  refused([&](SyntheticScanOptions& o) { o.grey[2] = nan; });
}

}  // namespace
}  // namespace toothprep
