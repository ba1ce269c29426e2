// The straight parts of the bur's way that it has cut, and by which of them each point of the lattice was cut deepest.
// Internal to this folder.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class SweepHistory {
 public:
  // Parts are numbered from 1 on; 0 stands for none. Numbers are exact in single precision.
  using Number = std::int32_t;

  explicit SweepHistory(const Workpiece& workpiece);

  // The bur cut its way straight on; `follows`: from where it cut last. The number of the part that this belongs to; 0 if it
  // leant otherwise. What is noted allocates nothing.
  Number note(const Bur& bur, const Pose& from, const Pose& to, bool follows) noexcept;
  // A part by its number; null for 0, and for those that are forgotten.
  const StraightSweep* find(Number number) const noexcept;
  Number latest() const { return latest_; }

  // Of each point of the workpiece's cut: the number of the part that cut deepest there, as cell_corners() has it.
  const LevelSet& deepest() const { return deepest_; }
  // The same of a brick, to be written; null if there is none.
  float* write(std::size_t brick) noexcept { return deepest_.writable_brick(brick, false); }

 private:
  double aside_;                      // mm
  std::vector<StraightSweep> parts_;  // the latest ones, by number over and over
  Number latest_ = 0;
  LevelSet deepest_;
};

}  // namespace toothprep
