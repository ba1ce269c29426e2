#include "toothprep/tools/calibrate/force_model.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/lowpass.h"

namespace toothprep {
namespace {

using SharedVector = Eigen::Matrix<double, kShared, 1>;
using OwnVector = Eigen::Matrix<double, kOwn, 1>;
using SampleJacobian = Eigen::Matrix<double, 3, kColumns>;

constexpr double kHuber = 1.345;   // 95 % efficient for normal noise
constexpr double kCauchy = 2.385;  // likewise

Mat3 rotation_of(const Vec3& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Mat3::Identity();
  return Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix();
}

// What doesn't change from sample to sample.
struct Constants {
  PerTissue<double> u{}, w{};
  Mat3 to_sensor;              // Q^T
  std::array<Mat3, 3> turned;  // d(Q^T)/d(rotation vector)
  Vec3 weight, bias, drift;
  double delay, lowpass;
  Eigen::Matrix<double, kMostShapes, 1> shape;

  Constants(const SharedVector& shared, const OwnVector& own, const ModelState& state) {
    for (int k = 0; k < kTissueCount; ++k) {
      if (state.mode[k] == TissueMode::kOff) continue;
      w[k] = std::exp(shared[2 * k + 1]);
      u[k] =
          state.mode[k] == TissueMode::kTied ? state.tied_ratio[k] * w[k] : std::exp(shared[2 * k]);
    }
    const Vec3 rotation = shared.segment<3>(kRotation);
    to_sensor = rotation_of(rotation).transpose();
    constexpr double kSmall = 1e-5;  // rad: central differences err by 1e-10
    for (int i = 0; i < 3; ++i)
      turned[i] = (rotation_of(rotation + kSmall * Vec3::Unit(i)) -
                   rotation_of(rotation - kSmall * Vec3::Unit(i)))
                      .transpose() /
                  (2 * kSmall);
    weight = shared.segment<3>(kWeight);
    bias = own.head<3>();
    drift = own.tail<3>();
    delay = shared[kDelay];
    lowpass = shared[kLowpass];
    shape = shared.segment<kMostShapes>(kShape);
  }
};

// The model at sample j; J, if given, is complete.
Vec3 model_at(const ComparedRecording& r, std::size_t j, const Constants& c,
              const ModelState& state, SampleJacobian* J, bool only_contact) {
  const ForceBasis& basis = *r.basis;
  const double place = std::clamp((r.time[j] - c.delay - basis.start) / basis.step, 0.0,
                                  static_cast<double>(basis.size - 1) - 1e-6);
  const auto i = static_cast<Eigen::Index>(place);
  const double f = place - static_cast<double>(i);

  const Mat3 nominal =
      r.frame.empty() ? Mat3(Mat3::Identity()) : Mat3(r.frame[j].conjugate().toRotationMatrix());
  const Mat3 rotation = c.to_sensor * nominal;
  Vec3 force = only_contact ? Vec3(Vec3::Zero()) : c.weight, change = Vec3::Zero();
  Vec3 by_lowpass = Vec3::Zero();
  const Eigen::Matrix3Xd& offset = r.offset();
  if (offset.cols() > 0) {
    const Vec3 low = offset.col(i), step = offset.col(i + 1) - low;
    force += low + f * step;
    change += step;
    if (r.offset_slope.cols() > 0) {
      const Vec3 slope = (1 - f) * r.offset_slope.col(i) + f * r.offset_slope.col(i + 1);
      force += c.lowpass * slope;
      by_lowpass += slope;
    }
  }
  if (J) J->middleCols<kMostShapes>(kShape).setZero();
  for (int s = 0; s < state.shapes; ++s) {
    const auto place_of = static_cast<std::size_t>(s);
    const Eigen::Matrix3Xd& columns = r.shape(place_of);
    if (columns.cols() == 0) continue;
    Vec3 low = columns.col(i);
    const Vec3 step = columns.col(i + 1) - low;
    if (const Eigen::Matrix3Xd& slopes = r.shape_slope[place_of]; slopes.cols() > 0) {
      const Vec3 slope = (1 - f) * slopes.col(i) + f * slopes.col(i + 1);
      low += c.lowpass * slope;
      by_lowpass += c.shape[s] * slope;
    }
    force += c.shape[s] * (low + f * step);
    change += c.shape[s] * step;
    if (J) J->col(kShape + s) = rotation * (low + f * step);
  }
  for (int k = 0; k < kTissueCount; ++k) {
    if (state.mode[k] == TissueMode::kOff || !basis.touched(k)) {
      if (J) J->middleCols<2>(2 * k).setZero();
      continue;
    }
    const auto& columns = r.columns(k);
    Eigen::Matrix<double, 6, 1> low = columns.col(i);
    const Eigen::Matrix<double, 6, 1> step = columns.col(i + 1) - low;
    if (r.slope[k].cols() > 0) {
      const Eigen::Matrix<double, 6, 1> slope =
          (1 - f) * r.slope[k].col(i) + f * r.slope[k].col(i + 1);
      low += c.lowpass * slope;
      by_lowpass += c.u[k] * slope.head<3>() + c.w[k] * slope.tail<3>();
    }
    const Vec3 t = c.u[k] * (low.head<3>() + f * step.head<3>());
    const Vec3 n = c.w[k] * (low.tail<3>() + f * step.tail<3>());
    force += t + n;
    if (!J) continue;
    change += c.u[k] * step.head<3>() + c.w[k] * step.tail<3>();
    if (state.mode[k] == TissueMode::kTied) {
      J->col(2 * k).setZero();
      J->col(2 * k + 1) = rotation * (t + n);
    } else {
      J->col(2 * k) = rotation * t;
      J->col(2 * k + 1) = rotation * n;
    }
  }
  const double since = r.time[j] - r.middle;
  if (J) {
    // The rotation's columns cost most, and are rarely wanted.
    const bool turns =
        state.columns.empty() ||
        std::find(state.columns.begin(), state.columns.end(), kRotation) != state.columns.end();
    J->col(kDelay) = rotation * change * (-1 / basis.step);
    for (int a = 0; a < 3; ++a)
      J->col(kRotation + a) = turns ? Vec3(c.turned[a] * (nominal * force)) : Vec3(Vec3::Zero());
    J->middleCols<3>(kWeight) = rotation;
    J->col(kLowpass) = rotation * by_lowpass;
    J->middleCols<3>(kShared).setIdentity();
    J->middleCols<3>(kShared + 3) = since * Mat3::Identity();
  }
  Vec3 y = rotation * force;
  if (!only_contact) y += c.bias + c.drift * since;
  return y;
}

}  // namespace

LossAt loss_at(RobustLoss loss, double r) {
  const double a = std::abs(r);
  if (loss == RobustLoss::kNone || (loss == RobustLoss::kHuber && a <= kHuber))
    return {r * r, r, 1};
  if (loss == RobustLoss::kHuber) return {kHuber * (2 * a - kHuber), std::copysign(kHuber, r), 0};
  const double s = 1 + r * r / (kCauchy * kCauchy);
  return {kCauchy * kCauchy * std::log(s), r / s, (2 - s) / (s * s)};
}

ComparedRecording compare(const MeasuredRecording& recording, const ForceBasis& basis,
                          double margin, double lowpass, bool on_handpiece) {
  ComparedRecording r;
  r.name = recording.name;
  r.basis = &basis;
  const double end = basis.start + basis.step * static_cast<double>(basis.size - 1);
  const auto& samples = recording.motion.samples;
  // A stall's force comes to the sensor within the margin, as that of the motion's ends does.
  std::vector<char> still(recording.stalled.empty() ? 0 : samples.size(), 0);
  for (const int direction : {1, -1}) {
    double last = -1e30 * direction;
    const auto n = static_cast<std::ptrdiff_t>(still.size());
    for (std::ptrdiff_t i = 0; i < n; ++i) {
      const auto j = static_cast<std::size_t>(direction > 0 ? i : n - 1 - i);
      if (recording.stalled[j]) last = samples[j].time;
      if (std::abs(samples[j].time - last) <= margin) still[j] = 1;
    }
  }
  for (std::size_t j = 0; j < samples.size(); ++j) {
    if (!recording.usable.empty() && !recording.usable[j]) continue;
    if (samples[j].time < basis.start + margin || samples[j].time > end - margin) continue;
    if (!still.empty() && still[j]) {
      ++r.stalled;
      continue;
    }
    r.time.push_back(samples[j].time);
    r.force.push_back(recording.motion.measured_force[j]);
    if (on_handpiece) r.frame.push_back(samples[j].pose.orientation);
  }
  if (!r.time.empty()) r.middle = (r.time.front() + r.time.back()) / 2;
  set_lowpass(r, lowpass > 0 ? 1 / (2 * units::kPi * lowpass) : 0, false);
  return r;
}

namespace {

template <class Columns>
void filter(const Columns& in, const LowpassStep& a, Columns& out) {
  out.resize(in.rows(), in.cols());
  if (in.cols() > 0) out.col(0) = in.col(0);
  for (Eigen::Index i = 1; i < in.cols(); ++i)
    out.col(i) = a.keep * out.col(i - 1) + a.before * in.col(i - 1) + a.now * in.col(i);
}

}  // namespace

void set_lowpass(ComparedRecording& r, double time_constant, bool with_slope) {
  const double h = r.basis->step, by = std::max(0.02 * time_constant, 0.05 * h);
  const double below = std::max(0.0, time_constant - by), above = time_constant + by;
  const auto set = [&](const auto& in, auto& filtered, auto& slope) {
    filtered.resize(in.rows(), 0);
    slope.resize(in.rows(), 0);
    if (in.cols() == 0) return;
    if (time_constant > 0) filter(in, lowpass_step(time_constant, h), filtered);
    if (!with_slope) return;
    std::decay_t<decltype(in)> low;
    filter(in, lowpass_step(below, h), low);
    filter(in, lowpass_step(above, h), slope);
    slope = (slope - low) / (above - below);
  };
  for (int k = 0; k < kTissueCount; ++k) set(r.basis->tissue[k].force, r.filtered[k], r.slope[k]);
  set(r.basis->offset, r.filtered_offset, r.offset_slope);
  r.filtered_shape.resize(r.basis->shape.size());
  r.shape_slope.resize(r.basis->shape.size());
  for (std::size_t s = 0; s < r.basis->shape.size(); ++s)
    set(r.basis->shape[s], r.filtered_shape[s], r.shape_slope[s]);
}

std::vector<Chunk> chunks_of(const std::vector<ComparedRecording>& recordings, double length) {
  std::vector<Chunk> chunks;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const std::vector<double>& time = recordings[r].time;
    std::size_t begin = 0;
    for (std::size_t j = 1; j <= time.size(); ++j)
      if (j == time.size() || time[j] - time[begin] >= length) {
        chunks.push_back({static_cast<int>(r), begin, j});
        begin = j;
      }
  }
  return chunks;
}

NormalSums normal_sums(const ComparedRecording& recording, const Chunk& chunk,
                       const SharedVector& shared, const OwnVector& own, const ModelState& state,
                       Weighting weighting, std::size_t stride,
                       const Eigen::Matrix<double, kColumns, 1>* shift) {
  const Constants constants(shared, own, state);
  NormalSums sums;
  SampleJacobian J;
  // Samples are gathered so that the sums are products of matrices, of the wanted columns.
  constexpr int kBatch = 64;
  std::vector<int> columns = state.columns;
  if (columns.empty())
    for (int a = 0; a < kColumns; ++a) columns.push_back(a);
  const auto m = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd rows(m, 3 * kBatch), weighted(m, 3 * kBatch), H = Eigen::MatrixXd::Zero(m, m);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(m);
  int filled = 0;
  const auto flush = [&] {
    if (filled > 0) H.noalias() += rows.leftCols(filled) * weighted.leftCols(filled).transpose();
    filled = 0;
  };
  for (std::size_t j = chunk.begin; j < chunk.end; j += stride) {
    Vec3 r = (model_at(recording, j, constants, state, &J, false) - recording.force[j]) /
             recording.sigma;
    J /= recording.sigma;
    if (shift) r += J * *shift;
    for (int a = 0; a < 3; ++a) {
      const LossAt at = loss_at(state.loss, r[a]);
      double h = at.slope, d = at.psi, cost = at.rho;
      if (weighting == Weighting::kInliers) {
        if (std::abs(r[a]) > kOutlierSigmas) continue;
        h = 1, d = r[a], cost = r[a] * r[a];
        sums.weight += 1;
      } else if (weighting == Weighting::kWeights) {
        h = r[a] == 0 ? 1 : at.psi / r[a];
        cost = h * r[a] * r[a];
        sums.weight += h;
      } else if (weighting == Weighting::kTransformed) {
        const double slope = at.rho > 0 ? at.psi / std::sqrt(at.rho) : 1;  // f' = psi / f
        h = slope * slope;
      }
      for (Eigen::Index b = 0; b < m; ++b) {
        const double x = J(a, columns[static_cast<std::size_t>(b)]);
        rows(b, filled) = x;
        weighted(b, filled) = h * x;
        g[b] += d * x;
      }
      sums.cost += cost;
      ++sums.rows;
      if (++filled == 3 * kBatch) flush();
    }
  }
  flush();
  for (Eigen::Index a = 0; a < m; ++a) {
    const int i = columns[static_cast<std::size_t>(a)];
    sums.g[i] = g[a];
    for (Eigen::Index b = 0; b < m; ++b) sums.H(i, columns[static_cast<std::size_t>(b)]) = H(a, b);
  }
  return sums;
}

std::vector<NormalSums> normal_sums(const std::vector<ComparedRecording>& recordings,
                                    const std::vector<Chunk>& chunks, const ModelState& state,
                                    Weighting weighting, std::size_t stride) {
  std::vector<NormalSums> sums(chunks.size());
  tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t i) {
    const auto r = static_cast<std::size_t>(chunks[i].recording);
    sums[i] =
        normal_sums(recordings[r], chunks[i], state.shared, state.own[r], state, weighting, stride);
  });
  return sums;
}

std::vector<Vec3> modelled_force(const ComparedRecording& recording, const OwnVector& own,
                                 const ModelState& state, bool only_contact) {
  const Constants constants(state.shared, own, state);
  std::vector<Vec3> force(recording.time.size());
  tbb::parallel_for(std::size_t{0}, force.size(), [&](std::size_t j) {
    force[j] = model_at(recording, j, constants, state, nullptr, only_contact);
  });
  return force;
}

}  // namespace toothprep
