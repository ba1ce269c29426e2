#include "toothprep/tools/calibrate/fit_solver.h"

#include <ceres/ceres.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"

namespace toothprep {
namespace {

class ChunkCost final : public ceres::SizedCostFunction<kColumns + 1, kShared, kOwn> {
 public:
  ChunkCost(const ComparedRecording& recording, const Chunk& chunk, const ModelState& state,
            std::size_t stride)
      : recording_(recording), chunk_(chunk), state_(state), stride_(stride) {}

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    using Shared = Eigen::Matrix<double, kShared, 1>;
    using Own = Eigen::Matrix<double, kOwn, 1>;
    const NormalSums sums =
        normal_sums(recording_, chunk_, Eigen::Map<const Shared>(x[0]), Eigen::Map<const Own>(x[1]),
                    state_, Weighting::kTransformed, stride_);
    constexpr int n = kColumns + 1;
    if (!std::isfinite(sums.cost)) return false;
    Eigen::Map<Eigen::Matrix<double, n, 1>> r(residuals);
    if (!jacobians) {
      r.setZero();
      r[0] = std::sqrt(sums.cost);
      return true;
    }
    // Over the free columns, which are few; the last is the residual's.
    const auto m = static_cast<Eigen::Index>(state_.columns.size());
    Eigen::MatrixXd A(m + 1, m + 1);
    for (Eigen::Index a = 0; a < m; ++a) {
      const int i = state_.columns[static_cast<std::size_t>(a)];
      A(a, m) = A(m, a) = sums.g[i];
      for (Eigen::Index c = 0; c < m; ++c)
        A(a, c) = sums.H(i, state_.columns[static_cast<std::size_t>(c)]);
    }
    A(m, m) = sums.cost;
    // Columns to length one first: their sizes differ by many orders.
    Eigen::VectorXd scale(m + 1);
    for (Eigen::Index i = 0; i <= m; ++i) scale[i] = A(i, i) > 0 ? std::sqrt(A(i, i)) : 0;
    for (Eigen::Index i = 0; i <= m; ++i)
      for (Eigen::Index j = 0; j <= m; ++j)
        A(i, j) = scale[i] > 0 && scale[j] > 0 ? A(i, j) / (scale[i] * scale[j]) : 0;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(A);
    const Eigen::MatrixXd root = eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() *
                                 eigen.eigenvectors().transpose() * scale.asDiagonal();
    r.setZero();
    r.head(m + 1) = root.col(m);
    using SharedColumns = Eigen::Matrix<double, n, kShared, Eigen::RowMajor>;
    using OwnColumns = Eigen::Matrix<double, n, kOwn, Eigen::RowMajor>;
    Eigen::Matrix<double, n, kColumns> J = Eigen::Matrix<double, n, kColumns>::Zero();
    for (Eigen::Index a = 0; a < m; ++a)
      J.col(state_.columns[static_cast<std::size_t>(a)]).head(m + 1) = root.col(a);
    if (double* to = jacobians[0]) Eigen::Map<SharedColumns>{to} = J.leftCols<kShared>();
    if (double* to = jacobians[1]) Eigen::Map<OwnColumns>{to} = J.middleCols<kOwn>(kShared);
    return true;
  }

 private:
  const ComparedRecording& recording_;
  const Chunk& chunk_;
  const ModelState& state_;
  std::size_t stride_;
};

std::vector<int> held(const std::vector<int>& place) {
  std::vector<int> constant;
  for (std::size_t i = 0; i < place.size(); ++i)
    if (place[i] < 0) constant.push_back(static_cast<int>(i));
  return constant;
}

}  // namespace

double minimise(const FitData& data, const FreeSet& free, const FitOptions& o, std::size_t stride,
                ModelState& state) {
  const auto& recordings = data.recordings;
  ceres::Problem problem;
  const auto restrict_block = [&](double* block, const std::vector<int>& constant, int size) {
    if (constant.empty()) return;
    if (static_cast<int>(constant.size()) == size)
      problem.SetParameterBlockConstant(block);
    else
      problem.SetManifold(block, new ceres::SubsetManifold(size, constant));
  };
  problem.AddParameterBlock(state.shared.data(), kShared);
  for (auto& own : state.own) problem.AddParameterBlock(own.data(), kOwn);
  ModelState fixed = state;  // mode and loss; its values aren't read
  fixed.columns = free.columns();
  for (const Chunk& c : data.chunks) {
    const auto r = static_cast<std::size_t>(c.recording);
    problem.AddResidualBlock(new ChunkCost(recordings[r], c, fixed, stride), nullptr,
                             state.shared.data(), state.own[r].data());
  }
  restrict_block(state.shared.data(), held(free.shared), kShared);
  for (std::size_t r = 0; r < recordings.size(); ++r)
    restrict_block(state.own[r].data(),
                   held(std::vector<int>(free.own[r].begin(), free.own[r].end())), kOwn);
  for (int i = 0; i < kDelay; ++i)
    if (free.shared[static_cast<std::size_t>(i)] >= 0) {
      problem.SetParameterLowerBound(state.shared.data(), i, -kLargestLog);
      problem.SetParameterUpperBound(state.shared.data(), i, kLargestLog);
    }
  if (free.shared[kDelay] >= 0) {
    problem.SetParameterLowerBound(state.shared.data(), kDelay, -o.largest_delay);
    problem.SetParameterUpperBound(state.shared.data(), kDelay, o.largest_delay);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.num_threads = 1;  // with more, sums depend on who is first
  options.max_num_iterations = 60;
  options.function_tolerance = 1e-10;  // polish() does the rest
  options.parameter_tolerance = 1e-9;
  options.gradient_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) throw Error("the fit failed: " + summary.message);
  return summary.final_cost;
}

Linear solve_linear(const FitData& data, const FreeSet& free, ModelState state, std::size_t stride,
                    int passes) {
  const auto& recordings = data.recordings;
  const auto& chunks = data.chunks;
  // Logarithms of free tissues at 0: u = w = 1.
  for (int i = 0; i < kDelay; ++i)
    if (free.shared[static_cast<std::size_t>(i)] >= 0) state.shared[i] = 0;
  state.columns = free.columns();
  Linear linear;
  linear.x = Eigen::VectorXd::Zero(free.size);
  const RobustLoss loss = state.loss;
  for (int pass = 0; pass < passes; ++pass) {
    state.loss = pass == 0 ? RobustLoss::kNone : loss;
    std::vector<NormalSums> sums(chunks.size());
    tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t i) {
      const auto r = static_cast<std::size_t>(chunks[i].recording);
      Eigen::Matrix<double, kColumns, 1> shift = Eigen::Matrix<double, kColumns, 1>::Zero();
      for (int a = 0; a < kColumns; ++a)
        if (const int p = free.place(r, a); p >= 0) shift[a] = linear.x[p];
      sums[i] = normal_sums(recordings[r], chunks[i], state.shared, state.own[r], state,
                            Weighting::kWeights, stride, &shift);
    });
    FreeSums total = total_of(sums, chunks, free);
    linear.cost = 0;
    for (const NormalSums& s : sums) linear.cost += s.cost;
    const Eigen::VectorXd step = -solve_scaled(total.H, total.g);
    linear.x += step;
    linear.cost += total.g.dot(step);  // of the quadratic, at its minimum
    linear.H = std::move(total.H);
  }
  for (int i = 0; i < kDelay; ++i)
    if (free.shared[static_cast<std::size_t>(i)] >= 0)
      linear.x[free.shared[static_cast<std::size_t>(i)]] += 1;
  return linear;
}

bool all_positive(const Linear& linear, const FreeSet& free) {
  for (int i = 0; i < kDelay; ++i) {
    const int p = free.shared[static_cast<std::size_t>(i)];
    if (p >= 0 && !(linear.x[p] > 0)) return false;
  }
  return true;
}

ModelState moved_to(const Linear& linear, const FreeSet& free, const FitOptions& o,
                    ModelState state) {
  for (int k = 0; k < kTissueCount; ++k)
    for (const int i : {2 * k, 2 * k + 1}) {
      const int p = free.shared[static_cast<std::size_t>(i)];
      const double start = i == 2 * k ? o.start[k].specific_energy
                                      : o.start[k].specific_energy / o.start[k].force_ratio;
      if (p >= 0) state.shared[i] = std::log(linear.x[p] > 0 ? linear.x[p] : std::max(start, 1e-3));
    }
  const auto add = [&](int place) {
    if (const int p = free.shared[static_cast<std::size_t>(place)]; p >= 0)
      state.shared[place] += linear.x[p];
  };
  for (int i = 0; i < 3; ++i) add(kWeight + i);
  for (int s = 0; s < state.shapes; ++s) add(kShape + s);
  for (std::size_t r = 0; r < state.own.size(); ++r)
    for (int i = 0; i < kOwn; ++i)
      if (const int p = free.own[r][static_cast<std::size_t>(i)]; p >= 0)
        state.own[r][i] += linear.x[p];
  return state;
}

namespace {

struct Start {
  ModelState state;
  double cost = 0;
};

// From the linear solution and, if several are asked for, the start values times 1, 10 and 1/10.
std::vector<Start> descents(const FitData& data, const ModelState& begin, const Asked& asked,
                            const FitOptions& o, const FreeSet& set) {
  const FreeSet linear = linear_set(begin, data.recordings.size(), asked);
  std::vector<Start> ends;
  for (const double factor : {0.0, 1.0, 10.0, 0.1}) {
    if (factor != 0 && !o.several_starts) break;
    ModelState state = begin;
    if (factor == 0) {
      state = moved_to(solve_linear(data, linear, begin, data.stride, 5), linear, o, begin);
    } else {
      for (int k = 0; k < kTissueCount; ++k) {
        if (state.mode[k] == TissueMode::kHeld) continue;
        const double u = std::max(factor * o.start[k].specific_energy, 1e-3);
        state.shared[2 * k] = std::log(u);
        state.shared[2 * k + 1] = std::log(u / o.start[k].force_ratio);
      }
    }
    const double cost = minimise(data, set, o, data.stride, state);
    ends.push_back({state, cost});
  }
  return ends;
}

void search(const Asked& asked, const FitOptions& o, Solution& s) {
  const FreeSet set = free_set(s.state, s.data.recordings.size(), asked);
  for (auto& own : s.state.own) {
    if (asked.bias) own.head<3>().setZero();
    if (asked.drift) own.tail<3>() = o.drift;
  }
  if (asked.weight) s.state.shared.segment<3>(kWeight) = o.weight;
  const std::vector<Start> ends = descents(s.data, s.state, asked, o, set);
  s.state = std::min_element(ends.begin(), ends.end(), [](const Start& a, const Start& b) {
              return a.cost < b.cost;
            })->state;
  for (const Start& end : ends)
    for (int i = 0; i < kDelay; ++i)
      if (set.shared[static_cast<std::size_t>(i)] >= 0)
        s.start_spread =
            std::max(s.start_spread, std::abs(std::expm1(end.state.shared[i] - s.state.shared[i])));
}

// The residuals' own size in contact, where it isn't given: it holds what noise and model together
// leave.
void take_sigma(const FitOptions& o, Solution& s) {
  for (std::size_t r = 0; r < s.data.recordings.size(); ++r) {
    ComparedRecording& recording = s.data.recordings[r];
    const auto modelled = modelled_force(recording, s.state.own[r], s.state);
    std::vector<double> residual;
    for (std::size_t j = 0; j < modelled.size(); ++j)
      if (s.data.contact[r][j])
        for (int a = 0; a < 3; ++a) residual.push_back(modelled[j][a] - recording.force[j][a]);
    if (residual.size() < kQuietSamples) continue;
    const double scale = robust_scale(std::move(residual));
    recording.sigma =
        std::max(o.noise ? std::max(*o.noise, scale) : scale, 1e-6 * s.data.force_rms);
  }
}

// Without the low-pass among what is asked where the search ended below zero: it is held there.
Asked settle_noise(Asked asked, const FitOptions& o, Solution& s) {
  const Asked filter = asked;  // the slope by the time constant is kept in either case
  const auto refilter = [&] {
    filter_at(s.data.lowpass + s.state.shared[kLowpass], o, filter, s.data, s.state);
  };
  const auto descend = [&](std::size_t stride) {
    minimise(s.data, free_set(s.state, s.data.recordings.size(), asked), o, stride, s.state);
  };
  for (int round = 0; round < 2; ++round) {
    take_sigma(o, s);
    // The filter is linear about its time constant only; below zero there is none.
    for (int pass = 0; asked.lowpass && pass < 2; ++pass) {
      asked.lowpass = s.data.lowpass + s.state.shared[kLowpass] > 0;
      refilter();
      descend(s.data.stride);
    }
    if (asked.lowpass) refilter();
    descend(round == 0 ? s.data.stride : 1);
  }
  return asked;
}

// Newton steps to the exact zero of the gradient, which the uncertainty is taken at.
void polish(const Asked& asked, const FitOptions& o, Solution& s) {
  const FreeSet set = free_set(s.state, s.data.recordings.size(), asked);
  for (int pass = 0; pass < 3; ++pass) {
    if (asked.lowpass)
      filter_at(s.data.lowpass + s.state.shared[kLowpass], o, asked, s.data, s.state);
    const FreeSums total =
        total_of(normal_sums(s.data.recordings, s.data.chunks, s.state, Weighting::kWeights),
                 s.data.chunks, set);
    const Eigen::VectorXd step = -solve_scaled(total.H, total.g);
    for (int i = 0; i < kShared; ++i)
      if (const int p = set.shared[static_cast<std::size_t>(i)]; p >= 0)
        s.state.shared[i] += std::clamp(step[p], -0.01, 0.01);
    for (std::size_t r = 0; r < s.state.own.size(); ++r)
      for (int i = 0; i < kOwn; ++i)
        if (const int p = set.own[r][static_cast<std::size_t>(i)]; p >= 0)
          s.state.own[r][i] += step[p];
  }
  s.state.shared[kDelay] = std::clamp(s.state.shared[kDelay], -o.largest_delay, o.largest_delay);
  s.state.shared[kLowpass] = std::max(s.state.shared[kLowpass], -s.data.lowpass);
}

}  // namespace

Solution solve(FitData data, const ModelState& start, const Asked& asked, const FitOptions& o) {
  Solution s{std::move(data), start};
  search(asked, o, s);
  const Asked settled = settle_noise(asked, o, s);
  polish(settled, o, s);
  return s;
}

double robust_scale(std::vector<double> values) {
  for (double& x : values) x = std::abs(x);
  return kSigmaOfMedian * median(std::move(values));
}

}  // namespace toothprep
