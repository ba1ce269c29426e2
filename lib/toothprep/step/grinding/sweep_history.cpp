#include "toothprep/step/grinding/sweep_history.h"

#include <algorithm>
#include <array>

#include "toothprep/step/grinding/commit_bricks.h"

namespace toothprep {
namespace {

// So many parts are remembered; and to so many voxels where the bur was.
constexpr std::int32_t kRemembered = 4096;
constexpr double kSweptAside = 0.006;
constexpr double kSameLean = 1e-3;             // sine
constexpr std::int32_t kLastNumber = 1 << 24;  // that a float holds

}  // namespace

SweepHistory::SweepHistory(const Bur& bur, const LevelSet& cut, double voxel, std::size_t most)
    : head_(outline_text(bur.profile())),
      aside_(kSweptAside * voxel),
      parts_(kRemembered),
      deepest_(cut.first_brick(), cut.brick_counts(), 0, {0}) {
  deepest_.reserve(cut.bricks_stored() + cut.bricks_free());
  commit_bricks(deepest_, voxel, most);
}

void SweepHistory::drop_behind(Number last) noexcept { latest_ = std::min(latest_, last); }

bool SweepHistory::is_of(const Bur& bur) const { return head_ == outline_text(bur.profile()); }

CutWay SweepHistory::kept() const {
  const Number forgotten = std::clamp(highest_ - kRemembered, 0, latest_);
  CutWay kept{head_, {}, BrickGrid<float>(deepest_.first_brick(), deepest_.brick_counts(), 0, {0})};
  for (Number n = forgotten + 1; n <= latest_; ++n) kept.parts.push_back(*find(n));
  std::array<float, kBrickVoxels> numbers;
  for (std::size_t b = 0; b < deepest_.table_size(); ++b) {
    if (deepest_.is_uniform(b) && deepest_.uniform_value(b) == 0) continue;
    const float* from = deepest_.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v)
      numbers[v] = std::max(0.0F, from[v] - static_cast<float>(forgotten));
    kept.deepest.set_brick(b, numbers.data());
  }
  return kept;
}

void SweepHistory::go_on_from(const CutWay& kept) {
  if (kept.head != head_) return;
  const std::size_t count = kept.parts.size(),
                    first = count > kRemembered ? count - kRemembered : 0;
  for (std::size_t n = first; n < count; ++n) parts_[(n + 1) % kRemembered] = {kept.parts[n]};
  latest_ = highest_ = static_cast<Number>(count);
  for (std::size_t b = 0; b < deepest_.table_size(); ++b) {
    const Index3 at = deepest_.brick_origin(b);
    const std::int64_t from = kept.deepest.brick_index(at.x(), at.y(), at.z());
    if (from < 0) continue;
    const auto source = static_cast<std::size_t>(from);
    if (kept.deepest.is_uniform(source) && kept.deepest.uniform_value(source) == 0) continue;
    if (float* to = write(b)) std::copy_n(kept.deepest.brick(source), kBrickVoxels, to);
  }
}

SweepHistory::Number SweepHistory::note(const Bur& bur, const Pose& from, const Pose& to,
                                        bool follows) noexcept {
  bool goes_on = false;
  if (latest_ > 0 && follows) {
    StraightSweep& last = parts_[static_cast<std::size_t>(latest_ % kRemembered)];
    goes_on = (last.from.position + last.way - from.position).norm() < aside_;
    if (goes_on && last.lead_on(bur, to, aside_)) return latest_;
    goes_on = goes_on &&
              (last.from.orientation * Vec3::UnitZ() - from.orientation * Vec3::UnitZ()).norm() <
                  kSameLean;
  }
  StraightSweep sweep{from, Vec3::Zero(), 0, goes_on};
  if (latest_ == kLastNumber || !sweep.lead_on(bur, to, aside_)) return 0;
  parts_[static_cast<std::size_t>(++latest_ % kRemembered)] = sweep;
  highest_ = std::max(highest_, latest_);
  return latest_;
}

const StraightSweep* SweepHistory::find(Number number) const noexcept {
  if (number <= 0 || number > latest_ || number <= highest_ - kRemembered) return nullptr;
  return &parts_[static_cast<std::size_t>(number % kRemembered)];
}

}  // namespace toothprep
