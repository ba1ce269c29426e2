#include "toothprep/step/grinding/workpiece.h"

#include <algorithm>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/commit_bricks.h"
#include "toothprep/step/tooth/extended_labels.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostSpareBricks = 8192;
constexpr int kLabelMargin = 2;  // voxels that labels are extended into the air

}  // namespace

Workpiece::Workpiece(const LayeredTooth& tooth)
    : tooth_(tooth), band_(static_cast<float>(tooth.band())) {
  const LevelSet& solid = tooth.solid;
  const auto same_bricks = [&](const auto& grid) {
    return grid.first_brick() == solid.first_brick() && grid.brick_counts() == solid.brick_counts();
  };
  if (!same_bricks(tooth.tissue) || !same_bricks(tooth.remains[0]) ||
      !same_bricks(tooth.remains[1]) || !same_bricks(tooth.remains[2]))
    throw Error("tooth: labels and level sets must cover the same bricks");
  labels_ = extended_labels(tooth.tissue, solid, band_, kLabelMargin);
  if (tooth.bodies && tooth.bodies->list.size() > 1) {
    if (!same_bricks(tooth.bodies->of)) throw Error("tooth: bodies must cover the same bricks");
    bodies_.emplace(tooth);
  }

  cut_ = LevelSet(solid.first_brick(), solid.brick_counts(), -band_, {band_});
  std::size_t not_void = 0;
  for (std::size_t b = 0; b < solid.table_size(); ++b)
    not_void += !(solid.is_uniform(b) && solid.uniform_value(b) > 0);
  // A cut carves the bricks of one head, a few thousand at the finest voxels.
  spare_bricks_ = std::min<std::size_t>(not_void, kMostSpareBricks);
  cut_.reserve(not_void + spare_bricks_);
  commit_bricks(cut_, voxel(), spare_bricks_);
  changed_ = ChangedBricks(cut_.table_size());

  // Per brick: a bit for each label in it, and whether it is inside as a whole.
  std::vector<std::uint8_t> present(solid.table_size(), 0);
  for (std::size_t b = 0; b < present.size(); ++b)
    for (int v = 0; v < (labels_.is_uniform(b) ? 1 : kBrickVoxels); ++v)
      present[b] |= static_cast<std::uint8_t>(1u << labels_.brick(b)[v]);
  cells_.resize(present.size());
  const Index3 n = solid.brick_counts();
  std::size_t b = 0;
  for (int x = 0; x < n.x(); ++x)
    for (int y = 0; y < n.y(); ++y)
      for (int z = 0; z < n.z(); ++z, ++b) {
        unsigned tissues = 0;
        bool deep = true, air = true;
        for (int c = 0; c < 8; ++c) {
          const int nx = std::min(x + (c >> 2), n.x() - 1),
                    ny = std::min(y + ((c >> 1) & 1), n.y() - 1),
                    nz = std::min(z + (c & 1), n.z() - 1);
          const std::size_t at = (static_cast<std::size_t>(nx) * n.y() + ny) * n.z() + nz;
          tissues |= present[at];
          deep = deep && solid.is_uniform(at) && solid.uniform_value(at) < 0;
          air = air && solid.is_uniform(at) && solid.uniform_value(at) > 0;
        }
        tissues &= ~1u;  // air
        for (int label = 1; label <= kTissueCount; ++label)
          if (tissues == 1u << label) cells_[b].only_tissue = static_cast<std::uint8_t>(label);
        cells_[b].deep = deep;
        cells_[b].air = air;
      }
}

LevelSet Workpiece::remaining_solid() const { return carved_solid(tooth_.solid, cut_); }

}  // namespace toothprep
