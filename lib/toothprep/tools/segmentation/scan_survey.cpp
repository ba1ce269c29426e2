#include "toothprep/tools/segmentation/scan_survey.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#include "toothprep/tools/segmentation/grey_classes.h"

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
  void add(float value, std::size_t n) {
    if (value > highest) highest = value, voxels = 0;
    if (value == highest) voxels += n;
  }
};

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
  BlockMeans classes(frame, whole_of(frame), result.class_block);
  const Index3 block = block_for_voxel(frame, voxel);
  std::optional<BlockMeans> greys;
  if (frame.size.cwiseQuotient(block).cast<double>().prod() <= kLittleVoxels)
    greys.emplace(frame, whole_of(frame), block);
  Extreme top;
  for_each_slab(
      scan,
      [&](int first, int count, const float* values) {
        classes.add(first, count, values);
        if (greys) greys->add(first, count, values);
        note_values(values, area * static_cast<std::size_t>(count), result.values);
        std::vector<Extreme> tops(static_cast<std::size_t>(count));
        tbb::parallel_for(0, count, [&](int k) {
          const float* slice = values + static_cast<std::size_t>(k) * area;
          float highest = slice[0];
          for (std::size_t v = 0; v < area; ++v) highest = std::max(highest, slice[v]);
          std::size_t voxels = 0;
          for (std::size_t v = 0; v < area; ++v) voxels += slice[v] == highest;
          tops[static_cast<std::size_t>(k)].add(highest, voxels);
        });
        for (const Extreme& t : tops) top.add(t.highest, t.voxels);
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
  BlockMeans greys(scan.frame(), part, block_for_voxel(scan.frame(), voxel));
  for_each_slab(
      scan, part.first.z(), part.last.z(),
      [&](int first, int count, const float* values) { greys.add(first, count, values); },
      progress);
  return greys.take();
}

}  // namespace toothprep
