// The distance function as compiled for the processors that it may run on. Internal: Bur::mitred_distances()
// takes the last one; all give the same bits.
#pragma once

#include <vector>

#include "toothprep/step/bur/bur.h"

namespace toothprep {

struct DistanceKernel {
  const char* name;
  void (*run)(const DistanceOutline<float>& outline, const float* r, const float* z, float* out,
              int n);
  void (*run_near)(const DistanceOutline<float>& outline, const DistanceBall& ball, const float* r,
                   const float* z, float* out);
  void (*places)(const float* to_bur, const float* first, float* r, float* z);
};

// Those that this processor runs, the fastest last.
std::vector<DistanceKernel> distance_kernels();

// The outline of a head as Bur has it for them.
DistanceOutline<float> fast_outline(const std::vector<ProfilePiece>& head);

}  // namespace toothprep
