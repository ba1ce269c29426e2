#include "toothprep/tools/calibrate/coupled.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/trajectory/smoothing.h"

namespace toothprep {
namespace {

constexpr double kLargestStep = 1.5;  // of a logarithm, per iteration
constexpr int kMostHalvings = 5;
constexpr double kWorse = 1.02;           // of the misfit, from which a step is too long
constexpr double kGuessWindow = 0.1;      // s
constexpr int kGuessBootstrap = 50;       // replicates while nothing is reported
constexpr double kSmallestEnergy = 1e-3;  // N/mm²

struct Replayed {
  Eigen::Matrix3Xd force;  // on the bur, W, N
  // Of the replay that is linearised only.
  std::vector<HandleSample> bur;
  std::vector<float> area, removal, axial;
  std::vector<char> stalled;
  PerTissue<double> touched{}, removed{};
  double shank = 0, overlap = 0;
};

Replayed replayed(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                  const std::vector<HandleSample>& path, bool whole) {
  Workpiece workpiece(tooth);
  Session session(bur, workpiece, parameters, Drive::kCoupled, path.front());
  const std::size_t n = path.size();
  const double h = parameters.time_step;
  Replayed r;
  r.force.setZero(3, static_cast<Eigen::Index>(n));
  if (whole) {
    r.area.assign(n, 0);
    r.removal.assign(n, 0);
    r.axial.assign(n, 0);
    r.stalled.assign(n, 0);
    r.bur = path;
    r.bur.front().pose = session.initial().bur;
  }
  StepRecord row;
  for (std::size_t i = 1; i < n; ++i) {
    row = session.step(path[i]);
    r.force.col(static_cast<Eigen::Index>(i)) = row.grinding_force;
    if (!whole) continue;
    r.bur[i].pose = row.bur;
    r.stalled[i] = row.stalled;
    const double speed = row.bur_velocity.norm();
    double area = 0;
    for (int k = 0; k < kTissueCount; ++k) {
      area += row.contact_area[k];
      if (row.contact_area[k] > 0) r.touched[k] += h;
    }
    r.area[i] = static_cast<float>(area);
    if (speed > 0)
      r.axial[i] =
          static_cast<float>(row.bur_velocity.dot(row.bur.orientation * Vec3::UnitZ()) / speed);
    // For the removal rate the time's share of the torque's work would need one u: the speed times
    // the contact's area is its order, and nothing but bins of residuals goes by it.
    r.removal[i] = static_cast<float>(area * speed);
    if (row.shank_contact_area > 0) r.shank += h;
  }
  if (whole) {
    session.finish(row);
    r.removed = row.removed_volume;
    for (const double v : session.totals().initial_overlap) r.overlap += v;
  }
  return r;
}

class Linearisation {
 public:
  Linearisation(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                const std::vector<RecordedMotion>& handles, double difference)
      : bur_(bur),
        tooth_(tooth),
        parameters_(parameters),
        handles_(handles),
        difference_(difference) {}

  // One replay each.
  void move_to(const PerTissue<GrindingProperties>& tissue) {
    at_ = tissue;
    middle_.assign(handles_.size(), {});
    tbb::parallel_for(std::size_t{0}, handles_.size(),
                      [&](std::size_t r) { middle_[r] = run(tissue, r, true); });
  }

  // The bases at the last move; without `derivatives` only what doesn't need them.
  std::deque<ForceBasis> bases(bool derivatives) const {
    PerTissue<double> touched{};
    for (const Replayed& r : middle_)
      for (int k = 0; k < kTissueCount; ++k) touched[k] += r.touched[k];
    // Two directions for each parameter of each tissue that is touched at all.
    struct Job {
      std::size_t recording;
      int k;
      bool normal;
      double sign;
      Eigen::Matrix3Xd force;
    };
    std::vector<Job> jobs;
    for (std::size_t r = 0; derivatives && r < handles_.size(); ++r)
      for (int k = 0; k < kTissueCount; ++k)
        for (const bool normal : {false, true})
          for (const double sign : {1.0, -1.0})
            if (touched[k] > 0) jobs.push_back({r, k, normal, sign, {}});
    tbb::parallel_for(std::size_t{0}, jobs.size(), [&](std::size_t i) {
      Job& job = jobs[i];
      PerTissue<GrindingProperties> tissue = at_;
      GrindingProperties& t = tissue[job.k];
      const double factor = std::exp(job.sign * difference_);
      // u at the same w = u/alpha, or w at the same u.
      if (job.normal) {
        t.force_ratio /= factor;
      } else {
        t.specific_energy *= factor;
        t.force_ratio *= factor;
      }
      job.force = run(tissue, job.recording, false).force;
    });
    std::deque<ForceBasis> bases(handles_.size());
    for (std::size_t r = 0; r < handles_.size(); ++r) {
      const Replayed& own = middle_[r];
      ForceBasis& b = bases[r];
      b.start = handles_[r].path.front().time;
      b.step = parameters_.time_step;
      b.size = handles_[r].path.size();
      b.rotation_rate = parameters_.handpiece.rotation_rate;
      b.offset = own.force;
      b.area = own.area;
      b.removal = own.removal;
      b.axial = own.axial;
      b.initial_overlap = own.overlap;
      b.shank_contact = own.shank;
      for (int k = 0; k < kTissueCount; ++k) {
        b.tissue[k].touched = own.touched[k];
        b.tissue[k].removed = own.removed[k];
      }
    }
    for (std::size_t i = 0; i + 1 < jobs.size(); i += 2) {
      const Job& job = jobs[i];
      ForceBasis& b = bases[job.recording];
      TissueColumns& t = b.tissue[job.k];
      if (t.force.cols() == 0) t.force.setZero(6, static_cast<Eigen::Index>(b.size));
      const Eigen::Matrix3Xd slope = (job.force - jobs[i + 1].force) / (2 * difference_);
      const GrindingProperties& at = at_[job.k];
      if (job.normal)
        t.force.bottomRows<3>() = slope / (at.specific_energy / at.force_ratio);
      else
        t.force.topRows<3>() = slope / at.specific_energy;
      b.offset -= slope;
    }
    return bases;
  }

  const std::vector<Replayed>& replays() const { return middle_; }

 private:
  Replayed run(const PerTissue<GrindingProperties>& tissue, std::size_t recording,
               bool whole) const {
    Parameters p = parameters_;
    p.tissue = tissue;
    return replayed(bur_, tooth_, p, handles_[recording].path, whole);
  }

  const Bur& bur_;
  const LayeredTooth& tooth_;
  const Parameters& parameters_;
  const std::vector<RecordedMotion>& handles_;
  double difference_;
  PerTissue<GrindingProperties> at_{};
  std::vector<Replayed> middle_;
};

std::vector<ComparedRecording> compared(const std::vector<MeasuredRecording>& recordings,
                                        const std::deque<ForceBasis>& bases, const FitOptions& o) {
  std::vector<ComparedRecording> all;
  for (std::size_t r = 0; r < recordings.size(); ++r)
    all.push_back(compare(recordings[r], bases[r], o.largest_delay, o.lowpass_hz, o.on_handpiece));
  return all;
}

// Mean size of what a replay at the basis' own parameters leaves, with the sensor as last fitted,
// N.
double misfit(std::vector<ComparedRecording> recordings, const FitResult& sensor) {
  ModelState state = sensor.state;
  // Without derivatives the whole force is the offset.
  state.mode.fill(TissueMode::kOff);
  double sum = 0, count = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    set_lowpass(recordings[r], sensor.lowpass.value, false);
    const auto modelled = modelled_force(recordings[r], state.own[r], state);
    for (std::size_t j = 0; j < modelled.size(); ++j)
      sum += (modelled[j] - recordings[r].force[j]).cwiseAbs().sum();
    count += static_cast<double>(modelled.size());
  }
  return sum / std::max(count, 1.0);
}

// What the fit says next, from `at`; and by how much relatively that differs.
PerTissue<GrindingProperties> next_of(const FitResult& fit, const PerTissue<GrindingProperties>& at,
                                      const PerTissue<GrindingProperties>& start, double& change) {
  PerTissue<GrindingProperties> next = at;
  change = 0;
  for (int k = 0; k < kTissueCount; ++k) {
    const TissueMode mode = fit.state.mode[k];
    if (mode != TissueMode::kFree && mode != TissueMode::kTied) continue;
    const double w0 = std::log(at[k].specific_energy / at[k].force_ratio);
    const double w = w0 + std::clamp(fit.state.shared[2 * k + 1] - w0, -kLargestStep, kLargestStep);
    double u = w + std::log(start[k].force_ratio);  // tied
    const double u0 = std::log(at[k].specific_energy);
    if (mode == TissueMode::kFree)
      u = u0 + std::clamp(fit.state.shared[2 * k] - u0, -kLargestStep, kLargestStep);
    next[k] = {std::max(std::exp(u), kSmallestEnergy), std::exp(u - w)};
    change = std::max({change, std::abs(std::expm1(w - w0)), std::abs(std::expm1(u - u0))});
  }
  return next;
}

PerTissue<GrindingProperties> between(const PerTissue<GrindingProperties>& a,
                                      const PerTissue<GrindingProperties>& b) {
  PerTissue<GrindingProperties> middle = a;
  for (int k = 0; k < kTissueCount; ++k) {
    middle[k].specific_energy = std::sqrt(a[k].specific_energy * b[k].specific_energy);
    middle[k].force_ratio = std::sqrt(a[k].force_ratio * b[k].force_ratio);
  }
  return middle;
}

// From where the force says that the bur was: a fit to imposed motion.
PerTissue<GrindingProperties> first_guess(const Bur& bur, const LayeredTooth& tooth,
                                          const Parameters& parameters,
                                          const std::vector<MeasuredRecording>& recordings,
                                          const std::vector<RecordedMotion>& handles,
                                          const FitOptions& light) {
  PerTissue<GrindingProperties> guess = light.start;
  for (GrindingProperties& t : guess)
    t.specific_energy = std::max(t.specific_energy, kSmallestEnergy);
  try {
    std::vector<RecordedMotion> motions;
    for (std::size_t r = 0; r < recordings.size(); ++r)
      motions.push_back({bur_by_force(recordings[r], handles[r], parameters, light),
                         {{}, handles[r].spindle.stalled}});
    const auto bases = force_bases(bur, tooth, parameters, motions);
    std::vector<ComparedRecording> all;
    for (std::size_t r = 0; r < recordings.size(); ++r)
      all.push_back(compare(recordings[r], bases[r], light.largest_delay, light.lowpass_hz,
                            light.on_handpiece));
    double change = 0;
    FitOptions o = light;
    o.start = guess;
    const FitResult result = fit(all, o);
    return next_of(result, guess, guess, change);
  } catch (const Error&) {
    return guess;  // the start that was given has to do
  }
}

}  // namespace

std::vector<HandleSample> bur_by_force(const MeasuredRecording& recording,
                                       const RecordedMotion& handle, const Parameters& parameters,
                                       const FitOptions& o) {
  const auto& samples = recording.motion.samples;
  std::vector<Vec3> force = recording.motion.measured_force;
  const double angle = o.rotation.norm();
  const Mat3 turn = angle > 0 ? Eigen::AngleAxisd(angle, o.rotation / angle).toRotationMatrix()
                              : Mat3(Mat3::Identity());
  Vec3 bias = o.bias.value_or(Vec3::Zero());
  if (!o.bias) {
    double count = 0;
    for (std::size_t j = 0; j < samples.size(); ++j)
      if (samples[j].time <= samples.front().time + kGuessWindow) bias += force[j], ++count;
    bias /= count;
  }
  for (std::size_t j = 0; j < force.size(); ++j) {
    force[j] = turn * (force[j] - bias);
    if (o.on_handpiece) force[j] = samples[j].pose.orientation * force[j];
  }
  std::vector<HandleSample> path = handle.path;
  std::vector<Vec3> spring(path.size());
  std::size_t j = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double time = path[i].time + o.delay;
    while (j + 1 < samples.size() && samples[j + 1].time <= time) ++j;
    spring[i] = force[j] / parameters.coupling.stiffness;
  }
  spring = smoothed(spring, static_cast<int>(kGuessWindow / parameters.time_step / 2));
  for (std::size_t i = 0; i < path.size(); ++i) path[i].pose.position += spring[i];
  return path;
}

CoupledFit fit_coupled(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                       const std::vector<MeasuredRecording>& recordings,
                       const std::vector<RecordedMotion>& handles, const FitOptions& options,
                       const CoupledOptions& coupled,
                       const std::function<void(const CoupledIteration&)>& progress) {
  if (recordings.empty()) throw Error("no recording to calibrate with");
  FitOptions light = options;
  light.diagnose = false;
  light.bootstrap = kGuessBootstrap;
  PerTissue<GrindingProperties> at =
      first_guess(bur, tooth, parameters, recordings, handles, light);
  CoupledFit result;
  Linearisation model(bur, tooth, parameters, handles, coupled.difference);
  model.move_to(at);
  double before = 0;
  for (int iteration = 0;; ++iteration) {
    const auto bases = model.bases(true);
    light.start = at;
    // A tissue whose alpha isn't identifiable keeps the one that was given.
    const auto all = compared(recordings, bases, options);
    const FitResult step = fit(all, light);
    CoupledIteration here{at, before, 0};
    PerTissue<GrindingProperties> next = next_of(step, at, options.start, here.change);
    result.iterations.push_back(here);
    if (progress) progress(here);
    if (here.change < coupled.tolerance) break;
    if (iteration + 1 >= coupled.most_iterations)
      throw Error("u and alpha do not converge: after " + std::to_string(iteration + 1) +
                  " replays they still change by " + std::to_string(100 * here.change) +
                  " %; check coupling, rotation rate and stall torque, or start nearer (--params)");
    double now = 0;
    for (int halving = 0;; ++halving) {
      model.move_to(next);
      now = misfit(compared(recordings, model.bases(false), options), step);
      if (iteration == 0 || now <= kWorse * before || halving == kMostHalvings) break;
      next = between(at, next);
    }
    at = next;
    before = now;
  }
  result.bases = model.bases(true);
  result.recordings = compared(recordings, result.bases, options);
  FitOptions last = options;
  last.start = at;
  result.fit = fit(result.recordings, last);
  for (std::size_t r = 0; r < handles.size(); ++r) {
    const Replayed& own = model.replays()[r];
    result.bur.push_back({own.bur, {{}, own.stalled}});
    for (const char s : own.stalled) result.stalled += s ? parameters.time_step : 0;
  }
  return result;
}

}  // namespace toothprep
