#include <gtest/gtest.h>

#include <algorithm>

#include "experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/calibrate/fit_files.h"

namespace toothprep::testing {
namespace {

const SensorOptions kRealistic = [] {
  SensorOptions s;
  s.noise = 0.05;
  s.bias = Vec3(0.11, -0.07, 0.04);
  s.delay = 0.003;
  s.outliers = 0.01;
  s.seed = 11;
  return s;
}();

void print(const char* title, const FitResult& r) {
  for (const int k : {0, 1})
    std::printf("[ fit      ] %s %-6s u %.5f of the truth +- %.5f, alpha %.5f +- %.5f\n", title,
                std::string(kTissueNames[k]).c_str(),
                r.tissue[k].u.value / truth()[k].specific_energy,
                r.tissue[k].u.std / truth()[k].specific_energy,
                r.tissue[k].alpha.value / truth()[k].force_ratio,
                r.tissue[k].alpha.std / truth()[k].force_ratio);
  for (const std::string& w : r.warnings) std::printf("[ fit      ]   %s\n", w.c_str());
}

TEST(Fit, NoiseFreeIsRecovered) {
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), {}, {});
  print("noise-free", r);
  expect_truth(r, 1e-3);
  EXPECT_GT(r.residual_r2, 0.999999);
  EXPECT_TRUE(r.constant_suffices);
  EXPECT_TRUE(r.warnings.empty());
}

TEST(Fit, NoiseBiasDelayAndOutliersLeaveTwoPercent) {
  FitOptions o;
  o.estimate_delay = true;
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), kRealistic, o);
  print("realistic", r);
  expect_truth(r, 0.02);
  EXPECT_NEAR(r.delay.value, 0.003, 3e-4);
  EXPECT_NEAR((r.recordings[0].bias - kRealistic.bias).norm(), 0, 0.02);
}

TEST(Fit, WrongStartsEndAtTheSame) {
  FitOptions o;
  o.estimate_delay = true;
  const FitResult right = fit_to(mixed_feed(), mixed_basis(), kRealistic, o);
  EXPECT_LT(right.start_spread, 1e-3);  // where the searches stop, before the last steps
  for (const double factor : {10.0, 0.1}) {
    FitOptions wrong = o;
    for (auto& t : wrong.start) t.specific_energy *= factor;
    const FitResult r = fit_to(mixed_feed(), mixed_basis(), kRealistic, wrong);
    for (const int k : {0, 1}) EXPECT_NEAR(r.tissue[k].u.value / right.tissue[k].u.value, 1, 1e-5);
    EXPECT_LT(r.start_spread, 1e-3);
  }
}

TEST(Fit, RotationOfTheSensorIsFoundWhenAskedAndFlaggedWhenNot) {
  for (int axis = 0; axis < 3; ++axis) {
    SensorOptions s = kRealistic;
    s.delay = 0;
    s.rotation = units::from_degree(20) * Vec3::Unit(axis);
    FitOptions o;
    const FitResult blind = fit_to(mixed_feed(), mixed_basis(), s, o);
    const bool flagged = std::any_of(
        blind.warnings.begin(), blind.warnings.end(),
        [](const std::string& w) { return w.find("sensor frame rotated") != std::string::npos; });
    EXPECT_TRUE(flagged) << "axis " << axis;
    o.estimate_rotation = true;
    const FitResult r = fit_to(mixed_feed(), mixed_basis(), s, o);
    print("rotated", r);
    EXPECT_NEAR(units::to_degree((r.rotation - s.rotation).norm()), 0, 0.5) << "axis " << axis;
    expect_truth(r, 0.05);
  }
}

TEST(Fit, GivenSensorValuesNeedNoEstimate) {
  SensorOptions s;
  s.noise = 0.02;
  s.bias = Vec3(0.3, 0, -0.2);
  s.drift = Vec3(0.01, -0.02, 0.005);
  s.delay = 0.005;
  s.rotation = Vec3(0.2, -0.3, 0.1);
  s.lowpass_hz = 30;
  FitOptions o;
  o.bias = s.bias;
  o.delay = s.delay;
  o.rotation = s.rotation;
  o.estimate_drift = true;
  o.lowpass_hz = 30;
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), s, o);
  print("given", r);
  expect_truth(r, 0.01);
  EXPECT_NEAR((r.recordings[0].drift - s.drift).norm(), 0, 0.002);
}

// A sensor in the handpiece has its weight in a direction that turns with it; with the handpiece
// tilted by some 17° that can be separated from the bias.
TEST(Fit, WeightOfATiltedHandpieceIsFound) {
  auto path = mixed_feed();
  for (HandleSample& s : path)
    s.pose.orientation = Quat(Eigen::AngleAxisd(0.3 * std::sin(0.9 * s.time), Vec3::UnitX()) *
                              Eigen::AngleAxisd(0.3 * std::sin(1.3 * s.time), Vec3::UnitZ())) *
                         s.pose.orientation;
  const ForceBasis basis =
      force_basis(cylinder(), block_with(1.0), preset_parameters("paper"), path);
  const Vec3 weight(0, -0.6, 0.1);
  std::vector<Vec3> force = true_force(basis);
  SensorOptions s;
  s.noise = 0.05;
  s.bias = Vec3(0.2, 0, -0.1);
  const double rms = contact_rms(force);
  for (std::size_t i = 0; i < force.size(); ++i)
    force[i] = path[i].pose.orientation.conjugate() * (force[i] + weight);
  s.noise *= rms / contact_rms(force);
  FitOptions o;
  o.on_handpiece = o.estimate_weight = true;
  const MeasuredRecording r = recorded(path, measured_by(s, force, basis.step));
  const FitResult fitted = fit({compare(r, basis, o.largest_delay, 0, true)}, o);
  print("weight", fitted);
  expect_truth(fitted, 0.03);
  EXPECT_NEAR((fitted.weight - weight).norm(), 0, 0.03);
  EXPECT_NEAR((fitted.recordings[0].bias - s.bias).norm(), 0, 0.03);
  o.on_handpiece = false;
  EXPECT_THROW(static_cast<void>(fit({compare(r, basis, o.largest_delay, 0, false)}, o)), Error);
}

TEST(Fit, DelayIsFlaggedWhenNotAsked) {
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), kRealistic, {});
  print("delayed", r);
  EXPECT_TRUE(std::any_of(r.warnings.begin(), r.warnings.end(), [](const std::string& w) {
    return w.find("3 ms behind the motion") != std::string::npos;
  }));
}

TEST(Fit, DentinOnlyTellsNothingOfEnamel) {
  const auto path = mixed_feed();
  const ForceBasis basis = force_basis(cylinder(), block_with(0), preset_parameters("paper"), path);
  const FitResult r = fit_to(path, basis, kRealistic, {});
  EXPECT_FALSE(r.tissue[0].identifiable);
  EXPECT_EQ(r.tissue[0].why_not.reason, NotIdentifiable::kNeverTouched);
  EXPECT_TRUE(std::isnan(r.tissue[0].u.value));
  ASSERT_TRUE(r.tissue[1].identifiable);
  EXPECT_NEAR(r.tissue[1].u.value / truth()[1].specific_energy, 1, 0.05);
  const std::string json = fit_json(r, {});
  EXPECT_NE(json.find("\"why_not\": \"never touched\""), std::string::npos);
}

// Along the axis the tangential forces cancel: only the normal part's u/alpha is known.
TEST(Fit, PlungeAloneTellsOnlyTheRatio) {
  const auto path = legs({0, 0.5, 0}, {{{0, -1.8, 0}, 0.5}, {{0, 0.5, 0}, 2}});
  const ForceBasis basis =
      force_basis(cylinder(), block_with(1.0), preset_parameters("paper"), path);
  SensorOptions s;
  s.noise = 0.05;
  const FitResult r = fit_to(path, basis, s, {});
  for (const int k : {0, 1}) {
    EXPECT_FALSE(r.tissue[k].identifiable);
    EXPECT_EQ(r.tissue[k].why_not.reason, NotIdentifiable::kOnlyPlunge) << r.tissue[k].why_not.text;
    ASSERT_TRUE(r.tissue[k].ratio_identifiable);
    EXPECT_NEAR(r.tissue[k].u_over_alpha.value, truth()[k].specific_energy / truth()[k].force_ratio,
                0.02 * r.tissue[k].u_over_alpha.value);
  }
}

// A turn of the sensor about the bur's axis does to a side feed just what another u and alpha do.
TEST(Fit, SideFeedAloneCantTellTheSensorsRotation) {
  const auto path = legs({-3.4, -2.0, 0}, {{{1.0, -2.0, 0}, 0.5}, {{-3.4, -2.0, 0}, 4}});
  const ForceBasis basis = force_basis(make_bur("cylinder:D1.2xL3.0", ""), block_with(0),
                                       preset_parameters("paper"), path);
  SensorOptions s;
  s.noise = 0.05;
  EXPECT_TRUE(fit_to(path, basis, s, {}).tissue[1].identifiable);
  FitOptions o;
  o.estimate_rotation = true;
  const FitResult r = fit_to(path, basis, s, o);
  EXPECT_FALSE(r.tissue[1].identifiable);
  EXPECT_EQ(r.tissue[1].why_not.reason, NotIdentifiable::kLikeRotation) << r.tissue[1].why_not.text;
}

TEST(Fit, MotionThatNeverTouchesIsRefused) {
  const auto path = legs({9, 9, 9}, {{{12, 9, 9}, 1.0}});
  const ForceBasis basis =
      force_basis(cylinder(), block_with(1.0), preset_parameters("paper"), path);
  const MeasuredRecording r = recorded(path, std::vector<Vec3>(path.size(), Vec3(0.1, 0, 0)));
  EXPECT_THROW(static_cast<void>(fit({compare(r, basis, 0.05, 0, false)}, {})), Error);
}

TEST(Fit, ABiasThatCannotBeIsRefusedOrWarnedOf) {
  for (const double bias : {1e4, 1e160}) {
    FitOptions o;
    o.bias = Vec3(bias, 0, 0);
    if (bias > 1e100) {
      EXPECT_THROW(fit_to(mixed_feed(), mixed_basis(), kRealistic, o), Error);
    } else {
      EXPECT_FALSE(fit_to(mixed_feed(), mixed_basis(), kRealistic, o).warnings.empty());
    }
  }
}

// Two recordings with their own bias; each is predicted from the other.
TEST(Fit, RecordingsAreFittedTogether) {
  const auto path = mixed_feed();
  const ForceBasis& basis = mixed_basis();
  FitOptions o;
  o.estimate_delay = true;
  std::vector<MeasuredRecording> recordings;
  for (const int seed : {1, 2}) {
    SensorOptions s = kRealistic;
    s.seed = static_cast<std::uint64_t>(seed);
    s.bias *= seed;
    recordings.push_back(recorded(path, measured_by(s, true_force(basis), basis.step)));
  }
  const FitResult r = fit({compare(recordings[0], basis, 0.05, 0, false),
                           compare(recordings[1], basis, 0.05, 0, false)},
                          o);
  print("two", r);
  expect_truth(r, 0.02);
  EXPECT_NEAR((r.recordings[1].bias - 2 * kRealistic.bias).norm(), 0, 0.03);
  EXPECT_EQ(r.validation, "leave one recording out");
  const double sigma = 0.05 * contact_rms(true_force(basis));
  EXPECT_NEAR(r.validation_rms, std::sqrt(3.0) * sigma, 0.15 * std::sqrt(3.0) * sigma);
}

// If u grows with the removal rate, constant u is not enough, and that is said.
TEST(Fit, VaryingSpecificEnergyIsSeen) {
  const auto path = mixed_feed();
  const ForceBasis& basis = mixed_basis();
  auto force = true_force(basis);
  for (std::size_t i = 0; i < force.size(); ++i) force[i] *= 0.6 + 0.5 * basis.removal[i];
  SensorOptions s;
  s.noise = 0.02;
  const MeasuredRecording r = recorded(path, measured_by(s, force, basis.step));
  EXPECT_FALSE(fit({compare(r, basis, 0.05, 0, false)}, {}).constant_suffices);
}

TEST(Fit, RepeatsBitForBit) {
  const FitResult a = fit_to(mixed_feed(), mixed_basis(), kRealistic, {});
  const FitResult b = fit_to(mixed_feed(), mixed_basis(), kRealistic, {});
  EXPECT_EQ(a.tissue[0].u.value, b.tissue[0].u.value);
  EXPECT_EQ(a.tissue[0].u.std, b.tissue[0].u.std);
}

TEST(Fit, ParametersFileGivesTheFittedValuesBack) {
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), {}, {});
  const Parameters p = parse_parameters(
      fitted_parameters_toml(r, preset_parameters("paper"), {"x", "t", "s", "b", {}, ""}),
      "fit.toml");
  EXPECT_EQ(p.tissue[0].specific_energy, r.tissue[0].u.value);
  EXPECT_EQ(p.tissue[1].force_ratio, r.tissue[1].alpha.value);
  EXPECT_EQ(p.tissue[2].specific_energy, preset_parameters("paper").tissue[2].specific_energy);
}

}  // namespace
}  // namespace toothprep::testing
