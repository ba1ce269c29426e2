#include "toothprep/step/grinding/removal.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace toothprep {
namespace {

constexpr std::size_t kMaxSubPoses = 1024;
// Distance of sub-poses: half a voxel, and a little more, so that a cut that is due by a hair takes
// two.
constexpr double kSubPoseVoxels = 0.55;
// Bricks are carved in blocks of 4³ voxels: those wholly inside or outside of the bur's band are
// judged by their centre.
constexpr int kBlockEdge = 4;
constexpr int kBlockVoxels = kBlockEdge * kBlockEdge * kBlockEdge;
constexpr int kBlocks = kBrickVoxels / kBlockVoxels;
constexpr float kDistanceRounding = 1e-5f;  // mm, of distances in single precision
// A cut is carved in proportion to the way, a little ahead of the next one's being due; never less
// than a few bricks a step, so that it ends when the bur rests.
constexpr double kAhead = 1.25;
constexpr std::size_t kLeastBricks = 4;
// The bricks of a cut are visited in leaps of about this part of it, so that those with much to
// carve and those with nothing come evenly.
constexpr double kLeap = 0.618;

// The first voxel of a block in its brick.
Index3 corner_of_block(int block) {
  return kBlockEdge * Index3(block >> 2, (block >> 1) & 1, block & 1);
}

// The least value in each block of a brick.
void least_of_blocks(const float* values, bool uniform, float* low) noexcept {
  if (uniform) {
    std::fill_n(low, kBlocks, values[0]);
    return;
  }
  for (int block = 0; block < kBlocks; ++block) {
    const Index3 corner = corner_of_block(block);
    const float* from = values + brick_offset(corner.x(), corner.y(), corner.z());
    float least[kBlockEdge];
    std::copy(from, from + kBlockEdge, least);
    for (int row = 1; row < kBlockEdge * kBlockEdge; ++row) {
      const float* at = from + brick_offset(row / kBlockEdge, row % kBlockEdge, 0);
      for (int k = 0; k < kBlockEdge; ++k) least[k] = at[k] < least[k] ? at[k] : least[k];
    }
    low[block] = *std::min_element(least, least + kBlockEdge);
  }
}

}  // namespace

Removal::Removal(const Bur& bur, Workpiece& workpiece, const Pose& pose)
    : bur_(bur),
      workpiece_(workpiece),
      due_distance_(workpiece.voxel()),
      last_(pose),
      previous_(pose) {
  sub_poses_.reserve(kMaxSubPoses);
  carved_.reserve(workpiece.spare_bricks());
}

double Removal::displacement(const Pose& from, const Pose& to) const noexcept {
  // The farthest that any point of the head moved: its tip, plus the turn times its longest arm.
  const double turn = from.orientation.angularDistance(to.orientation);
  return (to.position - from.position).norm() +
         turn * std::hypot(bur_.head_length(), bur_.max_radius());
}

void Removal::plan(const Pose& pose) noexcept {
  const LevelSet& solid = workpiece_.tooth().solid;
  const double voxel = workpiece_.voxel();
  const double way = displacement(last_, pose);
  const auto count = static_cast<std::size_t>(std::clamp(std::ceil(way / (kSubPoseVoxels * voxel)),
                                                         1.0, static_cast<double>(kMaxSubPoses)));
  sub_poses_.clear();
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (std::size_t i = 1; i <= count; ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(count);
    const Quat q = i == count ? pose.orientation : last_.orientation.slerp(t, pose.orientation);
    const Vec3 p =
        i == count ? pose.position : Vec3(last_.position + t * (pose.position - last_.position));
    SubPose s;
    s.tip = workpiece_.lattice().to_index(p);
    const Mat3 to_bur = q.toRotationMatrix().transpose() * voxel;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) s.to_bur[3 * r + c] = static_cast<float>(to_bur(r, c));
    sub_poses_.push_back(s);
    // Box of the capsule around the head, grown by the band.
    const Vec3 end = s.tip + q * Vec3(0, 0, bur_.head_length() / voxel);
    const Vec3 grow = Vec3::Constant(bur_.max_radius() / voxel + kBandVoxels);
    low = low.cwiseMin((s.tip.cwiseMin(end)) - grow);
    high = high.cwiseMax((s.tip.cwiseMax(end)) + grow);
  }
  last_ = pose;
  const Index3 grid_last = solid.first_brick() + solid.brick_counts() - Index3::Ones();
  for (int a = 0; a < 3; ++a) {
    const double limit = 1e8;  // a pose far outside must not overflow
    const int lo = static_cast<int>(std::floor(std::clamp(low[a], -limit, limit) / kBrickEdge));
    const int hi = static_cast<int>(std::floor(std::clamp(high[a], -limit, limit) / kBrickEdge));
    box_first_[a] = std::max(lo, solid.first_brick()[a]);
    box_counts_[a] = std::max(0, std::min(hi, grid_last[a]) - box_first_[a] + 1);
  }
  box_size_ = static_cast<std::size_t>(box_counts_.x()) * box_counts_.y() * box_counts_.z();
  cursor_ = 0;
  stride_ = static_cast<std::size_t>(kLeap * static_cast<double>(box_size_)) | 1u;
  while (std::gcd(stride_, box_size_) > 1) stride_ += 2;
}

void Removal::carve_some(std::size_t bricks) noexcept {
  const LevelSet& solid = workpiece_.tooth().solid;
  const LevelSet& cut = workpiece_.cut();
  const std::size_t end = std::min(box_size_, cursor_ + bricks);
  for (; cursor_ < end; ++cursor_) {
    const std::size_t at = cursor_ * stride_ % box_size_;
    const auto z = static_cast<int>(at % box_counts_.z());
    const auto y = static_cast<int>(at / box_counts_.z() % box_counts_.y());
    const auto x = static_cast<int>(at / box_counts_.z() / box_counts_.y());
    const Index3 voxel = (box_first_ + Index3(x, y, z)) * kBrickEdge;
    const auto b = static_cast<std::size_t>(solid.brick_index(voxel.x(), voxel.y(), voxel.z()));
    if (solid.is_uniform(b) && solid.uniform_value(b) > 0) continue;  // no tissue here
    if (cut.is_uniform(b) && cut.uniform_value(b) > 0) continue;      // nothing left
    // A sweep that is larger than what can be kept apart comes in several parts.
    if (carved_.size() == carved_.capacity()) apply();
    carve_brick(b);
  }
  if (cursor_ >= box_size_) apply();
}

// Puts everything carved in place.
void Removal::apply() noexcept {
  LevelSet& cut = workpiece_.cut();
  for (const Carved& c : carved_) {
    if (c.values)
      cut.put_brick(c.brick, c.values);
    else
      cut.put_constant(c.brick, Workpiece::kAllCut);
    workpiece_.changed().mark(c.brick);
  }
  if (!carved_.empty()) ++cuts_made_;
  carved_.clear();
}

// next <- the largest -d_bur of the sub-poses, where that can be above `before`. False if nowhere.
bool Removal::sweep_brick(const Index3& first, const float* before, bool uniform,
                          float* next) noexcept {
  const float band = workpiece_.band(), voxel = static_cast<float>(workpiece_.voxel());
  const float half_diagonal = 0.5f * static_cast<float>(kBlockEdge - 1) * 1.7320509f * voxel;
  constexpr float kHalf = 0.5f * (kBlockEdge - 1);
  alignas(32) float r[kBlocks], z[kBlocks], centre[kBlocks], low[kBlocks];
  bool touched = false;
  for (const SubPose& s : sub_poses_) {
    const Eigen::Vector3f offset = (first.cast<double>() - s.tip).cast<float>();
    const float* m = s.to_bur;
    for (int block = 0; block < kBlocks; ++block) {
      const Eigen::Vector3i corner = corner_of_block(block);
      const float x = offset.x() + static_cast<float>(corner.x()) + kHalf,
                  y = offset.y() + static_cast<float>(corner.y()) + kHalf,
                  w = offset.z() + static_cast<float>(corner.z()) + kHalf;
      const float bx = m[0] * x + m[1] * y + m[2] * w, by = m[3] * x + m[4] * y + m[5] * w;
      r[block] = std::sqrt(bx * bx + by * by);
      z[block] = m[6] * x + m[7] * y + m[8] * w;
    }
    bur_.distances(r, z, centre, kBlocks);
    for (int block = 0; block < kBlocks; ++block) {
      if (centre[block] > half_diagonal + band) continue;
      if (!touched) {
        std::fill(next, next + kBrickVoxels, -band);
        least_of_blocks(before, uniform, low);
        touched = true;
      }
      // A distance changes by no more than the way from the centre.
      if (low[block] >= std::min(half_diagonal - centre[block] + kDistanceRounding, band)) continue;
      const Eigen::Vector3i corner = corner_of_block(block);
      float* to = next + brick_offset(corner.x(), corner.y(), corner.z());
      if (centre[block] < -half_diagonal - band) {
        for (int row = 0; row < kBlockEdge * kBlockEdge; ++row)
          std::fill_n(to + brick_offset(row / kBlockEdge, row % kBlockEdge, 0), kBlockEdge, band);
        continue;
      }
      carve_block(s, offset + corner.cast<float>(), to);
    }
  }
  return touched;
}

void Removal::carve_brick(std::size_t brick) noexcept {
  LevelSet& cut = workpiece_.cut();
  const float band = workpiece_.band();
  alignas(32) float next[kBrickVoxels];
  if (!sweep_brick(cut.brick_origin(brick), cut.brick(brick), cut.is_uniform(brick), next)) return;

  const float* before = cut.brick(brick);
  int changed = 0, left = 0;
  for (int v = 0; v < kBrickVoxels; ++v) {
    const float now = std::min(std::max(next[v], before[v]), band);
    changed += now > before[v] ? 1 : 0;
    left += now < band ? 1 : 0;
    next[v] = now;
  }
  if (changed == 0) return;
  count_removed(brick, before, next);
  if (left == 0) {
    carved_.push_back({brick, nullptr});
    return;
  }
  float* values = cut.take_brick();
  if (!values) return;  // cannot happen: the workpiece reserved enough
  std::copy(next, next + kBrickVoxels, values);
  carved_.push_back({brick, values});
}

// next <- max(next, -d_bur) for the 4³ voxels from `offset` (voxels from the tip).
void Removal::carve_block(const SubPose& s, const Eigen::Vector3f& offset, float* next) noexcept {
  alignas(32) float r[kBlockVoxels], z[kBlockVoxels], d[kBlockVoxels];
  const float* m = s.to_bur;
  for (int i = 0; i < kBlockEdge; ++i)
    for (int j = 0; j < kBlockEdge; ++j) {
      const float x = offset.x() + static_cast<float>(i), y = offset.y() + static_cast<float>(j);
      const float rx = m[0] * x + m[1] * y, ry = m[3] * x + m[4] * y, rz = m[6] * x + m[7] * y;
      const int row = kBlockEdge * (kBlockEdge * i + j);
      for (int k = 0; k < kBlockEdge; ++k) {
        const float w = offset.z() + static_cast<float>(k);
        const float bx = rx + m[2] * w, by = ry + m[5] * w;
        r[row + k] = std::sqrt(bx * bx + by * by);
        z[row + k] = rz + m[8] * w;
      }
    }
  bur_.distances(r, z, d, kBlockVoxels);
  for (int i = 0; i < kBlockEdge; ++i)
    for (int j = 0; j < kBlockEdge; ++j) {
      float* row = next + brick_offset(i, j, 0);
      const float* from = d + kBlockEdge * (kBlockEdge * i + j);
      for (int k = 0; k < kBlockEdge; ++k) row[k] = std::max(row[k], -from[k]);
    }
}

// Volume of what remains in a voxel: (1/2 - phi/D) clamped to [0, 1]; before less after, by tissue.
// At the border of two tissues a voxel is shared as their level sets share it.
void Removal::count_removed(std::size_t brick, const float* before, const float* after) noexcept {
  const float* solid = workpiece_.tooth().solid.brick(brick);
  const std::uint8_t* labels = workpiece_.labels().brick(brick);
  const bool one_tissue = workpiece_.only_tissue(brick) != 0;
  const auto& tissues = workpiece_.tooth().remains;
  const auto per_voxel = static_cast<float>(1 / workpiece_.voxel());
  const auto inside = [per_voxel](float phi) {
    return std::min(std::max(0.5f - phi * per_voxel, 0.0f), 1.0f);
  };
  PerTissue<float> fraction{};
  const double volume = std::pow(workpiece_.voxel(), 3);
  if (one_tissue) {
    float sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int v = 0; v < kBrickVoxels; ++v) {
      const float gone =
          inside(std::max(solid[v], before[v])) - inside(std::max(solid[v], after[v]));
      sum += labels[v] == 0 ? 0 : gone;
    }
    removed_[workpiece_.only_tissue(brick) - 1] += volume * sum;
    return;
  }
  for (int v = 0; v < kBrickVoxels; ++v) {
    const float gone = inside(std::max(solid[v], before[v])) - inside(std::max(solid[v], after[v]));
    if (gone <= 0 || labels[v] == 0) continue;
    if (labels[v] != static_cast<std::uint8_t>(Tissue::kOther)) {
      const float share[3] = {inside(tissues[0].brick(brick)[v]),
                              inside(tissues[1].brick(brick)[v]),
                              inside(tissues[2].brick(brick)[v])};
      const float sum = share[0] + share[1] + share[2];
      if (sum > 0) {
        for (int k = 0; k < 3; ++k) fraction[k] += gone * share[k] / sum;
        continue;
      }
    }
    fraction[labels[v] - 1] += gone;
  }
  for (int k = 0; k < kTissueCount; ++k) removed_[k] += volume * fraction[k];
}

PerTissue<double> Removal::clear(const Pose& pose) {
  const PerTissue<double> before = removed_;
  last_ = previous_ = pose;
  plan(pose);
  carve_some(box_size_);
  PerTissue<double> volume{};
  for (int k = 0; k < kTissueCount; ++k) volume[k] = removed_[k] - before[k];
  removed_ = before;
  return volume;
}

void Removal::advance(const Pose& pose) noexcept {
  if (paused_) {
    finish(pose);
    last_ = pose;
    paused_ = false;
  }
  if (cursor_ >= box_size_ && displacement(last_, pose) >= due_distance_) plan(pose);
  if (cursor_ < box_size_) {
    const double part = kAhead * displacement(previous_, pose) / due_distance_;
    carve_some(std::max(kLeastBricks, static_cast<std::size_t>(std::min(1.0, part) * box_size_)));
  }
  previous_ = pose;
}

void Removal::pause(const Pose& pose) noexcept {
  if (!paused_) pause_pose_ = pose;
  paused_ = true;
}

void Removal::finish(const Pose& pose) noexcept {
  const Pose& end = paused_ ? pause_pose_ : pose;
  carve_some(box_size_);
  if (displacement(last_, end) > 0) {
    plan(end);
    carve_some(box_size_);
  }
}

}  // namespace toothprep
