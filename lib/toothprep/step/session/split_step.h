// A step that goes in parts: how many, and the row of the whole.
//
// A bur that moves freely (out of a stretched spring, say) covers several voxels in a step. It then
// goes in parts of about a third of a voxel, at its present speed or that which it has if its velocity
// changes as in the step before, so that it can't enter tissue without having met it. The cost is
// bounded: however fast the bur, the parts together stay within half a time step of CPU on the slowest
// machine that is meant for live use. The number of parts follows from the bur and the steps alone,
// never from a clock, so that a replay repeats it.
#pragma once

#include <cstddef>

#include "toothprep/step/core/step_record.h"

namespace toothprep {

// Parts that a step of `way` voxels is split into, at least 1.
int wanted_parts(double way) noexcept;

// The most parts that a step may have, for a bur of so many surface elements.
int most_parts(std::size_t elements, double time_step) noexcept;

// The smallest size in mm (engine.element_mm) whose elements a live step keeps half of its time for,
// as `size` would have `elements` of them; at most `size` if that does. For the slowest machine that
// is meant for live use.
double least_live_size(double size, std::size_t elements, double time_step) noexcept;

// The handle part/parts of the way between two samples.
HandleSample handle_between(const HandleSample& from, const HandleSample& to, int part,
                            int parts) noexcept;

// The row of a step from the rows of its parts, all of the same length:
//   handle, bur, device force, removed volume  at the end of the last part
//   velocity                                   way of the bur over the step's time
//   grinding force, torque, power, areas       mean over the parts, so that energy sums exactly
//   rotation rate                              power / (2 pi torque); without torque that of the last part
//   stalled                                    whether any part was; stalled_fraction says how many
//   trial torque                               the largest
class SplitStepRow {
 public:
  void add(const StepRecord& part) noexcept;
  // `start`: where the bur was before the first part; `time_step` of the whole, s.
  StepRecord row(const Vec3& start, double time_step) const noexcept;

 private:
  StepRecord sum_;  // means so far
  int parts_ = 0;
};

}  // namespace toothprep
