// u and alpha per tissue from measured forces, with what is known about them and what isn't.
//
// Least squares with a robust loss on the model of force_model.h (Ceres; u and u/alpha positive by
// their logarithms), from several starts. The uncertainty comes from the residuals as they are:
// blocks longer than their correlation are drawn anew (block bootstrap). A tissue whose parameters
// the recordings don't determine gets a reason instead of a number.
//
// Forces determine u/N and alpha only: u is for the rotation rate N of the basis, and scales with it.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/calibrate/force_model.h"

namespace toothprep {

struct FitOptions {  // what is given and what is estimated
  // The sensor: a given value is held, an estimated one starts from it.
  std::optional<Vec3> bias;        // N; absent: estimated, per recording
  bool estimate_drift = false;     // per recording
  Vec3 drift = Vec3::Zero();       // N/s
  bool estimate_delay = false;     // one for all recordings
  double delay = 0;                // s, of the force behind the motion
  double largest_delay = 0.05;     // s
  bool estimate_rotation = false;  // the same
  Vec3 rotation = Vec3::Zero();    // rotation vector, rad: takes sensor to W (or to B)
  bool on_handpiece = false;       // the sensor turns with the bur
  bool estimate_weight = false;    // of the handpiece; needs on_handpiece and a bur that turns
  Vec3 weight = Vec3::Zero();      // N, W
  double lowpass_hz = 0;           // first-order corner of the sensor; 0: none
  bool estimate_lowpass = false;   // its time constant; starts anywhere
  double largest_lowpass = 0.05;   // s
  std::optional<double> noise;     // N per axis; absent: from spans without contact

  RobustLoss loss = RobustLoss::kHuber;  // on the residuals
  int bootstrap = 1000;                  // replicates
  double block = 0;                      // s; 0: ten times the residuals' correlation time
  int folds = 5;                         // over time, for a single recording
  std::uint64_t seed = 1;                // of the bootstrap
  bool diagnose = true;                  // validation, suspicions, adequacy
  // The motion is known to be rough (rounded positions): residuals are laid to that, not to the
  // sensor's mounting.
  bool rough_motion = false;
  // Where the search starts (times 1, 10 and 1/10), and the alpha that stands in where only u/alpha
  // is identifiable.
  PerTissue<GrindingProperties> start = preset_parameters("paper").tissue;
  bool several_starts = true;  // there too, and not only where the linear solution is
};

struct Estimate {                                           // in the unit of what it estimates
  double value = std::numeric_limits<double>::quiet_NaN();  // NaN: not estimated
  double std = value;                                       // standard deviation
  double low = value, high = value;                         // 95 %
};

enum class NotIdentifiable {  // why u and alpha of a tissue aren't
  kNone,
  kNeverTouched,
  kHardlyTouched,
  kOnlyPlunge,
  kLikeRotation,  // alpha looks like the sensor's rotation
  kNotSeparable,  // u/alpha only, of such noise
  kLittleForce,   // not even that
  kUncertain      // free in the fit, but too uncertain in the end
};
struct WhyNot {                                     // a reason
  NotIdentifiable reason = NotIdentifiable::kNone;  // for programs
  std::string text;                                 // a clause for the user
};

struct TissueFit {                  // of one tissue
  bool identifiable = false;        // u and alpha
  WhyNot why_not;                   // if not identifiable
  Estimate u, alpha;                // N/mm² at N, 1
  bool ratio_identifiable = false;  // u/alpha
  Estimate u_over_alpha;            // N/mm²
  double touched = 0;               // s
  double removed = 0;               // mm³
};

// The handpiece's droop T = tau_s (1 - (N/N0)^k) and its rotor, from recorded speeds (spindle.h).
struct DroopFit {
  bool identifiable = false;  // see why_not
  std::string why_not;        // if not identifiable
  Estimate rate;              // N0, rev/s
  Estimate stall_torque;      // tau_s, N·mm
  double correlation = 0;     // between the two
  double residual_rms = 0;    // rev/s
  double largest_fall = 0;    // of the speed, as a share of N0 (99 % quantile)
  double exponent = 1;        // k
  // If k was fitted: the exponents that the recordings do not distinguish from it, and k itself.
  std::vector<double> exponents_like_the_best;
  std::optional<Estimate> inertia;   // J, t·mm²; if fitted and identifiable
  std::optional<Estimate> run_down;  // s; likewise
  std::string inertia_why_not;       // if fitted and not identifiable
};

struct RecordingFit {                                 // of one recording
  std::string name;                                   // of the recording
  std::size_t samples = 0;                            // that counted
  std::size_t stalled = 0;                            // samples left out since the bur stood still
  Vec3 bias = Vec3::Zero(), bias_std = Vec3::Zero();  // N
  Vec3 drift = Vec3::Zero(), drift_std = Vec3::Zero();  // N/s
  double noise = 0;                                     // N, per axis, as weighted in the end
  double quiet_noise = 0;     // N, of the spans without contact; NaN if there are too few
  double residual_rms = 0;    // N, of the 3-vector, without outliers
  double validation_rms = 0;  // N, predicted without this recording (or fold); NaN if not
  // Of a recorded torque: by the modelled one, and what is left, N·mm. NaN if there is none.
  double torque_factor = std::numeric_limits<double>::quiet_NaN(), torque_rms = torque_factor;
};

// How much more or less force than modelled there is in one part of the samples.
struct AdequacyBin {
  std::string of;              // "removal_rate_mm3_s", ...
  double low = 0, high = 0;    // of what `of` names
  double factor = 1, std = 0;  // of the force
};

struct FitResult {                // everything that fit.json holds
  PerTissue<TissueFit> tissue;    // per tissue
  double rotation_rate = 0;       // N, rev/s, that u is for
  bool speed_recorded = false;    // then u itself is known, and rotation_rate is only typical
  std::optional<DroopFit> droop;  // if asked for
  int replays = 0;                // iterations of a coupled fit
  Estimate delay;                 // s
  Vec3 rotation = Vec3::Zero(), rotation_std = Vec3::Zero();  // rad
  Vec3 weight = Vec3::Zero(), weight_std = Vec3::Zero();      // N
  std::string weight_why_not;                // of a requested weight that isn't identifiable
  std::vector<Estimate> shapes;              // further parameters of the bases (law_fit.h)
  Estimate lowpass;                          // time constant of the sensor, s
  double delay_lowpass_correlation = 0;      // where both were estimated
  std::vector<RecordingFit> recordings;      // per recording
  double residual_rms = 0, residual_r2 = 0;  // N of the 3-vector; without outliers
  double outlier_share = 0;                  // samples beyond kOutlierSigmas on an axis
  double validation_rms = 0;                 // N
  std::string validation;                    // "leave one recording out", "5 parts of time"
  double correlation_time = 0, block = 0;    // s
  std::size_t blocks = 0;                    // that the bootstrap drew from
  // Over the tissues' free parameters; and draws of them, for plots.
  std::vector<std::string> names;
  Eigen::MatrixXd correlation;          // names x names
  Eigen::MatrixXd draws;                // names x replicates, in the parameters' own units
  std::vector<double> singular_values;  // of the weighted basis, columns scaled to length 1
  double start_spread = 0;  // largest relative difference of u, u/alpha between the starts
  std::vector<AdequacyBin> adequacy;  // by removal rate and other
  bool constant_suffices = true;      // no bin is off by more than 5 %
  std::vector<std::string> warnings;  // a sentence each
  ModelState state;                   // of the fitted model (force_model.h)
};

// u and alpha as they stand in the fit's model, those that aren't identifiable among them; zero
// where a tissue makes no force.
[[nodiscard]] PerTissue<GrindingProperties> modelled_tissue(const FitResult& fit);

// One basis per recording, all at the same rotation rate. Throws Error for options that contradict
// each other, for recordings that never touch the tooth, and if the fit fails.
[[nodiscard]] FitResult fit(const std::vector<ComparedRecording>& recordings,
                            const FitOptions& options);

}  // namespace toothprep
