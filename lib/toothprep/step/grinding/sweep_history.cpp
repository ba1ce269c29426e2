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

SweepHistory::Head::Head(const std::string& outline)
    : text(outline), standing(outline_of(outline)), bur(outline, outline_of(outline), 0, 0) {}

SweepHistory::SweepHistory(const LevelSet& cut, double voxel, std::size_t most)
    : aside_(kSweptAside * voxel),
      parts_(kRemembered),
      deepest_(cut.first_brick(), cut.brick_counts(), 0, {0}) {
  deepest_.reserve(cut.bricks_stored() + cut.bricks_free());
  commit_bricks(deepest_, voxel, most);
}

void SweepHistory::drop_behind(Number last) noexcept {
  latest_ = std::min(latest_, std::max(last, forgotten_));
}

int SweepHistory::number_of(const std::string& outline) {
  const auto has_it = [&](const auto& head) { return head->text == outline; };
  const auto found = std::find_if(heads_.begin(), heads_.end(), has_it) - heads_.begin();
  if (found == std::ssize(heads_)) heads_.push_back(std::make_unique<Head>(outline));
  return static_cast<int>(found);
}

void SweepHistory::take(const Bur& bur) { head_ = number_of(outline_text(bur.profile())); }

SweepHistory::Number SweepHistory::first_known() const noexcept {
  return 1 + std::max(forgotten_, highest_ - kRemembered);
}

CutWay SweepHistory::kept() const {
  const Number forgotten = std::min(first_known() - 1, latest_);
  CutWay kept{{}, {}, BrickGrid<float>(deepest_.first_brick(), deepest_.brick_counts(), 0, {0})};
  std::vector<int> number_of_head(heads_.size(), -1);
  for (Number n = forgotten + 1; n <= latest_; ++n) {
    StraightPart part = *find(n);
    int& number = number_of_head[static_cast<std::size_t>(part.head)];
    if (number < 0) {
      number = static_cast<int>(kept.heads.size());
      kept.heads.push_back(head_of(part).text);
    }
    part.head = number;
    kept.parts.push_back(part);
  }
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
  std::vector<int> heads;
  for (const std::string& outline : kept.heads) heads.push_back(number_of(outline));
  const std::size_t count = kept.parts.size(),
                    first = count > kRemembered ? count - kRemembered : 0;
  for (std::size_t n = first; n < count; ++n) {
    StraightSweep& part = parts_[(n + 1) % kRemembered] = {kept.parts[n]};
    part.head = heads[static_cast<std::size_t>(part.head)];
  }
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
  if (latest_ > forgotten_ && follows) {
    StraightSweep& last = parts_[static_cast<std::size_t>(latest_ % kRemembered)];
    goes_on = is_own(last) && (last.from.position + last.way - from.position).norm() < aside_;
    if (goes_on && last.lead_on(bur, to, aside_)) return latest_;
    goes_on = goes_on &&
              (last.from.orientation * Vec3::UnitZ() - from.orientation * Vec3::UnitZ()).norm() <
                  kSameLean;
  }
  StraightSweep sweep{from, Vec3::Zero(), 0, goes_on, head_};
  if (latest_ == kLastNumber || !sweep.lead_on(bur, to, aside_)) return 0;
  parts_[static_cast<std::size_t>(++latest_ % kRemembered)] = sweep;
  highest_ = std::max(highest_, latest_);
  return latest_;
}

const StraightSweep* SweepHistory::find(Number number) const noexcept {
  if (number < first_known() || number > latest_) return nullptr;
  return &parts_[static_cast<std::size_t>(number % kRemembered)];
}

}  // namespace toothprep
