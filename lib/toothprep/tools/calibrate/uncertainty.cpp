#include "toothprep/tools/calibrate/uncertainty.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <random>

#include "toothprep/step/core/statistics.h"

namespace toothprep {

void FreeSums::add(const NormalSums& sums, const FreeSet& free, std::size_t recording,
                   double times) {
  for (int a = 0; a < kColumns; ++a) {
    const int i = free.place(recording, a);
    if (i < 0) continue;
    g[i] += times * sums.g[a];
    for (int b = 0; b < kColumns; ++b) {
      const int j = free.place(recording, b);
      if (j >= 0) H(i, j) += times * sums.H(a, b);
    }
  }
}

Eigen::VectorXd solve_scaled(const Eigen::MatrixXd& H, const Eigen::VectorXd& b) {
  Eigen::VectorXd scale = H.diagonal();
  for (double& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
  const Eigen::MatrixXd A = scale.asDiagonal() * H * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(A);
  const double least = 1e-13 * std::max(eigen.eigenvalues().cwiseAbs().maxCoeff(), 1e-300);
  Eigen::VectorXd y = eigen.eigenvectors().transpose() * scale.cwiseProduct(b);
  for (Eigen::Index i = 0; i < y.size(); ++i)
    y[i] = eigen.eigenvalues()[i] > least ? y[i] / eigen.eigenvalues()[i] : 0;
  return scale.cwiseProduct(eigen.eigenvectors() * y);
}

namespace {

// The chunks of one recording over its free columns only, H and g side by side: what is added up
// many times.
struct RecordingBlocks {
  std::size_t begin = 0, end = 0;
  std::vector<int> place;             // of each column among the free parameters
  std::vector<Eigen::MatrixXd> sums;  // columns x (columns + 1)
};

std::vector<RecordingBlocks> blocks_by_recording(const std::vector<NormalSums>& sums,
                                                 const std::vector<Chunk>& chunks,
                                                 const FreeSet& free) {
  std::vector<RecordingBlocks> recordings;
  std::vector<int> columns;
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    if (i == 0 || chunks[i].recording != chunks[i - 1].recording) {
      recordings.push_back({i, i, {}, {}});
      columns.clear();
      for (int a = 0; a < kColumns; ++a)
        if (const int p = free.place(static_cast<std::size_t>(chunks[i].recording), a); p >= 0) {
          columns.push_back(a);
          recordings.back().place.push_back(p);
        }
    }
    RecordingBlocks& r = recordings.back();
    r.end = i + 1;
    const auto n = static_cast<Eigen::Index>(columns.size());
    Eigen::MatrixXd block(n, n + 1);
    for (Eigen::Index a = 0; a < n; ++a) {
      const int ca = columns[static_cast<std::size_t>(a)];
      for (Eigen::Index b = 0; b < n; ++b)
        block(a, b) = sums[i].H(ca, columns[static_cast<std::size_t>(b)]);
      block(a, n) = sums[i].g[ca];
    }
    r.sums.push_back(std::move(block));
  }
  return recordings;
}

}  // namespace

Eigen::MatrixXd block_bootstrap(const std::vector<NormalSums>& sums,
                                const std::vector<Chunk>& chunks, const FreeSet& free,
                                int replicates, std::uint64_t seed) {
  const std::vector<RecordingBlocks> recordings = blocks_by_recording(sums, chunks, free);
  Eigen::MatrixXd steps(free.size, replicates);
  tbb::parallel_for(0, replicates, [&](int replicate) {
    std::seed_seq seeds{seed, static_cast<std::uint64_t>(replicate)};
    std::mt19937_64 random(seeds);
    FreeSums total(free.size);
    for (const RecordingBlocks& r : recordings) {
      std::vector<int> times(r.sums.size(), 0);
      for (std::size_t n = 0; n < times.size(); ++n) ++times[random() % times.size()];
      const auto n = static_cast<Eigen::Index>(r.place.size());
      Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(n, n + 1);
      for (std::size_t i = 0; i < times.size(); ++i)
        if (times[i] > 0) sum += times[i] * r.sums[i];
      for (Eigen::Index a = 0; a < n; ++a) {
        const int p = r.place[static_cast<std::size_t>(a)];
        for (Eigen::Index b = 0; b < n; ++b)
          total.H(p, r.place[static_cast<std::size_t>(b)]) += sum(a, b);
        total.g[p] += sum(a, n);
      }
    }
    steps.col(replicate) = -solve_scaled(total.H, total.g);
  });
  return steps;
}

double correlation_time(const std::vector<double>& series, double step) {
  const std::size_t n = std::min<std::size_t>(series.size(), 60000);
  if (n < 20) return step;
  std::vector<double> x(series.begin(), series.begin() + static_cast<std::ptrdiff_t>(n));
  std::vector<double> size(n);
  // The middle, and not the mean: outliers would leave the others off it, which looks like a
  // correlation that never ends.
  const double middle = median(x);
  for (std::size_t i = 0; i < n; ++i) size[i] = std::abs(x[i] -= middle);
  const double limit = 3 * kSigmaOfMedian * median(std::move(size));
  double power = 0;
  for (double& v : x) {
    v = std::clamp(v, -limit, limit);
    power += v * v;
  }
  if (!(power > 0)) return step;
  double sum = 1;
  for (std::size_t lag = 1; lag < n / 4 && lag < 2000; ++lag) {
    double product = 0;
    for (std::size_t i = lag; i < n; ++i) product += x[i] * x[i - lag];
    // Up to where the correlation is lost in its own scatter.
    if (product / power < 2 / std::sqrt(static_cast<double>(n))) break;
    sum += 2 * product / power;
  }
  return sum * step;
}

double student_95(double freedom) {
  return boost::math::quantile(boost::math::students_t(freedom), 0.975);
}

}  // namespace toothprep
