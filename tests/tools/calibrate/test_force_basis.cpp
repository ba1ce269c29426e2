#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/calibrate/force_basis.h"

namespace toothprep::testing {
namespace {

Parameters without_stall(const PerTissue<GrindingProperties>& tissue) {
  Parameters p = preset_parameters("paper");
  p.tissue = tissue;
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  return p;
}

// F = sum of u T + (u / alpha) N. The step sums its elements in single precision, hence not closer
// than some 1e-7 of the sum of the elements' sizes; the basis sums in double precision.
TEST(ForceBasis, TimesParametersIsTheReplayedForce) {
  const LayeredTooth tooth = block_with(1.0);
  const Bur bur = cylinder();
  const auto path = legs({-1.6, 0.1, -1.2}, {{{-1.6, -0.6, -1.2}, 1.0},
                                             {{-0.6, -0.6, -1.2}, 1.0},
                                             {{-0.6, -1.6, -1.2}, 1.0},
                                             {{0.2, -1.4, -0.6}, 1.0}});
  const ForceBasis basis = force_basis(bur, tooth, preset_parameters("paper"), path);
  ASSERT_TRUE(basis.touched(0));
  ASSERT_TRUE(basis.touched(1));
  PerTissue<GrindingProperties> other = truth();
  other[0].specific_energy *= 7;
  other[1].force_ratio = 0.6;
  for (const auto& tissue : {preset_parameters("paper").tissue, truth(), other}) {
    Workpiece workpiece(tooth);
    const ReplayResult r = replay(bur, workpiece, without_stall(tissue), Drive::kDirect, path);
    double peak = 0, worst = 0, worst_torque = 0, peak_torque = 0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      peak = std::max(peak, r.rows[i].grinding_force.norm());
      peak_torque = std::max(peak_torque, r.rows[i].torque);
      worst = std::max(worst, (r.rows[i].grinding_force - force_at(basis, i, tissue)).norm());
      worst_torque =
          std::max(worst_torque, std::abs(r.rows[i].torque - torque_at(basis, i, tissue)));
    }
    std::printf("[ basis    ] largest difference to the replay: %.1e of the peak force\n",
                worst / peak);
    EXPECT_LT(worst, 3e-6 * peak);
    EXPECT_LT(worst_torque, 3e-6 * peak_torque);
    for (int k = 0; k < kTissueCount; ++k) EXPECT_EQ(basis.tissue[k].removed, r.totals.removed[k]);
  }
}

// The parameters scale and mix the basis exactly, whatever they are.
TEST(ForceBasis, IsTheSameForAnyParameters) {
  const LayeredTooth tooth = block_with(1.0);
  const auto path = legs({-1.6, 0.1, -1.2}, {{{-1.6, -0.3, -1.2}, 1.0}});
  Parameters other = preset_parameters("paper");
  other.tissue = truth();
  other.handpiece.stall_torque = 1e-3;
  const ForceBasis a = force_basis(cylinder(), tooth, preset_parameters("paper"), path);
  const ForceBasis b = force_basis(cylinder(), tooth, other, path);
  EXPECT_EQ(a.tissue[0].force, b.tissue[0].force);
}

// u dV/dt is the torque's power 2 pi N T: with T = u tau, dV/dt = 2 pi N tau.
TEST(ForceBasis, RemovalRateAddsUpToWhatWasRemoved) {
  const ForceBasis& basis = mixed_basis();
  double volume = 0, removed = 0;
  for (const float q : basis.removal) volume += q * basis.step;
  for (const TissueColumns& t : basis.tissue) removed += t.removed;
  EXPECT_NEAR(volume / removed, 1, 0.02);  // the engine's energy audit
}

}  // namespace
}  // namespace toothprep::testing
