// Coupled drive: the virtual coupling, the implicit step and the stall.
#include <gtest/gtest.h>

#include <unsupported/Eigen/MatrixFunctions>

#include "experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/handpiece.h"
#include "toothprep/step/session/implicit_step.h"
#include "toothprep/step/session/stages.h"

namespace toothprep::testing {
namespace {

constexpr double kU = 300, kAlpha = 0.25, kRate = 100, kL = 3;

// B of the cylinder in full side feed along -y, on (x, y): B_n along the feed, B_t across. Seen
// from the advancing set {v·n > 0} of a feed direction d, F = -B_n v + B_t (z x v) for any d in the
// plane.
Eigen::Matrix2d cylinder_resistance() {
  const double bn = kU * kL / (4 * kAlpha * kRate), bt = kU * kL / (4 * kRate);
  Eigen::Matrix2d B;
  B << -bn, -bt, bt, -bn;
  return B;
}

// Share of the plateau that the feed component has reached at t. With (-B)^-1 = (B_n I - B_t J) /
// (B_n² + B_t²), J the quarter turn, exp(-k t (-B)^-1) is a decay by e^-s, s = k t / (B_n (1 + a²)),
// a = B_t/B_n = alpha, times a turn by a s; applied to (B_t, B_n) v the feed component is
// 1 - e^-s (cos(a s) + a sin(a s)) or, turned the other way, with -a.
double feed_share(double t, double k) {
  const double bn = kU * kL / (4 * kAlpha * kRate), a = kAlpha, s = k * t / (bn * (1 + a * a));
  return 1 - std::exp(-s) * (std::cos(a * s) - a * std::sin(a * s));
}
// When that is 1 - 1/e.
double rise_time(double k) {
  double low = 0, high = 100;
  while (high - low > 1e-9) {
    const double middle = (low + high) / 2;
    (feed_share(middle, k) < 1 - std::exp(-1) ? low : high) = middle;
  }
  return low;
}

TEST(Coupled, RiseFollowsTheMatrixExponential) {
  // Started fully engaged with the handle at constant v and inertia negligible:
  // F(t) = -(I - exp(-k (-B)^-1 t)) B v on the operator's side, i.e. F_VC; F_G = -F_VC.
  const Bur bur = paper_cylinder();
  Parameters p = paper_without_stall();
  const double v = 0.5;
  const Outcome r = run(block(0.1, 14, Vec3(6, 14, 6)), bur, p, Drive::kCoupled,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -12, -1.5)}, v));
  const Eigen::Matrix2d B = cylinder_resistance();
  // The handle goes along -y; the bur's path bends, but the surface keeps facing the block.
  const Eigen::Vector2d feed(0, -v);
  const Eigen::Vector2d final_force = B * feed;  // on the bur: (+B_t v, +B_n v)
  const double level = final_force.norm();
  double worst = 0;
  for (std::size_t i = 0; i < r.rows.size(); ++i) {
    const double t = r.rows[i].handle.time;
    const Eigen::Matrix2d decay = (-p.coupling.stiffness * t * (-B).inverse()).exp();
    const Eigen::Vector2d exact = (Eigen::Matrix2d::Identity() - decay) * final_force;
    const Eigen::Vector2d got = r.rows[i].grinding_force.head<2>();
    worst = std::max(worst, (got - exact).cwiseAbs().maxCoeff() / level);
  }
  std::printf("coupled rise: worst deviation %.3f %% of the plateau\n", 100 * worst);
  EXPECT_LT(worst, 0.01);
  // The 63 % time of the feed component, 0.971 B_n / k at alpha = 0.25.
  EXPECT_NEAR(rise_time(p.coupling.stiffness), 0.971 * 9.0, 0.001 * 9.0);
  double t63 = 0;
  for (const StepRecord& row : r.rows)
    if (row.grinding_force.y() < (1 - std::exp(-1)) * final_force.y()) t63 = row.handle.time;
  EXPECT_NEAR(t63, rise_time(p.coupling.stiffness), 0.02 * 9.0);
}

TEST(Coupled, ThreeByThreeEqualsThePapersSixBySix) {
  // Eq. 17 in (dP, dv): dP/h - dv = v0;  (m/h) dv - (B - b) dv + k dP = F_VC + B v0 + f0.
  Coupling c;
  c.stiffness = 1.3;
  c.damping = 0.02;
  Mat3 B;
  B << -9, -2.25, 0.3, 2.25, -9, -0.1, 0.2, 0.4, -3;
  const CouplingState s{Vec3(0.1, -0.2, 0.3), Vec3(0.5, 0.1, -0.3), Vec3(1, -2, 0.5),
                        Vec3(0.4, 0.2, -0.6)};
  const Vec3 f0(0.02, -0.3, 0.1);
  for (const double h : {1e-4, 1e-3, 1e-2}) {
    Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> right;
    A.topLeftCorner<3, 3>() = Mat3::Identity() / h;
    A.topRightCorner<3, 3>() = -Mat3::Identity();
    A.bottomLeftCorner<3, 3>() = c.stiffness * Mat3::Identity();
    A.bottomRightCorner<3, 3>() = (c.bur_mass / h + c.damping) * Mat3::Identity() - B;
    right << s.velocity, coupling_force(c, s) + B * s.velocity + f0;
    const Eigen::Matrix<double, 6, 1> six = A.fullPivLu().solve(right);
    const Vec3 v = implicit_velocity(c, h, s, B, f0);
    EXPECT_LT((v - (s.velocity + six.tail<3>())).norm(), 1e-12 * v.norm());
    EXPECT_LT((h * v - six.head<3>()).norm(), 1e-12 * v.norm());
  }
}

TEST(Coupled, NoStepSizeMakesItDiverge) {
  const Bur bur = paper_cylinder();
  const LayeredTooth tooth = block(0.1, 6, Vec3(5, 6, 6));
  for (const double h : {1e-4, 1e-3, 3e-3, 1e-2}) {
    Parameters p = paper_without_stall();
    p.time_step = h;
    const Outcome r = run(tooth, bur, p, Drive::kCoupled,
                          straight_path({Vec3(0, -1, -1.5), Vec3(0, -3, -1.5)}, 0.5, {}, h));
    double peak = 0;
    for (const StepRecord& row : r.rows) peak = std::max(peak, row.grinding_force.norm());
    EXPECT_LT(peak, 4.64 * 1.01) << "h = " << h;  // the plateau sqrt(4.5² + 1.125²) bounds the rise
    // 4 s into the rise the force is what the exact solution says, whatever h: within 1 % of the
    // plateau for the voxels, and backward Euler's own error, h/2 of the rise's rate.
    const double t = r.rows.back().handle.time;
    EXPECT_NEAR(r.rows.back().grinding_force.y(), 4.5 * feed_share(t, p.coupling.stiffness),
                0.045 + 4.5 * h / 2 / 9)
        << "h = " << h;
  }
}

TEST(Coupled, FollowsTheHandleInTheAirAndReportsNoForce) {
  const Outcome r = run(block(0.1, 2, Vec3(4, 4, 4)), paper_ball(), paper_without_stall(),
                        Drive::kCoupled, straight_path({Vec3(0, 4, 0), Vec3(3, 4, 0)}, 5.0));
  // The spring and 8 g settle within a few steps of 0.005 mm each.
  EXPECT_LT(r.totals.largest_lag, 0.02);
  EXPECT_EQ(r.rows.back().grinding_force.norm(), 0);
  EXPECT_LT(r.rows.back().device_force.norm(), 1e-2);
  EXPECT_EQ(r.totals.removed[0] + r.totals.removed[1], 0);
}

// Handle accelerated at 0.1 mm/s² into enamel, then pulled back (the paper's Fig. 14).
std::vector<HandleSample> accelerate_then_pull_back(double seconds, double hold,
                                                    double back_speed) {
  std::vector<HandleSample> path;
  const double h = 1e-3, a = 0.1;
  double y = -2;
  for (int i = 0; i <= static_cast<int>((seconds + hold) / h); ++i) {
    const double t = i * h;
    if (t <= seconds) {
      y = -2 - a * t * t / 2;
    } else {
      y += back_speed * h;
    }
    path.push_back({t, Pose{Vec3(0, y, -1.5), Quat::Identity()}, kPedalButton});
  }
  return path;
}

TEST(Stall, StopsOnceHoldsWithoutChatterAndLetsGoWhenPulledBack) {
  const Parameters p = preset_parameters("paper");  // 1.2 mN·m
  const double until = 14.5, back = 4;
  const Outcome r = run(block(0.1, 14, Vec3(6, 14, 6)), paper_cylinder(), p, Drive::kCoupled,
                        accelerate_then_pull_back(until, back, 1.0));
  // Runs of stalled rows.
  std::vector<std::pair<std::size_t, std::size_t>> stalls;
  for (std::size_t i = 0; i < r.rows.size(); ++i) {
    if (!r.rows[i].stalled) continue;
    if (stalls.empty() || stalls.back().second + 1 != i)
      stalls.emplace_back(i, i);
    else
      stalls.back().second = i;
  }
  ASSERT_EQ(stalls.size(), 1u);
  EXPECT_EQ(r.totals.stall_onsets, 1);
  const auto [first, last] = stalls[0];
  const StepRecord& before = r.rows[first - 1];
  // T = u v 2R L/(2 pi N) reaches 1.2 mN·m at v = 0.698 mm/s; F_feed is then pi T/(4 alpha R)
  // = 6.28 N.
  EXPECT_NEAR(before.bur_velocity.norm(), 0.698, 0.02);
  EXPECT_NEAR(before.grinding_force.norm(), 6.28 * std::sqrt(1 + kAlpha * kAlpha), 0.15);
  // It stands still, removes nothing, and the coupling force rises with k v_handle.
  const StepRecord& a = r.rows[first];
  const std::size_t end = static_cast<std::size_t>(until / 1e-3);
  const StepRecord& b = r.rows[std::min(last, end)];
  ASSERT_GT(end, first + 300);
  EXPECT_EQ((a.bur.position - b.bur.position).norm(), 0);
  EXPECT_EQ(a.removed_volume[0], b.removed_volume[0]);
  EXPECT_EQ(a.torque, p.handpiece.stall_torque);
  EXPECT_EQ(a.bur_velocity.norm() + a.power + a.rotation_rate, 0);
  const double handle_way = (b.handle.pose.position - a.handle.pose.position).norm();
  EXPECT_NEAR(b.device_force.norm() - a.device_force.norm(), handle_way, 0.03 * handle_way);
  EXPECT_EQ((a.grinding_force - a.device_force).norm(), 0);  // the reaction -F_VC
  // Pulled back, it restarts and follows the handle out.
  EXPECT_LT(last, r.rows.size() - 1);
  EXPECT_FALSE(r.rows.back().stalled);
  std::printf("stall at bur speed %.4f mm/s, %.3f N, handle lag %.2f mm, %zu stalled rows\n",
              before.bur_velocity.norm(), before.grinding_force.norm(), r.totals.largest_lag,
              last - first + 1);
}

TEST(Stall, OrientationIsHeldAndCatchesUpAtMost90DegreesPerSecond) {
  const Parameters p = preset_parameters("paper");
  std::vector<HandleSample> path = accelerate_then_pull_back(14.5, 6, 1.5);
  for (HandleSample& s : path)
    if (s.time > 14.4) s.pose.orientation = Quat(Eigen::AngleAxisd(0.3, Vec3::UnitZ()));
  const Outcome r = run(block(0.1, 14, Vec3(6, 14, 6)), paper_cylinder(), p, Drive::kCoupled, path);
  ASSERT_TRUE(r.rows[14400].stalled);
  double fastest = 0;
  for (std::size_t i = 1; i < r.rows.size(); ++i) {
    const double turn = r.rows[i].bur.orientation.angularDistance(r.rows[i - 1].bur.orientation);
    if (r.rows[i].stalled) {
      EXPECT_LT(turn, 1e-12);
    }
    fastest = std::max(fastest, turn / 1e-3);
  }
  EXPECT_LE(fastest, kCatchUpRate * 1.0001);
  EXPECT_LT(r.rows.back().bur.orientation.angularDistance(path.back().pose.orientation), 1e-6);
}

TEST(Stall, DirectDriveScalesToTheStallTorqueAndRemovesNothing) {
  Parameters p = preset_parameters("paper");
  p.handpiece.stall_torque = 0.5;  // the cylinder in enamel at 0.5 mm/s needs 0.859
  const Outcome r = run(block(0.1, 6, Vec3(5, 6, 6)), paper_cylinder(), p, Drive::kDirect,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -2.5, -1.5)}, 0.5));
  EXPECT_EQ(r.totals.stalled_steps, static_cast<long>(r.rows.size()) - 1);
  EXPECT_EQ(r.totals.removed[0], 0);
  EXPECT_EQ(r.rows.back().torque, 0.5);
  EXPECT_NEAR(r.rows.back().torque_trial, 0.8594, 0.01);
  EXPECT_NEAR(r.rows.back().grinding_force.y(), 4.5 * 0.5 / 0.8594, 0.03);
  EXPECT_NEAR((r.rows.back().bur.position - Vec3(0, -2.5, -1.5)).norm(), 0, 1e-9);
}

TEST(Stall, DirectDriveKeepsTheForcesDirectionWhileTheHandleTurns) {
  // The same first step with and without a limit: the stalled force is the free one scaled by
  // tau_s/T.
  auto path = straight_path({Vec3(0, -2, -1.5), Vec3(0, -2.01, -1.5)}, 0.5);
  for (std::size_t i = 1; i < path.size(); ++i)
    path[i].pose.orientation = Quat(Eigen::AngleAxisd(0.1, Vec3::UnitZ()));
  Parameters limited = preset_parameters("paper");
  limited.handpiece.stall_torque = 0.1;
  const LayeredTooth tooth = block(0.1, 6, Vec3(5, 6, 6));
  const StepRecord stalled = run(tooth, paper_cylinder(), limited, Drive::kDirect, path).rows[1];
  const StepRecord free =
      run(tooth, paper_cylinder(), paper_without_stall(), Drive::kDirect, path).rows[1];
  ASSERT_TRUE(stalled.stalled);
  EXPECT_LT((stalled.grinding_force - free.grinding_force * (0.1 / free.torque)).norm(),
            1e-9 * stalled.grinding_force.norm());
}

TEST(Droop, ImposedFeedFollowsTheClosedFormAndCollapsesAtHalfTheStallTorque) {
  // T = tau_s/2 (1 - sqrt(1 - uQ/P_max)), P_max = pi N0 tau_s/2, with uQ = u v 2R L for the
  // cylinder.
  Parameters p = preset_parameters("physical");
  p.tissue[0] = {300, 0.25};
  p.handpiece.rotation_rate = 100;
  p.handpiece.stall_torque = 2.5;
  const double p_max = units::kPi * 100 * 2.5 / 2;
  const LayeredTooth tooth = block(0.1, 6, Vec3(5, 6, 6));
  for (const double v : {0.1, 0.25, 0.34}) {
    const Outcome r = run(tooth, paper_cylinder(), p, Drive::kDirect,
                          straight_path({Vec3(0, -2, -1.5), Vec3(0, -2.3, -1.5)}, v));
    const double rest = 1 - 300 * v * 1.2 * 3 / p_max;
    ASSERT_GT(rest, 0);
    const double torque = 2.5 / 2 * (1 - std::sqrt(rest));
    EXPECT_NEAR(plateau(r.rows, 0.5).torque, torque, 0.02 * torque) << v;
    EXPECT_NEAR(r.rows.back().rotation_rate, 100 * (1 - r.rows.back().torque / 2.5), 1e-9);
  }
  const Outcome r = run(tooth, paper_cylinder(), p, Drive::kDirect,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -2.1, -1.5)}, 0.38));
  EXPECT_TRUE(r.rows.back().stalled);  // above P_max there is no operating point
}

TEST(Droop, ImposedForceHasItsOperatingPointOnTheLine) {
  Parameters p = preset_parameters("physical");
  p.tissue[0] = {300, 0.25};
  p.handpiece.rotation_rate = 100;
  p.handpiece.stall_torque = 1.2;
  const Outcome r = run(block(0.1, 8, Vec3(5, 8, 6)), paper_cylinder(), p, Drive::kCoupled,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -6, -1.5)}, 0.5));
  const StepRecord& row = r.rows[6000];
  ASSERT_FALSE(row.stalled);
  EXPECT_GT(row.torque, 0.2);
  EXPECT_NEAR(row.rotation_rate, 100 * (1 - row.torque / 1.2), 1e-6);
  // The torque hardly depends on N: T = F_feed 4 alpha R/pi of the cylinder.
  EXPECT_NEAR(row.torque, row.grinding_force.y() * 4 * 0.25 * 0.6 / units::kPi, 0.02);
}

Spindle turning(const Handpiece& handpiece) { return Spindle(handpiece, true, 0, 1e-3); }

// Wherever there is an operating point, the law and the power that is needed hold, and the
// rate is above that of the greatest power.
TEST(Droop, AnExponentGivesTheLawsTorqueAndTheImposedPower) {
  for (double k = 0.5; k <= 8; k += 0.5) {
    Handpiece h = preset_parameters("physical").handpiece;
    h.rotation_rate = 130, h.stall_torque = 1.7, h.droop_exponent = k;
    const double best = 130 * std::pow(k + 1, -1 / k);
    const double most = best * 1.7 * k / (k + 1);  // T N, N·mm·rev/s
    for (const double share : {1e-6, 0.1, 0.5, 0.9, 0.999, 1 - 1e-9}) {
      Trial trial;
      turn_at_imposed_feed(turning(h), share * most, trial);
      EXPECT_TRUE(trial.operating_point) << k << " " << share;
      EXPECT_NEAR(trial.torque * trial.rotation_rate, share * most, 1e-12 * most);
      EXPECT_NEAR(trial.torque, 1.7 * (1 - std::pow(trial.rotation_rate / 130, k)), 1e-12) << k;
      EXPECT_GE(trial.rotation_rate, best * (1 - 1e-9));
    }
    Trial none;
    turn_at_imposed_feed(turning(h), (1 + 1e-9) * most, none);
    EXPECT_FALSE(none.operating_point) << k;
  }
}

TEST(Droop, TheSquareIsTheRootOfItsCubic) {
  // x - x³ = c: x = 2/√3 cos(acos(-3√3 c/2)/3).
  Handpiece h = preset_parameters("physical").handpiece;
  h.rotation_rate = 100, h.stall_torque = 2, h.droop_exponent = 2;
  for (const double c : {0.01, 0.1, 0.3, 0.38}) {
    Trial trial;
    turn_at_imposed_feed(turning(h), c * 200, trial);
    const double x = 2 / std::sqrt(3) * std::cos(std::acos(-1.5 * std::sqrt(3) * c) / 3);
    EXPECT_NEAR(trial.rotation_rate, 100 * x, 1e-10);
  }
}

// By a closed form at k = 1, by bisection otherwise.
TEST(Droop, TheRateAtATorqueGivesThatTorque) {
  for (double k = 0.5; k <= 8; k += 0.5) {
    Handpiece h = preset_parameters("physical").handpiece;
    h.rotation_rate = 130, h.stall_torque = 1.7, h.droop_exponent = k;
    for (const double share : {0.0, 0.1, 0.5, 0.99, 1.0}) {
      const double rate = turning(h).rate_at(share * 1.7);
      EXPECT_NEAR(turning(h).torque(rate), share * 1.7, 1e-12) << k << " " << share;
      // At the stall the rate is ill-conditioned: x^k vanishes against 1.
      if (share < 1) {
        EXPECT_NEAR(rate, 130 * std::pow(1 - share, 1 / k), 1e-12 * 130) << k << " " << share;
      }
    }
    EXPECT_EQ(turning(h).rate_at(1.7001), 0) << k;
  }
}

TEST(Droop, WithAnExponentTheAuditHoldsAndTheForceHasItsOperatingPointOnTheCurve) {
  Parameters p = preset_parameters("physical");
  p.tissue[0] = {300, 0.25};
  p.handpiece.rotation_rate = 100;
  p.handpiece.stall_torque = 1.2;
  p.handpiece.droop_exponent = 2.5;
  const Outcome r = run(block(0.1, 8, Vec3(5, 8, 6)), paper_cylinder(), p, Drive::kCoupled,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -6, -1.5)}, 0.5));
  const StepRecord& row = r.rows[6000];
  ASSERT_FALSE(row.stalled);
  EXPECT_GT(row.torque, 0.2);
  EXPECT_NEAR(row.torque, 1.2 * (1 - std::pow(row.rotation_rate / 100, 2.5)), 1e-6);
  EXPECT_NEAR(row.torque, row.grinding_force.y() * 4 * 0.25 * 0.6 / units::kPi, 0.02);
  EXPECT_NEAR(r.totals.torque_work / (300 * r.totals.removed[0]), 1, 0.01);
}

TEST(Pedal, MotorOffRestsOnTissueAndRemovesNothing) {
  std::vector<HandleSample> path =
      straight_path({Vec3(0, 1.2, -1.5), Vec3(0, -1, -1.5), Vec3(0, 2, -1.5)}, 2.0);
  for (HandleSample& s : path) s.buttons = 0;
  const Outcome r = run(block(0.1, 3, Vec3(5, 6, 6)), paper_cylinder(), preset_parameters("paper"),
                        Drive::kCoupled, path);
  EXPECT_EQ(r.totals.removed[0], 0);
  double deepest = 10, peak = 0;
  for (const StepRecord& row : r.rows) {
    deepest = std::min(deepest, row.bur.position.y());
    peak = std::max(peak, row.device_force.norm());
    EXPECT_EQ(row.torque, 0);
    EXPECT_EQ(row.power, 0);
  }
  EXPECT_NEAR(deepest, 0.6, 0.02);  // rests on the face with its radius
  EXPECT_NEAR(peak, 1.6, 0.05);     // the spring holds 1.6 mm of handle below it
  EXPECT_NEAR((r.rows.back().bur.position - path.back().pose.position).norm(), 0, 0.01);
}

TEST(Determinism, TheSamePathGivesTheSameBits) {
  const LayeredTooth tooth = block(0.1, 2, Vec3(5, 5, 5));
  const auto path = straight_path({Vec3(0, 0.7, -1), Vec3(0.2, -1.5, -1)}, 0.7);
  const Outcome a = run(tooth, paper_ball(), preset_parameters("paper"), Drive::kCoupled, path);
  const Outcome b = run(tooth, paper_ball(), preset_parameters("paper"), Drive::kCoupled, path);
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    EXPECT_EQ(a.rows[i].bur.position, b.rows[i].bur.position);
    EXPECT_EQ(a.rows[i].grinding_force, b.rows[i].grinding_force);
    EXPECT_EQ(a.rows[i].removed_volume, b.rows[i].removed_volume);
  }
}

TEST(Coupled, ABurThatFliesOutOfAStretchedSpringRemovesNothingWithoutWork) {
  // Across an edge of the block, out of its side under a spring stretched by two millimetres: the
  // bur swings at half a metre a second, which is several voxels a step, and comes back to the
  // wall. Work and removal still agree: of one such flight to 3 %, of fourteen to 1.2 %, since how
  // the bur meets the wall again differs from flight to flight (72 of them, at other places beside
  // these: mean 0.9900, standard deviation 0.0044, least 0.9811. While the speed at a step's start
  // alone said in how many parts it goes, which is low where the bur turns back, a flight that
  // differed by rounding alone had 0.968).
  const Parameters p = paper_without_stall();
  double mean = 0;
  for (const double z : {-1.5, -1.47, -1.44, -1.41, -1.38, -1.35, -1.33})
    for (const double x : {-0.1, -0.17}) {
      const Outcome r = run(block(0.1, 6, Vec3(5, 6, 5)), paper_cylinder(), p, Drive::kCoupled,
                            straight_path({Vec3(x, 0.8, z), Vec3(x + 5.5, -4.7, z)}, 0.5));
      double fastest = 0;
      for (const StepRecord& row : r.rows) fastest = std::max(fastest, row.bur_velocity.norm());
      EXPECT_GT(fastest, 200);
      std::printf("fastest %.0f mm/s, energy ratio %.4f\n", fastest, r.energy_ratio(p));
      EXPECT_NEAR(r.energy_ratio(p), 1, 0.03);
      mean += r.energy_ratio(p) / 14;
    }
  EXPECT_NEAR(mean, 1, 0.012);
}

}  // namespace
}  // namespace toothprep::testing
