#include "toothprep/tools/calibrate/fit_start.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/calibrate/fit_solver.h"

namespace toothprep {
namespace {

constexpr double kFirstChunks = 32;  // that all the time is cut into at first
constexpr double kSubset = 8000;     // samples that the search for a start looks at
constexpr double kLeastTurn = 1;     // degrees rms: less of a turn doesn't show a weight
constexpr double kInfinity = std::numeric_limits<double>::infinity();

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
double noise_without_contact(const ComparedRecording& r, const std::vector<char>& contact) {
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

Vec3 median_force(const ComparedRecording& r) {
  Vec3 centre;
  for (int a = 0; a < 3; ++a) {
    std::vector<double> axis;
    axis.reserve(r.force.size());
    for (const Vec3& f : r.force) axis.push_back(f[a]);
    centre[a] = median(std::move(axis));
  }
  return centre;
}

// Chunks, contact and the force's size; what the bur touched.
void survey(const FitOptions& o, FitStart& start) {
  FitData& data = start.data;
  double samples = 0, square = 0, duration = 0;
  bool touched = false;
  for (const ComparedRecording& r : data.recordings) {
    if (r.time.size() < 20) throw Error(r.name + ": fewer than 20 usable samples");
    if (r.basis->rotation_rate != data.recordings.front().basis->rotation_rate)
      throw Error(r.name + ": another rotation rate than the first recording's");
    samples += static_cast<double>(r.time.size());
    duration += r.time.back() - r.time.front();
    data.contact.push_back(in_contact(r, o.largest_delay));
    for (int k = 0; k < kTissueCount; ++k) {
      touched = touched || r.basis->touched(k);
      start.touched[k] += r.basis->tissue[k].touched;
      start.removed[k] += r.basis->tissue[k].removed;
    }
    const Vec3 centre = median_force(r);
    for (const Vec3& f : r.force) square += (f - centre).squaredNorm();
  }
  if (!touched)
    throw Error(data.recordings.front().name +
                ": the bur never touches the tooth along this motion; check that tooth, bur and "
                "motion are in the same frame (mm)");
  data.force_rms = std::sqrt(square / samples);
  data.stride = std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(samples / kSubset)));
  data.chunks = chunks_of(data.recordings, duration / kFirstChunks);
  data.linearised = data.recordings.front().basis->offset.cols() > 0;
  data.lowpass = o.lowpass_hz > 0 ? 1 / (2 * units::kPi * o.lowpass_hz) : 0;
}

// How the sensor turns: the mean square of its frame about the frame's mean.
Eigen::SelfAdjointEigenSolver<Mat3> turn_of(const std::vector<ComparedRecording>& recordings) {
  Mat3 turn = Mat3::Zero();
  double samples = 0;
  for (const ComparedRecording& r : recordings) {
    Mat3 mean = Mat3::Zero();
    const auto n = static_cast<double>(r.frame.size());
    for (const Quat& q : r.frame) mean += q.conjugate().toRotationMatrix() / n;
    for (const Quat& q : r.frame) {
      const Mat3 d = q.conjugate().toRotationMatrix() - mean;
      turn += d.transpose() * d;
    }
    samples += n;
  }
  return Eigen::SelfAdjointEigenSolver<Mat3>(turn / samples);
}

// A weight that doesn't turn in the sensor's frame is a bias. What sets it apart from one is the
// turn of the sensor, about more than the weight's own axis.
void check_weight(FitStart& start) {
  if (!start.asked.weight || !start.asked.bias) return;
  const auto turn = turn_of(start.data.recordings);
  const double least = units::from_degree(kLeastTurn);
  if (turn.eigenvalues()[0] > least * least) return;
  const Vec3 axis = turn.eigenvectors().col(0);
  start.weight_why_not =
      turn.eigenvalues()[2] > least * least
          ? fmt::format(
                "the handpiece turned about ({:.2f}, {:.2f}, {:.2f}) only, and its weight along "
                "that axis can't be separated from the sensor's bias: turn it about another axis "
                "too",
                axis.x(), axis.y(), axis.z())
          : fmt::format(
                "the bur never turned ({:.1f} degrees rms), so the handpiece's weight can't be "
                "separated from the sensor's bias: turn it by some 20 degrees, or give the bias or "
                "the weight",
                units::to_degree(std::sqrt(std::max(0.0, turn.eigenvalues()[2]))));
  start.asked.weight = false;
}

// The state and each recording's sigma at the options' values.
void set_state(const FitOptions& o, FitStart& start) {
  ModelState& state = start.state;
  FitData& data = start.data;
  state.loss = o.loss;
  state.shapes = static_cast<int>(data.recordings.front().basis->shape.size());
  state.shared[kDelay] = o.delay;
  state.shared.segment<3>(kRotation) = o.rotation;
  state.shared.segment<3>(kWeight) = o.weight;
  state.own.resize(data.recordings.size());
  for (std::size_t r = 0; r < data.recordings.size(); ++r) {
    state.own[r].head<3>() = o.bias.value_or(Vec3::Zero());
    state.own[r].tail<3>() = o.drift;
    const double quiet = noise_without_contact(data.recordings[r], data.contact[r]);
    start.quiet_noise.push_back(quiet);
    const double sigma = o.noise.value_or(std::isfinite(quiet) ? quiet : 0.05 * data.force_rms);
    data.recordings[r].sigma = std::max(sigma, 1e-6 * data.force_rms);
  }
  for (int k = 0; k < kTissueCount; ++k) {
    state.tied_ratio[k] = o.start[k].force_ratio;
    state.mode[k] = start.touched[k] > 0 ? TissueMode::kFree : data.aside();
    const double u = std::max(o.start[k].specific_energy, 1e-3);
    state.shared[2 * k] = std::log(u);
    state.shared[2 * k + 1] = std::log(u / o.start[k].force_ratio);
    if (start.touched[k] > 0 && start.touched[k] < kLeastTouched) state.mode[k] = TissueMode::kTied;
  }
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

// Delay, rotation and low-pass by trial, everything else linear.
class Trials {
 public:
  Trials(const FitOptions& o, FitStart& start)
      : o_(o),
        start_(start),
        set_(linear_set(start.state, start.data.recordings.size(), start.asked)) {}

  void find_rotation() {
    ModelState trial = start_.state;
    double best = kInfinity;
    for (const Mat3& m : trial_rotations(o_.rotation)) {
      trial.shared.segment<3>(kRotation) = rotation_vector(m);
      const double cost = cost_of(trial, true);
      if (cost < best) {
        best = cost;
        start_.state.shared.segment<3>(kRotation) = rotation_vector(m);
      }
    }
  }
  void find_delay() {
    find_delay(-o_.largest_delay, o_.largest_delay, o_.largest_delay / 10);
    const double centre = start_.state.shared[kDelay], step = o_.largest_delay / 50;
    find_delay(centre - 5 * step, centre + 5 * step, step);
  }
  // By profile: at each time constant the delay that suits it best.
  void find_lowpass() {
    double best = kInfinity, at = 0, delay = o_.delay;
    for (double tau = 0; tau <= o_.largest_lowpass; tau = tau == 0 ? 5e-4 : 2 * tau) {
      filter_at(tau, o_, start_.asked, start_.data, start_.state);
      if (start_.asked.delay) find_delay();
      const double cost = cost_of(start_.state, false);
      if (cost < best) best = cost, at = tau, delay = start_.state.shared[kDelay];
    }
    filter_at(at, o_, start_.asked, start_.data, start_.state);
    start_.state.shared[kDelay] = delay;
  }
  // Before anything is judged, the rotation has to be right.
  void settle_rotation() {
    const FitData& data = start_.data;
    const FreeSet all = free_set(start_.state, data.recordings.size(), start_.asked);
    start_.state =
        moved_to(solve_linear(data, set_, start_.state, data.stride, 4), set_, o_, start_.state);
    minimise(data, all, o_, data.stride, start_.state);
  }

 private:
  double cost_of(const ModelState& state, bool positive) const {
    const Linear linear = solve_linear(start_.data, set_, state, start_.data.stride * 3, 3);
    return positive && !all_positive(linear, set_) ? kInfinity : linear.cost;
  }
  void find_delay(double low, double high, double step) {
    ModelState trial = start_.state;
    double best = kInfinity, at = start_.state.shared[kDelay];
    for (double tau = low; tau <= high + 1e-12; tau += step) {
      trial.shared[kDelay] = std::clamp(tau, -o_.largest_delay, o_.largest_delay);
      const double cost = cost_of(trial, false);
      if (cost < best) best = cost, at = trial.shared[kDelay];
    }
    start_.state.shared[kDelay] = at;
  }

  const FitOptions& o_;
  FitStart& start_;
  FreeSet set_;
};

}  // namespace

FitStart start_of(std::vector<ComparedRecording> recordings, const FitOptions& o) {
  if (recordings.empty()) throw Error("no recording to calibrate with");
  if (o.estimate_weight && !o.on_handpiece)
    throw Error(
        "the handpiece's weight can't be separated from the sensor's bias unless the sensor turns "
        "with the handpiece: give --sensor-on handpiece, or leave the weight to the bias");
  FitStart start;
  start.asked = {!o.bias.has_value(), o.estimate_drift,  o.estimate_delay,
                 o.estimate_rotation, o.estimate_weight, o.estimate_lowpass};
  start.data.recordings = std::move(recordings);
  survey(o, start);
  check_weight(start);
  set_state(o, start);

  Trials trials(o, start);
  if (start.asked.rotation) trials.find_rotation();
  if (start.asked.lowpass)
    trials.find_lowpass();
  else if (start.asked.delay)
    trials.find_delay();
  if (start.asked.rotation) trials.settle_rotation();
  return start;
}

}  // namespace toothprep
