#include "toothprep/proof/figures/one_layer_engine.h"

#include <cmath>
#include <utility>

#include "toothprep/step/grinding/deep_voxels.h"

namespace toothprep::figures {
OneLayerEngine::OneLayerEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                               const Pose& pose, Layers layers)
    : bur_(bur),
      workpiece_(workpiece),
      contact_(bur, workpiece, parameters, pose),
      met_(layers == Layers::kMet),
      deep_(met_ ? workpiece.voxel() : 0) {}

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
  const LevelSet& cut = workpiece_.cut();  // over the labels' bricks
  const Vec3 tip = workpiece_.lattice().to_index(pose.position);
  if (!(tip.cwiseAbs().maxCoeff() < 1e6)) return;  // a bur that was thrown out
  if (met_)
    contact_.for_met(pose, [&](std::size_t brick, int voxel, int tissue) {
      if (cut.brick(brick)[voxel] <= 0)
        remove_voxel(brick, voxel, static_cast<std::uint8_t>(tissue + 1));
    });
  for_deep_voxels(bur_, workpiece_, pose, deep_,
                  [&](std::size_t brick, int voxel, const Index3&, std::uint8_t label) {
                    remove_voxel(brick, voxel, label);
                  });
}

}  // namespace toothprep::figures
