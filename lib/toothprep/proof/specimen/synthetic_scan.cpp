#include "toothprep/proof/specimen/synthetic_scan.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kMostVoxels = 536870912.0;  // 2^29

void check(const SyntheticScanOptions& o, const Box& bounds) {
  const auto require = [](bool ok, const char* what) {
    if (!ok) throw Error(std::string("synthetic scan: ") + what);
  };
  require(o.spacing.allFinite() && o.spacing.minCoeff() >= 0.01 && o.spacing.maxCoeff() <= 5,
          "the spacing must lie in [0.01, 5] mm");
  require(o.blur_fwhm_voxels >= 0 && o.blur_fwhm_voxels <= 20,
          "the blur must lie in [0, 20] voxels");
  require(o.noise >= 0 && o.noise <= 1e4, "the noise must lie in [0, 10000] grey values");
  require(o.margin >= 0 && o.margin <= 50, "the margin must lie in [0, 50] mm");
  require(o.supersampling >= 1 && o.supersampling <= 10, "the supersampling must lie in [1, 10]");
  require(o.lowest >= -32768 && o.highest <= 32767 && o.lowest < o.highest,
          "the grey values' range must be ordered and fit 16 bits");
  for (const double g : o.grey) require(std::isfinite(g), "grey values must be finite");
  require(
      bounds.min.allFinite() && bounds.max.allFinite() && (bounds.max - bounds.min).minCoeff() > 0,
      "the bounds must be finite and hold a volume");
}

// The Gaussian kernel for sampled signals (Lindeberg 1990): weights exp(-t) I_k(t) with variance
// exactly t = sigma², also where a sampled Gaussian would be too coarse. weights[k] for the offsets
// +-k.
std::vector<double> discrete_gaussian(double sigma) {
  const double t = sigma * sigma;
  std::vector<double> weights;
  for (int k = 0; k <= std::ceil(5 * sigma) + 2; ++k)
    weights.push_back(std::exp(-t) * std::cyl_bessel_i(k, t));
  double sum = weights[0];
  for (std::size_t k = 1; k < weights.size(); ++k) sum += 2 * weights[k];
  for (double& w : weights) w /= sum;
  return weights;
}

// Convolves every line along `axis`; beyond the image its last value goes on.
void convolve(std::vector<float>& data, const Index3& size, int axis,
              const std::vector<double>& weights) {
  const std::array<std::ptrdiff_t, 3> stride = {1, size.x(),
                                                static_cast<std::ptrdiff_t>(size.x()) * size.y()};
  const int b = axis == 0 ? 1 : 0, c = axis == 2 ? 1 : 2, n = size[axis];
  const auto radius = static_cast<int>(weights.size()) - 1;
  tbb::parallel_for(0, size[c], [&](int k) {
    std::vector<double> line(n + 2 * radius);
    for (int j = 0; j < size[b]; ++j) {
      float* start = data.data() + k * stride[c] + j * stride[b];
      for (int i = 0; i < n; ++i) line[i + radius] = start[i * stride[axis]];
      std::fill_n(line.begin(), radius, line[radius]);
      std::fill_n(line.end() - radius, radius, line[radius + n - 1]);
      for (int i = 0; i < n; ++i) {
        double sum = weights[0] * line[i + radius];
        for (int w = 1; w <= radius; ++w)
          sum += weights[w] * (line[i + radius - w] + line[i + radius + w]);
        start[i * stride[axis]] = static_cast<float>(sum);
      }
    }
  });
}

// SplitMix64's output function: a counter-based generator, so that a voxel's noise is its own.
std::uint64_t scramble(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// A standard normal number per counter (Box and Muller); std::normal_distribution differs between
// standard libraries.
double standard_normal(std::uint64_t seed, std::uint64_t counter) {
  const std::uint64_t key = scramble(scramble(seed) ^ counter);
  const auto unit = [](std::uint64_t bits) {  // in (0, 1)
    return (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53;
  };
  const double radius = std::sqrt(-2 * std::log(unit(key)));
  return radius * std::cos(2 * units::kPi * unit(scramble(key)));
}

}  // namespace

SyntheticScan make_synthetic_scan(const std::function<ToothSample(const Vec3&)>& sample,
                                  const Box& bounds, const SyntheticScanOptions& o) {
  check(o, bounds);
  const Vec3 low = bounds.min - Vec3::Constant(o.margin);
  const Vec3 extent = bounds.max + Vec3::Constant(o.margin) - low;
  const Vec3 counts =
      (extent.cwiseQuotient(o.spacing).array() - 1e-9).ceil().matrix() + Vec3::Ones();
  if (counts.prod() > kMostVoxels)
    throw Error("synthetic scan: more than 2^29 voxels; use a larger spacing or a smaller margin");
  SyntheticScan scan;
  auto& labels = scan.labels;
  labels.size = counts.cast<int>();
  labels.spacing = o.spacing;
  labels.origin = low;
  const std::size_t voxels = static_cast<std::size_t>(counts.prod());
  labels.data.assign(voxels, 0);
  std::vector<float> grey(voxels, 0);

  // A block, be it a single voxel, is one tissue when its middle is far enough from every surface; else its
  // eighths are looked at. The factor is for distances that are not exact far from a surface.
  constexpr double kCaution = 2.0;
  constexpr int kBlock = 8;
  const auto uniform = [&](const ToothSample& s, double radius) {
    const double far = kCaution * radius;
    return std::abs(s.solid) > far &&
           (s.solid > 0 || std::all_of(s.tissue.begin(), s.tissue.end(),
                                       [far](float d) { return std::abs(d) > far; }));
  };
  const auto grey_of = [&](Tissue t) { return o.grey[static_cast<std::size_t>(t)]; };
  const int n = o.supersampling;
  const auto mean_around = [&](const Vec3& centre) {
    std::array<int, kTissueCount + 1> hits{};
    for (int v = 0; v < n * n * n; ++v) {
      const Vec3 offset = Index3(v % n, v / n % n, v / n / n).cast<double>();
      const Vec3 within = (offset + Vec3::Constant(0.5)) / n - Vec3::Constant(0.5);
      ++hits[static_cast<std::size_t>(sample(centre + o.spacing.cwiseProduct(within)).label)];
    }
    return std::inner_product(hits.begin(), hits.end(), o.grey.begin(), 0.0) / (n * n * n);
  };
  const double voxel_radius = o.spacing.norm() / 2;
  const auto fill = [&](const auto& fill_part, const Index3& first, int edge) -> void {
    const Index3 last = (first + Index3::Constant(edge)).cwiseMin(labels.size);
    if ((first.array() >= last.array()).any()) return;
    const Vec3 middle = labels.to_world((first + last - Index3::Ones()).cast<double>() / 2);
    const ToothSample s = sample(middle);
    const bool one = uniform(s, (edge - 1.0 / n) * voxel_radius);  // to the farthest point
    if (!one && edge > 1) {
      for (int part = 0; part < 8; ++part)
        fill_part(fill_part, first + edge / 2 * Index3(part & 1, part >> 1 & 1, part >> 2),
                  edge / 2);
      return;
    }
    const double mean = one || n == 1 ? grey_of(s.label) : mean_around(middle);
    for (int k = first.z(); k < last.z(); ++k)
      for (int j = first.y(); j < last.y(); ++j)
        for (int i = first.x(); i < last.x(); ++i) {
          labels.at(i, j, k) = static_cast<std::uint8_t>(s.label);
          grey[labels.offset(i, j, k)] = static_cast<float>(mean);
        }
  };
  const Index3 blocks = (labels.size + Index3::Constant(kBlock - 1)) / kBlock;
  tbb::parallel_for(0, blocks.prod(), [&](int b) {
    fill(fill,
         kBlock * Index3(b % blocks.x(), b / blocks.x() % blocks.y(), b / blocks.x() / blocks.y()),
         kBlock);
  });

  if (o.blur_fwhm_voxels > 0) {
    const double sigma = o.blur_fwhm_voxels / (2 * std::sqrt(2 * std::log(2.0)));
    const auto weights = discrete_gaussian(sigma);
    for (int axis = 0; axis < 3; ++axis) convolve(grey, labels.size, axis, weights);
  }

  scan.image.size = labels.size;
  scan.image.spacing = labels.spacing;
  scan.image.origin = labels.origin;
  scan.image.data.resize(voxels);
  const auto plane = static_cast<std::size_t>(labels.size.x()) * labels.size.y();
  tbb::parallel_for(0, labels.size.z(), [&](int k) {
    for (std::size_t v = k * plane; v < (k + 1) * plane; ++v) {
      const double noise = o.noise > 0 ? o.noise * standard_normal(o.seed, v) : 0.0;
      scan.image.data[v] =
          static_cast<std::int16_t>(std::lround(std::clamp(grey[v] + noise, o.lowest, o.highest)));
    }
  });
  return scan;
}

SyntheticScan make_molar_scan(const SyntheticScanOptions& options) {
  return make_synthetic_scan(sample_molar, molar_bounds(), options);
}

}  // namespace toothprep
