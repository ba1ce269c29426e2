// The straight parts of the bur's way that it has cut, and by which of them each point of the lattice was cut deepest.
// Internal to this folder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

class SweepHistory {
 public:
  // Parts are numbered from 1 on; 0 stands for none. Numbers are exact in single precision.
  using Number = std::int32_t;

  // Of the head of this bur, for a cut in a lattice of voxels of `voxel` mm. No more than `most` bricks are changed at a
  // time.
  SweepHistory(const Bur& bur, const LevelSet& cut, double voxel, std::size_t most);

  // Whether it is of this bur's head.
  [[nodiscard]] bool is_of(const Bur& bur) const;
  // What a tooth keeps for the next session, and goes on from that, if it is of this bur's head.
  [[nodiscard]] CutWay kept() const;
  void go_on_from(const CutWay& kept);

  // The bur cut its way straight on; `follows`: from where it cut last. The number of the part that this belongs to; 0 if it
  // leant otherwise. What is noted allocates nothing.
  Number note(const Bur& bur, const Pose& from, const Pose& to, bool follows) noexcept;
  // A part by its number; null for 0, and for those that are forgotten.
  const StraightSweep* find(Number number) const noexcept;
  Number latest() const { return latest_; }

  // Of each point of the workpiece's cut: the number of the part that cut deepest there, as cell_corners() has it.
  const LevelSet& deepest() const { return deepest_; }
  // Forgets the parts behind `last`. Whose numbers they were is to be forgotten as well.
  void drop_behind(Number last) noexcept;
  // The same of a brick, to be written; null if there is none.
  float* write(std::size_t brick) noexcept { return deepest_.writable_brick(brick, false); }

 private:
  std::string head_;                  // the bur's outline
  double aside_;                      // mm
  std::vector<StraightSweep> parts_;  // the latest ones, by number over and over
  Number latest_ = 0;
  Number highest_ = 0;  // of all that there ever were
  LevelSet deepest_;
};

}  // namespace toothprep
