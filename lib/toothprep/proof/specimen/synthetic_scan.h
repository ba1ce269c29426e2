// A synthetic CT: the grey values that a scanner would give of a tooth known exactly, with its
// ground truth. Every estimator of tissues can so be tested against known answers.
#pragma once

#include <cstdint>
#include <functional>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/image_volume.h"

namespace toothprep {

struct SyntheticScanOptions {
  Vec3 spacing{0.15, 0.15, 0.15};  // mm
  // Full width at half maximum of the Gaussian point spread function, in voxels along each axis; 0:
  // none.
  double blur_fwhm_voxels = 1.5;
  double noise = 45;  // standard deviation of the white Gaussian noise, grey values (added last)
  std::uint64_t seed = 1;  // of the noise
  double margin = 1.5;     // air around the tooth, mm
  int supersampling = 3;   // samples per voxel and axis where tissues meet (partial volume)
  // Grey values, Hounsfield-like, indexed by label: air, enamel, dentin, pulp, other. The image is
  // clipped to [lowest, highest], as a scanner's 12 bits are.
  std::array<double, kTissueCount + 1> grey{-1000, 2500, 1600, 300, 1200};
  double lowest = -1024, highest = 3071;
};

struct SyntheticScan {
  ImageVolume<std::int16_t> image;
  ImageVolume<std::uint8_t> labels;  // Tissue values at the voxel centres
};

// Scans the tooth given by `sample` (pure and thread-safe; distances as in ToothSample), which lies
// within `bounds`. Axes along W's. Per voxel: the mean grey value over supersampling³ points, then
// the point spread function, then noise, which depends on the seed and the voxel's index alone, so
// that it is the same for any number of threads. Throws Error naming the option that is out of
// range, or for more than 2^29 voxels.
SyntheticScan make_synthetic_scan(const std::function<ToothSample(const Vec3&)>& sample,
                                  const Box& bounds, const SyntheticScanOptions& options);

// The same of the molar.
SyntheticScan make_molar_scan(const SyntheticScanOptions& options);

}  // namespace toothprep
