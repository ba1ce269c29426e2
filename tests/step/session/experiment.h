// Straight-feed experiments shared by the session's tests and benchmarks: a block, a bur, a path.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/session.h"

namespace toothprep::testing {

inline Parameters paper_without_stall() {
  Parameters p = preset_parameters("paper");
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  return p;
}

// A pure enamel (or layered) block of the given size turned and placed by `pose`.
inline LayeredTooth block(double voxel, double enamel, const Vec3& size = Vec3(8, 8, 8),
                          const Pose& pose = {}) {
  BlockOptions o;
  o.size = size;
  o.enamel = enamel;
  o.voxel = voxel;
  o.pose = pose;
  return make_block(o);
}

// Handle samples at 1 kHz along straight lines through `points` at `speed`, in the frame `frame`,
// bur axis along the frame's +z.
inline std::vector<HandleSample> straight_path(const std::vector<Vec3>& points, double speed,
                                               const Pose& frame = {}, double h = 1e-3) {
  std::vector<HandleSample> path;
  double length = 0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i] - points[i - 1]).norm();
  const auto steps = static_cast<int>(std::floor(length / speed / h + 1e-9));
  for (int i = 0; i <= steps; ++i) {
    double s = i * h * speed;
    std::size_t leg = 1;
    while (leg + 1 < points.size() && s > (points[leg] - points[leg - 1]).norm()) {
      s -= (points[leg] - points[leg - 1]).norm();
      ++leg;
    }
    const Vec3 direction = (points[leg] - points[leg - 1]).normalized();
    path.push_back({i * h, Pose{frame.to_world(points[leg - 1] + s * direction), frame.orientation},
                    kPedalButton});
  }
  return path;
}

struct Outcome {
  std::vector<StepRecord> rows;
  SessionTotals totals;
  LevelSet solid;  // what remained

  double removed_energy(const Parameters& p) const {
    return energy_of_removal(p, totals, totals.removed);
  }
  double energy_ratio(const Parameters& p) const { return totals.torque_work / removed_energy(p); }
};

inline Outcome run(const LayeredTooth& tooth, const Bur& bur, const Parameters& parameters,
                   Drive drive, const std::vector<HandleSample>& path, double element_size = 0) {
  Workpiece workpiece(tooth);
  Parameters sized = parameters;
  sized.element_size = element_size;
  Session session(bur, workpiece, sized, drive, path.front());
  Outcome r;
  r.rows.push_back(session.initial());
  for (std::size_t i = 1; i < path.size(); ++i) r.rows.push_back(session.step(path[i]));
  session.finish(r.rows.back());
  r.totals = session.totals();
  r.solid = workpiece.remaining_solid();
  return r;
}

// Mean over the last `share` of the rows, seen in `frame`.
struct Plateau {
  Vec3 force = Vec3::Zero();
  double torque = 0;
  Vec3 rms_force = Vec3::Zero();  // deviation from the mean
};
inline Plateau plateau(const std::vector<StepRecord>& rows, double share, const Pose& frame = {}) {
  Plateau p;
  const auto first = static_cast<std::size_t>(static_cast<double>(rows.size()) * (1 - share));
  const auto n = static_cast<double>(rows.size() - first);
  for (std::size_t i = first; i < rows.size(); ++i) {
    p.force += frame.orientation.conjugate() * rows[i].grinding_force / n;
    p.torque += rows[i].torque / n;
  }
  for (std::size_t i = first; i < rows.size(); ++i)
    p.rms_force +=
        (frame.orientation.conjugate() * rows[i].grinding_force - p.force).cwiseAbs2() / n;
  p.rms_force = p.rms_force.cwiseSqrt();
  return p;
}

inline Bur paper_cylinder() { return make_bur("cylinder:D1.2xL3.0", ""); }
inline Bur paper_ball() { return make_bur("ball:D1.2", ""); }

}  // namespace toothprep::testing
