#include "toothprep/scan/grey_classes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "toothprep/core/errors.h"
#include "toothprep/scan/dense_filters.h"

namespace toothprep {
namespace {

constexpr double kReducedVoxels =
    6e6;  // classes are found on block means of at most so many voxels
constexpr int kBins = 1024;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

constexpr const char* kRemedy =
    "check that it is a scan of one tooth, or give --thresholds DENTIN,ENAMEL";

// Means over blocks of n^3 voxels, and their slope: the length of the gradient per block.
struct Reduced {
  int block = 1;
  Index3 size = Index3::Zero();
  std::vector<float> grey, slope;
};

Reduced reduce(const ImageVolume<float>& scan) {
  Reduced r;
  const double voxels = scan.size.cast<double>().prod();
  while (voxels / std::pow(r.block, 3) > kReducedVoxels) ++r.block;
  const int n = r.block;
  r.size = (scan.size / n).cwiseMax(1);
  r.grey.resize(static_cast<std::size_t>(r.size.cast<double>().prod()));
  tbb::parallel_for(0, r.size.z(), [&](int k) {
    for (int j = 0; j < r.size.y(); ++j)
      for (int i = 0; i < r.size.x(); ++i) {
        double sum = 0;
        int count = 0;
        for (int z = k * n; z < std::min((k + 1) * n, scan.size.z()); ++z)
          for (int y = j * n; y < std::min((j + 1) * n, scan.size.y()); ++y)
            for (int x = i * n; x < std::min((i + 1) * n, scan.size.x()); ++x, ++count)
              sum += scan.at(x, y, z);
        r.grey[(static_cast<std::size_t>(k) * r.size.y() + j) * r.size.x() + i] =
            static_cast<float>(sum / count);
      }
  });
  // A light smoothing tames noise; it widens borders, but those are left out by their slope.
  smooth(r.size, r.grey, 0.7);
  r.slope.resize(r.grey.size());
  tbb::parallel_for(0, r.size.z(), [&](int k) {
    const auto at = [&](int x, int y, int z) {
      return static_cast<double>(
          r.grey[(static_cast<std::size_t>(z) * r.size.y() + y) * r.size.x() + x]);
    };
    for (int j = 0; j < r.size.y(); ++j)
      for (int i = 0; i < r.size.x(); ++i) {
        Vec3 gradient;
        Index3 low(i, j, k), high(i, j, k);
        for (int a = 0; a < 3; ++a) {
          Index3 p(i, j, k), q(i, j, k);
          p[a] = std::max(p[a] - 1, 0);
          q[a] = std::min(q[a] + 1, r.size[a] - 1);
          gradient[a] = q[a] > p[a]
                            ? (at(q.x(), q.y(), q.z()) - at(p.x(), p.y(), p.z())) / (q[a] - p[a])
                            : 0.0;
        }
        r.slope[(static_cast<std::size_t>(k) * r.size.y() + j) * r.size.x() + i] =
            static_cast<float>(gradient.norm());
      }
  });
  return r;
}

double quantile(std::vector<float> values, double q) {
  if (values.empty()) return 0;
  const auto n = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + n, values.end());
  return values[static_cast<std::size_t>(n)];
}

struct Peak {
  double grey, height, mass;  // mass: share of the homogeneous voxels between the valleys beside it
};

// Peaks of the smoothed histogram that stand out of the valleys beside them, in ascending order of
// grey.
std::vector<Peak> find_peaks(const std::vector<float>& values, double low, double high) {
  std::vector<double> count(kBins, 0.0);
  for (const float v : values) {
    const int bin = static_cast<int>((v - low) / (high - low) * kBins);
    if (bin >= 0 && bin < kBins) count[static_cast<std::size_t>(bin)] += 1;
  }
  constexpr int kSigma = kBins / 100, kRadius = 3 * kSigma;
  std::vector<double> density(kBins, 0.0);
  for (int b = 0; b < kBins; ++b) {
    double weights = 0;
    for (int d = -kRadius; d <= kRadius; ++d) {
      const double weight = std::exp(-0.5 * d * d / (kSigma * kSigma));
      weights += weight;
      if (b + d >= 0 && b + d < kBins) density[b] += weight * count[b + d];
    }
    density[b] /= weights;
  }
  // From local maxima, drop the one that stands out least until all stand out.
  std::vector<int> tops;
  for (int b = 0; b < kBins; ++b) {
    const double before = b > 0 ? density[b - 1] : -1, after = b + 1 < kBins ? density[b + 1] : -1;
    if (density[b] > before && density[b] >= after) tops.push_back(b);
  }
  const auto valley = [&](int a, int b) {
    return static_cast<int>(std::min_element(density.begin() + a, density.begin() + b + 1) -
                            density.begin());
  };
  constexpr double kDip = 0.75;  // a valley must fall below this share of the lower peak beside it
  while (tops.size() > 1) {
    std::size_t worst = 0;
    double worst_ratio = -1;
    for (std::size_t t = 0; t + 1 < tops.size(); ++t) {
      const double lower = std::min(density[tops[t]], density[tops[t + 1]]);
      // Five standard deviations of counting noise may not make a valley either.
      const double noise = 5 * std::sqrt(std::max(lower, 1.0) / (2 * std::sqrt(M_PI) * kSigma));
      const double ratio = (density[valley(tops[t], tops[t + 1])] + noise) / lower;
      if (ratio > worst_ratio) {
        worst_ratio = ratio;
        worst = density[tops[t]] < density[tops[t + 1]] ? t : t + 1;
      }
    }
    if (worst_ratio <= kDip) break;
    tops.erase(tops.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  std::vector<Peak> peaks;
  for (std::size_t t = 0; t < tops.size(); ++t) {
    const int from = t > 0 ? valley(tops[t - 1], tops[t]) : 0;
    const int to = t + 1 < tops.size() ? valley(tops[t], tops[t + 1]) : kBins;
    double mass = 0;
    for (int b = from; b < to; ++b) mass += count[b];
    peaks.push_back({low + (tops[t] + 0.5) / kBins * (high - low), density[tops[t]],
                     mass / static_cast<double>(values.size())});
  }
  return peaks;
}

std::string list_of(const std::vector<Peak>& peaks) {
  std::string text;
  for (const auto& peak : peaks) text += (text.empty() ? "" : ", ") + number(peak.grey);
  return text;
}

}  // namespace

GreyClasses find_grey_classes(const ImageVolume<float>& scan,
                              const std::optional<std::array<double, 2>>& thresholds) {
  const Reduced r = reduce(scan);
  const double low = quantile(r.grey, 0.0005), high = quantile(r.grey, 0.9995);
  if (!(high > low))
    throw Error("no tooth can be told from its surroundings: the image is flat (grey value " +
                number(low) + "); check that it is a scan of one tooth");
  const double margin = 0.05 * (high - low);
  const double homogeneous_slope = std::max(0.05 * (high - low), quantile(r.slope, 0.5));
  std::vector<float> homogeneous;
  for (std::size_t v = 0; v < r.grey.size(); ++v)
    if (r.slope[v] <= homogeneous_slope) homogeneous.push_back(r.grey[v]);

  GreyClasses classes;
  if (thresholds) {
    classes.threshold_dentin = (*thresholds)[0];
    classes.threshold_enamel = (*thresholds)[1];
    if (!std::isfinite((*thresholds)[0]) || !std::isfinite((*thresholds)[1]) ||
        !((*thresholds)[0] < (*thresholds)[1]))
      throw Error("--thresholds: DENTIN must be below ENAMEL, got " + number((*thresholds)[0]) +
                  "," + number((*thresholds)[1]));
    if ((*thresholds)[0] <= low || (*thresholds)[0] >= high)
      throw Error("--thresholds: no tooth can be told at DENTIN = " + number((*thresholds)[0]) +
                  "; the scan's grey values lie in " + number(low) + " .. " + number(high));
    std::vector<float> below, dentin, enamel;
    for (const float g : homogeneous)
      (g < (*thresholds)[0] ? below : g < (*thresholds)[1] ? dentin : enamel).push_back(g);
    classes.below_dentin = quantile(below, 0.5);
    classes.dentin =
        dentin.size() >= 20 ? quantile(dentin, 0.5) : 0.5 * ((*thresholds)[0] + (*thresholds)[1]);
    classes.enamel =
        enamel.size() >= 20 ? quantile(enamel, 0.5) : 2 * (*thresholds)[1] - classes.dentin;
  } else {
    std::vector<Peak> peaks = find_peaks(homogeneous, low - margin, high + margin);
    const std::string found = list_of(peaks);
    // Too few voxels for a tissue: specks of metal, rings, glare.
    double total = 0, largest = 0;
    for (const Peak& p : peaks) total += p.mass, largest = std::max(largest, p.mass);
    std::erase_if(peaks, [&](const Peak& p) {
      return p.mass * static_cast<double>(homogeneous.size()) < 60 ||
             p.mass < 0.01 * (total - largest);
    });
    if (peaks.size() < 3)
      throw Error("no tooth can be told from its surroundings: its grey values form " +
                  std::to_string(peaks.size()) + (peaks.size() == 1 ? " class" : " classes") +
                  (found.empty() ? "" : " (at " + found + ")") +
                  " where surroundings, dentin and enamel are three; " + kRemedy);
    classes.enamel = peaks.back().grey;
    classes.dentin = peaks[peaks.size() - 2].grey;
    classes.below_dentin = peaks[peaks.size() - 3].grey;
    classes.threshold_enamel = 0.5 * (classes.dentin + classes.enamel);
    classes.threshold_dentin = 0.5 * (classes.below_dentin + classes.dentin);
  }

  // The tooth, roughly, and what is around it.
  Mask tooth(r.grey.size());
  for (std::size_t v = 0; v < tooth.size(); ++v) tooth[v] = r.grey[v] >= classes.threshold_dentin;
  keep_largest_component(r.size, tooth);
  std::size_t tooth_voxels = 0, enamel_voxels = 0;
  Index3 box_min = r.size, box_max = Index3::Constant(-1);
  std::size_t v = 0;
  for (int k = 0; k < r.size.z(); ++k)
    for (int j = 0; j < r.size.y(); ++j)
      for (int i = 0; i < r.size.x(); ++i, ++v) {
        if (!tooth[v]) continue;
        ++tooth_voxels;
        enamel_voxels += r.grey[v] >= classes.threshold_enamel;
        box_min = box_min.cwiseMin(Index3(i, j, k));
        box_max = box_max.cwiseMax(Index3(i, j, k));
      }
  if (tooth_voxels < 200)
    throw Error(
        "no tooth can be told from its surroundings: the largest piece at or above grey value " +
        number(classes.threshold_dentin) + " is " + std::to_string(tooth_voxels) + " voxels; " +
        kRemedy);
  if (static_cast<double>(tooth_voxels) > 0.95 * static_cast<double>(tooth.size()))
    throw Error(
        "no tooth can be told from its surroundings: " +
        number(100.0 * static_cast<double>(tooth_voxels) / static_cast<double>(tooth.size())) +
        " % of the scan is at or above grey value " + number(classes.threshold_dentin) + "; " +
        kRemedy);
  if (!thresholds && enamel_voxels < 60)
    throw Error("no enamel can be told in the tooth: " + std::to_string(enamel_voxels) +
                " voxels at or above grey value " + number(classes.threshold_enamel) +
                "; give --thresholds DENTIN,ENAMEL");
  classes.touches_edge =
      box_min.minCoeff() == 0 || ((box_max + Index3::Ones() - r.size).array() == 0).any();
  // A block of slack, since a block's mean may hide a corner of the tooth.
  classes.box_min = ((box_min - Index3::Ones()) * r.block).cast<double>().cwiseMax(0.0);
  classes.box_max = ((box_max + Index3::Constant(2)) * r.block)
                        .cast<double>()
                        .cwiseMin((scan.size - Index3::Ones()).cast<double>());

  Mask filled = tooth;
  fill_enclosed(r.size, filled);
  const std::vector<float> distance = distance_to(r.size, filled);
  std::vector<float> around;
  for (std::size_t n = 0; n < distance.size(); ++n)
    if (distance[n] >= 2.5f && distance[n] <= 6 && r.grey[n] < classes.threshold_dentin)
      around.push_back(r.grey[n]);
  classes.surroundings = around.size() >= 20 ? quantile(around, 0.5) : classes.below_dentin;
  if (!thresholds) classes.threshold_dentin = 0.5 * (classes.surroundings + classes.dentin);
  return classes;
}

}  // namespace toothprep
