#include "toothprep/step/session/run_warnings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace toothprep {

std::vector<std::string> run_warnings(const SessionTotals& totals, Drive drive) {
  std::vector<std::string> warnings;
  if (drive == Drive::kDirect && totals.stalled_steps > 0)
    warnings.push_back(
        fmt::format("direct drive needed more than the stall torque in {} steps: nothing was "
                    "removed there, force and torque are scaled to the limit",
                    totals.stalled_steps));
  // A step or two as the bur enters are nothing.
  if (100 * totals.unbalanced_steps > totals.contact_steps)
    warnings.push_back(fmt::format(
        "the load was not balanced in {} steps: the bur slid along the tissue at its largest speed "
        "(load.max_speed_mm_s); a rail (load.rail) guides it as a sled does",
        totals.unbalanced_steps));
  if (totals.split_steps_cut_short > 0)
    warnings.push_back(fmt::format(
        "the bur was so fast in {} steps that they went in fewer parts than a third of a voxel "
        "each: work and removal may disagree there; move the handle more slowly",
        totals.split_steps_cut_short));
  if (totals.unsettled_steps > 0)
    warnings.push_back(
        fmt::format("force and velocity didn't come to agree to a millionth in {} steps (grinding "
                    "law with size_exponent, ratio_exponent, rubbing or up_cutting)",
                    totals.unsettled_steps));
  if (totals.shank_contact_steps > 0)
    warnings.push_back(
        fmt::format("the shank touched the tooth in {} steps; it neither grinds nor removes",
                    totals.shank_contact_steps));
  const double overlap =
      std::accumulate(totals.initial_overlap.begin(), totals.initial_overlap.end(), 0.0);
  if (overlap > 0)
    warnings.push_back(fmt::format(
        "{:.3f} mm^3 of tissue lay inside the bur at the first sample and were removed first",
        overlap));
  return warnings;
}

namespace {

constexpr std::size_t kMostPoses = 300;
constexpr double kFarFromGrid = 25;  // mm; a hand that waits beside the tooth is nearer

double distance_of(const Bur& bur, const Pose& pose, const Vec3& x) {
  const Vec3 local = pose.to_local(x);
  return bur.distance(std::hypot(local.x(), local.y()), local.z());
}

// The centres of the bricks that the surface crosses.
std::vector<std::pair<std::size_t, Vec3>> surface_bricks(const LayeredTooth& tooth) {
  std::vector<std::pair<std::size_t, Vec3>> bricks;
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b)
    if (!tooth.solid.is_uniform(b))
      bricks.emplace_back(b, tooth.lattice.to_world(tooth.solid.brick_origin(b)) +
                                 Vec3::Constant(3.5 * tooth.lattice.voxel));
  return bricks;
}

// The row at which the volume removed of a tissue is first above zero.
const StepRecord* first_removed(const std::vector<StepRecord>& rows, Tissue tissue) {
  const auto k = static_cast<std::size_t>(tissue_index(tissue));
  const auto row = std::find_if(rows.begin(), rows.end(),
                                [k](const StepRecord& r) { return r.removed_volume[k] > 0; });
  return row == rows.end() ? nullptr : &*row;
}

// Where the bur was farthest from the box of the tooth's grid.
struct Farthest {
  double distance = 0, time = 0;  // mm, s
  std::size_t rows = 0;           // beyond kFarFromGrid
};
Farthest farthest_from_grid(const std::vector<StepRecord>& rows, const LayeredTooth& tooth) {
  const Vec3 low = tooth.lattice.to_world(kBrickEdge * tooth.solid.first_brick());
  const Vec3 size = tooth.lattice.voxel * (kBrickEdge * tooth.solid.brick_counts()).cast<double>();
  Farthest found;
  for (const StepRecord& row : rows) {
    const Vec3 from = row.bur.position - low;
    const double distance = (from - from.cwiseMax(Vec3::Zero()).cwiseMin(size)).norm();
    found.rows += distance > kFarFromGrid;
    if (distance > found.distance) found = {distance, row.handle.time, found.rows};
  }
  return found;
}

}  // namespace

double least_distance(const std::vector<StepRecord>& rows, const Bur& bur,
                      const LayeredTooth& tooth) {
  const auto bricks = surface_bricks(tooth);
  // From a brick's centre to its farthest voxel.
  const double reach = 3.5 * std::sqrt(3.0) * tooth.lattice.voxel;
  double least = std::numeric_limits<double>::infinity();
  const std::size_t apart = std::max<std::size_t>(1, rows.size() / kMostPoses);
  for (std::size_t i = 0; i < rows.size(); i += apart)
    for (const auto& [brick, centre] : bricks) {
      if (distance_of(bur, rows[i].bur, centre) - reach >= least) continue;
      const float* solid = tooth.solid.brick(brick);
      const Index3 first = tooth.solid.brick_origin(brick);
      for (int v = 0; v < kBrickVoxels; ++v) {
        if (std::abs(solid[v]) > tooth.lattice.voxel) continue;
        const Vec3 x = tooth.lattice.to_world(first + Index3(v >> 6, v >> 3 & 7, v & 7));
        least = std::min(least, distance_of(bur, rows[i].bur, x) + solid[v]);
      }
    }
  return least;
}

std::vector<std::string> outcome_warnings(const std::vector<StepRecord>& rows, const Bur& bur,
                                          const LayeredTooth& tooth) {
  std::vector<std::string> warnings;
  const bool on = std::any_of(rows.begin(), rows.end(), [](const StepRecord& r) {
    return (r.handle.buttons & kPedalButton) != 0;
  });
  const auto removed = [](const StepRecord& r) {
    return std::accumulate(r.removed_volume.begin(), r.removed_volume.end(), 0.0);
  };
  if (!on)
    warnings.push_back("the motor was never on (bit 0 of the buttons): nothing can be removed");
  if (on && !rows.empty() && removed(rows.back()) == 0) {
    const double distance = least_distance(rows, bur, tooth);
    warnings.push_back(
        distance > 0 ? fmt::format("nothing was removed: the bur came no nearer to the tooth than "
                                   "{:.2f} mm; are path and tooth in one frame?",
                                   distance)
                     : std::string("nothing was removed, though the bur reached the tooth: did it "
                                   "stall from the first contact on?"));
  }
  if (const Farthest far = farthest_from_grid(rows, tooth);
      far.rows > 0 && !rows.empty() && removed(rows.back()) > 0)
    warnings.push_back(fmt::format(
        "the bur left the tooth's grid: {:.1f} mm from it at {:.3f} s, for {:.2g} % of "
        "the steps beyond {:g} mm; is a sample or a unit wrong there?",
        far.distance, far.time,
        100 * static_cast<double>(far.rows) / static_cast<double>(rows.size()), kFarFromGrid));
  if (const StepRecord* row = first_removed(rows, Tissue::kPulp))
    warnings.push_back(
        fmt::format("the pulp was opened at {:.3f} s: {:.3f} mm^3 of it were removed",
                    row->handle.time, rows.back().removed_volume[tissue_index(Tissue::kPulp)]));
  if (const StepRecord* row =
          tooth.bodies ? nullptr : first_removed(rows, Tissue::kOther))  // else body_warnings()
    warnings.push_back(
        fmt::format("tissue 'other' (a neighbour, gum) was cut from {:.3f} s on: {:.3f} mm^3",
                    row->handle.time, rows.back().removed_volume[tissue_index(Tissue::kOther)]));
  return warnings;
}

}  // namespace toothprep
