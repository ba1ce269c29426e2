// What must fall when the voxel and the element size halve, and what must not depend on placement.
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/core/units.h"

namespace toothprep::testing {
namespace {

// Mean over placements of |feed force / closed form - 1| and of the RMS about the mean, ball in
// side feed. The block is turned so that nothing lines up with the grid.
struct Errors {
  double bias = 0, ripple = 0;
};
Errors ball_errors(double voxel) {
  const double R = 0.6, exact = units::kPi * 300 * 0.5 * R / (8 * 0.25 * 100);
  Errors e;
  const int n = 4;
  for (int i = 0; i < n; ++i) {
    Pose frame{Vec3(0.013 * i, 0.029 * i, -0.017 * i),
               Quat(Eigen::AngleAxisd(0.37 * i + 0.2, Vec3(1, 0.5 * i, -0.3).normalized()))};
    const Outcome r =
        run(block(voxel, 4, Vec3(3, 4, 3), frame), paper_ball(), paper_without_stall(),
            Drive::kDirect, straight_path({Vec3(0, -1.5, -0.6), Vec3(0, -2.1, -0.6)}, 0.5, frame));
    const Plateau p = plateau(r.rows, 0.8, frame);
    e.bias += std::abs(p.force.y() / exact - 1) / n;
    e.ripple += p.rms_force.y() / exact / n;
  }
  std::printf("ball at %.3f mm: bias %.4f %%, ripple %.4f %%\n", voxel, 100 * e.bias,
              100 * e.ripple);
  return e;
}

TEST(Convergence, VoxelEffectFallsWithTheVoxelSize) {
  const Errors coarse = ball_errors(0.2), middle = ball_errors(0.1), fine = ball_errors(0.05);
  EXPECT_LT(middle.ripple, coarse.ripple);
  EXPECT_LT(fine.ripple, middle.ripple);
  EXPECT_LT(fine.bias, 0.005);
}

TEST(Convergence, ForceErrorFallsWithTheElementSize) {
  // The bur alone, every element engaged: the sum over elements of w (d·n)² against its integral,
  // pi L/2 for the cylinder's side. Second order: halving the size quarters the error.
  const Bur bur = paper_cylinder();
  double previous = 1;
  for (const double size : {0.4, 0.2, 0.1, 0.05}) {
    const SurfaceElements e = bur.elements(size);
    double worst = 0;
    for (double angle = 0; angle < 0.5; angle += 0.013) {
      double sum = 0;
      for (std::size_t i = 0; i < e.size(); ++i) {
        const double s = e.nx[i] * std::cos(angle) + e.ny[i] * std::sin(angle);
        if (s > 0) sum += e.weight[i] * s;
      }
      worst = std::max(worst, std::abs(sum / (2 * 3.0) - 1));  // int cos = 2 over the half
    }
    EXPECT_LT(worst, previous / 2.5);
    previous = worst;
  }
  EXPECT_LT(previous, 0.003);
}

TEST(Convergence, TurningEverythingChangesNothingBeyond1Percent) {
  // Bur, block and path turned together: entry, enamel, crossing, dentin.
  const Bur bur = paper_cylinder();
  std::vector<std::vector<Vec3>> forces;
  for (const Quat& q : {Quat::Identity(), Quat(Eigen::AngleAxisd(0.5, Vec3(1, 1, 0).normalized())),
                        Quat(Eigen::AngleAxisd(2.2, Vec3(0.2, -1, 0.6).normalized()))}) {
    const Pose frame{Vec3(0.4, -0.7, 0.2), q};
    const Outcome r =
        run(block(0.1, 1.5, Vec3(4, 5, 6), frame), bur, paper_without_stall(), Drive::kDirect,
            straight_path({Vec3(0, 0.8, -1.5), Vec3(0, -3, -1.5)}, 1.0, frame));
    std::vector<Vec3> f;
    for (const StepRecord& row : r.rows) f.push_back(q.conjugate() * row.grinding_force);
    forces.push_back(f);
  }
  for (std::size_t c = 1; c < forces.size(); ++c) {
    double sum = 0;
    for (std::size_t i = 0; i < forces[0].size(); ++i)
      sum += (forces[c][i] - forces[0][i]).squaredNorm();
    const double rms =
        std::sqrt(sum / static_cast<double>(forces[0].size())) / 9.0;  // of the plateau at 1 mm/s
    std::printf("turned %zu: RMS difference %.3f %% of the plateau\n", c, 100 * rms);
    EXPECT_LT(rms, 0.01);
  }
}

}  // namespace
}  // namespace toothprep::testing
