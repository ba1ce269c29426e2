// The voxel engine without the second layer of bur voxels (the paper's figure 7): what the bur
// meets is removed in the same step, so that the next step finds nothing there. With kInside, of
// the voxels that the surface goes through about half stay.
//
// Contact is the voxel engine's own. What the cut looks like afterwards (finish()) isn't made.
#pragma once

#include "toothprep/proof/figures/ablation.h"
#include "toothprep/step/grinding/voxel_engine.h"

namespace toothprep::figures {

class OneLayerEngine final : public GrindingEngine {
 public:
  // `layers` isn't kTwo. Throws Error as VoxelEngine does.
  OneLayerEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                 const Pose& pose, Layers layers);

  void sample(const Pose& pose, const Vec3& v, const Vec3& omega) noexcept override {
    contact_.sample(pose, v, omega);
  }
  bool covers(const Vec3& v) const noexcept override { return contact_.covers(v); }
  const ContactSet& contact() const noexcept override { return contact_.contact(); }
  PerTissue<double> clear(const Pose& pose) override;
  void advance(const Pose& pose) noexcept override { remove_at(pose); }
  void carve() noexcept override {}
  void pause(const Pose&) noexcept override {}
  void finish(const Pose&) noexcept override {}
  const PerTissue<double>& removed() const noexcept override { return removed_; }

 private:
  void remove_at(const Pose& pose) noexcept;
  void remove_voxel(std::size_t brick, int voxel, std::uint8_t label) noexcept;

  const Bur& bur_;
  Workpiece& workpiece_;
  VoxelEngine contact_;
  bool met_;     // whether what its surface meets is removed
  double deep_;  // mm: what lies deeper in the bur is removed
  PerTissue<double> removed_{};
};

}  // namespace toothprep::figures
