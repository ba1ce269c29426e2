#include "toothprep/step/grinding/workpiece.h"

#include <algorithm>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/commit_bricks.h"
#include "toothprep/step/grinding/sweep_history.h"
#include "toothprep/step/tooth/extended_labels.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostSpareBricks = 8192;
constexpr int kLabelMargin = 2;  // voxels that labels are extended into the air

}  // namespace

Workpiece::Workpiece(const LayeredTooth& tooth)
    : tooth_(tooth),
      solid_(tooth.parts ? &tooth.parts->intact : &tooth.solid),
      tissues_(tooth.parts && tooth.parts->tissues ? &*tooth.parts->tissues : &tooth.remains),
      band_(static_cast<float>(tooth.band())) {
  const LevelSet& solid = *solid_;
  const auto same_bricks = [&](const auto& grid) {
    return grid.first_brick() == solid.first_brick() && grid.brick_counts() == solid.brick_counts();
  };
  if (!same_bricks(tooth.tissue) || !same_bricks(tooth.solid) ||
      (tooth.parts && !same_bricks(tooth.parts->cut)) ||
      !std::all_of(tissues_->begin(), tissues_->end(), same_bricks))
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
  if (tooth.parts) take_up_cut(tooth.parts->cut);
  if (tooth.parts && tooth.parts->way) {
    way_ = std::make_unique<SweepHistory>(cut_, voxel(), spare_bricks_);
    way_->go_on_from(*tooth.parts->way);
  }
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

Workpiece::~Workpiece() = default;

// Where there was tissue: elsewhere nothing is ever read of it.
void Workpiece::take_up_cut(const LevelSet& cut) {
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    if (cut.is_uniform(b) && cut.uniform_value(b) > 0) continue;
    if (solid_->is_uniform(b) && solid_->uniform_value(b) > 0) continue;
    if (cut.is_uniform(b)) {
      cut_.put_constant(b, kAllCut);
      continue;
    }
    const float* from = cut.brick(b);
    float* to = cut_.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) to[v] = -from[v];
  }
}

Workpiece::CutState Workpiece::cut_state() const { return {cut_, way_ ? way_->latest() : 0}; }

void Workpiece::restore(const CutState& state) {
  // Of BrickGrid::put_constant(), whose constants count from the one after the background.
  constexpr std::uint32_t kBackground = ~std::uint32_t{0};
  const LevelSet& before = state.cut;
  for (std::size_t b = 0; b < cut_.table_size(); ++b) {
    const float *from = before.brick(b), *now = cut_.brick(b);
    const bool uniform = before.is_uniform(b);
    if (uniform == cut_.is_uniform(b) && std::equal(from, from + (uniform ? 1 : kBrickVoxels), now))
      continue;
    if (float* numbers = way_ ? way_->write(b) : nullptr)
      for (int v = 0; v < kBrickVoxels; ++v)
        if (from[v] != now[v]) numbers[v] = 0;
    if (uniform)
      cut_.put_constant(b, before.uniform_value(b) == before.background() ? kBackground : kAllCut);
    else
      std::copy_n(from, kBrickVoxels, cut_.writable_brick(b));
    changed_.mark(b);
  }
  if (way_) way_->drop_behind(state.parts);
}

SweepHistory& Workpiece::way_of(const Bur& bur) {
  if (!way_) way_ = std::make_unique<SweepHistory>(cut_, voxel(), spare_bricks_);
  way_->take(bur);
  return *way_;
}

void Workpiece::forget_way() {
  if (way_) way_->forget();
}

std::optional<CutWay> Workpiece::kept_way() const {
  if (!way_) return std::nullopt;
  CutWay kept = way_->kept();
  return kept.parts.empty() ? std::nullopt : std::optional(std::move(kept));
}

LevelSet Workpiece::remaining_solid() const { return carved_solid(*solid_, cut_); }

void apply_cut(LayeredTooth& tooth, const Workpiece& workpiece) {
  apply_cut(tooth, workpiece.cut());
  tooth.parts->way = workpiece.kept_way();
}

}  // namespace toothprep
