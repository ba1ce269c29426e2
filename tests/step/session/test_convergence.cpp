// What must fall when the voxel and the element size halve, and what must not depend on placement.
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/core/units.h"

namespace toothprep::testing {
namespace {

// The whole path of the cylinder fed along -y into a layered block, exact: the element at angle phi
// from the feed lies R cos(phi) ahead of the axis and is in tissue k while y - R cos(phi) is;
// everything it meets is fresh. The side's width is not limited, so that for depth y of the axis
//
//   F_feed(y) = sum_k u_k v L/(2 pi N alpha) int_{phi in k} cos² phi dphi,
//
// elementary integrals between the angles where the layer's faces cut the front.
double exact_feed_force(double y, double v, double L, double enamel, double height) {
  const double R = 0.6, N = 100, alpha = 0.25;
  // Tissue between y_top and y_bottom covers cos(phi) in ((y - y_top)/R, (y - y_bottom)/R).
  const auto integral_above = [&](double c) {  // int cos² over cos(phi) > c, phi in (-pi/2, pi/2)
    const double a = std::acos(std::clamp(c, 0.0, 1.0));
    return a + std::sin(2 * a) / 2;
  };
  const auto layer = [&](double top, double bottom) {
    return integral_above((y - top) / R) - integral_above((y - bottom) / R);
  };
  const double sum = 300 * layer(0, -enamel) + 100 * layer(-enamel, -height);
  return sum * v * L / (2 * units::kPi * N * alpha);
}

struct PathError {
  double rms = 0, worst = 0;  // of the enamel plateau
};
PathError path_error(double voxel, double element_size, const Pose& frame) {
  const double v = 1.0, L = 3, enamel = 1.53, height = 4;
  const Outcome r =
      run(block(voxel, enamel, Vec3(4, height, 5), frame), paper_cylinder(), paper_without_stall(),
          Drive::kDirect, straight_path({Vec3(0, 0.8, -1.5), Vec3(0, -3, -1.5)}, v, frame),
          element_size);
  const double level = 300 * v * L / (4 * 0.25 * 100);
  PathError e;
  for (const StepRecord& row : r.rows) {
    // A row holds the force of the step that ended there.
    const double y = frame.to_local(row.bur.position).y() + v * 1e-3;
    const double got = (frame.orientation.conjugate() * row.grinding_force).y();
    const double error = row.handle.time > 0 ? got - exact_feed_force(y, v, L, enamel, height) : 0;
    e.rms += error * error / static_cast<double>(r.rows.size());
    e.worst = std::max(e.worst, std::abs(error) / level);
  }
  e.rms = std::sqrt(e.rms) / level;
  return e;
}

// Elements of a quarter of a voxel. What is left is what a sample may stand for, a hundredth of a piece.
TEST(Convergence, WholePathErrorIsBelowAHundredthOfAPercentAtEveryVoxelSize) {
  // Entry, enamel, crossing, dentin; along the grid and turned to it.
  for (const Pose& frame :
       {Pose{}, Pose{Vec3(0.3, 0.1, -0.2),
                     Quat(Eigen::AngleAxisd(0.6, Vec3(0.3, 1, -0.5).normalized()))}}) {
    const PathError coarse = path_error(0.2, 0.05, frame), middle = path_error(0.1, 0.025, frame),
                    fine = path_error(0.05, 0.0125, frame);
    for (const auto& [size, e] :
         {std::pair(0.2, coarse), std::pair(0.1, middle), std::pair(0.05, fine)})
      std::printf("whole path at %.2f mm voxels: RMS %.3f %%, worst %.2f %%\n", size, 100 * e.rms,
                  100 * e.worst);
    for (const PathError& e : {coarse, middle, fine}) {
      EXPECT_LT(e.rms, 1e-4);
      EXPECT_LT(e.worst, 5e-3);
    }
  }
}

TEST(Convergence, VoxelEffectOnThePlateauStaysBelow1PercentAtEveryVoxelSize) {
  const double R = 0.6, exact = units::kPi * 300 * 0.5 * R / (8 * 0.25 * 100);
  for (const double voxel : {0.2, 0.1, 0.05}) {
    const Pose frame{Vec3(0.013, 0.029, -0.017),
                     Quat(Eigen::AngleAxisd(0.57, Vec3(1, 0.5, -0.3).normalized()))};
    const Outcome r =
        run(block(voxel, 4, Vec3(3, 4, 3), frame), paper_ball(), paper_without_stall(),
            Drive::kDirect, straight_path({Vec3(0, -1.5, -0.6), Vec3(0, -2.1, -0.6)}, 0.5, frame));
    const Plateau p = plateau(r.rows, 0.8, frame);
    std::printf("ball at %.2f mm: mean %.4f of exact, voxel effect %.3f %%\n", voxel,
                p.force.y() / exact, 100 * p.rms_force.y() / exact);
    EXPECT_NEAR(p.force.y() / exact, 1, 0.01);
    EXPECT_LT(p.rms_force.y() / exact, 0.01);
  }
}

TEST(Convergence, ForceErrorFallsWithTheElementSize) {
  // The bur alone, every element engaged: the sum over advancing elements of w (d·n) against its
  // integral, 2 L for the cylinder's side. Second order: halving the size quarters the bound.
  const Bur bur = paper_cylinder();
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
    // The midpoint rule over arcs of dphi = size/R errs by dphi²/24, and by as much again where the
    // half ends within an element.
    EXPECT_LT(worst, std::pow(size / 0.6, 2) / 12) << size;
  }
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
