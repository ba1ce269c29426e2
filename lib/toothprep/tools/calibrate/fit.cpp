#include "toothprep/tools/calibrate/fit.h"

#include <ceres/ceres.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/uncertainty.h"

namespace toothprep {
namespace {

using Recordings = std::vector<ComparedRecording>;

constexpr double kFirstChunks = 32;         // that all the time is cut into at first
constexpr double kSubset = 8000;            // samples that the search for a start looks at
constexpr double kLeastTouched = 0.05;      // s
constexpr double kLeastShare = 1e-3;        // of the force: less of a tissue isn't modelled
constexpr double kAssumedNoise = 0.01;      // of the force: no sensor on a rig does better
constexpr double kWorstStd = 0.25;          // relative: beyond, a parameter isn't identifiable
constexpr double kUseless = 0.6;            // likewise: beyond, it isn't even left free
constexpr double kSmallPart = 0.01;         // tangential by normal squares: they cancel
constexpr double kLargestLog = 30;          // of u, N/mm²
constexpr std::size_t kQuietSamples = 100;  // that a noise is estimated from
constexpr double kLeastTurn = 1;            // degrees rms: less of a turn doesn't tell a weight
constexpr double kAlike = 0.8;              // correlation, from which delay and low-pass are alike

// Standard deviation of normal values by their median size.
double robust_scale(std::vector<double> v) {
  for (double& x : v) x = std::abs(x);
  return kSigmaOfMedian * median(std::move(v));
}

std::size_t basis_index(const ComparedRecording& r, std::size_t j, double delay) {
  const double place = (r.time[j] - delay - r.basis->start) / r.basis->step + 0.5;
  return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(r.basis->size - 1)));
}

// Whether the bur touched anything within `margin` s, per sample.
std::vector<char> in_contact(const ComparedRecording& r, double margin) {
  const ForceBasis& b = *r.basis;
  std::vector<double> last(b.size), next(b.size);
  double seen = -1e30;
  for (std::size_t i = 0; i < b.size; ++i) {
    if (b.removal[i] > 0) seen = b.start + b.step * static_cast<double>(i);
    last[i] = seen;
  }
  seen = 1e30;
  for (std::size_t i = b.size; i-- > 0;) {
    if (b.removal[i] > 0) seen = b.start + b.step * static_cast<double>(i);
    next[i] = seen;
  }
  std::vector<char> contact(r.time.size());
  for (std::size_t j = 0; j < contact.size(); ++j) {
    const std::size_t i = basis_index(r, j, 0);
    contact[j] = r.time[j] - last[i] <= margin || next[i] - r.time[j] <= margin;
  }
  return contact;
}

// Noise per axis in the spans without contact, N: what is left of the differences of samples is
// free of bias and drift, but not of correlation, so the spread about the median is taken too.
double quiet_noise(const ComparedRecording& r, const std::vector<char>& contact) {
  double variance = 0;
  for (int a = 0; a < 3; ++a) {
    std::vector<double> value;
    for (std::size_t j = 0; j < contact.size(); ++j)
      if (!contact[j]) value.push_back(r.force[j][a]);
    if (value.size() < kQuietSamples) return std::numeric_limits<double>::quiet_NaN();
    const double centre = median(value);
    for (double& v : value) v -= centre;
    const double scale = robust_scale(std::move(value));
    variance += scale * scale / 3;
  }
  return std::sqrt(variance);
}

// --- Ceres: a chunk as one cost function
// ---------------------------------------------------------- A chunk's residuals r (3n of them) go
// to the solver as kColumns + 1 numbers that have the same sum of squares, gradient and J^T J: a
// square root of [J r]^T [J r]. Thousands of samples then cost the solver nothing, and a recording
// of ten minutes needs no Jacobian of a gigabyte. The robust loss is in r already
// (Weighting::kTransformed).
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
    Eigen::Matrix<double, n, n> A;
    A.topLeftCorner<kColumns, kColumns>() = sums.H;
    A.topRightCorner<kColumns, 1>() = sums.g;
    A.bottomLeftCorner<1, kColumns>() = sums.g.transpose();
    A(kColumns, kColumns) = sums.cost;
    // Columns to length one first: their sizes differ by many orders.
    Eigen::Matrix<double, n, 1> scale;
    for (int i = 0; i < n; ++i) scale[i] = A(i, i) > 0 ? std::sqrt(A(i, i)) : 0;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j)
        A(i, j) = scale[i] > 0 && scale[j] > 0 ? A(i, j) / (scale[i] * scale[j]) : 0;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, n, n>> eigen(A);
    const Eigen::Matrix<double, n, n> root =
        eigen.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal() *
        eigen.eigenvectors().transpose() * scale.asDiagonal();
    r = root.col(kColumns);
    using SharedColumns = Eigen::Matrix<double, n, kShared, Eigen::RowMajor>;
    using OwnColumns = Eigen::Matrix<double, n, kOwn, Eigen::RowMajor>;
    if (double* J = jacobians[0]) Eigen::Map<SharedColumns>{J} = root.leftCols<kShared>();
    if (double* J = jacobians[1]) Eigen::Map<OwnColumns>{J} = root.middleCols<kOwn>(kShared);
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

// Minimises from `state` on; the cost in the end.
double minimise(const Recordings& recordings, const std::vector<Chunk>& chunks, const FreeSet& free,
                const FitOptions& o, std::size_t stride, ModelState& state) {
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
  for (const Chunk& c : chunks) {
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

// --- The linear problem
// --------------------------------------------------------------------------- With delay and
// rotation held, u and w enter linearly: J at u = w = 1 is the basis itself.
struct Linear {
  Eigen::VectorXd x;  // u, w, bias, ...: in the order of the free set
  Eigen::MatrixXd H;
  double cost = 0;
};

Linear solve_linear(const Recordings& recordings, const std::vector<Chunk>& chunks,
                    const FreeSet& free, ModelState state, std::size_t stride, int passes) {
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
    FreeSums total(free.size);
    linear.cost = 0;
    for (std::size_t i = 0; i < chunks.size(); ++i) {
      total.add(sums[i], free, static_cast<std::size_t>(chunks[i].recording));
      linear.cost += sums[i].cost;
    }
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

// The free parameters for a state's modes and what is asked for.
struct Asked {
  bool bias, drift, delay, rotation, weight;
  bool lowpass = false;
};
FreeSet free_set(const ModelState& state, std::size_t recordings, const Asked& asked) {
  FreeSet free(recordings);
  for (int k = 0; k < kTissueCount; ++k) {
    if (state.mode[k] == TissueMode::kFree) free.free_shared(2 * k);
    if (state.mode[k] == TissueMode::kFree || state.mode[k] == TissueMode::kTied)
      free.free_shared(2 * k + 1);
  }
  if (asked.delay) free.free_shared(kDelay);
  if (asked.lowpass) free.free_shared(kLowpass);
  for (int i = 0; i < 3; ++i) {
    if (asked.rotation) free.free_shared(kRotation + i);
    if (asked.weight) free.free_shared(kWeight + i);
  }
  for (std::size_t r = 0; r < recordings; ++r)
    for (int i = 0; i < 3; ++i) {
      if (asked.bias) free.free_own(r, i);
      if (asked.drift) free.free_own(r, i + 3);
    }
  return free;
}

Mat3 rotation_matrix(const Vec3& vector) {
  const double angle = vector.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix()
                   : Mat3(Mat3::Identity());
}

std::vector<Mat3> trial_rotations(const Vec3& given) {
  const Mat3 base = rotation_matrix(given);
  std::vector<Mat3> all = {base};
  for (int axis = 0; axis < 3; ++axis)
    for (const double angle : {-0.5, 0.5})
      all.push_back(base * Eigen::AngleAxisd(angle, Vec3::Unit(axis)).toRotationMatrix());
  for (int a = 0; a < 3; ++a)  // a sensor that was mounted with other axes
    for (int b = 0; b < 3; ++b)
      for (const int signs : {0, 1, 2, 3}) {
        if (a == b) continue;
        Mat3 m;
        m.col(0) = Vec3::Unit(a) * (signs & 1 ? -1 : 1);
        m.col(1) = Vec3::Unit(b) * (signs & 2 ? -1 : 1);
        m.col(2) = m.col(0).cross(m.col(1));
        all.push_back(base * m);
      }
  return all;
}

Vec3 rotation_vector(const Mat3& m) {
  const Eigen::AngleAxisd turn(m);
  return turn.angle() * turn.axis();
}

// Squared length of the weighted columns of tissue k, tangential and normal, with u = w = 1.
struct ColumnSizes {
  double tangential = 0, normal = 0;
};

// --- The whole fit, stage by stage
// ----------------------------------------------------------------
class Fitter {
 public:
  Fitter(const Recordings& recordings, const FitOptions& options)
      : recordings_(recordings), o_(options) {
    asked_ = {!o_.bias.has_value(), o_.estimate_drift,  o_.estimate_delay,
              o_.estimate_rotation, o_.estimate_weight, o_.estimate_lowpass};
  }

  FitResult run() {
    prepare();
    first_guess();
    choose_modes();
    search();
    settle_noise();
    polish();
    block_length();
    uncertainty();
    describe_tissues();
    residuals();
    if (o_.diagnose) {
      validation();
      suspicions();
      adequacy();
    }
    result_.lowpass.value = lowpass_ + state_.shared[kLowpass];
    state_.shared[kLowpass] = 0;
    result_.state = state_;
    return std::move(result_);
  }

 private:
  void prepare();
  void first_guess();
  void choose_modes();
  void search();
  void settle_noise();
  void polish();
  void block_length();
  void uncertainty();
  void describe_tissues();
  void residuals();
  void validation();
  void suspicions();
  void adequacy();

  FreeSet free() const {
    Asked now = asked_;
    now.lowpass = now.lowpass && !no_lowpass_;
    return free_set(state_, recordings_.size(), now);
  }
  void set_linear(const Linear& linear, const FreeSet& set);
  void check_weight();
  void filter_at(double time_constant);
  double minimise_from(ModelState& state, const FreeSet& set, std::size_t stride) const {
    return minimise(recordings_, chunks_, set, o_, stride, state);
  }
  // What a tissue becomes that isn't fitted: absent, or held where the replay was linearised.
  TissueMode aside() const { return linearised_ ? TissueMode::kHeld : TissueMode::kOff; }
  ColumnSizes column_sizes(int k) const;

  Recordings recordings_;  // with sigma
  FitOptions o_;
  Asked asked_{};
  ModelState state_;
  FitResult result_;
  std::vector<Chunk> chunks_;
  std::vector<std::vector<char>> contact_;  // per recording and sample
  std::size_t stride_ = 1;
  bool linearised_ = false;
  double lowpass_ = 0;       // s, of the recordings' filters
  bool no_lowpass_ = false;  // the search ended below zero: held there
  double force_rms_ = 0;     // N, measured, about its median
  Eigen::MatrixXd steps_;    // of the bootstrap, free parameters x replicates
  Eigen::VectorXd std_;      // of the free parameters
  PerTissue<std::size_t> tissue_blocks_{};
};

void Fitter::prepare() {
  if (recordings_.empty()) throw Error("no recording to calibrate with");
  if (o_.estimate_weight && !o_.on_handpiece)
    throw Error(
        "the handpiece's weight can't be told from the sensor's bias unless the sensor turns with "
        "the handpiece: give --sensor-on handpiece, or leave the weight to the bias");
  std::size_t samples = 0;
  bool touched = false;
  double square = 0;
  result_.rotation_rate = recordings_.front().basis->rotation_rate;
  for (const ComparedRecording& r : recordings_)
    result_.speed_recorded = result_.speed_recorded || r.basis->speed_recorded;
  for (ComparedRecording& r : recordings_) {
    if (r.time.size() < 20) throw Error(r.name + ": fewer than 20 usable samples");
    if (r.basis->rotation_rate != result_.rotation_rate)
      throw Error(r.name + ": another rotation rate than the first recording's");
    samples += r.time.size();
    contact_.push_back(in_contact(r, o_.largest_delay));
    for (int k = 0; k < kTissueCount; ++k) {
      touched = touched || r.basis->touched(k);
      result_.tissue[k].touched += r.basis->tissue[k].touched;
      result_.tissue[k].removed += r.basis->tissue[k].removed;
    }
    Vec3 centre;
    for (int a = 0; a < 3; ++a) {
      std::vector<double> axis;
      axis.reserve(r.force.size());
      for (const Vec3& f : r.force) axis.push_back(f[a]);
      centre[a] = median(std::move(axis));
    }
    for (const Vec3& f : r.force) square += (f - centre).squaredNorm();
  }
  if (!touched)
    throw Error(recordings_.front().name +
                ": the bur never touches the tooth along this motion; check that tooth, bur and "
                "motion are in the same frame (mm)");
  force_rms_ = std::sqrt(square / static_cast<double>(samples));
  stride_ = std::max<std::size_t>(
      1, static_cast<std::size_t>(std::ceil(static_cast<double>(samples) / kSubset)));
  double duration = 0;
  for (const ComparedRecording& r : recordings_) duration += r.time.back() - r.time.front();
  chunks_ = chunks_of(recordings_, duration / kFirstChunks);
  linearised_ = recordings_.front().basis->offset.cols() > 0;
  lowpass_ = o_.lowpass_hz > 0 ? 1 / (2 * units::kPi * o_.lowpass_hz) : 0;
  check_weight();

  state_.loss = o_.loss;
  state_.shared[kDelay] = o_.delay;
  state_.shared.segment<3>(kRotation) = o_.rotation;
  state_.shared.segment<3>(kWeight) = o_.weight;
  state_.own.resize(recordings_.size());
  result_.recordings.resize(recordings_.size());
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    state_.own[r].head<3>() = o_.bias.value_or(Vec3::Zero());
    state_.own[r].tail<3>() = o_.drift;
    const double quiet = quiet_noise(recordings_[r], contact_[r]);
    result_.recordings[r].name = recordings_[r].name;
    result_.recordings[r].samples = recordings_[r].time.size();
    result_.recordings[r].stalled = recordings_[r].stalled;
    result_.recordings[r].quiet_noise = quiet;
    double sigma = o_.noise.value_or(std::isfinite(quiet) ? quiet : 0.05 * force_rms_);
    recordings_[r].sigma = std::max(sigma, 1e-6 * force_rms_);
  }
  for (int k = 0; k < kTissueCount; ++k) {
    state_.tied_ratio[k] = o_.start[k].force_ratio;
    state_.mode[k] = result_.tissue[k].touched > 0 ? TissueMode::kFree : aside();
    const double u = std::max(o_.start[k].specific_energy, 1e-3);
    state_.shared[2 * k] = std::log(u);
    state_.shared[2 * k + 1] = std::log(u / o_.start[k].force_ratio);
    if (result_.tissue[k].touched > 0 && result_.tissue[k].touched < kLeastTouched)
      state_.mode[k] = TissueMode::kTied;
  }
}

// A weight that doesn't turn in the sensor's frame is a bias. What tells it from one is the turn of
// the sensor, about more than the weight's own axis.
void Fitter::check_weight() {
  if (!asked_.weight || !asked_.bias) return;
  Mat3 turn = Mat3::Zero();
  double samples = 0;
  for (const ComparedRecording& r : recordings_) {
    Mat3 mean = Mat3::Zero();
    const auto n = static_cast<double>(r.frame.size());
    for (const Quat& q : r.frame) mean += q.conjugate().toRotationMatrix() / n;
    for (const Quat& q : r.frame) {
      const Mat3 d = q.conjugate().toRotationMatrix() - mean;
      turn += d.transpose() * d;
    }
    samples += n;
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(turn / samples);
  const double least = units::from_degree(kLeastTurn);
  if (eigen.eigenvalues()[0] > least * least) return;
  const Vec3 axis = eigen.eigenvectors().col(0);
  result_.weight_why_not =
      eigen.eigenvalues()[2] > least * least
          ? fmt::format(
                "the handpiece turned about ({:.2f}, {:.2f}, {:.2f}) only, and its weight along "
                "that axis can't be told from the sensor's bias: turn it about another axis too",
                axis.x(), axis.y(), axis.z())
          : fmt::format(
                "the bur never turned ({:.1f} degrees rms), so the handpiece's weight can't be "
                "told from the sensor's bias: turn it by some 20 degrees, or give the bias or the "
                "weight",
                units::to_degree(std::sqrt(std::max(0.0, eigen.eigenvalues()[2]))));
  result_.warnings.push_back("handpiece weight not identifiable: " + result_.weight_why_not);
  asked_.weight = false;
}

void Fitter::filter_at(double time_constant) {
  lowpass_ = std::clamp(time_constant, 0.0, o_.largest_lowpass);
  state_.shared[kLowpass] = 0;
  tbb::parallel_for(std::size_t{0}, recordings_.size(),
                    [&](std::size_t r) { set_lowpass(recordings_[r], lowpass_, asked_.lowpass); });
}

void Fitter::set_linear(const Linear& linear, const FreeSet& set) {
  for (int k = 0; k < kTissueCount; ++k)
    for (const int i : {2 * k, 2 * k + 1}) {
      const int p = set.shared[static_cast<std::size_t>(i)];
      const double start = i == 2 * k ? o_.start[k].specific_energy
                                      : o_.start[k].specific_energy / o_.start[k].force_ratio;
      if (p >= 0)
        state_.shared[i] = std::log(linear.x[p] > 0 ? linear.x[p] : std::max(start, 1e-3));
    }
  for (int i = 0; i < 3; ++i)
    if (const int p = set.shared[static_cast<std::size_t>(kWeight + i)]; p >= 0)
      state_.shared[kWeight + i] += linear.x[p];
  for (std::size_t r = 0; r < recordings_.size(); ++r)
    for (int i = 0; i < kOwn; ++i)
      if (const int p = set.own[r][static_cast<std::size_t>(i)]; p >= 0)
        state_.own[r][i] += linear.x[p];
}

// Delay and rotation by trial, everything else linear.
void Fitter::first_guess() {
  const FreeSet set = free_set(state_, recordings_.size(),
                               {asked_.bias, asked_.drift, false, false, asked_.weight});
  const std::size_t coarse = stride_ * 3;
  const auto cost_of = [&](const ModelState& state, bool positive) {
    const Linear linear = solve_linear(recordings_, chunks_, set, state, coarse, 3);
    return positive && !all_positive(linear, set) ? std::numeric_limits<double>::infinity()
                                                  : linear.cost;
  };
  const auto best_delay = [&](double low, double high, double step) {
    ModelState trial = state_;
    double best = std::numeric_limits<double>::infinity(), at = state_.shared[kDelay];
    for (double tau = low; tau <= high + 1e-12; tau += step) {
      trial.shared[kDelay] = std::clamp(tau, -o_.largest_delay, o_.largest_delay);
      const double cost = cost_of(trial, false);
      if (cost < best) best = cost, at = trial.shared[kDelay];
    }
    state_.shared[kDelay] = at;
  };
  if (asked_.rotation) {
    ModelState trial = state_;
    double best = std::numeric_limits<double>::infinity();
    for (const Mat3& m : trial_rotations(o_.rotation)) {
      trial.shared.segment<3>(kRotation) = rotation_vector(m);
      const double cost = cost_of(trial, true);
      if (cost < best) {
        best = cost;
        state_.shared.segment<3>(kRotation) = rotation_vector(m);
      }
    }
  }
  const auto find_delay = [&] {
    best_delay(-o_.largest_delay, o_.largest_delay, o_.largest_delay / 10);
    const double centre = state_.shared[kDelay], step = o_.largest_delay / 50;
    best_delay(centre - 5 * step, centre + 5 * step, step);
  };
  if (asked_.lowpass) {
    // By profile: at each time constant the delay that suits it best.
    double best = std::numeric_limits<double>::infinity(), at = 0, delay = o_.delay;
    for (double tau = 0; tau <= o_.largest_lowpass; tau = tau == 0 ? 5e-4 : 2 * tau) {
      filter_at(tau);
      if (asked_.delay) find_delay();
      const double cost = cost_of(state_, false);
      if (cost < best) best = cost, at = tau, delay = state_.shared[kDelay];
    }
    filter_at(at);
    state_.shared[kDelay] = delay;
  } else if (asked_.delay) {
    find_delay();
  }
  if (asked_.rotation) {
    // Before anything is judged, the rotation has to be right.
    const FreeSet all = free();
    set_linear(solve_linear(recordings_, chunks_, set, state_, stride_, 4), set);
    minimise_from(state_, all, stride_);
  }
}

ColumnSizes Fitter::column_sizes(int k) const {
  ColumnSizes sizes;
  for (const ComparedRecording& r : recordings_)
    if (r.basis->touched(k)) {
      sizes.tangential += r.columns(k).topRows<3>().squaredNorm();
      sizes.normal += r.columns(k).bottomRows<3>().squaredNorm();
    }
  return sizes;
}

// What the recordings tell, from the weighted basis: relative standard deviations that a sensor of
// realistic noise would leave, one tissue parameter after another.
void Fitter::choose_modes() {
  // Correlated noise counts as fewer samples: a sensor's noise is taken as white up to 100 Hz.
  double samples = 0, duration = 0;
  for (const ComparedRecording& r : recordings_) {
    samples += static_cast<double>(r.time.size());
    duration += r.time.back() - r.time.front();
  }
  const double crowd = std::max(1.0, samples / std::max(duration * 200, 1.0));
  for (int k = 0; k < kTissueCount; ++k) {
    TissueFit& t = result_.tissue[k];
    if (t.touched == 0)
      t.why_not = "never touched";
    else if (state_.mode[k] == TissueMode::kTied)
      t.why_not = fmt::format("touched for only {:.3f} s", t.touched);
  }
  for (int pass = 0; pass <= 2 * kTissueCount; ++pass) {
    // With everything free that will be, so that what the delay or a rotation could explain isn't
    // counted as known.
    const FreeSet linear_set = free_set(state_, recordings_.size(),
                                        {asked_.bias, asked_.drift, false, false, asked_.weight});
    const Linear linear = solve_linear(recordings_, chunks_, linear_set, state_, stride_, 5);
    ModelState here = state_;
    for (int i = 0; i < kDelay; ++i)
      if (const int p = linear_set.shared[static_cast<std::size_t>(i)]; p >= 0)
        here.shared[i] = std::log(std::max(std::abs(linear.x[p]), 1e-12));
    const FreeSet set = free();
    ModelState plain = here;
    plain.loss = RobustLoss::kNone;
    const auto sums = normal_sums(recordings_, chunks_, plain, Weighting::kWeights, stride_);
    FreeSums total(set.size);
    for (std::size_t i = 0; i < chunks_.size(); ++i)
      total.add(sums[i], set, static_cast<std::size_t>(chunks_[i].recording));
    Eigen::VectorXd scale = total.H.diagonal();
    for (double& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
    const Eigen::MatrixXd A = scale.asDiagonal() * total.H * scale.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(A);
    result_.singular_values.clear();
    for (Eigen::Index i = eigen.eigenvalues().size(); i-- > 0;)
      result_.singular_values.push_back(std::sqrt(std::max(0.0, eigen.eigenvalues()[i])));
    // Inverse with a floor, so that what isn't determined at all has a huge deviation.
    const Eigen::VectorXd inverse = eigen.eigenvalues().cwiseMax(1e-12).cwiseInverse();
    const double sigma = recordings_.front().sigma;
    const double noise = std::max(sigma, kAssumedNoise * force_rms_) / sigma *
                         std::sqrt(crowd * static_cast<double>(stride_));
    const auto deviation = [&](int column) {
      const int p = set.shared[static_cast<std::size_t>(column)];
      const int q = linear_set.shared[static_cast<std::size_t>(column)];
      if (p < 0) return 0.0;
      if (!(linear.x[q] > 0)) return 9.99;
      const Eigen::VectorXd row = eigen.eigenvectors().row(p);
      return scale[p] == 0 ? 9.99 : noise * scale[p] * std::sqrt(row.cwiseAbs2().dot(inverse));
    };
    // The worst parameter goes first; what it did to the others shows in the next pass.
    // One that is merely uncertain stays free, so that it doesn't pull the others; the uncertainty
    // in the end says what is reported.
    int worst = -1;
    double most = 0;
    for (int i = 0; i < kDelay; ++i) {
      const double d = deviation(i);
      if (d == 0 || (i % 2 == 1 && deviation(i - 1) > 0)) continue;
      const ColumnSizes size = column_sizes(i / 2);
      const bool cancels = i % 2 == 0 && size.tangential < kSmallPart * size.normal;
      if (d > (cancels ? kWorstStd / 5 : kUseless) && d > most) most = d, worst = i;
    }
    if (worst < 0) break;
    const int k = worst / 2;
    TissueFit& t = result_.tissue[k];
    const ColumnSizes size = column_sizes(k);
    if (worst % 2 == 0) {
      state_.mode[k] = TissueMode::kTied;
      if (size.tangential < kSmallPart * size.normal)
        t.why_not = fmt::format(
            "only plunge: the tangential forces around the bur cancel ({:.1f} % of the normal "
            "part), so u and alpha can't be separated; feed sideways too",
            100 * std::sqrt(size.tangential / size.normal));
      else if (asked_.rotation)
        t.why_not =
            "u and alpha can't be separated from the sensor's rotation: feed sideways and plunge, "
            "or give the rotation";
      else
        t.why_not = fmt::format(
            "too little excitation to separate u and alpha (u to about {:.0f} %; touched {:.2f} s)",
            100 * std::min(most, 9.99), t.touched);
    } else {
      // Little force altogether. It stays in the model if it makes any.
      const auto part = here.shared[worst];
      const double share = std::exp(2 * part) * size.normal;
      double all = 0;
      for (const ComparedRecording& r : recordings_)
        all += force_rms_ * force_rms_ * static_cast<double>(r.basis->size);
      if (t.why_not.empty() || t.touched >= kLeastTouched)
        t.why_not =
            fmt::format("too little excitation (touched {:.2f} s; u/alpha to about {:.0f} %)",
                        t.touched, 100 * std::min(most, 9.99));
      if (share < kLeastShare * all || most >= 9.99) {
        state_.mode[k] = aside();
        state_.shared[2 * k] = std::log(std::max(o_.start[k].specific_energy, 1e-3));
        state_.shared[2 * k + 1] = state_.shared[2 * k] - std::log(o_.start[k].force_ratio);
      } else {
        break;  // modelled, not reported
      }
    }
  }
  bool any = false;
  for (int k = 0; k < kTissueCount; ++k) any = any || state_.mode[k] != aside();
  if (!any) {
    std::string why;
    for (int k = 0; k < kTissueCount; ++k)
      if (result_.tissue[k].touched > 0)
        why += (why.empty() ? "" : "; ") + std::string(kTissueNames[k]) + ": " +
               result_.tissue[k].why_not;
    throw Error("no parameter can be told from these recordings (" + why + ")");
  }
}

void Fitter::search() {
  const FreeSet set = free();
  const FreeSet linear_set = free_set(state_, recordings_.size(),
                                      {asked_.bias, asked_.drift, false, false, asked_.weight});
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    if (asked_.bias) state_.own[r].head<3>().setZero();
    if (asked_.drift) state_.own[r].tail<3>() = o_.drift;
  }
  if (asked_.weight) state_.shared.segment<3>(kWeight) = o_.weight;
  const ModelState begin = state_;
  std::vector<ModelState> ends;
  std::vector<double> costs;
  for (const double factor : {0.0, 1.0, 10.0, 0.1}) {
    state_ = begin;
    if (factor == 0) {
      set_linear(solve_linear(recordings_, chunks_, linear_set, state_, stride_, 5), linear_set);
    } else {
      for (int k = 0; k < kTissueCount; ++k) {
        if (state_.mode[k] == TissueMode::kHeld) continue;
        const double u = std::max(factor * o_.start[k].specific_energy, 1e-3);
        state_.shared[2 * k] = std::log(u);
        state_.shared[2 * k + 1] = std::log(u / o_.start[k].force_ratio);
      }
    }
    costs.push_back(minimise_from(state_, set, stride_));
    ends.push_back(state_);
  }
  const auto best =
      static_cast<std::size_t>(std::min_element(costs.begin(), costs.end()) - costs.begin());
  state_ = ends[best];
  for (const ModelState& end : ends)
    for (int i = 0; i < kDelay; ++i)
      if (set.shared[static_cast<std::size_t>(i)] >= 0)
        result_.start_spread =
            std::max(result_.start_spread, std::abs(std::expm1(end.shared[i] - state_.shared[i])));
}

// The residuals' own size in contact, where it isn't given: it holds what noise and model together
// leave.
void Fitter::settle_noise() {
  for (int round = 0; round < 2; ++round) {
    for (std::size_t r = 0; r < recordings_.size(); ++r) {
      const auto modelled = modelled_force(recordings_[r], state_.own[r], state_);
      std::vector<double> residual;
      for (std::size_t j = 0; j < modelled.size(); ++j)
        if (contact_[r][j])
          for (int a = 0; a < 3; ++a)
            residual.push_back(modelled[j][a] - recordings_[r].force[j][a]);
      if (residual.size() < kQuietSamples) continue;
      recordings_[r].sigma =
          std::max(o_.noise ? std::max(*o_.noise, robust_scale(residual)) : robust_scale(residual),
                   1e-6 * force_rms_);
    }
    // The filter is linear about its time constant only; below zero there is none.
    for (int pass = 0; asked_.lowpass && !no_lowpass_ && pass < 2; ++pass) {
      no_lowpass_ = lowpass_ + state_.shared[kLowpass] <= 0;
      filter_at(lowpass_ + state_.shared[kLowpass]);
      minimise_from(state_, free(), stride_);
    }
    if (asked_.lowpass && !no_lowpass_) filter_at(lowpass_ + state_.shared[kLowpass]);
    minimise_from(state_, free(), round == 0 ? stride_ : 1);
  }
  for (std::size_t r = 0; r < recordings_.size(); ++r)
    result_.recordings[r].noise = recordings_[r].sigma;
}

// Newton steps to the exact zero of the gradient, which the uncertainty is taken at.
void Fitter::polish() {
  const FreeSet set = free();
  for (int pass = 0; pass < 3; ++pass) {
    if (asked_.lowpass && !no_lowpass_) filter_at(lowpass_ + state_.shared[kLowpass]);
    const auto sums = normal_sums(recordings_, chunks_, state_, Weighting::kWeights);
    FreeSums total(set.size);
    for (std::size_t i = 0; i < chunks_.size(); ++i)
      total.add(sums[i], set, static_cast<std::size_t>(chunks_[i].recording));
    const Eigen::VectorXd step = -solve_scaled(total.H, total.g);
    for (int i = 0; i < kShared; ++i)
      if (const int p = set.shared[static_cast<std::size_t>(i)]; p >= 0)
        state_.shared[i] += std::clamp(step[p], -0.01, 0.01);
    for (std::size_t r = 0; r < recordings_.size(); ++r)
      for (int i = 0; i < kOwn; ++i)
        if (const int p = set.own[r][static_cast<std::size_t>(i)]; p >= 0)
          state_.own[r][i] += step[p];
  }
  state_.shared[kDelay] = std::clamp(state_.shared[kDelay], -o_.largest_delay, o_.largest_delay);
  state_.shared[kLowpass] = std::max(state_.shared[kLowpass], -lowpass_);
}

void Fitter::block_length() {
  double longest = 0, duration = 0, step = 0;
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    const ComparedRecording& rec = recordings_[r];
    const auto modelled = modelled_force(rec, state_.own[r], state_);
    const double span = rec.time.back() - rec.time.front();
    duration += span;
    step = std::max(step, span / static_cast<double>(rec.time.size() - 1));
    for (int a = 0; a < 3; ++a) {
      std::vector<double> residual;
      residual.reserve(modelled.size());
      for (std::size_t j = 0; j < modelled.size(); ++j)
        if (contact_[r][j]) residual.push_back(modelled[j][a] - rec.force[j][a]);
      longest = std::max(
          longest, correlation_time(residual, span / static_cast<double>(rec.time.size() - 1)));
    }
  }
  result_.correlation_time = longest;
  result_.block =
      o_.block > 0 ? o_.block : std::min(std::max(10 * longest, 20 * step), duration / 40);
  chunks_ = chunks_of(recordings_, result_.block);
  result_.blocks = chunks_.size();
  for (int k = 0; k < kTissueCount; ++k)
    for (const Chunk& c : chunks_) {
      const ComparedRecording& rec = recordings_[static_cast<std::size_t>(c.recording)];
      if (!rec.basis->touched(k)) continue;
      const auto first = static_cast<Eigen::Index>(basis_index(rec, c.begin, 0));
      const auto last = static_cast<Eigen::Index>(basis_index(rec, c.end - 1, 0));
      tissue_blocks_[k] +=
          rec.columns(k).middleCols(first, last - first + 1).cwiseAbs().maxCoeff() > 0;
    }
}

// Residuals are smaller than the noise by what the parameters took up: a tissue's own two and about
// as many of the sensor's.
double inflation(std::size_t blocks, int parameters) {
  const auto n = static_cast<double>(blocks);
  return n > parameters + 1 ? std::sqrt(n / (n - parameters)) : 3;
}

void Fitter::uncertainty() {
  no_lowpass_ = false;  // how far from zero it might be is wanted all the same
  const FreeSet set = free();
  const auto sums = normal_sums(recordings_, chunks_, state_, Weighting::kSlope);
  steps_ = block_bootstrap(sums, chunks_, set, o_.bootstrap, o_.seed);
  std_ = (steps_.array().square().rowwise().mean()).sqrt();
  for (int i = 0; i < 3; ++i) {
    if (asked_.rotation)
      result_.rotation_std[i] = std_[set.shared[static_cast<std::size_t>(kRotation + i)]];
    if (asked_.weight)
      result_.weight_std[i] = std_[set.shared[static_cast<std::size_t>(kWeight + i)]];
    for (std::size_t r = 0; r < recordings_.size(); ++r) {
      const auto& own = set.own[r];
      if (asked_.bias) result_.recordings[r].bias_std[i] = std_[own[static_cast<std::size_t>(i)]];
      if (asked_.drift)
        result_.recordings[r].drift_std[i] = std_[own[static_cast<std::size_t>(i + 3)]];
    }
  }
  result_.rotation = state_.shared.segment<3>(kRotation);
  result_.weight = state_.shared.segment<3>(kWeight);
  Estimate& delay = result_.delay;
  delay.value = state_.shared[kDelay];
  delay.std = asked_.delay ? std_[set.shared[kDelay]] : 0;
  delay.low = delay.value - 1.96 * delay.std;
  delay.high = delay.value + 1.96 * delay.std;
  Estimate& lowpass = result_.lowpass;
  lowpass.value = lowpass_ + state_.shared[kLowpass];
  lowpass.std = asked_.lowpass ? std_[set.shared[kLowpass]] : 0;
  lowpass.low = std::max(0.0, lowpass.value - 1.96 * lowpass.std);
  lowpass.high = lowpass.value + 1.96 * lowpass.std;
  if (asked_.lowpass && asked_.delay) {
    const Eigen::VectorXd a = steps_.row(set.shared[kDelay]), b = steps_.row(set.shared[kLowpass]);
    result_.delay_lowpass_correlation = a.dot(b) / std::max(a.norm() * b.norm(), 1e-300);
    if (std::abs(result_.delay_lowpass_correlation) > kAlike)
      result_.warnings.push_back(fmt::format(
          "delay and low-pass look alike in these recordings (correlation {:.2f}): their sum, "
          "{:.2f} ms, is known better than either; sharp changes of the force tell them apart",
          result_.delay_lowpass_correlation, 1e3 * (delay.value + lowpass.value)));
  }
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    result_.recordings[r].bias = state_.own[r].head<3>();
    result_.recordings[r].drift = state_.own[r].tail<3>();
  }
}

void Fitter::describe_tissues() {
  const FreeSet set = free();
  const Eigen::Index replicates = steps_.cols();
  std::vector<Eigen::VectorXd> logs;  // changes of the logarithms of what is reported
  std::vector<double> values;
  const auto estimate = [&](double log_value, const Eigen::VectorXd& change, int k) {
    const double raw = std::sqrt(change.squaredNorm() / static_cast<double>(replicates));
    const double relative = raw * inflation(tissue_blocks_[k], 4);
    const double t = student_95(std::max(1.0, static_cast<double>(tissue_blocks_[k]) - 2));
    Estimate e;
    e.value = std::exp(log_value);
    e.std = e.value * relative;
    e.low = e.value * std::exp(-t * relative);
    e.high = e.value * std::exp(t * relative);
    return e;
  };
  for (int k = 0; k < kTissueCount; ++k) {
    TissueFit& t = result_.tissue[k];
    const int pu = set.shared[static_cast<std::size_t>(2 * k)];
    const int pw = set.shared[static_cast<std::size_t>(2 * k + 1)];
    if (pw < 0) continue;
    const Eigen::VectorXd w = steps_.row(pw);
    const double log_u = state_.shared[2 * k], log_w = state_.shared[2 * k + 1];
    const Estimate ratio = estimate(log_w, w, k);
    const bool little =
        t.why_not.rfind("too little excitation (", 0) == 0 || t.touched < kLeastTouched;
    if (ratio.std <= kWorstStd * ratio.value && !little) {
      t.ratio_identifiable = true;
      t.u_over_alpha = ratio;
    } else if (t.why_not.empty()) {
      t.why_not = fmt::format("too little excitation (u/alpha to {:.0f} % only)",
                              100 * ratio.std / ratio.value);
    }
    if (pu < 0) continue;
    const Eigen::VectorXd u = steps_.row(pu);
    const Estimate energy = estimate(log_u, u, k), alpha = estimate(log_u - log_w, u - w, k);
    if (!t.ratio_identifiable || energy.std > kWorstStd * energy.value ||
        std::abs(log_u) >= kLargestLog) {
      if (t.why_not.empty())
        t.why_not =
            fmt::format("too little excitation to separate u and alpha (u to {:.0f} % only)",
                        100 * energy.std / energy.value);
      continue;
    }
    t.identifiable = true;
    t.u = energy;
    t.alpha = alpha;
    const std::string name(kTissueNames[k]);
    result_.names.push_back(name + ".u");
    logs.push_back(u);
    values.push_back(log_u);
    result_.names.push_back(name + ".alpha");
    logs.push_back(u - w);
    values.push_back(log_u - log_w);
  }
  const auto n = static_cast<Eigen::Index>(logs.size());
  result_.correlation = Eigen::MatrixXd::Identity(n, n);
  result_.draws.resize(n, replicates);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& a = logs[static_cast<std::size_t>(i)];
    result_.draws.row(i) = (a.array() + values[static_cast<std::size_t>(i)]).exp().transpose();
    for (Eigen::Index j = 0; j < n; ++j) {
      const auto& b = logs[static_cast<std::size_t>(j)];
      if (i != j) result_.correlation(i, j) = a.dot(b) / std::max(a.norm() * b.norm(), 1e-300);
    }
  }
}

// Samples far out are counted and then left aside: a handful of them would drown the rest.
void Fitter::residuals() {
  double square = 0, spread = 0, samples = 0, all = 0;
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    const ComparedRecording& rec = recordings_[r];
    const auto modelled = modelled_force(rec, state_.own[r], state_);
    const double limit = kOutlierSigmas * rec.sigma;
    std::vector<char> good(modelled.size());
    Vec3 mean = Vec3::Zero();
    double own = 0, count = 0;
    for (std::size_t j = 0; j < modelled.size(); ++j) {
      const Vec3 residual = modelled[j] - rec.force[j];
      good[j] = residual.cwiseAbs().maxCoeff() <= limit;
      if (!good[j]) continue;
      own += residual.squaredNorm();
      mean += rec.force[j];
      ++count;
    }
    mean /= std::max(count, 1.0);
    for (std::size_t j = 0; j < modelled.size(); ++j)
      if (good[j]) spread += (rec.force[j] - mean).squaredNorm();
    result_.recordings[r].residual_rms = std::sqrt(own / std::max(count, 1.0));
    square += own;
    samples += count;
    all += static_cast<double>(modelled.size());
  }
  result_.residual_rms = std::sqrt(square / std::max(samples, 1.0));
  result_.residual_r2 = spread > 0 ? 1 - square / spread : 0;
  result_.outlier_share = 1 - samples / all;
}

// Each recording, or each part of the time of a single one, predicted from the others: the fit
// without it by one step of Gauss and Newton.
void Fitter::validation() {
  const FreeSet set = free();
  const auto sums = normal_sums(recordings_, chunks_, state_, Weighting::kInliers);
  const bool by_recording = recordings_.size() > 1;
  const std::size_t folds =
      by_recording
          ? recordings_.size()
          : std::min<std::size_t>(static_cast<std::size_t>(std::max(o_.folds, 2)), chunks_.size());
  result_.validation = by_recording ? "leave one recording out"
                                    : fmt::format("{} parts of time, each left out once", folds);
  const auto fold_of = [&](std::size_t chunk) {
    return by_recording ? static_cast<std::size_t>(chunks_[chunk].recording)
                        : chunk * folds / chunks_.size();
  };
  double square = 0, weight = 0;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    FreeSums rest(set.size);
    for (std::size_t i = 0; i < chunks_.size(); ++i)
      if (fold_of(i) != fold)
        rest.add(sums[i], set, static_cast<std::size_t>(chunks_[i].recording));
    Eigen::VectorXd step = -solve_scaled(rest.H, rest.g);
    if (by_recording && (asked_.bias || asked_.drift)) {
      // A recording's bias is its own: it is taken from the recording that is left out.
      FreeSums own(set.size);
      for (std::size_t i = 0; i < chunks_.size(); ++i)
        if (fold_of(i) == fold)
          own.add(sums[i], set, static_cast<std::size_t>(chunks_[i].recording));
      std::vector<int> places;
      for (const int p : set.own[fold])
        if (p >= 0) places.push_back(p);
      const auto n = static_cast<Eigen::Index>(places.size());
      for (const int p : places) step[p] = 0;
      const Eigen::VectorXd gradient = own.g + own.H * step;
      Eigen::MatrixXd H(n, n);
      Eigen::VectorXd g(n);
      for (Eigen::Index a = 0; a < n; ++a) {
        g[a] = gradient[places[static_cast<std::size_t>(a)]];
        for (Eigen::Index b = 0; b < n; ++b)
          H(a, b) = own.H(places[static_cast<std::size_t>(a)], places[static_cast<std::size_t>(b)]);
      }
      const Eigen::VectorXd bias = -solve_scaled(H, g);
      for (Eigen::Index a = 0; a < n; ++a) step[places[static_cast<std::size_t>(a)]] = bias[a];
    }
    double own_square = 0, own_weight = 0;
    for (std::size_t i = 0; i < chunks_.size(); ++i) {
      if (fold_of(i) != fold) continue;
      const auto r = static_cast<std::size_t>(chunks_[i].recording);
      Eigen::Matrix<double, kColumns, 1> local = Eigen::Matrix<double, kColumns, 1>::Zero();
      for (int a = 0; a < kColumns; ++a)
        if (const int p = set.place(r, a); p >= 0) local[a] = step[p];
      const double sigma = recordings_[r].sigma;
      own_square +=
          sigma * sigma *
          std::max(0.0, sums[i].cost + 2 * sums[i].g.dot(local) + local.dot(sums[i].H * local));
      own_weight += sums[i].weight;
    }
    if (by_recording)
      result_.recordings[fold].validation_rms =
          std::sqrt(3 * own_square / std::max(own_weight, 1.0));
    square += own_square;
    weight += own_weight;
  }
  result_.validation_rms = std::sqrt(3 * square / std::max(weight, 1.0));
}

// What wasn't asked for but shows in the residuals: one step towards a rotated sensor or a delay.
void Fitter::suspicions() {
  const double scatter = [&] {
    double most = 0;
    for (std::size_t r = 0; r < recordings_.size(); ++r)
      if (result_.recordings[r].quiet_noise > 1e-3 * force_rms_)
        most = std::max(most, recordings_[r].sigma / result_.recordings[r].quiet_noise);
    return most;
  }();
  // The fit once more with what wasn't asked for free as well: it is suspected where it leaves
  // clearly less.
  const auto cost_with = [&](const Asked& more, ModelState& trial) {
    trial = state_;
    return minimise_from(trial, free_set(trial, recordings_.size(), more), stride_);
  };
  constexpr double kClearly = 0.01;  // chance alone makes 0.1 %
  ModelState trial;
  const double cost = cost_with(asked_, trial);
  if (!asked_.rotation) {
    Asked more = asked_;
    more.rotation = true;
    const double rotated = cost_with(more, trial);
    const Mat3 turn = rotation_matrix(trial.shared.segment<3>(kRotation)) *
                      rotation_matrix(state_.shared.segment<3>(kRotation)).transpose();
    const Eigen::AngleAxisd by(turn);
    if (rotated < (1 - kClearly) * cost && units::to_degree(by.angle()) > 2)
      result_.warnings.push_back(fmt::format(
          "the residuals look like a sensor frame rotated by about {:.0f} degrees about ({:.2f}, "
          "{:.2f}, {:.2f}): check its mounting, or estimate it (--estimate rotation)",
          units::to_degree(by.angle()), by.axis().x(), by.axis().y(), by.axis().z()));
  }
  if (!asked_.delay) {
    // A delay shows at the steps of the force only, so that a descent doesn't find it: by trial.
    const std::size_t stride = std::max<std::size_t>(1, stride_ / 8);
    const auto cost_at = [&](double delay) {
      trial = state_;
      trial.shared[kDelay] = delay;
      trial.columns = {kShared};  // only the cost is wanted
      double sum = 0;
      for (const NormalSums& c :
           normal_sums(recordings_, chunks_, trial, Weighting::kSlope, stride))
        sum += c.cost / 2;
      return sum;
    };
    const double now = cost_at(state_.shared[kDelay]);
    double least = now, by = 0;
    for (int ms = -10; ms <= 10; ++ms) {
      const double delay = state_.shared[kDelay] + 1e-3 * ms;
      if (std::abs(delay) > o_.largest_delay) continue;
      if (const double c = cost_at(delay); c < least) least = c, by = 1e-3 * ms;
    }
    double samples = 0, duration = 0;
    for (const ComparedRecording& r : recordings_) {
      samples += static_cast<double>(r.time.size());
      duration += r.time.back() - r.time.front();
    }
    const double spacing = duration / samples * static_cast<double>(stride);
    if (now - least > 20 * std::max(1.0, result_.correlation_time / spacing))
      result_.warnings.push_back(
          fmt::format("the force seems {:.0f} ms {} the motion: estimate it (--estimate delay)",
                      1e3 * std::abs(by), by > 0 ? "behind" : "ahead of"));
  }
  if (scatter > 2)
    result_.warnings.push_back(
        fmt::format("the residuals in contact are {:.1f} times the sensor's noise without contact: "
                    "the model with constant u and alpha leaves something unexplained",
                    scatter));
  double shank = 0, overlap = 0;
  for (const ComparedRecording& r : recordings_) {
    shank += r.basis->shank_contact;
    overlap += r.basis->initial_overlap;
  }
  if (shank > 0)
    result_.warnings.push_back(
        fmt::format("the shank touched the tooth for {:.2f} s; its force is not modelled", shank));
  if (overlap > 0.01)
    result_.warnings.push_back(
        fmt::format("{:.3f} mm^3 of tissue lay inside the bur at the first sample: is the tooth as "
                    "it was before the recording, and in its frame?",
                    overlap));
  if (result_.residual_r2 < 0.5)
    result_.warnings.push_back(
        fmt::format("the model explains only {:.0f} % of the force's variance: check tooth, bur, "
                    "frames and sign of the force",
                    100 * std::max(0.0, result_.residual_r2)));
  if (result_.start_spread > 0.01)
    result_.warnings.push_back(
        fmt::format("the starts end {:.1f} % apart", 100 * result_.start_spread));
}

// Force per modelled force in parts of the samples: by removal rate, contact area, direction of
// feed and time.
void Fitter::adequacy() {
  struct Sample {
    double modelled, measured_along, by[4];
  };
  std::vector<Sample> samples;
  for (std::size_t r = 0; r < recordings_.size(); ++r) {
    const ComparedRecording& rec = recordings_[r];
    const auto all = modelled_force(rec, state_.own[r], state_);
    const auto contact = modelled_force(rec, state_.own[r], state_, true);
    for (std::size_t j = 0; j < all.size(); j += stride_) {
      const double size = contact[j].squaredNorm();
      const std::size_t i = basis_index(rec, j, state_.shared[kDelay]);
      if (!(rec.basis->removal[i] > 0) || !(size > 0)) continue;
      Vec3 residual = rec.force[j] - all[j];
      residual = residual.cwiseMax(-5 * rec.sigma).cwiseMin(5 * rec.sigma);
      samples.push_back(
          {size,
           size + contact[j].dot(residual),
           {rec.basis->removal[i], rec.basis->area[i],
            std::abs(static_cast<double>(rec.basis->axial[i])), rec.time[j] - rec.time.front()}});
    }
  }
  if (samples.size() < 100) return;
  const char* names[] = {"removal_rate_mm3_s", "contact_area_mm2", "axial_feed_cosine", "time_s"};
  const double crowd =
      std::max(1.0, result_.correlation_time * static_cast<double>(samples.size()) /
                        std::max(1e-9, static_cast<double>(result_.blocks) * result_.block));
  for (int v = 0; v < 4; ++v) {
    std::sort(samples.begin(), samples.end(),
              [v](const Sample& a, const Sample& b) { return a.by[v] < b.by[v]; });
    constexpr std::size_t kBins = 5;
    double total = 0;
    for (const Sample& s : samples) total += s.modelled;
    for (std::size_t bin = 0; bin < kBins; ++bin) {
      const std::size_t begin = bin * samples.size() / kBins,
                        end = (bin + 1) * samples.size() / kBins;
      AdequacyBin b;
      b.of = names[v];
      b.low = samples[begin].by[v];
      b.high = samples[end - 1].by[v];
      double size = 0, along = 0, scatter = 0;
      for (std::size_t i = begin; i < end; ++i) {
        size += samples[i].modelled;
        along += samples[i].measured_along;
      }
      if (size < 1e-3 * total) continue;  // hardly any force: its factor tells nothing
      b.factor = along / size;
      for (std::size_t i = begin; i < end; ++i) {
        const double rest = samples[i].measured_along - b.factor * samples[i].modelled;
        scatter += rest * rest;
      }
      b.std = std::sqrt(scatter * crowd) / size;
      if (std::abs(b.factor - 1) > std::max(0.05, 3 * b.std)) result_.constant_suffices = false;
      result_.adequacy.push_back(b);
    }
  }
}

}  // namespace

PerTissue<GrindingProperties> modelled_tissue(const FitResult& fit) {
  PerTissue<GrindingProperties> tissue;
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueMode mode = fit.state.mode[k];
    tissue[k] = {0, 1};
    if (mode == TissueMode::kOff) continue;
    const double w = std::exp(fit.state.shared[2 * k + 1]);
    const double u =
        mode == TissueMode::kTied ? fit.state.tied_ratio[k] * w : std::exp(fit.state.shared[2 * k]);
    tissue[k] = {u, u / w};
  }
  return tissue;
}

FitResult fit(const std::vector<ComparedRecording>& recordings, const FitOptions& options) {
  return Fitter(recordings, options).run();
}

}  // namespace toothprep
