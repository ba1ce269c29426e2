// The step alone: a block of enamel on dentin made here, and a bur that is fed into its side at 2 mm/s.
#include <toothprep/step/bur/bur_library.h>
#include <toothprep/step/session/session.h>
#include <toothprep/version.h>

#include <algorithm>
#include <cstdio>

using namespace toothprep;

// 4 x 2 x 4 mm, top at y = 0; enamel down to y = -1. Signed distances, negative inside.
ToothSample block_at(const Vec3& x) {
  const Vec3 beyond = (x - Vec3(0, -1, 0)).cwiseAbs() - Vec3(2, 1, 2);
  const double solid = beyond.cwiseMax(0.0).norm() + std::min(beyond.maxCoeff(), 0.0);
  const double enamel = std::max(solid, -1 - x.y()), dentin = std::max(solid, x.y() + 1);
  const float air = 10;  // far from any pulp
  const Tissue label = solid > 0 ? Tissue::kAir : x.y() > -1 ? Tissue::kEnamel : Tissue::kDentin;
  return {static_cast<float>(solid),
          {static_cast<float>(enamel), static_cast<float>(dentin), air},
          label};
}

int main() {
  const Lattice lattice{Vec3(0.05, 0.05, 0.05), 0.1};
  const LayeredTooth tooth =
      build_tooth(lattice, Index3(-21, -21, -21), Index3(20, 0, 20), block_at, true);
  const Bur bur = make_bur("cylinder:D0.8xL1.5", "");
  const Parameters parameters = preset_parameters("paper");
  Workpiece workpiece(tooth);

  HandleSample hand;  // the bur's tip 0.8 mm under the top, 0.2 mm beside the block
  hand.pose = {Vec3(-2.6, -0.8, 0), orientation_of_axis(Vec3::UnitY())};
  Session session(bur, workpiece, parameters, Drive::kCoupled, hand);
  StepRecord row;
  for (int step = 1; step <= 1500; ++step) {
    hand.time = step * parameters.time_step;
    hand.pose.position.x() += 2 * parameters.time_step;
    row = session.step(hand);
    if (step % 250 == 0)
      std::printf("%.3f s  force %.4f N  torque %.4f N mm  %s\n", hand.time,
                  row.device_force.norm(), row.torque, row.stalled ? "stalled" : "turns");
  }
  session.finish(row);
  const SessionTotals& totals = session.totals();
  const double energy = parameters.tissue[0].specific_energy * totals.removed[0];
  std::printf("toothprep %s: removed %.4f mm3 of enamel; work over energy %.4f\n", kVersion,
              totals.removed[0], totals.torque_work / energy);
}
