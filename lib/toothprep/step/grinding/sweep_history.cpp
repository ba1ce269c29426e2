#include "toothprep/step/grinding/sweep_history.h"

#include "toothprep/step/grinding/commit_bricks.h"

namespace toothprep {
namespace {

// So many parts are remembered; and to so many voxels where the bur was.
constexpr std::int32_t kRemembered = 4096;
constexpr double kSweptAside = 0.006;
constexpr double kSameLean = 1e-3;             // sine
constexpr std::int32_t kLastNumber = 1 << 24;  // that a float holds

}  // namespace

SweepHistory::SweepHistory(const Workpiece& workpiece)
    : aside_(kSweptAside * workpiece.voxel()),
      parts_(kRemembered),
      deepest_(workpiece.cut().first_brick(), workpiece.cut().brick_counts(), 0, {0}) {
  deepest_.reserve(workpiece.cut().bricks_stored() + workpiece.cut().bricks_free());
  commit_bricks(deepest_, workpiece.voxel(), workpiece.spare_bricks());
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
  return latest_;
}

const StraightSweep* SweepHistory::find(Number number) const noexcept {
  if (number <= 0 || number > latest_ || number <= latest_ - kRemembered) return nullptr;
  return &parts_[static_cast<std::size_t>(number % kRemembered)];
}

}  // namespace toothprep
