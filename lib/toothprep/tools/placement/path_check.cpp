#include "toothprep/tools/placement/path_check.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/placement/own_frame.h"

namespace toothprep {
namespace {

constexpr double kApart = 0.15;  // mm

// Samples so far apart that a bur's motion between them counts, in the grid's frame.
std::vector<HandleSample> thinned(const std::vector<HandleSample>& path, const Pose& to_grid,
                                  double head_length) {
  std::vector<HandleSample> kept;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (path[i].rejected) continue;
    HandleSample s = path[i];
    s.pose = to_grid * s.pose;
    if (!kept.empty() && i + 1 < path.size()) {
      const Pose& last = kept.back().pose;
      const double moved = (s.pose.position - last.position).norm() +
                           head_length * s.pose.orientation.angularDistance(last.orientation);
      if (moved < kApart) continue;
    }
    kept.push_back(s);
  }
  return kept;
}

// Those within `kNear` of where the head goes, whatever way it points.
std::vector<SurfacePlace> within_reach(std::vector<SurfacePlace> places,
                                       const std::vector<HandleSample>& steps, const Bur& bur) {
  constexpr double kNear = 2;  // mm
  Box box{steps[0].pose.position, steps[0].pose.position};
  for (const HandleSample& s : steps)
    for (const double along : {0.0, bur.head_length()}) {
      const Vec3 x = s.pose.position + along * (s.pose.orientation * Vec3::UnitZ());
      box.min = box.min.cwiseMin(x);
      box.max = box.max.cwiseMax(x);
    }
  const Vec3 around = Vec3::Constant(bur.max_radius() + kNear);
  const auto far = [&](const SurfacePlace& p) {
    return ((p.at - box.min + around).array() < 0).any() ||
           ((box.max + around - p.at).array() < 0).any();
  };
  places.erase(std::remove_if(places.begin(), places.end(), far), places.end());
  return places;
}

std::optional<double> depth(const ToothGrid& grid, ToothGrid::Surface surface, const Vec3& tip) {
  const double h = grid.height(surface, tip.x(), tip.y());
  return std::isfinite(h) ? std::optional(h - tip.z()) : std::nullopt;
}

std::optional<double> finite(double d) {
  return std::isfinite(d) ? std::optional(d) : std::nullopt;
}

}  // namespace

PathCheck check_path(const LayeredTooth& whole, const Pose& frame, const Bur& bur,
                     const std::vector<HandleSample>& path) {
  using Surface = ToothGrid::Surface;
  const LayeredTooth tooth = with_others_as_other(whole);
  const ToothGrid grid(tooth, frame, std::clamp(tooth.lattice.voxel, 0.1, 0.2));
  const auto solid = grid.surface(Surface::kTooth), dentin = grid.surface(Surface::kDentin),
             pulp = grid.surface(Surface::kPulp);
  const auto steps = thinned(path, inverse(frame), bur.head_length());
  PathCheck check;
  if (steps.empty()) return check;
  const auto others = within_reach(surface_of_others(grid, whole), steps, bur);
  Milling milling(grid, bur);
  check.clearance_at_start = std::max(0.0, head_distance(bur, steps[0].pose, solid));
  bool touched = false;
  double nearest = check.clearance_at_start;
  check.tips = {frame.to_world(steps[0].pose.position), frame.to_world(steps[0].pose.position)};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const Pose& pose = steps[i].pose;
    PathPlace p;
    p.time = steps[i].time;
    p.tip = frame.to_world(pose.position);
    p.below_surface = depth(grid, Surface::kTooth, pose.position);
    p.below_dentin = depth(grid, Surface::kDentin, pose.position);
    p.to_dentin = finite(head_distance(bur, pose, dentin));
    Vec3 where = Vec3::Zero();
    p.to_pulp = finite(head_distance(bur, pose, pulp, &where));
    check.tips.min = check.tips.min.cwiseMin(p.tip);
    check.tips.max = check.tips.max.cwiseMax(p.tip);
    check.deepest_below_surface =
        std::max(check.deepest_below_surface, p.below_surface.value_or(0));
    check.deepest_below_dentin = std::max(check.deepest_below_dentin, p.below_dentin.value_or(0));
    if (p.to_pulp && *p.to_pulp < check.least_to_pulp.value_or(1e30)) {
      check.least_to_pulp = p.to_pulp;
      check.least_to_pulp_at = frame.to_world(where);
      check.least_to_pulp_time = p.time;
    }
    if (const double d = head_distance(bur, pose, others, &where);
        d < check.least_to_other.value_or(1e30)) {
      check.least_to_other = d;
      check.least_to_other_at = frame.to_world(where);
      check.least_to_other_time = p.time;
    }
    const Milling::Bite bite = i == 0 ? milling.at(pose) : milling.along(steps[i - 1].pose, pose);
    for (int k = 0; k < kTissueCount; ++k) {
      check.removed[k] += bite.removed[k];
      touched |= bite.removed[k] > 0;
    }
    if (bite.shank > 0 && check.shank_overlap == 0) check.shank_time = p.time;
    check.shank_overlap = std::max(check.shank_overlap, bite.shank);
    if (!touched) nearest = std::min(nearest, head_distance(bur, pose, solid));
    check.places.push_back(p);
  }
  check.least_distance = touched ? 0 : std::max(0.0, nearest);
  return check;
}

}  // namespace toothprep
