// The experiment on transparency and stability, small; and what the shipped one recommends.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "scratch_folder.h"
#include "toothprep/proof/figures/coupled_cut.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/proof/figures/figures.h"
#include "toothprep/proof/reference/coupling_response.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/session.h"

namespace toothprep::figures {
namespace {

using toothprep::testing::ScratchFolder;

constexpr double kMass = 8e-6;  // 8 g

CoupledCut small_cut(double stiffness, double damping) {
  CoupledCut cut;
  cut.length = 1;
  cut.parameters = preset_parameters("paper");
  cut.parameters.handpiece.stall_torque = INFINITY;
  cut.parameters.coupling.stiffness = stiffness;
  cut.parameters.coupling.damping = damping;
  return cut;
}

TEST(Transparency, ABurThatLagsByForceOverStiffnessGoesAsFastAsTheHandle) {
  const SteadyFeed cut = steady_feed(small_cut(2, 0), 0.5, 0.2);
  // u v L/(4 alpha N) = 0.5 N in dentin, a quarter of it across: 0.25 and 0.0625 mm.
  EXPECT_NEAR(cut.expected.y(), -0.25, 1e-9);
  EXPECT_NEAR(std::abs(cut.expected.x()), 0.0625, 1e-9);
  EXPECT_NEAR(cut.speed.y(), -0.5, 0.005);
  EXPECT_NEAR(cut.speed.x(), 0, 0.005);
  EXPECT_NEAR((cut.lag - cut.expected).norm(), 0, 0.0025);
}

TEST(Transparency, APlungeShowsTheLowPassOfTheCoupling) {
  const CoupledCut cut = small_cut(5, 2.5e-3);
  const double B = reference::flat_end_plunge(grinding_of(cut), cut.radius, 1).against;
  std::vector<double> share = plunge(cut, Drive::kCoupled, 0.5, {5, 50});
  const std::vector<double> direct = plunge(cut, Drive::kDirect, 0.5, {5, 50});
  for (std::size_t i = 0; i < share.size(); ++i) share[i] /= direct[i];
  for (const std::size_t i : {0, 1}) {
    const double exact =
        std::abs(reference::rendered_share({kMass, 5, 2.5e-3, 1e-3}, B, i == 0 ? 5 : 50));
    EXPECT_NEAR(share[i] / exact, 1, 0.01);
  }
}

TEST(Transparency, TheBurOfASessionRingsInFreeAirByTheRootsOfItsStep) {
  for (const double b : {0.0, 2.5e-3})
    for (const double h : {1e-3, 1e-4}) {
      CoupledCut cut = small_cut(1, b);
      cut.parameters.time_step = h;
      const LayeredTooth tooth = make_block({});
      Workpiece workpiece(tooth);
      const Bur bur = make_bur("cylinder:D1.2xL1.0", "");
      HandleSample handle;
      handle.pose.position = Vec3(0, 20, 0);  // far above the block
      Session session(bur, workpiece, cut.parameters, Drive::kCoupled, handle);
      handle.pose.position.x() = 1e-3;  // a jump, then at rest
      std::vector<double> x;
      for (int n = 1; n <= 60; ++n) {
        handle.time = n * h;
        x.push_back(session.step(handle).bur.position.x() - 1e-3);
      }
      const double whole = kMass + h * b + h * h;  // k = 1 N/mm
      for (std::size_t n = 2; n < x.size(); ++n)
        EXPECT_NEAR(x[n], (1 + (kMass - h * h) / whole) * x[n - 1] - kMass / whole * x[n - 2],
                    1e-12)
            << b << " " << h << " " << n;
    }
}

Experiment shipped() {
  return read_experiment(std::string(TOOTHPREP_SOURCE_DIR) + "/data/figures/transparency");
}

TEST(Transparency, TheRecommendedDampersEndTheRingingAtAnyTimeStepUpToAMillisecond) {
  const Experiment e = shipped();
  ASSERT_EQ(e.transparency.devices.size(), 3u);
  for (const RenderingDevice& d : e.transparency.devices) {
    EXPECT_LE(reference::remaining({kMass, d.practical_stiffness, d.recommended_damping, 0}, 0.02),
              0.05);
    for (int parts = 20; parts <= 2000; parts = parts * 5 / 4)  // of 20 ms
      EXPECT_LE(reference::remaining(
                    {kMass, d.practical_stiffness, d.recommended_damping, 0.02 / parts}, 0.02),
                0.05)
          << d.name << " " << parts;
  }
}

TEST(Transparency, OnThePremiumNoDamperEndsTheRingingAndStaysBelowFriction) {
  for (const RenderingDevice& d : shipped().transparency.devices) {
    const double k = d.practical_stiffness;
    const double least = reference::least_damping(kMass, k, {1e-3, 1e-4, 0}, 0.02, 0.05);
    const double pulse = (k + least / 1e-3) * d.model.encoder_count;  // N, of a count
    EXPECT_EQ(pulse > 2 * d.model.friction, d.name == "premium") << d.name;
  }
}

TEST(Transparency, ASmallExperimentHasItsTablesAndItsClosedFormsHold) {
  const ScratchFolder folder("transparency");
  folder.write("in/small/experiment.toml",
               "kind = 'transparency'\nbur = 'cylinder:D1.2xL1.0'\nparams = 'params.toml'\n"
               "[[device]]\nname = 'one'\nrecommended_damping_n_s_per_m = 2.5\n"
               "[[device]]\nname = 'none'\nencoder_count_mm = 0.03\n"
               "[grid]\nstiffnesses_n_per_mm = [1.0]\ndampings_n_s_per_m = [2.5]\n"
               "feeds_mm_s = [0.5]\nfrequencies_hz = [5.0]\ntime_steps_ms = [1.0, 0.1]\n");
  folder.write("in/small/params.toml", "[handpiece]\nstall_torque_mnm = inf\n");
  FigureOptions o;
  o.experiments = find_experiments(folder / "in", {});
  o.voxel = 0.15;
  o.base = preset_parameters("paper");
  o.version = "test";
  o.output = folder / "out";
  std::filesystem::create_directories(o.output);
  const FigureReport report = run_figures(o).at(0);
  ASSERT_EQ(report.tables.size(), 7u);  // stiffness, ringing, noise, lag, transfer, two devices
  for (const MetricTable& table : report.tables)
    for (const MetricTable::Row& row : table.rows)
      EXPECT_EQ(row.values.size(), table.columns.size()) << table.title;
  EXPECT_EQ(report.maps.size(), 2u);
  int misses = 0;
  for (const Claim& c : report.claims) {
    if (c.claim.rfind("Passive by Colgate", 0) == 0) {
      misses += !c.holds;  // k T/2 = 0.5 N·s/m is more than the arm's 0.05
      continue;
    }
    EXPECT_TRUE(c.holds) << c.claim << ": " << c.quantity << ": " << c.expected << " "
                         << c.measured;
  }
  EXPECT_GT(misses, 0);
  for (const char* file : {"small/one.csv", "small/none.csv", "figures.md"})
    EXPECT_TRUE(std::filesystem::exists(folder / ("out/" + std::string(file)))) << file;
}

}  // namespace
}  // namespace toothprep::figures
