// Removal of tissue by the level-set engine: cut <- max(cut, -d_bur), with the bur's exact distance
// d_bur, mitred at sharp edges (Bur::mitred_distances).
//
// A cut is due when the bur has moved one voxel since the last, or 0.05 mm with finer voxels (Eq. 20
// as a distance: it needs no clock). A cut sweeps the bur along its way since the last cut in sub-poses
// of half that way or less, so that a fast move can't jump over tissue; what sharp edges cut between these is added
// (swept_edge.h). Its work is spread over the following steps, brick by
// brick, so that no step pays for a whole cut; the carved bricks are put in place all at once when
// the last is done, so that contact never reads a field that is half carved. Until then the bur meets
// the same tissue a little deeper below its surface.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/grinding/edge_ridges.h"
#include "toothprep/step/grinding/feed_sides.h"
#include "toothprep/step/grinding/sweep_history.h"
#include "toothprep/step/grinding/swept_edge.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class Removal {
 public:
  // Starts at `pose`. Keeps references: bur and workpiece must outlive it.
  Removal(const Bur& bur, Workpiece& workpiece, const Pose& pose);

  // Removes at once whatever lies inside the bur at `pose`, and returns the volume per tissue, mm³.
  PerTissue<double> clear(const Pose& pose);

  // The bur has cut its way to `pose`. This, pause() and carve() allocate nothing.
  void advance(const Pose& pose) noexcept;
  // From `pose` on the bur moves without cutting (motor off, or stalled in direct drive). What was
  // due by then is carved when it turns again; the way in between is not.
  void pause(const Pose& pose) noexcept;
  // Once a step: plans a cut if one is due and none is under way, then carves a share of the cut
  // under way. Does nothing unless the bur has advanced since the last call.
  void carve() noexcept;
  // Where a bur at `pose` that moves with v (mm/s, B) and turns with omega (rad/s, B) has cut before, so that it goes over
  // that again, though no cut that is in place has it yet: the poses at which the way turned, the latest first. Fills
  // `found` as far as it goes, and returns how many there are in it.
  std::size_t ahead(const Pose& pose, const Vec3& v, const Vec3& omega,
                    std::span<Pose> found) const noexcept;
  // The straight parts of the way that it has cut, if the head is convex.
  const SweepHistory& history() const noexcept { return history_; }
  // Carves everything that is due up to `pose`, or up to where it was paused.
  void finish(const Pose& pose) noexcept;

  // Removed so far per tissue, mm³ (without clear()).
  const PerTissue<double>& removed() const { return removed_; }
  // How often carved bricks were put in place: what was read of the cut before stands no longer.
  std::uint64_t cuts_made() const { return cuts_made_; }

 private:
  struct SubPose {
    Vec3 tip, end;    // of the head, index coordinates
    float to_bur[9];  // rotation W -> B times the voxel size, row by row
  };
  struct Range {  // of sub-poses
    std::size_t begin, end;
  };
  // A pose on the way. To the first after a pause nothing is cut.
  struct Waypoint {
    Pose pose;
    bool jump;
    double length;  // mm, of the way from the one before
  };
  // A brick being carved, by blocks of 4³ voxels.
  struct UnderWay {
    std::size_t brick;
    const float* before;
    float* values = nullptr;  // its own, once it changes
    float low[8] = {};        // the least value of each block
    unsigned changed = 0;     // a bit per block
    unsigned counted = 0;     // likewise: of which some volume may be gone
  };
  void add_waypoint(const Pose& pose) noexcept;
  bool cut_is_due() const noexcept;
  double way_until_due() const noexcept;
  void plan() noexcept;
  void plan_sub_poses(const Pose& from, const Pose& to) noexcept;
  void plan_sides(const Pose& from, const Pose& to) noexcept;
  void plan_box() noexcept;
  bool is_straight(std::size_t waypoints) const noexcept;
  void carve_some(std::size_t visits, std::size_t bricks) noexcept;
  void carve_all() noexcept { carve_some(box_size_, box_size_); }
  void apply() noexcept;
  void carve_brick(std::size_t brick) noexcept;
  void measure_brick(const Vec3& centre) noexcept;
  void measure_blocks(const Index3& first, Range near) noexcept;
  void draw_edges(const Eigen::Vector3f& offset, float* deepest) const noexcept;
  void sweep_block(const Index3& first, int block, Range near, UnderWay& b) noexcept;
  FeedSides::Side side_of_block(std::size_t nearest, const Eigen::Vector3f& offset) const noexcept;
  bool carve_block(const SubPose& pose, const Eigen::Vector3f& offset, float* deepest) noexcept;
  void put_block(int block, const float* deepest, UnderWay& b) noexcept;
  void count_removed(std::size_t brick, const UnderWay& b) noexcept;
  double displacement(const Pose& from, const Pose& to) const noexcept;

  const Bur& bur_;
  Workpiece& workpiece_;
  double due_distance_;  // mm
  double voxel_volume_;  // mm³
  double arm_;           // mm, longest from the tip to a point of the head
  bool convex_;          // the head
  EdgeRidges ridges_;
  std::vector<SweptEdge> edges_;   // sharp ones
                                   // of its sweeps
  FeedSides sides_;                // of blocks
  Pose last_;                      // where the last planned cut ended
  bool last_carved_ = false;       // there the head has cut, too
  std::vector<Waypoint> way_;      // from there on; capacity reserved once
  SweepHistory& history_;          // of that way, the workpiece's
  SweepHistory::Number part_ = 0;  // of it: the cut under way
  Pose carved_at_;                 // of the last call of carve()
  double way_since_plan_ = 0;      // mm
  double due_after_ = 0;           // mm of that way: the next cut
  bool advanced_ = false;          // since then
  bool paused_ = false, resumes_ = false;

  // The cut under way: sub-poses, and the box of bricks it may touch with a cursor in it.
  std::vector<SubPose> sub_poses_;  // capacity reserved once
  // The distance from a convex body that moves straight on has one least value on the way: sub-poses
  // are tried from the nearest on as long as they cut deeper.
  bool one_least_ = false;
  FeedSides::Motion motion_{};
  bool edges_draw_ = false;  // edges_ tell what lies between the sub-poses
  float drawn_way_ = 0,
        drawn_deeper_ =
            0;             // mm: of the sweep; by how much edges cut deeper than sub-poses, at most
  bool by_sides_ = false;  // motion_ tells
  bool from_carved_ = false;  // the place before the first sub-pose has been carved
  bool late_ = false;         // it is of much more way than is due: as fast as a step may
  // mm, from the bur at each sub-pose: of a brick's centre, and of those of its blocks.
  std::vector<float> from_brick_, from_blocks_;
  Index3 box_first_ = Index3::Zero(), box_counts_ = Index3::Zero();
  std::size_t cursor_ = 0, box_size_ = 0, stride_ = 1;
  // Carved and not yet in place: the brick and its new values, null for all cut.
  struct Carved {
    std::size_t brick;
    const float* values;
  };
  std::vector<Carved> carved_;  // capacity reserved once
  float* kept_ = nullptr;       // taken for a brick of which nothing was left
  PerTissue<double> removed_{};
  std::uint64_t cuts_made_ = 0;
};

}  // namespace toothprep
