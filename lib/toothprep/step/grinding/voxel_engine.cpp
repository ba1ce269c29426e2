#include "toothprep/step/grinding/voxel_engine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/deep_voxels.h"
#include "toothprep/step/grinding/voxel_at.h"

namespace toothprep {
namespace {

constexpr double kSweepVoxels = 0.55;      // a fast move is swept in steps of half a voxel
constexpr double kElementsPerVoxel = 4;    // along each direction, to share the surface out
constexpr double kSmallestElement = 0.02;  // mm
constexpr double kDepthRounding = 1e-9;    // a centre exactly one voxel deep is boundary
constexpr double kWayRounding = 1e-6;      // voxels

using Cell = std::array<int, 3>;

Vec3 centre_of(const Cell& c, double pitch) {
  return pitch * Vec3(c[0] + 0.5, c[1] + 0.5, c[2] + 0.5);
}

bool within(const Vec3& way, const Vec3& until) {  // not if anything is NaN
  return way.x() < until.x() && way.y() < until.y() && way.z() < until.z();
}

double distance_at(const Bur& bur, const Vec3& x) {
  return bur.distance(std::hypot(x.x(), x.y()), x.z());
}

// The cells of the head by depth: at most one voxel beneath the surface, and whether any is deeper.
struct Layers {
  int half = 0, height = 0;    // cells each way around the axis, and along it
  std::vector<bool> boundary;  // which ones are
  bool any_interior = false;
  std::size_t place(int i, int j, int k) const {
    return static_cast<std::size_t>(((i + half) * 2 * half + j + half) * height + k);
  }
  bool has(int i, int j, int k) const {
    return i >= -half && i < half && j >= -half && j < half && k >= 0 && k < height &&
           boundary[place(i, j, k)];
  }
};
Layers layers_of(const Bur& bur, double pitch) {
  Layers layers;
  const int half = layers.half = static_cast<int>(std::ceil(bur.max_radius() / pitch));
  const int height = layers.height = static_cast<int>(std::ceil(bur.head_length() / pitch));
  layers.boundary.resize(static_cast<std::size_t>(4 * half * half * height));
  for (int i = -half; i < half; ++i)
    for (int j = -half; j < half; ++j)
      for (int k = 0; k < height; ++k) {
        const double d = distance_at(bur, centre_of({i, j, k}, pitch));
        if (d >= 0) continue;
        if (d >= -pitch * (1 + kDepthRounding))
          layers.boundary[layers.place(i, j, k)] = true;
        else
          layers.any_interior = true;
      }
  return layers;
}

ContactSet::Element element_at(const Vec3& position, const Vec3& normal, const Vec3& tangent,
                               double weight, double area) {
  const Vec3 m = position.cross(normal);
  const auto f = [](double x) { return static_cast<float>(x); };
  return {f(normal.x()),  f(normal.y()),  f(normal.z()), f(m.x()),         f(m.y()), f(m.z()),
          f(tangent.x()), f(tangent.y()), f(weight),     f(area / weight), f(area)};
}

constexpr int kReach = 3;                       // voxels: to where distances are found
constexpr int kSide = kBrickEdge + 2 * kReach;  // of a brick and what is around it
constexpr std::uint8_t kBeyond = 100;           // the square of a distance that is beyond
using Squares = std::array<std::uint8_t, kSide * kSide * kSide>;

// Of squares of distances to the nearest along some axes, in voxels, those along another one too:
// that on which neighbours are `stride` apart. Right as far as a brick and what is left around it.
void look_along(int stride, Squares& squares) {
  const Squares from = squares;
  for (int i = kReach * stride; i < static_cast<int>(from.size()) - kReach * stride; ++i) {
    std::uint8_t least = from[i];
    for (int d = 1; d <= kReach; ++d)
      least = std::min(least, static_cast<std::uint8_t>(
                                  std::min(from[i - d * stride], from[i + d * stride]) + d * d));
    squares[i] = least;
  }
}

// Per voxel of a brick and around it the square of the distance to the nearest one that is gone, or
// that is there, right in the brick. `bricks`: the brick in the middle and its neighbours, z
// fastest; null: all is there. What was gone `before` counts as there.
Squares squares_to(bool gone, const std::array<const float*, 27>& bricks,
                   const std::array<const float*, 27>& before) {
  constexpr int kBefore = kBrickEdge - kReach;
  Squares squares;
  std::size_t at = 0;
  for (int x = kBefore; x < kBefore + kSide; ++x)
    for (int y = kBefore; y < kBefore + kSide; ++y)
      for (int z = kBefore; z < kBefore + kSide; ++z, ++at) {
        const int b = 9 * (x >> 3) + 3 * (y >> 3) + (z >> 3), v = brick_offset(x & 7, y & 7, z & 7);
        const bool is_gone = bricks[b] && bricks[b][v] > 0 && !(before[b][v] > 0);
        squares[at] = is_gone == gone ? 0 : kBeyond;
      }
  look_along(1, squares);
  look_along(kSide, squares);
  look_along(kSide * kSide, squares);
  return squares;
}

}  // namespace

VoxelEngine::VoxelEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                         const Pose& pose)
    : bur_(bur),
      workpiece_(workpiece),
      before_(workpiece.cut()),
      arm_(std::hypot(bur.head_length(), bur.max_radius())),
      contact_(0, parameters.tissue, parameters.trailing_elements),
      last_(pose) {
  workpiece.forget_way();
  share_surface_out(bur, parameters.handpiece.clockwise);
  turned_.resize(samples_.size());
  places_.resize(samples_.size());
  group_until_.resize((samples_.size() + kGroup - 1) / kGroup, Vec3::Zero());
  met_.resize(samples_.size(), kNoTissue);
  contact_ = ContactSet(samples_.size(), parameters.tissue, parameters.trailing_elements);
}

// Each small element of the true surface goes to the boundary voxel whose centre is nearest to the
// point half a voxel beneath it.
void VoxelEngine::share_surface_out(const Bur& bur, bool clockwise) {
  struct Part {
    double weight = 0, area = 0;
    Vec3 position = Vec3::Zero(), normal = Vec3::Zero(), tangent = Vec3::Zero();
  };
  const double pitch = workpiece_.voxel();
  const Layers layers = layers_of(bur, pitch);
  if (!layers.any_interior)
    throw Error("bur " + bur.name() + ": at a voxel of " + std::to_string(pitch) +
                " mm it has no interior voxel, so that it could never remove anything; voxelize "
                "the tooth finer");
  const SurfaceElements e =
      bur.elements(std::max(pitch / kElementsPerVoxel, kSmallestElement), clockwise);
  std::map<Cell, Part> parts;  // ordered: the sum in the step has a fixed order
  for (std::size_t n = 0; n < e.size(); ++n) {
    const Vec3 position(e.x[n], e.y[n], e.z[n]), normal(e.nx[n], e.ny[n], e.nz[n]);
    const Vec3 beneath = position - 0.5 * pitch * normal;
    const Vec3 index = (beneath / pitch).array().floor();
    Cell best{};
    double nearest = 1e300;
    const auto look = [&](int reach) {
      for (int i = -reach; i <= reach; ++i)
        for (int j = -reach; j <= reach; ++j)
          for (int k = -reach; k <= reach; ++k) {
            const Cell c = {static_cast<int>(index.x()) + i, static_cast<int>(index.y()) + j,
                            static_cast<int>(index.z()) + k};
            if (!layers.has(c[0], c[1], c[2])) continue;
            const double distance = (centre_of(c, pitch) - beneath).squaredNorm();
            if (distance >= nearest) continue;
            nearest = distance;
            best = c;
          }
    };
    look(1);
    // Those farther off are at least one and a half voxels away.
    if (nearest > 2 * pitch * pitch) nearest = 1e300, look(2);
    if (nearest == 1e300) continue;  // a feature thinner than a voxel, which this engine can't see
    Part& part = parts[best];
    part.weight += e.weight[n];
    part.area += e.area[n];
    part.position += e.weight[n] * position;
    part.normal += e.weight[n] * normal;
    part.tangent += e.weight[n] * Vec3(e.tx[n], e.ty[n], 0);
  }
  for (const auto& [cell, part] : parts) {
    if (part.normal.norm() < 1e-6 * part.weight || part.tangent.norm() < 1e-6 * part.weight)
      continue;  // round the axis: opposite directions cancel
    const Vec3 normal = part.normal.normalized();
    Vec3 point = part.position / part.weight;  // a little inside, where the surface is curved
    point -= distance_at(bur, point) * normal;
    samples_.push_back(
        {point, element_at(point, normal, part.tangent.normalized(), part.weight, part.area)});
  }
}

// In a step the tip moves by a small part of a voxel, so most points stay in their voxels: each is
// looked for again when the tip may have moved far enough for it to leave.
void VoxelEngine::follow(const Pose& pose) noexcept {
  const Vec3 tip = workpiece_.lattice().to_index(pose.position);
  const Mat3 rotation = pose.orientation.toRotationMatrix() / workpiece_.voxel();
  const Vec3 by = tip - tip_;
  tip_ = tip;
  bool anew = rotation != rotation_;
  if (anew) {
    rotation_ = rotation;
    moves_.fill(Ways{});
    for (std::size_t i = 0; i < samples_.size(); ++i)
      turned_[i] = rotation * samples_[i].surface_point;
  } else {
    for (int a = 0; a < 3; ++a) {
      bool& known = by[a] < 0 ? moves_[a].down : moves_[a].up;
      if (by[a] == 0 || known) continue;
      known = anew = true;
    }
  }
  // More than any rounding, so that it grows with every move; NaN stays.
  for (int a = 0; a < 3; ++a)
    if (by[a] != 0) way_[a] += std::abs(by[a]) + kWayRounding;
  for (std::size_t group = 0; group < group_until_.size(); ++group)
    if (anew || !within(way_, group_until_[group])) follow_group(group, anew);
}

void VoxelEngine::follow_group(std::size_t group, bool anew) noexcept {
  const std::size_t end = std::min((group + 1) * kGroup, samples_.size());
  Vec3 least = Vec3::Constant(std::numeric_limits<double>::infinity());
  for (std::size_t i = group * kGroup; i < end; ++i) {
    if (anew || !within(way_, places_[i].until)) {
      find_place(i);
      see(i);
    }
    least = least.cwiseMin(places_[i].until);
  }
  group_until_[group] = least;
}

void VoxelEngine::find_place(std::size_t sample) noexcept {
  const LabelGrid& labels = workpiece_.tooth().tissue;
  const Vec3 at = tip_ + turned_[sample] + Vec3::Constant(0.5);
  Place& place = places_[sample];
  place = {};
  if (!(at.cwiseAbs().maxCoeff() <= 1e8)) return;  // far outside; must not overflow
  const Index3 v = voxel_at(at);
  for (int a = 0; a < 3; ++a) {
    double to_face = 1;  // of its voxel, the ways that the tip moves
    if (moves_[a].down) to_face = at[a] - v[a];
    if (moves_[a].up) to_face = std::min(to_face, v[a] + 1 - at[a]);
    place.until[a] = way_[a] + to_face - kWayRounding;
  }
  const std::int64_t brick = labels.brick_index(v.x(), v.y(), v.z());
  if (brick < 0) return;
  const int voxel = brick_offset(v.x() & 7, v.y() & 7, v.z() & 7);
  const std::uint8_t label = labels.brick(static_cast<std::size_t>(brick))[voxel];
  if (label == 0) return;
  place.brick = static_cast<std::int32_t>(brick);
  place.voxel = static_cast<std::int16_t>(voxel);
  place.tissue = static_cast<std::int16_t>(label - 1);
}

// What the sample meets in its place.
void VoxelEngine::see(std::size_t sample) noexcept {
  const LevelSet& cut = workpiece_.cut();  // over the same bricks as the labels
  const Place& place = places_[sample];
  std::int8_t met = kNoTissue;
  if (place.brick >= 0 && !(cut.brick(static_cast<std::size_t>(place.brick))[place.voxel] > 0))
    met = static_cast<std::int8_t>(place.tissue);
  if (met == met_[sample]) return;
  met_[sample] = met;
  stale_ = true;
}

void VoxelEngine::look(const Pose& pose) noexcept {
  follow(pose);
  const std::uint64_t changes = workpiece_.changed().changes();
  if (changes != cut_seen_)
    for (std::size_t i = 0; i < samples_.size(); ++i) see(i);
  cut_seen_ = changes;
}

// Most steps meet what the one before met.
void VoxelEngine::sample(const Pose& pose, const Vec3&, const Vec3&) noexcept {
  look(pose);
  if (!stale_) return;
  stale_ = false;
  contact_.clear();
  for (std::size_t i = 0; i < samples_.size(); ++i)
    if (met_[i] != kNoTissue) contact_.add(samples_[i].element, met_[i], 1);
}

double VoxelEngine::way(const Pose& from, const Pose& to) const noexcept {
  return (to.position - from.position).norm() +
         arm_ * from.orientation.angularDistance(to.orientation);
}

void VoxelEngine::remove_at(const Pose& pose) noexcept {
  LevelSet& cut = workpiece_.cut();
  const auto half = static_cast<float>(0.5 * workpiece_.voxel());
  const double volume = std::pow(workpiece_.voxel(), 3);
  const double depth = workpiece_.voxel() * (1 + kDepthRounding);
  for_deep_voxels(bur_, workpiece_, pose, depth,
                  [&](std::size_t brick, int voxel, const Index3& place, std::uint8_t label) {
                    float* values = cut.writable_brick(brick, false);
                    if (!values)
                      return;  // cannot happen: every brick with tissue has a place reserved
                    values[voxel] = half;
                    workpiece_.changed().mark(brick);
                    removed_[label - 1] += volume;
                    if (WorkpieceBodies* bodies = workpiece_.bodies())
                      bodies->count_removed(place, volume);
                  });
}

void VoxelEngine::sweep(const Pose& to) noexcept {
  const double length = way(last_, to);
  const auto count = static_cast<int>(
      std::clamp(std::ceil(length / (kSweepVoxels * workpiece_.voxel())), 1.0, 1e6));
  for (int i = 1; i < count; ++i) {
    const double t = static_cast<double>(i) / count;
    remove_at({last_.position + t * (to.position - last_.position),
               last_.orientation.slerp(t, to.orientation)});
  }
  remove_at(to);
  last_ = to;
}

PerTissue<double> VoxelEngine::clear(const Pose& pose) {
  const PerTissue<double> before = removed_;
  last_ = pose;
  remove_at(pose);
  const PerTissue<double> after = removed_;
  removed_ = before;
  PerTissue<double> volume{};
  for (int k = 0; k < kTissueCount; ++k) volume[k] = after[k] - before[k];
  return volume;
}

void VoxelEngine::advance(const Pose& pose) noexcept {
  if (paused_) {
    sweep(pause_pose_);
    last_ = pose;
    paused_ = false;
  }
  if (way(last_, pose) >= workpiece_.voxel() * (1 - 1e-9)) sweep(pose);
}

void VoxelEngine::pause(const Pose& pose) noexcept {
  if (!paused_) pause_pose_ = pose;
  paused_ = true;
}

void VoxelEngine::finish(const Pose& pose) noexcept {
  sweep(paused_ ? pause_pose_ : pose);
  redistance();
}

// While stepping a voxel that is removed becomes +D/2. What is handed on is a narrow band again: the distance to the
// nearest voxel of the other kind, less half a voxel, so that the surface runs along the faces between them and every voxel
// counts as a whole. What was cut before keeps its distances.
void VoxelEngine::redistance() noexcept {
  LevelSet& cut = workpiece_.cut();
  const float band = workpiece_.band();
  const auto voxel = static_cast<float>(workpiece_.voxel());
  std::array<float, kBeyond + 1> distance;  // by its square in voxels
  for (int square = 0; square <= kBeyond; ++square)
    distance[square] = std::min(band, voxel * (std::sqrt(static_cast<float>(square)) - 0.5f));
  distance[kBeyond] = band;
  // Bricks with a voxel gone, and their neighbours: the signs never change, so it works in place.
  const std::size_t bricks = cut.table_size();
  for (std::size_t b = 0; b < bricks; ++b) {
    const LevelSet& solid = workpiece_.solid();
    if (solid.is_uniform(b) && solid.uniform_value(b) > 0) continue;
    const Index3 origin = cut.brick_origin(b);
    std::array<const float*, 27> around, before;  // null: as nothing was cut
    bool near = false;
    for (int c = 0; c < 27; ++c) {
      const std::int64_t beside =
          cut.brick_index(origin.x() + 8 * (c / 9 - 1), origin.y() + 8 * (c / 3 % 3 - 1),
                          origin.z() + 8 * (c % 3 - 1));
      around[c] = beside < 0 ? nullptr : cut.brick(static_cast<std::size_t>(beside));
      before[c] = beside < 0 ? nullptr : before_.brick(static_cast<std::size_t>(beside));
      near = near || (beside >= 0 && !cut.is_uniform(static_cast<std::size_t>(beside)));
    }
    if (!near) continue;
    const Squares to_gone = squares_to(true, around, before),
                  to_there = squares_to(false, around, before);
    float* values = nullptr;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const auto at = static_cast<std::size_t>(
          (((v >> 6) + kReach) * kSide + ((v >> 3) & 7) + kReach) * kSide + (v & 7) + kReach);
      const bool is_gone = to_gone[at] == 0;
      const float away = distance[std::max(to_gone[at], to_there[at])];
      if (!is_gone && away == band && cut.is_uniform(b)) continue;
      if (!values) {
        values = cut.writable_brick(b, false);
        if (!values) break;
        workpiece_.changed().mark(b);
      }
      values[v] = std::max(is_gone ? away : -away, before_.brick(b)[v]);
    }
  }
}

}  // namespace toothprep
