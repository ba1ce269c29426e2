// Removal of tissue by the level-set engine: cut <- max(cut, -d_bur), with the bur's exact distance
// d_bur.
//
// A cut is due when the bur has moved one voxel since the last (Eq. 20 as a distance: it needs no
// clock). A cut sweeps the bur from its last cut pose to the present one in sub-poses of at most
// half a voxel, so that a fast move can't jump over tissue. Its work is spread over the following
// steps, brick by brick, so that no step pays for a whole cut; the carved bricks are put in place
// all at once when the last is done, so that contact never reads a field that is half carved. Until
// then the bur meets the same tissue a little deeper below its surface.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class Removal {
 public:
  // Starts at `pose`. Keeps references: bur and workpiece must outlive it.
  Removal(const Bur& bur, Workpiece& workpiece, const Pose& pose);

  // Removes at once whatever lies inside the bur at `pose`, and returns the volume per tissue, mm³.
  PerTissue<double> clear(const Pose& pose);

  // Plans a cut to `pose` if one is due and none is under way, then carves a share of the cut under
  // way. Allocates nothing.
  void advance(const Pose& pose) noexcept;
  // From `pose` on the bur moves without cutting (motor off, or stalled in direct drive). What was
  // due by then is carved when it turns again; the way in between is not.
  void pause(const Pose& pose) noexcept;
  // Carves everything that is due up to `pose`, or up to where it was paused.
  void finish(const Pose& pose) noexcept;

  // Removed so far per tissue, mm³ (without clear()).
  const PerTissue<double>& removed() const { return removed_; }
  // How often carved bricks were put in place: what was read of the cut before stands no longer.
  std::uint64_t cuts_made() const { return cuts_made_; }

 private:
  struct SubPose {
    Vec3 tip;         // index coordinates
    float to_bur[9];  // rotation W -> B times the voxel size, row by row
  };
  void plan(const Pose& pose) noexcept;
  void carve_some(std::size_t bricks) noexcept;
  void apply() noexcept;
  void carve_brick(std::size_t brick) noexcept;
  bool sweep_brick(const Index3& first, const float* before, bool uniform, float* next) noexcept;
  void carve_block(const SubPose& pose, const Eigen::Vector3f& offset, float* next) noexcept;
  void count_removed(std::size_t brick, const float* before, const float* after) noexcept;
  double displacement(const Pose& from, const Pose& to) const noexcept;

  const Bur& bur_;
  Workpiece& workpiece_;
  double due_distance_;  // mm
  Pose last_;            // where the last planned cut ended
  Pose previous_;        // of the step before

  // The cut under way: sub-poses, and the box of bricks it may touch with a cursor in it.
  std::vector<SubPose> sub_poses_;  // capacity reserved once
  Index3 box_first_ = Index3::Zero(), box_counts_ = Index3::Zero();
  std::size_t cursor_ = 0, box_size_ = 0, stride_ = 1;
  // Carved and not yet in place: the brick and its new values, null for all cut.
  struct Carved {
    std::size_t brick;
    const float* values;
  };
  std::vector<Carved> carved_;  // capacity reserved once
  PerTissue<double> removed_{};
  std::uint64_t cuts_made_ = 0;
  bool paused_ = false;
  Pose pause_pose_;
};

}  // namespace toothprep
