#include "toothprep/tools/segmentation/scan_survey.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

constexpr double kLittleVoxels = 3.4e7;  // 2^25 values: 128 MB

// Blocks that are nearly as large as the tooth's voxels, but not larger. Means over them are what a
// coarser scanner would have seen, and cost a good deal less than the mean over each of the tooth's
// voxels.
Index3 block_for_voxel(const ImageFrame& scan, double voxel) {
  Index3 block;
  for (int a = 0; a < 3; ++a)
    block[a] = std::clamp(static_cast<int>(voxel / (1.1 * scan.spacing[a])), 1, scan.size[a]);
  return block;
}

struct Extreme {
  float highest = -std::numeric_limits<float>::infinity();
  std::size_t voxels = 0;
};

float highest_of(const float* values, std::size_t count) {
  constexpr std::size_t kLanes = 8;
  using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));
  float highest = values[0];
  Lanes most = Lanes{} + highest, others = most, a, b;
  std::size_t v = 0;
  for (; v + 2 * kLanes <= count; v += 2 * kLanes) {
    std::memcpy(&a, values + v, sizeof a);
    std::memcpy(&b, values + v + kLanes, sizeof b);
    most = most < a ? a : most;
    others = others < b ? b : others;
  }
  for (; v < count; ++v) highest = std::max(highest, values[v]);
  for (std::size_t l = 0; l < kLanes; ++l) highest = std::max({highest, most[l], others[l]});
  return highest;
}

void note_highest(const float* values, std::size_t count, Extreme& top) {
  constexpr std::size_t kPart = 1 << 16;
  std::vector<float> highest((count + kPart - 1) / kPart);
  const auto size_of = [&](std::size_t p) { return std::min(kPart, count - p * kPart); };
  tbb::parallel_for(std::size_t{0}, highest.size(), [&](std::size_t p) {
    with_wide_vectors([&] { highest[p] = highest_of(values + p * kPart, size_of(p)); });
  });
  const float most = *std::max_element(highest.begin(), highest.end());
  if (most < top.highest) return;
  if (most > top.highest) top = {most, 0};
  for (std::size_t p = 0; p < highest.size(); ++p)
    if (highest[p] == most) {
      const float* part = values + p * kPart;
      top.voxels += static_cast<std::size_t>(std::count(part, part + size_of(p), most));
    }
}

void note_values(const float* values, std::size_t count, std::vector<float>& seen) {
  for (std::size_t v = 0; v < count && seen.size() < kManyValues; ++v)
    if (std::find(seen.begin(), seen.end(), values[v]) == seen.end()) seen.push_back(values[v]);
}

}  // namespace

ScanSurvey survey(ScanSource& scan, double voxel, const std::function<void(double)>& progress) {
  const ImageFrame& frame = scan.frame();
  const std::size_t area = static_cast<std::size_t>(frame.size.x()) * frame.size.y();
  ScanSurvey result;
  result.class_block = block_for_classes(frame.size);
  BlockMeans classes(frame, whole_of(frame), result.class_block, scan.whole_up_to());
  const Index3 block = block_for_voxel(frame, voxel);
  std::optional<BlockMeans> greys;
  if (frame.size.cwiseQuotient(block).cast<double>().prod() <= kLittleVoxels)
    greys.emplace(frame, whole_of(frame), block, scan.whole_up_to());
  Extreme top;
  for_each_slab(
      scan,
      [&](int first, int count, const float* values) {
        classes.add(first, count, values);
        if (greys) greys->add(first, count, values);
        note_values(values, area * static_cast<std::size_t>(count), result.values);
        note_highest(values, area * static_cast<std::size_t>(count), top);
      },
      progress);
  result.class_means = classes.take();
  if (greys) result.greys = greys->take();
  result.highest = top.highest;
  result.voxels_at_highest = top.voxels;
  return result;
}

ImageVolume<float> greys_of(ScanSource& scan, double voxel, const VoxelRange& part,
                            const std::function<void(double)>& progress) {
  BlockMeans greys(scan.frame(), part, block_for_voxel(scan.frame(), voxel), scan.whole_up_to());
  for_each_slab(
      scan, part,
      [&](int first, int count, const float* values) { greys.add(first, count, values); },
      progress);
  return greys.take();
}

}  // namespace toothprep
