// Of a workpiece with several bodies (tooth/tooth_bodies.h): whose tissue is where, and what was
// removed of each.
//
// Only bricks that hold another body than the tooth that is prepared are looked into, and how far
// the nearest such brick is is known beforehand: away from neighbours a step pays for one look-up,
// however many teeth are loaded.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// What was removed of each body beside the prepared tooth, and which bricks hold such bodies.
class WorkpieceBodies {
 public:
  // Keeps a reference to a tooth that has bodies.
  explicit WorkpieceBodies(const LayeredTooth& tooth);

  std::size_t count() const { return removed_.size(); }  // of bodies
  std::size_t worked() const { return worked_; }         // the place of the tooth that is prepared
  // 1 + the body's place; 0 where there is none.
  const LabelGrid& of() const { return tooth_->bodies->of; }
  // Whether the brick holds another body than the tooth that is prepared.
  bool holds_others(std::size_t brick) const { return away_[brick] == 0; }
  // How many bricks along each axis at least to the nearest brick that does, from the brick of a
  // voxel, which may lie outside the grid; at most 255.
  int bricks_to_others(const Index3& voxel) const noexcept;

  // The cut of a brick has gone from `before` to `after` (its values, mm).
  void count_removed(std::size_t brick, const float* before, const float* after) noexcept;
  // The same of a single voxel that was emptied, mm³.
  void count_removed(const Index3& voxel, double volume) noexcept;
  // Removed so far of each body but the tooth that is prepared, mm³.
  const std::vector<double>& removed() const { return removed_; }

 private:
  const LayeredTooth* tooth_;
  std::size_t worked_;
  std::vector<std::uint8_t> away_;  // per brick
  std::vector<double> removed_;
};

}  // namespace toothprep
