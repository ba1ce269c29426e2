// The straight parts of the burs' ways that these have cut, and by which of them each point of the lattice was cut deepest.
// Internal to this folder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "toothprep/step/grinding/convex_profile.h"
#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

class SweepHistory {
 public:
  // Parts are numbered from 1 on; 0 stands for none. Numbers are exact in single precision.
  using Number = std::int32_t;

  // For a cut in a lattice of voxels of `voxel` mm. No more than `most` bricks are changed at a time.
  SweepHistory(const LevelSet& cut, double voxel, std::size_t most);

  // What a tooth keeps for the next session, and goes on from that, before anything else.
  [[nodiscard]] CutWay kept() const;
  void go_on_from(const CutWay& kept);

  // From now on this bur cuts. Allocates if its head is a new one.
  void take(const Bur& bur);
  // Whether the bur that cuts now has the head that a part is of.
  bool is_own(const StraightPart& part) const noexcept { return part.head == head_; }
  // The head that a part is of. Both stay where they are.
  const Bur& bur_of(const StraightPart& part) const noexcept { return head_of(part).bur; }
  const ConvexProfile& standing(const StraightPart& part) const noexcept {
    return head_of(part).standing;
  }

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
  // Forgets all of them: the cut was changed otherwise.
  void forget() noexcept { forgotten_ = latest_; }
  // The same of a brick, to be written; null if there is none.
  float* write(std::size_t brick) noexcept { return deepest_.writable_brick(brick, false); }

 private:
  struct Head {
    explicit Head(const std::string& outline);
    std::string text;
    ConvexProfile standing;
    Bur bur;
  };
  const Head& head_of(const StraightPart& part) const noexcept {
    return *heads_[static_cast<std::size_t>(part.head)];
  }
  int number_of(const std::string& outline);
  Number first_known() const noexcept;

  std::vector<std::unique_ptr<const Head>> heads_;
  int head_ = -1;                     // of the bur that cuts now
  double aside_;                      // mm
  std::vector<StraightSweep> parts_;  // the latest ones, by number over and over
  Number latest_ = 0;
  Number highest_ = 0;  // of all that there ever were
  Number forgotten_ = 0;
  LevelSet deepest_;
};

}  // namespace toothprep
