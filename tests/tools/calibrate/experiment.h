// Experiments with known truth: a small block of enamel on dentin, a bur, a path through it, and
// what an imperfect sensor reads.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/fit.h"
#include "toothprep/tools/calibrate/measurement.h"

namespace toothprep::testing {

struct Leg {
  Vec3 to;
  double speed;  // mm/s
};

// At `rate` Hz from `start` along the legs, the bur's axis along +y (out of the block's top face).
inline std::vector<HandleSample> legs(const Vec3& start, const std::vector<Leg>& way,
                                      double rate = 1000) {
  const Quat upright = orientation_of_axis(Vec3::UnitY());
  std::vector<HandleSample> path = {{0, {start, upright}, kPedalButton}};
  Vec3 from = start;
  for (const Leg& leg : way) {
    const auto n =
        std::max(1, static_cast<int>(std::round((leg.to - from).norm() / leg.speed * rate)));
    for (int i = 1; i <= n; ++i)
      path.push_back({static_cast<double>(path.size()) / rate,
                      {from + (leg.to - from) * i / n, upright},
                      kPedalButton});
    from = leg.to;
  }
  return path;
}

// Side feeds and plunges through both tissues, about 20 s: slots in enamel alone, in dentin alone
// (the same slot deeper) and in both, plunges slower than side feeds; contact-free at both ends and
// once in between.
inline std::vector<HandleSample> mixed_feed() {
  return legs({-3.6, -0.9, -1.0}, {{{1.0, -0.9, -1.0}, 1.2},
                                   {{1.0, -2.0, -1.0}, 0.4},
                                   {{-2.0, -2.0, -1.0}, 1.5},
                                   {{-1.0, -2.0, 1.4}, 1.2},
                                   {{-1.0, 0.4, 1.4}, 4.0},
                                   {{1.6, 0.05, 1.4}, 3.0},
                                   {{1.6, -0.6, 1.4}, 0.4},
                                   {{1.6, -0.6, -0.2}, 1.0},
                                   {{1.6, -1.9, -0.2}, 0.5},
                                   {{1.6, -1.9, 1.4}, 1.2},
                                   {{1.6, 0.2, 1.4}, 4.0},
                                   {{1.6, 0.6, 1.4}, 0.4}});
}

// Into dentin only: the block has no enamel then. Or a pure plunge, or pure side feed.
inline LayeredTooth block_with(double enamel) {
  BlockOptions o;
  o.size = Vec3(5, 3, 5);
  o.enamel = enamel;
  o.voxel = 0.15;
  return make_block(o);
}

inline Bur cylinder() { return make_bur("cylinder:D1.2xL3.0", ""); }

// Truth unlike the preset's.
inline PerTissue<GrindingProperties> truth() {
  PerTissue<GrindingProperties> t = preset_parameters("paper").tissue;
  t[0] = {units::from_joule_per_mm3(0.42), 0.31};
  t[1] = {units::from_joule_per_mm3(0.085), 0.22};
  return t;
}

// The basis of the mixed feed, computed once.
inline const ForceBasis& mixed_basis() {
  static const ForceBasis basis =
      force_basis(cylinder(), block_with(1.0), preset_parameters("paper"), mixed_feed());
  return basis;
}

inline std::vector<Vec3> true_force(const ForceBasis& basis,
                                    const PerTissue<GrindingProperties>& tissue = truth()) {
  std::vector<Vec3> force(basis.size);
  for (std::size_t i = 0; i < basis.size; ++i) force[i] = force_at(basis, i, tissue);
  return force;
}

inline MeasuredRecording recorded(const std::vector<HandleSample>& path,
                                  std::vector<Vec3> measured) {
  MeasuredRecording r;
  r.name = "synthetic";
  r.motion.samples = path;
  r.motion.measured_force = std::move(measured);
  return r;
}

inline FitResult fit_to(const std::vector<HandleSample>& path, const ForceBasis& basis,
                        const SensorOptions& sensor, const FitOptions& options) {
  const MeasuredRecording r = recorded(path, measured_by(sensor, true_force(basis), basis.step));
  return fit({compare(r, basis, options.largest_delay, options.lowpass_hz, options.on_handpiece)},
             options);
}

inline void expect_truth(const FitResult& result, double tolerance) {
  for (const int k : {0, 1}) {
    const TissueFit& t = result.tissue[k];
    ASSERT_TRUE(t.identifiable) << kTissueNames[k] << ": " << t.why_not.text;
    EXPECT_NEAR(t.u.value / truth()[k].specific_energy, 1, tolerance) << kTissueNames[k];
    EXPECT_NEAR(t.alpha.value / truth()[k].force_ratio, 1, tolerance) << kTissueNames[k];
  }
}

}  // namespace toothprep::testing
