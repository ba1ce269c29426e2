// What blocks of the residuals say about the uncertainty of parameters at a minimum.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/tools/calibrate/force_model.h"

namespace toothprep {

// Which parameters are free, and where each stands in the vector of the free ones.
struct FreeSet {
  std::vector<int> shared;                 // kShared places, -1: held
  std::vector<std::array<int, kOwn>> own;  // per recording
  int size = 0;

  FreeSet(std::size_t recordings) : shared(kShared, -1), own(recordings) {
    for (auto& o : own) o.fill(-1);
  }
  void free_shared(int i) {
    if (shared[static_cast<std::size_t>(i)] < 0) shared[static_cast<std::size_t>(i)] = size++;
  }
  void free_own(std::size_t recording, int i) {
    own[recording][static_cast<std::size_t>(i)] = size++;
  }
  // The columns of the Jacobian that any recording has free.
  std::vector<int> columns() const {
    std::vector<int> list;
    for (int a = 0; a < kColumns; ++a) {
      bool any = a < kShared && shared[static_cast<std::size_t>(a)] >= 0;
      if (a >= kShared)
        for (const auto& o : own) any = any || o[static_cast<std::size_t>(a - kShared)] >= 0;
      if (any) list.push_back(a);
    }
    return list;
  }
  int place(std::size_t recording, int column) const {
    return column < kShared ? shared[static_cast<std::size_t>(column)]
                            : own[recording][static_cast<std::size_t>(column - kShared)];
  }
};

// Sums of chunks over the free parameters.
struct FreeSums {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  FreeSums(int size) : H(Eigen::MatrixXd::Zero(size, size)), g(Eigen::VectorXd::Zero(size)) {}
  void add(const NormalSums& sums, const FreeSet& free, std::size_t recording, double times = 1);
};

// x of H x = b for symmetric H with columns of very different size; directions that H doesn't
// determine (eigenvalue below 1e-13 of the largest, scaled) are left out.
Eigen::VectorXd solve_scaled(const Eigen::MatrixXd& H, const Eigen::VectorXd& b);

// Changes of the free parameters (a column each) when the blocks of each recording are drawn anew
// with replacement: one step of Gauss and Newton from the minimum. Replicate i depends on `seed`
// and i only.
Eigen::MatrixXd block_bootstrap(const std::vector<NormalSums>& sums,
                                const std::vector<Chunk>& chunks, const FreeSet& free,
                                int replicates, std::uint64_t seed);

// Integrated correlation time of a series sampled every `step`, s: step for white noise. Values are
// clipped at three times their median size, so that outliers don't hide the correlation.
double correlation_time(const std::vector<double>& series, double step);

// The factor on a standard deviation for a two-sided 95 % interval with `freedom` degrees of
// freedom (Student's t), which need not be a whole number.
double student_95(double freedom);

}  // namespace toothprep
