#include "toothprep/step/grinding/removal.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {
namespace {

// A way of more than 17 voxels is swept coarser: 2 mm in steps of 0.06 mm, which leaves ridges of
// 1 µm with a bur of 1.2 mm.
constexpr std::size_t kMaxSubPoses = 32;
// Of the way that is not yet cut, at most; and how many are due, however little way they are.
constexpr std::size_t kMostWaypoints = 512;
constexpr std::size_t kDueWaypoints = 12;
// A cut is due after a voxel of way, or after this: finer voxels would be carved more often, not
// better.
constexpr double kLeastDue = 0.05;  // mm
// Distance of sub-poses, of the way after which a cut is due: half, and a little more, so that a cut
// that is due by a hair takes two.
constexpr double kSubPoses = 0.55;
// Where a sharp edge cuts, nearer, so that the ridges between them are no higher than this part of it.
constexpr double kRidge = 0.03;
// Unless no point of the head turns by this (voxels): then the sweep of an edge is known (swept_edge.h).
constexpr double kTurns = 0.01;
// Bricks are carved in blocks of 4³ voxels: those wholly inside or outside of the bur's band are
// judged by their centre.
constexpr int kBlockRows = kBlockEdge * kBlockEdge, kBlockVoxels = kDistanceBlock;
constexpr int kBlocks = kBrickVoxels / kBlockVoxels;
constexpr float kDistanceRounding = 1e-5f;  // mm, of distances in single precision
constexpr float kSurface = 0.501f;  // voxels: a voxel that is nearer to a surface is crossed by it
constexpr float kRoot3 = 1.7320509f;
constexpr float kHalfEdge = 0.5f * (kBlockEdge - 1);  // voxels, from a block's middle to a side
constexpr double kHalfBlock = 0.5 * (kBlockEdge - 1) * kRoot3;  // and to a corner
// A sweep is taken for a translation if no point of the head leaves its chord by more than this,
constexpr double kStraight = 0.01;  // voxels
// nor goes farther than its ends: what was ground beyond them and left would be ground each time.
constexpr double kBeyondEnds = 0.01;  // voxels
// A cut is carved in proportion to the way, a little ahead of the next one's being due. At once it
// would come too near to the surface: a wall that is nearer than most of a voxel disturbs what is
// read there, so that a slow bur would have felt less than a fast one.
constexpr double kAhead = 1.25;
// Where the way winds a cut takes up only its straight part, so that the next one is due the sooner: carved within so
// much of the usual way, at least.
constexpr double kLeastPace = 0.5;
// Never more than so many a step, however fast the bur: at 1 to 4 µs each (bench_step) a quarter of
// a millisecond. A cut that is then late leaves more way to the next one, which costs less than the
// same way in several, so that the delay stays below a voxel or two up to some 50 mm/s.
constexpr std::size_t kMostBricks = 64;
// The bricks of a cut are visited in leaps of about this part of it, so that those with much to
// carve and those with nothing come evenly.
constexpr double kLeap = 0.618;

// A block that is gone as a whole: more than any band.
constexpr std::array<float, kBlockVoxels> all_gone() {
  std::array<float, kBlockVoxels> values{};
  for (float& v : values) v = std::numeric_limits<float>::max();
  return values;
}
constexpr std::array<float, kBlockVoxels> kGone = all_gone();

// The first voxel of a block in its brick.
Index3 corner_of_block(int block) {
  return kBlockEdge * Index3(block >> 2, (block >> 1) & 1, block & 1);
}
// Where row number `row` of a block (along z) begins, from the block's first voxel in its brick.
constexpr int row_offset(int row) { return brick_offset(row / kBlockEdge, row % kBlockEdge, 0); }
// The block that row number `row` of a brick, of half its length, belongs to.
constexpr int block_of_row(int row) {
  return (row >> 6 & 1) << 2 | (row >> 3 & 1) << 1 | (row & 1);
}

// Of the tip, in B at the end, mm.
Vec3 way_in_bur(const Pose& from, const Pose& to) {
  return to.orientation.conjugate() * (to.position - from.position);
}

// In B, mm, of a point `p` voxels from the tip (W).
Eigen::Vector3f place(const float* to_bur, const Eigen::Vector3f& p) noexcept {
  const float* m = to_bur;
  return {m[0] * p.x() + m[1] * p.y() + m[2] * p.z(), m[3] * p.x() + m[4] * p.y() + m[5] * p.z(),
          m[6] * p.x() + m[7] * p.y() + m[8] * p.z()};
}

// Distance from the bur's axis and place along it, likewise.
void put_place(const float* to_bur, const Eigen::Vector3f& p, float& r, float& z) noexcept {
  const Eigen::Vector3f at = place(to_bur, p);
  r = std::sqrt(at.x() * at.x() + at.y() * at.y());
  z = at.z();
}

// Has a brick's values brought near to the processor, to be read soon.
void bring_near(const float* values) noexcept {
  constexpr int kLine = 64 / sizeof(float);
  for (int v = 0; v < kBrickVoxels; v += kLine) __builtin_prefetch(values + v);
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
    Float4 lowest = load4(from);
    for (int row = 1; row < kBlockRows; ++row)
      lowest = least(lowest, load4(from + row_offset(row)));
    low[block] = least_of(lowest);
  }
}

}  // namespace

Removal::Removal(const Bur& bur, Workpiece& workpiece, const Pose& pose)
    : bur_(bur),
      workpiece_(workpiece),
      due_distance_(std::max(workpiece.voxel(), kLeastDue)),
      voxel_volume_(std::pow(workpiece.voxel(), 3)),
      arm_(std::hypot(bur.head_length(), bur.max_radius())),
      convex_(is_convex(bur.profile())),
      ridges_(bur),
      sides_(bur, kHalfBlock * workpiece.voxel() + kSubPoses * due_distance_,
             (kBandVoxels + kHalfBlock + 1) * workpiece.voxel()),
      last_(pose),
      history_(workpiece.way_of(bur)),
      carved_at_(pose) {
  for (const SharpEdge& edge : sharp_edges(bur.profile())) edges_.emplace_back(edge);
  way_.reserve(kMostWaypoints);
  sub_poses_.reserve(kMaxSubPoses);
  from_brick_.resize(kMaxSubPoses);
  from_blocks_.resize(kBlocks * kMaxSubPoses);
  carved_.reserve(workpiece.spare_bricks());
}

double Removal::displacement(const Pose& from, const Pose& to) const noexcept {
  // The farthest that any point of the head moved: its tip, plus the turn times its longest arm.
  const bool turned = from.orientation.coeffs() != to.orientation.coeffs();
  const double turn = turned ? from.orientation.angularDistance(to.orientation) : 0;
  return (to.position - from.position).norm() + turn * arm_;
}

void Removal::add_waypoint(const Pose& pose) noexcept {
  const bool jump = std::exchange(resumes_, false);
  const double step = displacement(way_.empty() ? last_ : way_.back().pose, pose);
  if (!jump && step == 0) return;
  // The latest is moved on as long as it is near to the one before and the way hardly winds; or if
  // there is no place for more. A way of length l between places at distance c is nowhere farther
  // than sqrt(l² - c²)/2 from the line between them. What goes aside for less than a voxel and comes
  // back was ground too: were it not cut, it would be ground anew each time.
  const auto moves_on = [&] {
    if (jump || way_.empty() || way_.back().jump) return false;
    if (way_.size() == way_.capacity()) return true;
    const Pose& before = way_.size() > 1 ? way_[way_.size() - 2].pose : last_;
    const double chord = displacement(before, pose);
    const double length = way_.back().length + step, aside = 2 * kStraight * workpiece_.voxel();
    const double farthest = displacement(before, way_.back().pose);
    return chord <= kSubPoses * due_distance_ &&
           chord >= farthest - kBeyondEnds * workpiece_.voxel() &&
           length * length - chord * chord <= aside * aside;
  };
  if (moves_on()) {
    way_.back().pose = pose;
    way_.back().length += step;
    return;
  }
  if (way_.size() == way_.capacity()) {
    carve_all();
    plan();
  }
  way_.push_back({pose, jump, step});
}

// After a voxel of way, however it winds; and of what is left before a pause.
bool Removal::cut_is_due() const noexcept { return !(way_until_due() > 0); }

// How far that is from here, mm.
double Removal::way_until_due() const noexcept {
  if (way_.size() >= kDueWaypoints) return 0;
  double length = 0;
  for (const Waypoint& w : way_) {
    if (w.jump) return 0;
    length += w.length;
  }
  return due_distance_ - length;
}

// A cut of the way as far as the next jump, or as it is straight: the longest part by halving.
void Removal::plan() noexcept {
  while (!way_.empty() && way_.front().jump) {
    last_ = way_.front().pose;
    last_carved_ = false;
    way_.erase(way_.begin());
  }
  std::size_t count = 0;
  while (count < way_.size() && !way_[count].jump) ++count;
  if (count == 0) return;
  bool straight = is_straight(count);
  for (; !straight && count > 1; straight = is_straight(count)) count /= 2;
  const Pose end = way_[count - 1].pose;
  one_least_ = convex_ && straight;
  late_ = displacement(last_, end) > 2 * due_distance_;
  part_ = one_least_ ? history_.note(bur_, last_, end, last_carved_) : 0;
  plan_sub_poses(last_, end);
  plan_sides(last_, end);
  last_ = end;
  last_carved_ = true;
  way_.erase(way_.begin(), way_.begin() + static_cast<long>(count));
  way_since_plan_ = 0;
  due_after_ = std::max(way_until_due(), kLeastPace * due_distance_);
  plan_box();
}

void Removal::plan_sub_poses(const Pose& from, const Pose& to) noexcept {
  const double voxel = workpiece_.voxel();
  const Vec3 way = way_in_bur(from, to);
  double ridge = way.squaredNorm() > 0 ? ridges_.height_per_step(way.normalized()) : 0;
  const double turn = from.orientation.angularDistance(to.orientation) * arm_;
  edges_draw_ = ridge > 0 && one_least_ && turn < kTurns * voxel;
  drawn_deeper_ = 0;
  if (edges_draw_) {
    for (SweptEdge& edge : edges_) edge.move(way.normalized());
    drawn_way_ = static_cast<float>(way.norm());
    drawn_deeper_ = static_cast<float>(std::exchange(ridge, 0) * kSubPoses * due_distance_);
  }
  const double spacing = due_distance_ * (ridge * kSubPoses > kRidge ? kRidge / ridge : kSubPoses);
  const auto count = static_cast<int>(std::clamp(std::ceil(displacement(from, to) / spacing), 1.0,
                                                 static_cast<double>(kMaxSubPoses)));
  sub_poses_.clear();
  for (int i = 1; i <= count; ++i) {
    const double t = static_cast<double>(i) / count;
    const Quat q = i == count ? to.orientation : from.orientation.slerp(t, to.orientation);
    const Vec3 p =
        i == count ? to.position : Vec3(from.position + t * (to.position - from.position));
    SubPose s;
    s.tip = workpiece_.lattice().to_index(p);
    s.end = s.tip + q * Vec3(0, 0, bur_.head_length() / voxel);
    const Mat3 to_bur = q.toRotationMatrix().transpose() * voxel;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) s.to_bur[3 * r + c] = static_cast<float>(to_bur(r, c));
    sub_poses_.push_back(s);
  }
}

// Whether and how the sides of the head's motion tell what a sub-pose can cut.
void Removal::plan_sides(const Pose& from, const Pose& to) noexcept {
  const double voxel = workpiece_.voxel();
  const double step = displacement(from, to) / static_cast<double>(sub_poses_.size());
  by_sides_ = one_least_ && step <= kSubPoses * due_distance_ * (1 + 1e-6);
  from_carved_ = last_carved_;
  if (!by_sides_) return;
  const Vec3 way = way_in_bur(from, to);
  const double turn = from.orientation.angularDistance(to.orientation);
  const double arm = arm_ + way.norm() + (kBandVoxels + 2 * kHalfBlock) * voxel;
  motion_.x = static_cast<float>(way.x());
  motion_.y = static_cast<float>(way.y());
  motion_.z = static_cast<float>(way.z());
  motion_.across = static_cast<float>(std::sqrt(way.x() * way.x() + way.y() * way.y()));
  // From one sub-pose to the next the distance changes by more than it is rounded by.
  motion_.uncertain = static_cast<float>(
      3 * turn * arm + 2 * kDistanceRounding * static_cast<double>(sub_poses_.size()));
}

// Whether the sweep is a translation along a line: nowhere further off it than a small part of a
// voxel, and not beyond its ends.
bool Removal::is_straight(std::size_t waypoints) const noexcept {
  const Pose& end = way_[waypoints - 1].pose;
  const double limit = kStraight * workpiece_.voxel();
  const double turn = last_.orientation.angularDistance(end.orientation);
  if (turn * turn / 8 * bur_.head_length() > limit) return false;
  const Vec3 chord = end.position - last_.position;
  const double length = chord.norm(), beyond = kBeyondEnds * workpiece_.voxel();
  const Vec3 along = length > 0 ? Vec3(chord / length) : Vec3::Zero();
  for (std::size_t i = 0; i < waypoints; ++i) {
    const Vec3 from_start = way_[i].pose.position - last_.position;
    const double here = along.dot(from_start);
    if (here < -beyond || here > length + beyond) return false;
    if ((from_start - here * along).norm() > limit) return false;
  }
  return true;
}

// The bricks that the sub-poses may touch: the boxes of the capsules around the head, grown by the
// band.
void Removal::plan_box() noexcept {
  const LevelSet& solid = workpiece_.solid();
  const Vec3 grow = Vec3::Constant(bur_.max_radius() / workpiece_.voxel() + kBandVoxels);
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (const SubPose& s : sub_poses_) {
    low = low.cwiseMin(s.tip.cwiseMin(s.end) - grow);
    high = high.cwiseMax(s.tip.cwiseMax(s.end) + grow);
  }
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

// Visits `visits` bricks of the box, and carves `bricks` of them at most.
void Removal::carve_some(std::size_t visits, std::size_t bricks) noexcept {
  const LevelSet& solid = workpiece_.solid();
  const LevelSet& cut = workpiece_.cut();
  const std::size_t end = cursor_ + std::min(box_size_ - cursor_, visits);
  for (; cursor_ < end && bricks > 0; ++cursor_) {
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
    --bricks;
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

// from_brick_: how far the bur is from `centre` (index coordinates) at each sub-pose.
void Removal::measure_brick(const Vec3& centre) noexcept {
  alignas(32) float r[kBlocks], z[kBlocks];
  for (std::size_t from = 0; from < sub_poses_.size(); from += kBlocks) {
    const std::size_t some = std::min<std::size_t>(kBlocks, sub_poses_.size() - from);
    for (std::size_t i = 0; i < some; ++i)
      put_place(sub_poses_[from + i].to_bur, (centre - sub_poses_[from + i].tip).cast<float>(),
                r[i], z[i]);
    bur_.mitred_distances(r, z, from_brick_.data() + from, static_cast<int>(some));
  }
}

// from_blocks_: the same for the centres of the brick's blocks, at the sub-poses of `near`.
void Removal::measure_blocks(const Index3& first, Range near) noexcept {
  alignas(32) float r[kBlocks], z[kBlocks];
  for (std::size_t i = near.begin; i < near.end; ++i) {
    const SubPose& s = sub_poses_[i];
    const Eigen::Vector3f offset =
        (first.cast<double>() - s.tip).cast<float>() + Eigen::Vector3f::Constant(kHalfEdge);
    for (int block = 0; block < kBlocks; ++block)
      put_place(s.to_bur, offset + corner_of_block(block).cast<float>(), r[block], z[block]);
    bur_.mitred_distances(r, z, from_blocks_.data() + kBlocks * i, kBlocks);
  }
}

void Removal::carve_brick(std::size_t brick) noexcept {
  const LevelSet& cut = workpiece_.cut();
  const float band = workpiece_.band(), voxel = static_cast<float>(workpiece_.voxel());
  const float half = 0.5f * static_cast<float>(kBrickEdge - 1) * kRoot3 * voxel;
  const Index3 first = cut.brick_origin(brick);
  measure_brick(first.cast<double>() + Vec3::Constant(0.5 * (kBrickEdge - 1)));
  // A distance changes by no more than the way from the centre.
  const auto begin = from_brick_.begin(), end = begin + static_cast<long>(sub_poses_.size());
  const auto reaches = [&](float d) { return d <= half + band; };
  const auto one = std::find_if(begin, end, reaches);
  if (one == end) return;
  auto past = end;
  while (!reaches(past[-1])) --past;
  const Range near{static_cast<std::size_t>(one - begin), static_cast<std::size_t>(past - begin)};
  const bool gone = *std::min_element(begin, end) < -half - band;
  UnderWay b{brick, cut.brick(brick)};
  bring_near(b.before);
  if (!gone) measure_blocks(first, near);
  least_of_blocks(b.before, cut.is_uniform(brick), b.low);
  for (int block = 0; block < kBlocks; ++block) {
    if (b.low[block] >= band) continue;
    if (gone)
      put_block(block, kGone.data(), b);
    else
      sweep_block(first, block, near, b);
  }
  if (b.changed == 0) return;
  count_removed(brick, b);
  if (WorkpieceBodies* bodies = workpiece_.bodies())
    bodies->count_removed(brick, b.before, b.values);
  const bool left = std::any_of(b.low, b.low + kBlocks, [&](float low) { return low < band; });
  if (!left) kept_ = b.values;
  carved_.push_back({brick, left ? b.values : nullptr});
}

// Carves a block of the brick.
void Removal::sweep_block(const Index3& first, int block, Range near, UnderWay& b) noexcept {
  const float band = workpiece_.band();
  const float half = static_cast<float>(kHalfBlock) * static_cast<float>(workpiece_.voxel());
  const float low = b.low[block];
  const float* d = from_blocks_.data() + block;
  std::size_t best = near.begin;
  for (std::size_t i = near.begin; i < near.end; ++i)
    if (d[kBlocks * i] < d[kBlocks * best]) best = i;
  // Whether it is near enough, and can cut something deeper than it is.
  const auto cuts = [&](std::size_t i, float deeper = kDistanceRounding) {
    return d[kBlocks * i] <= half + band && low < half - d[kBlocks * i] + deeper;
  };
  if (!cuts(best, kDistanceRounding + drawn_deeper_)) return;
  if (d[kBlocks * best] < -half - band) return put_block(block, kGone.data(), b);
  const Eigen::Vector3f corner = corner_of_block(block).cast<float>();
  const auto offset = [&](std::size_t i) -> Eigen::Vector3f {
    return (first.cast<double>() - sub_poses_[i].tip).cast<float>() + corner;
  };
  const FeedSides::Side side = side_of_block(best, offset(best));
  if (side == FeedSides::Side::kBehind) return;
  alignas(32) float deepest[kBlockVoxels];
  std::fill_n(deepest, kBlockVoxels, -band);
  const auto deepens = [&](std::size_t i) {
    return cuts(i) && carve_block(sub_poses_[i], offset(i), deepest);
  };
  deepens(best);
  if (side == FeedSides::Side::kEither) {
    for (std::size_t i = best + 1; i < near.end; ++i)
      if (!deepens(i) && one_least_) break;
    for (std::size_t i = best; i-- > near.begin;)
      if (!deepens(i) && one_least_) break;
    if (edges_draw_) draw_edges(offset(sub_poses_.size() - 1), deepest);
  }
  put_block(block, deepest, b);
}

// deepest <- max(deepest, -d_edge) with what sharp edges sweep, of the 4³ voxels from `offset` (voxels from the tip at
// the last sub-pose).
void Removal::draw_edges(const Eigen::Vector3f& offset, float* deepest) const noexcept {
  const float* m = sub_poses_.back().to_bur;
  const Float4 k{0, 1, 2, 3};
  for (const SweptEdge& edge : edges_) {
    if (!edge.draws()) continue;
    for (int row = 0; row < kBlockRows; ++row) {
      const Index3 in_block(row / kBlockEdge, row % kBlockEdge, 0);
      const Eigen::Vector3f first = place(m, offset + in_block.cast<float>());
      const Float4 z = first.z() + k * m[8];
      const SweptEdge::Sample cut =
          edge.at(edge.across(first.x() + k * m[2], first.y() + k * m[5], z - edge.height()));
      const Float4 way = edge.way_to(z, cut.distance), before = load4(deepest + kBlockEdge * row);
      const Int4 counts = cut.counts & (way <= 0) & (way >= -drawn_way_);
      store4(counts ? greatest(before, -cut.distance) : before, deepest + kBlockEdge * row);
    }
  }
}

// Where the sub-pose that is nearest to a block, `offset` voxels from the tip, has nothing to cut
// there that the place before the sweep didn't, or no other sub-pose of the sweep has.
FeedSides::Side Removal::side_of_block(std::size_t nearest,
                                       const Eigen::Vector3f& offset) const noexcept {
  const bool first = nearest == 0 && from_carved_, last = nearest + 1 == sub_poses_.size();
  if (!by_sides_ || !(first || last)) return FeedSides::Side::kEither;
  const Eigen::Vector3f middle = offset + Eigen::Vector3f::Constant(kHalfEdge);
  const Eigen::Vector3f at = place(sub_poses_[nearest].to_bur, middle);
  const float r = std::sqrt(at.x() * at.x() + at.y() * at.y());
  const FeedSides::Side side = sides_.of(at.x(), at.y(), r, at.z(), motion_);
  const bool counts = side == FeedSides::Side::kAhead ? last : first;
  return counts ? side : FeedSides::Side::kEither;
}

// The block's values become `deepest` where that is above what they were.
void Removal::put_block(int block, const float* deepest, UnderWay& b) noexcept {
  const float band = workpiece_.band();
  const Index3 corner = corner_of_block(block);
  const int start = brick_offset(corner.x(), corner.y(), corner.z());
  alignas(32) float now[kBlockVoxels];
  Int4 deeper{};
  Float4 low = all4(band), high = all4(-band);
  for (int row = 0; row < kBlockRows; ++row) {
    const Float4 before = load4(b.before + start + row_offset(row));
    const Float4 value = least(greatest(load4(deepest + kBlockEdge * row), before), all4(band));
    deeper |= value > before;
    low = least(low, value);
    high = greatest(high, value);
    store4(value, now + kBlockEdge * row);
  }
  if (!(deeper[0] | deeper[1] | deeper[2] | deeper[3])) return;
  if (!b.values) {
    b.values = kept_ ? std::exchange(kept_, nullptr) : workpiece_.cut().take_brick();
    if (!b.values) return;  // cannot happen: the workpiece reserved enough
    std::copy(b.before, b.before + kBrickVoxels, b.values);
  }
  float* const by = history_.write(b.brick);
  for (int row = 0; by && row < kBlockRows; ++row) {
    const int at = start + row_offset(row);
    const Int4 cuts_here = load4(now + kBlockEdge * row) > load4(b.before + at);
    store4(cuts_here ? all4(static_cast<float>(part_)) : load4(by + at), by + at);
  }
  for (int row = 0; row < kBlockRows; ++row)
    std::copy(now + kBlockEdge * row, now + kBlockEdge * (row + 1),
              b.values + start + row_offset(row));
  b.changed |= 1u << block;
  // Nothing is gone where all was out of the solid before, or all is in it still.
  const float surface = kSurface * static_cast<float>(workpiece_.voxel());
  const float highest = std::max(std::max(high[0], high[1]), std::max(high[2], high[3]));
  if (b.low[block] < surface && highest > -surface) b.counted |= 1u << block;
  b.low[block] = std::min(std::min(low[0], low[1]), std::min(low[2], low[3]));
}

// deepest <- max(deepest, -d_bur) for the 4³ voxels from `offset` (voxels from the tip). Whether any
// changed.
bool Removal::carve_block(const SubPose& s, const Eigen::Vector3f& offset,
                          float* deepest) noexcept {
  alignas(32) float r[kBlockVoxels], z[kBlockVoxels], d[kBlockVoxels];
  places_of_block(s.to_bur, offset.data(), r, z);
  const auto half = static_cast<float>(kHalfBlock * workpiece_.voxel());
  DistanceBall ball{0, 0, half + kDistanceRounding};
  put_place(s.to_bur, offset + Eigen::Vector3f::Constant(kHalfEdge), ball.r, ball.z);
  bur_.mitred_distances_near(ball, r, z, d);
  int deeper = 0;
  for (int v = 0; v < kBlockVoxels; ++v) {
    deeper |= -d[v] > deepest[v] ? 1 : 0;
    deepest[v] = std::max(deepest[v], -d[v]);
  }
  return deeper != 0;
}

// Volume of what remains in a voxel: (1/2 - phi/D) clamped to [0, 1]; before less after, by tissue.
// At the border of two tissues a voxel is shared as their level sets share it. In the order of the
// voxels, whichever blocks are left out.
void Removal::count_removed(std::size_t brick, const UnderWay& b) noexcept {
  const float* solid = workpiece_.solid().brick(brick);
  const std::uint8_t* labels = workpiece_.labels().brick(brick);
  const auto per_voxel = static_cast<float>(1 / workpiece_.voxel());
  const auto inside = [per_voxel](auto phi) {
    using T = decltype(phi);
    return least(greatest(0.5f - phi * per_voxel, T{}), T{} + 1.0f);
  };
  const auto of_rows = [&b](const auto& count) {
    for (int row = 0; row < kBrickVoxels / kBlockEdge; ++row)
      if (b.counted >> block_of_row(row) & 1u) count(kBlockEdge * row);
  };
  if (workpiece_.only_tissue(brick) != 0) {
    Float4 sums[4] = {};
    of_rows([&](int v) {
      const Float4 of_tooth = load4(solid + v);
      const Float4 gone = inside(greatest(of_tooth, load4(b.before + v))) -
                          inside(greatest(of_tooth, load4(b.values + v)));
      const Int4 label{labels[v], labels[v + 1], labels[v + 2], labels[v + 3]};
      sums[v / kBlockEdge % 4] += label == 0 ? Float4{} : gone;
    });
    float sum = 0;
    for (const Float4& s : sums)
      for (int k = 0; k < kBlockEdge; ++k) sum += s[k];
    removed_[workpiece_.only_tissue(brick) - 1] += voxel_volume_ * static_cast<double>(sum);
    return;
  }
  const auto& remains = workpiece_.tissues();
  const PackedBrick enamel = remains[0].brick(brick), dentin = remains[1].brick(brick),
                    pulp = remains[2].brick(brick);
  PerTissue<float> fraction{};
  const auto count = [&](int v) {
    const float gone =
        inside(std::max(solid[v], b.before[v])) - inside(std::max(solid[v], b.values[v]));
    if (gone <= 0 || labels[v] == 0) return;
    if (labels[v] != static_cast<std::uint8_t>(Tissue::kOther)) {
      const float share[3] = {inside(enamel[v]), inside(dentin[v]), inside(pulp[v])};
      const float sum = share[0] + share[1] + share[2];
      if (sum > 0) {
        for (int k = 0; k < 3; ++k) fraction[k] += gone * share[k] / sum;
        return;
      }
    }
    fraction[labels[v] - 1] += gone;
  };
  of_rows([&](int v) {
    for (int k = 0; k < kBlockEdge; ++k) count(v + k);
  });
  for (int k = 0; k < kTissueCount; ++k)
    removed_[k] += voxel_volume_ * static_cast<double>(fraction[k]);
}

PerTissue<double> Removal::clear(const Pose& pose) {
  const PerTissue<double> before = removed_;
  last_ = carved_at_ = pose;
  way_.assign(1, {pose, false, 0});
  plan();
  carve_all();
  PerTissue<double> volume{};
  for (int k = 0; k < kTissueCount; ++k) volume[k] = removed_[k] - before[k];
  removed_ = before;
  return volume;
}

void Removal::advance(const Pose& pose) noexcept {
  resumes_ |= std::exchange(paused_, false);
  if (resumes_) carved_at_ = pose;
  add_waypoint(pose);
  advanced_ = true;
}

void Removal::pause(const Pose& pose) noexcept {
  if (!paused_) add_waypoint(pose);
  paused_ = true;
}

void Removal::carve() noexcept {
  if (!std::exchange(advanced_, false)) return;
  const Pose& pose = way_.empty() ? last_ : way_.back().pose;
  way_since_plan_ += displacement(carved_at_, pose);
  carved_at_ = pose;
  if (cursor_ >= box_size_ && cut_is_due()) plan();
  if (cursor_ >= box_size_) return;
  const bool hurry = late_ || cut_is_due();
  const double after = std::min(due_distance_ / kAhead, due_after_);
  const double part = hurry ? 1 : std::min(1.0, way_since_plan_ / after);
  const auto by_now = static_cast<std::size_t>(std::ceil(part * static_cast<double>(box_size_)));
  if (by_now > cursor_) carve_some(by_now - cursor_, kMostBricks);
}

std::size_t Removal::ahead(const Pose& pose, const Vec3& v, const Vec3& omega,
                           std::span<Pose> found) const noexcept {
  const double least = kBeyondEnds * workpiece_.voxel();
  const Vec3 ends[2] = {Vec3::Zero(), Vec3(0, 0, bur_.head_length())};  // of the axis, B
  std::size_t count = 0;
  const auto add = [&](const Pose& been) {
    for (const Vec3& end : ends) {
      const Vec3 velocity = v + omega.cross(end);
      const Vec3 way = pose.to_local(been.to_world(end)) - end;
      if (way.dot(velocity) <= least * velocity.norm()) continue;
      found[count++] = been;
      return;
    }
  };
  for (auto w = way_.rbegin(); w != way_.rend(); ++w) {
    if (count == found.size() || w->jump) return count;
    add(w->pose);
  }
  if (count < found.size() && cursor_ < box_size_) add(last_);
  return count;
}

void Removal::finish(const Pose& pose) noexcept {
  if (!paused_) add_waypoint(pose);
  carve_all();
  while (!way_.empty()) {
    plan();
    carve_all();
  }
}

}  // namespace toothprep
