#include "toothprep/step/grinding/advance_kernels.h"

#include <cmath>

#include "toothprep/step/core/processor.h"

namespace toothprep {
namespace {

// Motion along another direction (cosine) finds something else.
constexpr float kSameDirection = 0.995f;

template <bool kTurns>
TOOTHPREP_INLINE void advance(const AdvancingElements& e, const FeedOfElements& feed) {
  const int n = e.count;
  const float vx = feed.vx, vy = feed.vy, vz = feed.vz, speed_of_all = feed.speed;
  const float ox = feed.ox, oy = feed.oy, oz = feed.oz;
  const float *x = e.x, *y = e.y, *z = e.z, *nx = e.nx, *ny = e.ny, *nz = e.nz;
  const float *lx = e.lx, *ly = e.ly, *lz = e.lz, *tx = e.tx, *ty = e.ty;
  const float *turn_around = e.turn_around, *turn_along = e.turn_along;
  const float *looked_x = e.looked_x, *looked_y = e.looked_y, *looked_z = e.looked_z;
  float *advance = e.advance, *range = e.range, *left = e.left;
  std::int32_t* worth = e.worth;
#pragma omp simd
  for (int i = 0; i < n; ++i) {
    float ux = vx, uy = vy, uz = vz, speed = speed_of_all;
    if constexpr (kTurns) {
      ux = vx + (oy * z[i] - oz * y[i]), uy = vy + (oz * x[i] - ox * z[i]),
      uz = vz + (ox * y[i] - oy * x[i]);
      speed = std::sqrt(ux * ux + (uy * uy + uz * uz));
      const float same = looked_x[i] * ux + looked_y[i] * uy + looked_z[i] * uz;
      left[i] = same >= kSameDirection * speed ? left[i] : -1;
    }
    const float s = nx[i] * ux + ny[i] * uy + nz[i] * uz;
    const float r = std::abs((tx[i] * ux + ty[i] * uy) * turn_around[i]) +
                    std::abs((lx[i] * ux + ly[i] * uy + lz[i] * uz) * turn_along[i]);
    advance[i] = s;
    range[i] = r;
    worth[i] = s + r > -kMarginSine * speed ? 1 : 0;
  }
}

template <bool kTurns>
void plain(const AdvancingElements& elements, const FeedOfElements& feed) {
  advance<kTurns>(elements, feed);
}
constexpr AdvanceKernel kPlain = {"plain", plain<false>, plain<true>};

#if defined(__x86_64__) && defined(__GNUC__)
template <bool kTurns>
__attribute__((target("avx2"))) void with_avx2(const AdvancingElements& elements,
                                               const FeedOfElements& feed) {
  advance<kTurns>(elements, feed);
}
constexpr AdvanceKernel kAvx2 = {"avx2", with_avx2<false>, with_avx2<true>};
#else
constexpr AdvanceKernel kAvx2 = kPlain;
#endif

// Chosen when the program is loaded: a tick must neither allocate nor wait for another's choice.
const AdvanceKernel kFastest = has_avx2() ? kAvx2 : kPlain;

}  // namespace

std::vector<AdvanceKernel> advance_kernels() {
  std::vector<AdvanceKernel> kernels = {kPlain};
  if (has_avx2()) kernels.push_back(kAvx2);
  return kernels;
}

const AdvanceKernel& fastest_advance_kernel() noexcept { return kFastest; }

}  // namespace toothprep
