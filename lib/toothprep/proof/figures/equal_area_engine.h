// The voxel engine with the paper's boundary voxels taken literally: each stands for the same area
// D², is sampled at its centre, and has its normal from the voxels around it.
//
//   boundary voxel   a cell whose centre lies in the head, with a neighbour whose centre does not:
//                    of 6 (faces), 18 (edges too) or 26 (corners too)
//   normal           the sum of the unit vectors to all 26 neighbours outside of the head
//   dphi dl          D²/r, r the distance of the centre from the axis
//
// Removal is the voxel engine's own. Which cells are boundary isn't said in the paper.
#pragma once

#include <vector>

#include "toothprep/step/grinding/voxel_engine.h"

namespace toothprep::figures {

class EqualAreaEngine final : public GrindingEngine {
 public:
  // `neighbours`: 6, 18 or 26. Throws Error as VoxelEngine does.
  EqualAreaEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                  const Pose& pose, int neighbours);

  void sample(const Pose& pose, const Vec3& v, const Vec3& omega) noexcept override;
  bool covers(const Vec3&) const noexcept override { return true; }
  const ContactSet& contact() const noexcept override { return contact_; }
  PerTissue<double> clear(const Pose& pose) override { return removal_.clear(pose); }
  void advance(const Pose& pose) noexcept override { removal_.advance(pose); }
  void carve() noexcept override { removal_.carve(); }
  void pause(const Pose& pose) noexcept override { removal_.pause(pose); }
  void finish(const Pose& pose) noexcept override { removal_.finish(pose); }
  const PerTissue<double>& removed() const noexcept override { return removal_.removed(); }

 private:
  struct Cell {
    Vec3 centre;  // mm, B
    ContactSet::Element element;
  };

  Workpiece& workpiece_;
  VoxelEngine removal_;
  std::vector<Cell> cells_;
  ContactSet contact_;
};

}  // namespace toothprep::figures
