// How fast each element of a head advances, compiled for the processors that it may run on: where the
// handle turns, a fifth of a large head's step. Internal: ContactModel takes the last; all give the same
// bits.
#pragma once

#include <cstdint>
#include <vector>

namespace toothprep {

// Elements whose normal is up to this far behind the motion (sine of the angle) are sampled as
// well, so that the trial velocity may turn by as much without a new sample.
constexpr float kMarginSine = 0.05f;

// Of `count` elements, one array each: place, normal and axes as of SurfaceElements, by how much v·n changes
// over half of it per speed around and along, and the direction looked in. B, mm and mm/s.
struct AdvancingElements {
  int count;
  const float *x, *y, *z, *nx, *ny, *nz, *lx, *ly, *lz, *tx, *ty;
  const float *turn_around, *turn_along, *looked_x, *looked_y, *looked_z;
  // v·n, and half its range over the element; 1 where it is worth a look, else 0; -1 where it was looked at
  // along another direction, else as it is.
  float *advance, *range;
  std::int32_t* worth;
  float* left;
};

struct FeedOfElements {
  float vx, vy, vz, speed;  // mm/s, B
  float ox, oy, oz;         // of the handle, rad/s, B
};

struct AdvanceKernel {
  const char* name;
  // With one velocity v for all; what was looked at stands.
  void (*straight)(const AdvancingElements& elements, const FeedOfElements& feed);
  // With v(s) = v + omega x r(s).
  void (*turning)(const AdvancingElements& elements, const FeedOfElements& feed);
};

// Those that this processor runs, the fastest last.
std::vector<AdvanceKernel> advance_kernels();
// The last of them.
const AdvanceKernel& fastest_advance_kernel() noexcept;

}  // namespace toothprep
