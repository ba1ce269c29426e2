#include "toothprep/tools/calibrate/fit_diagnostics.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kClearly = 0.01;  // less cost, as a share; chance alone makes 0.1 %
constexpr std::size_t kBins = 5;   // of each quantity that forces are compared by

// ---- Validation

struct Fold {
  FreeSums rest, own;  // of the other chunks, and of those that are left out
};
Fold fold_of(const std::vector<NormalSums>& sums, const std::vector<Chunk>& chunks,
             const FreeSet& set, const std::vector<char>& left_out) {
  Fold fold{FreeSums(set.size), FreeSums(set.size)};
  for (std::size_t i = 0; i < chunks.size(); ++i)
    (left_out[i] ? fold.own : fold.rest)
        .add(sums[i], set, static_cast<std::size_t>(chunks[i].recording));
  return fold;
}

// A recording's bias and drift are its own: they are taken from the recording that is left out.
void take_own_bias(const FreeSums& own, const std::array<int, kOwn>& of_recording,
                   Eigen::VectorXd& step) {
  std::vector<int> places;
  for (const int p : of_recording)
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

struct SquareAndWeight {
  double square = 0, weight = 0;
  double rms() const { return std::sqrt(3 * square / std::max(weight, 1.0)); }  // of the 3-vector
};
SquareAndWeight left_after(const Eigen::VectorXd& step, const std::vector<NormalSums>& sums,
                           const FitData& data, const FreeSet& set,
                           const std::vector<char>& left_out) {
  SquareAndWeight left;
  for (std::size_t i = 0; i < data.chunks.size(); ++i) {
    if (!left_out[i]) continue;
    const auto r = static_cast<std::size_t>(data.chunks[i].recording);
    Eigen::Matrix<double, kColumns, 1> local = Eigen::Matrix<double, kColumns, 1>::Zero();
    for (int a = 0; a < kColumns; ++a)
      if (const int p = set.place(r, a); p >= 0) local[a] = step[p];
    const double sigma = data.recordings[r].sigma;
    left.square +=
        sigma * sigma *
        std::max(0.0, sums[i].cost + 2 * sums[i].g.dot(local) + local.dot(sums[i].H * local));
    left.weight += sums[i].weight;
  }
  return left;
}

// ---- What may be behind the residuals

double cost_with(const Asked& asked, const FitData& data, const FitOptions& o, ModelState& state) {
  return minimise(data, free_set(state, data.recordings.size(), asked), o, data.stride, state);
}

// The fit once more with a rotation free as well: it is suspected where it leaves clearly less.
void look_for_rotation(const Solution& solution, Asked asked, const FitOptions& o,
                       FitResult& result) {
  ModelState plain = solution.state, turned = solution.state;
  const double cost = cost_with(asked, solution.data, o, plain);
  asked.rotation = true;
  const double rotated = cost_with(asked, solution.data, o, turned);
  const Mat3 turn = rotation_matrix(turned.shared.segment<3>(kRotation)) *
                    rotation_matrix(solution.state.shared.segment<3>(kRotation)).transpose();
  const Eigen::AngleAxisd by(turn);
  if (rotated < (1 - kClearly) * cost && units::to_degree(by.angle()) > 2)
    result.warnings.push_back(fmt::format(
        "the residuals look like a sensor frame rotated by about {:.0f} degrees about ({:.2f}, "
        "{:.2f}, {:.2f}): check its mounting, or estimate it (--estimate rotation)",
        units::to_degree(by.angle()), by.axis().x(), by.axis().y(), by.axis().z()));
}

// A delay shows at the steps of the force only, so that a descent doesn't find it: by trial.
void look_for_delay(const Solution& solution, const FitOptions& o, FitResult& result) {
  const FitData& data = solution.data;
  const double here = solution.state.shared[kDelay];
  const std::size_t stride = std::max<std::size_t>(1, data.stride / 8);
  ModelState trial = solution.state;
  trial.columns = {kShared};  // only the cost is wanted
  const auto cost_at = [&](double delay) {
    trial.shared[kDelay] = delay;
    double sum = 0;
    for (const NormalSums& c :
         normal_sums(data.recordings, data.chunks, trial, Weighting::kSlope, stride))
      sum += c.cost / 2;
    return sum;
  };
  const double now = cost_at(here);
  double least = now, by = 0;
  for (int ms = -10; ms <= 10; ++ms) {
    const double delay = here + 1e-3 * ms;
    if (std::abs(delay) > o.largest_delay) continue;
    if (const double c = cost_at(delay); c < least) least = c, by = 1e-3 * ms;
  }
  double samples = 0, duration = 0;
  for (const ComparedRecording& r : data.recordings) {
    samples += static_cast<double>(r.time.size());
    duration += r.time.back() - r.time.front();
  }
  const double spacing = duration / samples * static_cast<double>(stride);
  if (now - least > 20 * std::max(1.0, result.correlation_time / spacing))
    result.warnings.push_back(
        fmt::format("the force seems {:.0f} ms {} the motion: estimate it (--estimate delay)",
                    1e3 * std::abs(by), by > 0 ? "behind" : "ahead of"));
}

// The largest ratio of the residuals in contact to the noise without.
double scatter_over_noise(const Solution& solution, const FitResult& result) {
  double most = 0;
  for (std::size_t r = 0; r < result.recordings.size(); ++r)
    if (result.recordings[r].quiet_noise > 1e-3 * solution.data.force_rms)
      most = std::max(most, solution.data.recordings[r].sigma / result.recordings[r].quiet_noise);
  return most;
}

// ---- Adequacy

struct ForceSample {
  double modelled, measured_along, by[4];
};
std::vector<ForceSample> force_samples(const Solution& solution) {
  std::vector<ForceSample> samples;
  const ModelState& state = solution.state;
  for (std::size_t r = 0; r < solution.data.recordings.size(); ++r) {
    const ComparedRecording& rec = solution.data.recordings[r];
    const auto all = modelled_force(rec, state.own[r], state);
    const auto contact = modelled_force(rec, state.own[r], state, true);
    for (std::size_t j = 0; j < all.size(); j += solution.data.stride) {
      const double size = contact[j].squaredNorm();
      const std::size_t i = basis_index(rec, j, state.shared[kDelay]);
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
  return samples;
}

// Of the samples [begin, end): the factor, with each of them standing for 1/crowd.
void add_factor(const std::vector<ForceSample>& samples, std::size_t begin, std::size_t end,
                double crowd, AdequacyBin& bin) {
  double size = 0, along = 0, scatter = 0;
  for (std::size_t i = begin; i < end; ++i) {
    size += samples[i].modelled;
    along += samples[i].measured_along;
  }
  bin.factor = along / size;
  for (std::size_t i = begin; i < end; ++i) {
    const double rest = samples[i].measured_along - bin.factor * samples[i].modelled;
    scatter += rest * rest;
  }
  bin.std = std::sqrt(scatter * crowd) / size;
}

}  // namespace

// Samples far out are counted and then left aside: a handful of them would drown the rest.
void measure_residuals(const Solution& solution, FitResult& result) {
  double square = 0, spread = 0, samples = 0, all = 0;
  for (std::size_t r = 0; r < solution.data.recordings.size(); ++r) {
    const ComparedRecording& rec = solution.data.recordings[r];
    const auto modelled = modelled_force(rec, solution.state.own[r], solution.state);
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
    result.recordings[r].residual_rms = std::sqrt(own / std::max(count, 1.0));
    square += own;
    samples += count;
    all += static_cast<double>(modelled.size());
  }
  result.residual_rms = std::sqrt(square / std::max(samples, 1.0));
  result.residual_r2 = spread > 0 ? 1 - square / spread : 0;
  result.outlier_share = 1 - samples / all;
}

void validate(const Solution& solution, const Asked& asked, const FitOptions& o,
              FitResult& result) {
  const FitData& data = solution.data;
  const FreeSet set = free_set(solution.state, data.recordings.size(), asked);
  const auto sums = normal_sums(data.recordings, data.chunks, solution.state, Weighting::kInliers);
  const bool by_recording = data.recordings.size() > 1;
  const std::size_t folds =
      by_recording ? data.recordings.size()
                   : std::min<std::size_t>(static_cast<std::size_t>(std::max(o.folds, 2)),
                                           data.chunks.size());
  result.validation = by_recording ? "leave one recording out"
                                   : fmt::format("{} parts of time, each left out once", folds);
  SquareAndWeight total;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<char> left_out;
    for (std::size_t i = 0; i < data.chunks.size(); ++i)
      left_out.push_back((by_recording ? static_cast<std::size_t>(data.chunks[i].recording)
                                       : i * folds / data.chunks.size()) == fold);
    const Fold f = fold_of(sums, data.chunks, set, left_out);
    Eigen::VectorXd step = -solve_scaled(f.rest.H, f.rest.g);
    if (by_recording && (asked.bias || asked.drift)) take_own_bias(f.own, set.own[fold], step);
    const SquareAndWeight left = left_after(step, sums, data, set, left_out);
    if (by_recording) result.recordings[fold].validation_rms = left.rms();
    total.square += left.square;
    total.weight += left.weight;
  }
  result.validation_rms = total.rms();
}

void look_for_causes(const Solution& solution, const Asked& asked, const FitOptions& o,
                     FitResult& result) {
  if (!asked.rotation && !o.rough_motion) look_for_rotation(solution, asked, o, result);
  if (!asked.delay) look_for_delay(solution, o, result);
  if (const double scatter = scatter_over_noise(solution, result); scatter > 2)
    result.warnings.push_back(
        fmt::format("the residuals in contact are {:.1f} times the sensor's noise without contact: "
                    "the model with constant u and alpha leaves something unexplained",
                    scatter));
  double shank = 0, overlap = 0;
  for (const ComparedRecording& r : solution.data.recordings) {
    shank += r.basis->shank_contact;
    overlap += r.basis->initial_overlap;
  }
  if (shank > 0)
    result.warnings.push_back(
        fmt::format("the shank touched the tooth for {:.2f} s; its force is not modelled", shank));
  if (overlap > 0.01)
    result.warnings.push_back(
        fmt::format("{:.3f} mm^3 of tissue lay inside the bur at the first sample: is the tooth as "
                    "it was before the recording, and in its frame?",
                    overlap));
  if (result.residual_r2 < 0.5)
    result.warnings.push_back(
        fmt::format("the model explains only {:.0f} % of the force's variance: check tooth, bur, "
                    "frames and sign of the force",
                    100 * std::max(0.0, result.residual_r2)));
  if (result.start_spread > 0.01)
    result.warnings.push_back(
        fmt::format("the starts end {:.1f} % apart", 100 * result.start_spread));
}

void check_adequacy(const Solution& solution, FitResult& result) {
  std::vector<ForceSample> samples = force_samples(solution);
  if (samples.size() < 100) return;
  const char* names[] = {"removal_rate_mm3_s", "contact_area_mm2", "axial_feed_cosine", "time_s"};
  const double crowd =
      std::max(1.0, result.correlation_time * static_cast<double>(samples.size()) /
                        std::max(1e-9, static_cast<double>(result.blocks) * result.block));
  for (int v = 0; v < 4; ++v) {
    std::sort(samples.begin(), samples.end(),
              [v](const ForceSample& a, const ForceSample& b) { return a.by[v] < b.by[v]; });
    double total = 0;
    for (const ForceSample& s : samples) total += s.modelled;
    for (std::size_t part = 0; part < kBins; ++part) {
      const std::size_t begin = part * samples.size() / kBins,
                        end = (part + 1) * samples.size() / kBins;
      double size = 0;
      for (std::size_t i = begin; i < end; ++i) size += samples[i].modelled;
      if (size < 1e-3 * total) continue;  // hardly any force: its factor means nothing
      AdequacyBin bin{names[v], samples[begin].by[v], samples[end - 1].by[v]};
      add_factor(samples, begin, end, crowd, bin);
      if (std::abs(bin.factor - 1) > std::max(0.05, 3 * bin.std)) result.constant_suffices = false;
      result.adequacy.push_back(bin);
    }
  }
}

}  // namespace toothprep
