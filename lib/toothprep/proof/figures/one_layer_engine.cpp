#include "toothprep/proof/figures/one_layer_engine.h"

#include <cmath>
#include <utility>

#include "toothprep/step/grinding/deep_voxels.h"
#include "toothprep/step/grinding/voxel_at.h"

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

void OneLayerEngine::remove_voxel(std::size_t brick, int voxel, std::uint8_t label) noexcept {
  float* values = workpiece_.cut().writable_brick(brick, false);
  if (!values) return;
  values[voxel] = static_cast<float>(0.5 * workpiece_.voxel());
  workpiece_.changed().mark(brick);
  removed_[label - 1] += std::pow(workpiece_.voxel(), 3);
}

void OneLayerEngine::remove_at(const Pose& pose) noexcept {
  const LabelGrid& labels = workpiece_.tooth().tissue;
  const LevelSet& cut = workpiece_.cut();  // over the same bricks
  const Vec3 tip = workpiece_.lattice().to_index(pose.position);
  if (!(tip.cwiseAbs().maxCoeff() < 1e6)) return;  // a bur that was thrown out
  const Mat3 to_index = pose.orientation.toRotationMatrix() / workpiece_.voxel();
  for (const Vec3& point : surface_) {
    const Index3 v = voxel_at(tip + to_index * point + Vec3::Constant(0.5));
    const std::int64_t index = labels.brick_index(v.x(), v.y(), v.z());
    if (index < 0) continue;
    const auto brick = static_cast<std::size_t>(index);
    const int voxel = brick_offset(v.x() & 7, v.y() & 7, v.z() & 7);
    const std::uint8_t label = labels.brick(brick)[voxel];
    if (label != 0 && cut.brick(brick)[voxel] <= 0) remove_voxel(brick, voxel, label);
  }
  for_deep_voxels(bur_, workpiece_, pose, deep_,
                  [&](std::size_t brick, int voxel, const Index3&, std::uint8_t label) {
                    remove_voxel(brick, voxel, label);
                  });
}

}  // namespace toothprep::figures
