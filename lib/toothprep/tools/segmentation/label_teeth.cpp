#include "toothprep/tools/segmentation/label_teeth.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {
namespace {

constexpr double kReach = 2;  // mm from a tooth's nearest voxel to the place that is asked for
constexpr double kOtherMargin = 1;    // mm around the tooth's box
constexpr std::size_t kShareOf = 20;  // of the largest: smaller pieces are no teeth

struct Found {
  std::vector<LabelTooth> teeth;
  std::vector<Index3> low, high;
  std::size_t nearest = 0;  // to the place that is asked for
  double distance = std::numeric_limits<double>::infinity();
};

// work(i, j, k, v) for every voxel.
template <class Work>
void for_each_voxel(const Index3& size, const Work& work) {
  std::size_t v = 0;
  for (int k = 0; k < size.z(); ++k)
    for (int j = 0; j < size.y(); ++j)
      for (int i = 0; i < size.x(); ++i, ++v) work(i, j, k, v);
}

Found teeth_of(const ImageVolume<std::uint16_t>& labels, const MaskParts& parts,
               const std::optional<Vec3>& place) {
  Found found;
  std::size_t count = 0;
  while (count < parts.count() && parts.voxels[count] * kShareOf >= parts.voxels[0]) ++count;
  found.teeth.resize(count);
  found.low.assign(count, labels.size);
  found.high.assign(count, Index3::Constant(-1));
  const auto add = [&](std::size_t t, const Index3& index) {
    const Vec3 at = labels.to_world(index.cast<double>());
    LabelTooth& tooth = found.teeth[t];
    tooth.bounds = found.high[t].x() < 0
                       ? Box{at, at}
                       : Box{tooth.bounds.min.cwiseMin(at), tooth.bounds.max.cwiseMax(at)};
    tooth.centre += at / static_cast<double>(parts.voxels[t]);
    found.low[t] = found.low[t].cwiseMin(index);
    found.high[t] = found.high[t].cwiseMax(index);
    if (place && (at - *place).norm() < found.distance) {
      found.distance = (at - *place).norm();
      found.nearest = t;
    }
  };
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (part >= count) return;
    for (std::size_t v = first; v < end; ++v) add(part, index_of(labels.size, v));
  });
  for (std::size_t t = 0; t < count; ++t)
    found.teeth[t].volume = static_cast<double>(parts.voxels[t]) * labels.spacing.prod();
  return found;
}

std::string list_of(const std::vector<LabelTooth>& teeth) {
  std::string text;
  for (std::size_t n = 0; n < teeth.size(); ++n) {
    const LabelTooth& t = teeth[n];
    text += fmt::format(
        "{}{}: {:.0f} mm3, centre {:.1f},{:.1f},{:.1f}, from {:.1f},{:.1f},{:.1f} to "
        "{:.1f},{:.1f},{:.1f} mm",
        n ? "; " : "", n + 1, t.volume, t.centre.x(), t.centre.y(), t.centre.z(), t.bounds.min.x(),
        t.bounds.min.y(), t.bounds.min.z(), t.bounds.max.x(), t.bounds.max.y(), t.bounds.max.z());
  }
  return text;
}

}  // namespace

std::string keep_one_tooth(ImageVolume<std::uint16_t>& labels,
                           const std::vector<std::uint8_t>& tissue_of,
                           const VoxelizeOptions& options) {
  const auto other = static_cast<std::uint8_t>(Tissue::kOther);
  Mask mask(labels.data.size());
  for (std::size_t v = 0; v < mask.size(); ++v) {
    const std::uint8_t tissue = tissue_of[labels.data[v]];
    mask[v] = tissue != 0 && tissue != other;
  }
  const MaskParts parts = parts_of(labels.size, mask);
  const Found found = teeth_of(labels, parts, options.tooth_at);
  const std::string list = list_of(found.teeth);
  const std::size_t chosen =
      options.tooth_at ? found.nearest : static_cast<std::size_t>(options.tooth - 1);
  if (found.teeth.empty()) throw Error("--tooth: the labels hold no enamel, dentin or pulp");
  if (options.tooth_at && found.distance > kReach)
    throw Error("--tooth: there is no tooth within 2 mm of that place; there are " + list);
  if (chosen >= found.teeth.size())
    throw Error("--tooth: there is no tooth " + std::to_string(options.tooth) + "; there are " +
                list);
  const Index3 margin = (kOtherMargin / labels.spacing.array()).ceil().cast<int>().matrix();
  const Index3 low = found.low[chosen] - margin, high = found.high[chosen] + margin;
  for_each_voxel(labels.size, [&](int i, int j, int k, std::size_t v) {
    if (mask[v] || tissue_of[labels.data[v]] == 0) return;
    const Index3 at(i, j, k);
    const bool near = (at.array() >= low.array()).all() && (at.array() <= high.array()).all();
    if (!near) labels.data[v] = 0;
  });
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (part != chosen) std::fill(labels.data.data() + first, labels.data.data() + end, 0);
  });
  return "took tooth " + std::to_string(chosen + 1) + " of " + std::to_string(found.teeth.size()) +
         ": " + list;
}

}  // namespace toothprep
