#include "toothprep/proof/figures/one_layer_engine.h"

#include <cmath>
#include <utility>

namespace toothprep::figures {
OneLayerEngine::OneLayerEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                               const Pose& pose, Layers layers)
    : bur_(bur),
      workpiece_(workpiece),
      contact_(bur, workpiece, parameters, pose),
      surface_(layers == Layers::kMet ? contact_.contact_points() : std::vector<Vec3>{}),
      deep_(layers == Layers::kMet ? workpiece.voxel() : 0) {}

PerTissue<double> OneLayerEngine::clear(const Pose& pose) {
  contact_.clear(pose);
  remove_at(pose);
  return std::exchange(removed_, PerTissue<double>{});
}

void OneLayerEngine::remove_voxel(const Index3& v) noexcept {
  LevelSet& cut = workpiece_.cut();
  const std::uint8_t label = workpiece_.tooth().tissue.value(v.x(), v.y(), v.z());
  if (label == 0 || cut.value(v.x(), v.y(), v.z()) > 0) return;
  const auto brick = static_cast<std::size_t>(cut.brick_index(v.x(), v.y(), v.z()));
  float* values = cut.writable_brick(brick, false);
  if (!values) return;
  values[brick_offset(v.x() & 7, v.y() & 7, v.z() & 7)] =
      static_cast<float>(0.5 * workpiece_.voxel());
  workpiece_.changed().mark(brick);
  removed_[label - 1] += std::pow(workpiece_.voxel(), 3);
}

void OneLayerEngine::remove_at(const Pose& pose) noexcept {
  const double voxel = workpiece_.voxel();
  const Vec3 tip = workpiece_.lattice().to_index(pose.position);
  if (!(tip.cwiseAbs().maxCoeff() < 1e6)) return;  // a bur that was thrown out
  const Mat3 to_index = pose.orientation.toRotationMatrix() / voxel;
  for (const Vec3& point : surface_) {
    const Vec3 at = (tip + to_index * point + Vec3::Constant(0.5)).array().floor();
    remove_voxel(at.cast<int>());
  }
  const Vec3 end = tip + to_index * Vec3(0, 0, bur_.head_length());
  const double grow = bur_.max_radius() / voxel;
  const Vec3 first = (tip.cwiseMin(end).array() - grow).ceil();
  const Vec3 last = (tip.cwiseMax(end).array() + grow).floor();
  const Index3 low = first.cast<int>(), high = last.cast<int>();
  const Mat3 to_bur = pose.orientation.toRotationMatrix().transpose() * voxel;
  const double widest = bur_.max_radius() + 1e-9;  // mm, and more than rounding
  const LabelGrid& labels = workpiece_.tooth().tissue;
  const LevelSet& cut = workpiece_.cut();
  for (int x = low.x(); x <= high.x(); ++x)
    for (int y = low.y(); y <= high.y(); ++y)
      for (int z = low.z(); z <= high.z(); ++z) {
        const std::int64_t brick = labels.brick_index(x, y, z);  // of both grids
        if (brick < 0) {
          z |= kBrickEdge - 1;  // on to the next
          continue;
        }
        const int at = brick_offset(x & 7, y & 7, z & 7);
        if (cut.brick(static_cast<std::size_t>(brick))[at] > 0 ||
            labels.brick(static_cast<std::size_t>(brick))[at] == 0)
          continue;
        const Vec3 b = to_bur * (Vec3(x, y, z) - tip);
        if (b.head<2>().squaredNorm() > widest * widest) continue;  // what is asked most
        if (bur_.distance(std::hypot(b.x(), b.y()), b.z()) < -deep_) remove_voxel({x, y, z});
      }
}

}  // namespace toothprep::figures
