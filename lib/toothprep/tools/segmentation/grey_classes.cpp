#include "toothprep/tools/segmentation/grey_classes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/near_distance.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {
namespace {

constexpr double kReducedVoxels = 6e6;  // classes are found on so many block means at most
constexpr double kFewestVoxels = 200;   // of a tooth, of such means
constexpr int kBins = 1024;

constexpr const char* kRemedy =
    "check that it is a scan of one tooth, or give --thresholds DENTIN,ENAMEL";

// Length of the gradient, per voxel.
std::vector<float> slope_of(const Index3& size, const std::vector<float>& grey) {
  std::vector<float> slope(grey.size());
  const auto row = static_cast<std::size_t>(size.x()),
             plane = row * static_cast<std::size_t>(size.y());
  const std::array<std::size_t, 3> stride = {1, row, plane};
  tbb::parallel_for(0, size.z(), [&](int k) {
    std::size_t v = static_cast<std::size_t>(k) * plane;
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i, ++v) {
        const Index3 index(i, j, k);
        double squared = 0;
        for (int a = 0; a < 3; ++a) {
          const int below = index[a] > 0, above = index[a] + 1 < size[a];
          if (below + above == 0) continue;
          const std::size_t step = stride[static_cast<std::size_t>(a)];
          const double d =
              (static_cast<double>(grey[above ? v + step : v]) - grey[below ? v - step : v]) /
              (below + above);
          squared += d * d;
        }
        slope[v] = static_cast<float>(std::sqrt(squared));
      }
  });
  return slope;
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
  for (const auto& peak : peaks) text += (text.empty() ? "" : ", ") + short_number(peak.grey);
  return text;
}

// Typical greys on either side of borders that are given.
void classes_between(const std::vector<float>& homogeneous, const std::array<double, 2>& borders,
                     GreyClasses& classes) {
  classes.threshold_dentin = borders[0];
  classes.threshold_enamel = borders[1];
  std::vector<float> below, dentin, enamel;
  for (const float g : homogeneous)
    (g < borders[0] ? below : g < borders[1] ? dentin : enamel).push_back(g);
  classes.below_dentin = quantile(below, 0.5);
  classes.dentin = dentin.size() >= 20 ? quantile(dentin, 0.5) : 0.5 * (borders[0] + borders[1]);
  classes.enamel = enamel.size() >= 20 ? quantile(enamel, 0.5) : 2 * borders[1] - classes.dentin;
}

// What is this many times (enamel - dentin) above enamel is metal.
constexpr double kMetalGap = 1.5;
// A peak of metal: from the darkest class it is that much farther than the next, while enamel is
// 1.3 to 2 times as far as dentin; the two peaks below it are the tooth's.
constexpr double kMetalContrast = 2.2;

void classes_from_peaks(const std::vector<float>& homogeneous, double low, double high,
                        GreyClasses& classes) {
  std::vector<Peak> peaks = find_peaks(homogeneous, low, high);
  const std::string found = list_of(peaks);
  // Too few voxels for a tissue: specks, rings, glare.
  double total = 0, largest = 0;
  for (const Peak& p : peaks) total += p.mass, largest = std::max(largest, p.mass);
  std::erase_if(peaks, [&](const Peak& p) {
    return p.mass * static_cast<double>(homogeneous.size()) < 60 ||
           p.mass < 0.01 * (total - largest);
  });
  if (peaks.size() < 3)
    throw Error("no tooth can be distinguished from its surroundings: its grey values form " +
                std::to_string(peaks.size()) + (peaks.size() == 1 ? " class" : " classes") +
                (found.empty() ? "" : " (at " + found + ")") +
                " where surroundings, dentin and enamel are three; " + kRemedy);
  const auto from_top = [&](std::size_t n) { return peaks[peaks.size() - 1 - n].grey; };
  const double darkest = peaks.front().grey;
  const bool metal = peaks.size() >= 4 &&
                     from_top(0) - from_top(1) > kMetalGap * (from_top(1) - from_top(2)) &&
                     from_top(0) - darkest > kMetalContrast * (from_top(1) - darkest);
  const std::size_t top = metal ? 1 : 0;
  // An even layer of thin enamel has a peak of its own, between dentin and enamel. There is less of
  // it than a tooth has dentin (layers with less dentin are refused: plausibility.h).
  constexpr double kLeastDentin = 0.25;  // of the enamel
  while (peaks.size() >= top + 4 &&
         peaks[peaks.size() - 2 - top].mass < kLeastDentin * peaks[peaks.size() - 1 - top].mass)
    peaks.erase(peaks.end() - 2 - static_cast<std::ptrdiff_t>(top));
  classes.enamel = from_top(top);
  classes.dentin = from_top(top + 1);
  classes.below_dentin = from_top(top + 2);
  classes.threshold_enamel = 0.5 * (classes.dentin + classes.enamel);
  classes.threshold_dentin = 0.5 * (classes.below_dentin + classes.dentin);
}

// The components that could be teeth, the largest first, and which one is meant.
std::size_t choose_piece(const ImageVolume<float>& means, const MaskParts& parts,
                         const GreyHints& hints, GreyClasses& classes) {
  const double voxel = means.spacing.prod();
  const std::size_t most = parts.voxels.empty() ? 0 : parts.voxels[0];
  for (const std::size_t voxels : parts.voxels) {
    if (static_cast<double>(voxels) < kFewestVoxels || voxels * 10 < most) break;
    classes.pieces.push_back({static_cast<double>(voxels) * voxel, Vec3::Zero()});
  }
  const std::size_t count = classes.pieces.size();
  double nearest = std::numeric_limits<double>::infinity();
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (part >= count) return;
    for (std::size_t v = first; v < end; ++v) {
      const Vec3 at = means.to_world(index_of(means.size, v).cast<double>());
      classes.pieces[part].centre += at / static_cast<double>(parts.voxels[part]);
      if (!hints.tooth_at) continue;
      const double distance = (at - *hints.tooth_at).norm();
      if (distance < nearest) nearest = distance, classes.chosen = part;
    }
  });
  const auto list = [&] {
    std::string text;
    for (std::size_t n = 0; n < count; ++n)
      text += (n ? ", " : "") + std::to_string(n + 1) + ": " +
              short_number(classes.pieces[n].volume) + " mm3 at (" +
              short_number(classes.pieces[n].centre.x()) + ", " +
              short_number(classes.pieces[n].centre.y()) + ", " +
              short_number(classes.pieces[n].centre.z()) + ")";
    return text;
  };
  if (hints.tooth_at) {
    if (!(nearest <= 2 + means.spacing.norm()))
      throw Error("--tooth: there is no tooth within 2 mm of that place; there are " + list());
  } else {
    if (hints.tooth < 1 || static_cast<std::size_t>(hints.tooth) > std::max<std::size_t>(count, 1))
      throw Error("--tooth: there is no tooth " + std::to_string(hints.tooth) + "; there are " +
                  list());
    classes.chosen = static_cast<std::size_t>(hints.tooth) - 1;
  }
  return classes.chosen;
}

// Greys where the gradient is small.
std::vector<float> homogeneous_greys(const Index3& size, const std::vector<float>& grey,
                                     double range) {
  const std::vector<float> slope = slope_of(size, grey);
  const double small = std::max(0.05 * range, quantile(slope, 0.5));
  std::vector<float> homogeneous;
  for (std::size_t v = 0; v < grey.size(); ++v)
    if (slope[v] <= small) homogeneous.push_back(grey[v]);
  return homogeneous;
}

// Typical greys and borders, but for what surrounds the tooth. The scan's greys lie in low .. high.
void find_borders(const std::vector<float>& homogeneous, double low, double high,
                  const GreyHints& hints, GreyClasses& classes) {
  if (hints.thresholds) {
    const auto& [dentin, enamel] = *hints.thresholds;
    if (!std::isfinite(dentin) || !std::isfinite(enamel) || !(dentin < enamel))
      throw Error("--thresholds: DENTIN must be below ENAMEL, got " + short_number(dentin) + "," +
                  short_number(enamel));
    if (dentin <= low || dentin >= high)
      throw Error("--thresholds: no tooth is found at DENTIN = " + short_number(dentin) +
                  "; the scan's grey values lie in " + short_number(low) + " .. " +
                  short_number(high));
    classes_between(homogeneous, *hints.thresholds, classes);
  } else if (hints.typical) {
    classes_between(homogeneous, *hints.typical, classes);
    classes.threshold_enamel = 0.5 * (classes.dentin + classes.enamel);
  } else {
    const double margin = 0.05 * (high - low);
    classes_from_peaks(homogeneous, low - margin, high + margin, classes);
  }
}

// The tooth, roughly: the chosen piece of what is at least as bright as dentin.
Mask rough_tooth(const ImageVolume<float>& means, const GreyHints& hints, GreyClasses& classes) {
  Mask tooth(means.data.size());
  for (std::size_t v = 0; v < tooth.size(); ++v)
    tooth[v] = means.data[v] >= classes.threshold_dentin;
  const MaskParts parts = parts_of(means.size, tooth);
  const std::size_t chosen = choose_piece(means, parts, hints, classes);
  const bool several = classes.pieces.size() > 1;
  if (several) {
    classes.others_frame = means;
    classes.others.assign(tooth.size(), 0);
  }
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (part == chosen) return;
    std::fill(tooth.data() + first, tooth.data() + end, std::uint8_t{0});
    if (several)
      std::fill(classes.others.data() + first, classes.others.data() + end, std::uint8_t{1});
  });
  return tooth;
}

// That it is neither a speck nor everything, and whether it has enamel.
void check_tooth(const ImageVolume<float>& means, const Mask& tooth, const GreyHints& hints,
                 GreyClasses& classes) {
  std::size_t tooth_voxels = 0, enamel_voxels = 0;
  for (std::size_t v = 0; v < tooth.size(); ++v) {
    tooth_voxels += tooth[v];
    enamel_voxels += tooth[v] && means.data[v] >= classes.threshold_enamel;
  }
  const std::string at_or_above = " at or above grey value ";
  if (static_cast<double>(tooth_voxels) < kFewestVoxels)
    throw Error("no tooth can be distinguished from its surroundings: the largest piece" +
                at_or_above + short_number(classes.threshold_dentin) + " is " +
                std::to_string(tooth_voxels) + " voxels; " + kRemedy);
  if (static_cast<double>(tooth_voxels) > 0.95 * static_cast<double>(tooth.size()))
    throw Error("no tooth can be distinguished from its surroundings: " +
                short_number(100.0 * static_cast<double>(tooth_voxels) /
                             static_cast<double>(tooth.size())) +
                " % of the scan is" + at_or_above + short_number(classes.threshold_dentin) + "; " +
                kRemedy);
  classes.enamel_seen = enamel_voxels >= 60;
  if (!hints.thresholds && !classes.enamel_seen)
    throw Error("no enamel is found in the tooth: " + std::to_string(enamel_voxels) + " voxels" +
                at_or_above + short_number(classes.threshold_enamel) +
                "; give --thresholds DENTIN,ENAMEL");
}

// The tooth's box, with a block of slack, since a block's mean may hide a corner of the tooth.
void find_box(const Index3& size, const Mask& tooth, const Index3& block, const Index3& scan_size,
              GreyClasses& classes) {
  Index3 low = size, high = Index3::Constant(-1);
  std::size_t v = 0;
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i, ++v) {
        if (!tooth[v]) continue;
        low = low.cwiseMin(Index3(i, j, k));
        high = high.cwiseMax(Index3(i, j, k));
      }
  classes.touches_edge = low.minCoeff() == 0 || ((high + Index3::Ones() - size).array() == 0).any();
  classes.box_min = (low - Index3::Ones()).cwiseProduct(block).cast<double>().cwiseMax(0.0);
  classes.box_max = (high + Index3::Constant(2))
                        .cwiseProduct(block)
                        .cast<double>()
                        .cwiseMin((scan_size - Index3::Ones()).cast<double>());
}

// What lies above all that enamel's greys may be. A tenth of a mm^3 is no speck.
void find_metal(const ImageVolume<float>& means, const Mask& tooth, GreyClasses& classes) {
  const double metal = classes.enamel + kMetalGap * (classes.enamel - classes.dentin);
  std::size_t voxels = 0;
  for (std::size_t v = 0; v < tooth.size(); ++v) voxels += tooth[v] && means.data[v] > metal;
  if (static_cast<double>(voxels) * means.spacing.prod() > 0.1) classes.threshold_metal = metal;
}

// The median grey a few voxels off the tooth.
double grey_around(const ImageVolume<float>& means, Mask tooth, const GreyClasses& classes) {
  fill_enclosed(means.size, tooth);
  const NearDistance distance(means.size, tooth, 6);
  std::vector<float> around;
  for (std::size_t v = 0; v < tooth.size(); ++v)
    if (distance[v] >= 2.5f && distance[v] <= 6 && means.data[v] < classes.threshold_dentin)
      around.push_back(means.data[v]);
  return around.size() >= 20 ? quantile(around, 0.5) : classes.below_dentin;
}

}  // namespace

Index3 block_for_classes(const Index3& size) {
  int block = 1;
  while (size.cast<double>().prod() / std::pow(block, 3) > kReducedVoxels) ++block;
  return Index3::Constant(block);
}

GreyClasses find_grey_classes(ImageVolume<float> means, const Index3& block,
                              const Index3& scan_size, const GreyHints& hints) {
  // A light smoothing tames noise; it widens borders, but those are left out by their slope.
  smooth(means.size, means.data, 0.7);
  const double low = quantile(means.data, 0.0005), high = quantile(means.data, 0.9995);
  if (!(high > low))
    throw Error(
        "no tooth can be distinguished from its surroundings: the image is flat (grey value " +
        short_number(low) + "); check that it is a scan of one tooth");
  GreyClasses classes;
  classes.darkest = low;
  find_borders(homogeneous_greys(means.size, means.data, high - low), low, high, hints, classes);
  const Mask tooth = rough_tooth(means, hints, classes);
  check_tooth(means, tooth, hints, classes);
  find_box(means.size, tooth, block, scan_size, classes);
  find_metal(means, tooth, classes);
  classes.surroundings = grey_around(means, tooth, classes);
  if (!hints.thresholds) classes.threshold_dentin = 0.5 * (classes.surroundings + classes.dentin);
  return classes;
}

}  // namespace toothprep
