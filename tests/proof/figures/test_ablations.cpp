// The step with a part taken out: nothing taken out is the step itself, and each part that is
// missing shows.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "scratch_folder.h"
#include "toothprep/proof/figures/ablated_session.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/proof/figures/figures.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/session.h"

namespace toothprep::figures {
namespace {

using toothprep::testing::ScratchFolder;

constexpr double kFeed = 0.5;  // mm/s

Parameters parameters_with(EngineKind engine) {
  Parameters p = preset_parameters("paper");
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  p.engine = engine;
  return p;
}

// A ball of 1 mm into a small block of dentin, from just above its top face.
struct Scene {
  LayeredTooth tooth;
  Bur bur = bur_from_shorthand("ball:D1.0");
  Scene() {
    BlockOptions block;
    block.size = Vec3(2, 2, 2);
    block.enamel = 0;
    block.voxel = 0.1;
    tooth = make_block(block);
  }
  static HandleSample handle(int step, int stop = 1 << 20) {
    HandleSample s;
    s.time = 1e-3 * step;
    s.pose.position = Vec3(0, 0.52 - kFeed * 1e-3 * std::min(step, stop), -0.5);
    s.buttons = kPedalButton;
    return s;
  }
};

TEST(Ablations, WithNothingTakenOutTheRowsAreTheSessionsOwn) {
  for (const EngineKind engine : {EngineKind::kVoxel, EngineKind::kLevelset})
    for (const Drive drive : {Drive::kCoupled, Drive::kDirect}) {
      const Scene scene;
      const Parameters p = parameters_with(engine);
      Workpiece a(scene.tooth), b(scene.tooth);
      Session session(scene.bur, a, p, drive, Scene::handle(0));
      AblatedSession same(scene.bur, b, p, drive, {}, Scene::handle(0));
      for (int i = 1; i < 1200; ++i) {
        const StepRecord s = session.step(Scene::handle(i)), t = same.step(Scene::handle(i));
        ASSERT_EQ(s.grinding_force, t.grinding_force) << i;
        ASSERT_EQ(s.device_force, t.device_force) << i;
        ASSERT_EQ(s.bur.position, t.bur.position) << i;
        ASSERT_EQ(s.removed_volume, t.removed_volume) << i;
      }
      EXPECT_EQ(session.totals().torque_work, same.torque_work());
      EXPECT_GT(same.torque_work(), 0);
    }
}

// Steps without a force, of the last half of a path of 1.2 s in tissue.
double without_contact(Layers layers) {
  const Scene scene;
  Workpiece workpiece(scene.tooth);
  AblatedSession session(scene.bur, workpiece, parameters_with(EngineKind::kVoxel), Drive::kDirect,
                         {layers}, Scene::handle(0));
  int lost = 0;
  for (int i = 1; i < 1200; ++i)
    lost += session.step(Scene::handle(i)).grinding_force.norm() < 1e-9 && i >= 600;
  return lost / 600.0;
}

TEST(Ablations, WithoutTheSecondLayerContactIsLost) {
  EXPECT_EQ(without_contact(Layers::kTwo), 0);
  // What the surface meets goes at once: the next voxel comes after some way.
  EXPECT_GT(without_contact(Layers::kMet), 0.1);
}

// Mean force against the feed of a ball in full contact over its closed form.
double force_with_equal_areas(int neighbours) {
  const Scene scene;
  Workpiece workpiece(scene.tooth);
  const Parameters p = parameters_with(EngineKind::kVoxel);
  Ablation ablation;
  ablation.equal_area = neighbours;
  AblatedSession session(scene.bur, workpiece, p, Drive::kDirect, ablation, Scene::handle(0));
  double sum = 0;
  for (int i = 1; i <= 2400; ++i) {
    const double force = session.step(Scene::handle(i)).grinding_force.y();
    if (i > 1400) sum += force / 1000;
  }
  const GrindingProperties& dentin = p.tissue[1];
  const reference::Grinding g{dentin.specific_energy, dentin.force_ratio,
                              p.handpiece.rotation_rate};
  return sum / reference::ball_side_feed(g, 0.5, kFeed).against;
}

TEST(Ablations, TheSameAreaForEveryBoundaryVoxelIsBiased) {
  EXPECT_NEAR(force_with_equal_areas(0), 1, 0.03);  // the true surface's areas
  EXPECT_LT(force_with_equal_areas(6), 0.9);        // too few voxels are boundary
  EXPECT_GT(force_with_equal_areas(26), 1.05);      // too many
}

TEST(Ablations, ExplicitEulerDivergesWhereBackwardEulerDoesNot) {
  // 2 m/h = 0.016 N·s/mm is far below the ball's resistance.
  for (const Integrator integrator :
       {Integrator::kBackward, Integrator::kSemiImplicit, Integrator::kExplicit}) {
    const Scene scene;
    Workpiece workpiece(scene.tooth);
    AblatedSession session(scene.bur, workpiece, parameters_with(EngineKind::kVoxel),
                           Drive::kCoupled, {Layers::kTwo, integrator}, Scene::handle(0));
    double fastest = 0;
    for (int i = 1; i < 1200 && !session.diverged(); ++i)
      fastest = std::max(fastest, session.step(Scene::handle(i)).bur_velocity.norm());
    const bool backward = integrator == Integrator::kBackward;
    EXPECT_EQ(session.diverged(), !backward);
    if (backward) {
      EXPECT_LT(fastest, 2.5 * kFeed);  // the handle starts at once: it overshoots
    }
  }
}

TEST(Ablations, AFilteredVelocityLagsByTheTimeOfItsCutoff) {
  const double cutoff = 10;
  Ablation ablation;
  ablation.filter_hz = cutoff;
  const Scene scene;
  Workpiece workpiece(scene.tooth);
  AblatedSession session(scene.bur, workpiece, parameters_with(EngineKind::kLevelset),
                         Drive::kDirect, ablation, Scene::handle(0));
  constexpr int kStop = 1000;
  double before = 0;
  for (int i = 1; i <= kStop; ++i)
    before = session.step(Scene::handle(i, kStop)).grinding_force.norm();
  ASSERT_GT(before, 0);
  int steps = 0;
  while (session.step(Scene::handle(kStop + ++steps, kStop)).grinding_force.norm() >
             before / std::exp(1.0) &&
         steps < 1000) {
  }
  EXPECT_NEAR(steps * 1e-3, 1 / (2 * units::kPi * cutoff), 1.1e-3);  // to a step
}

TEST(Ablations, ExplicitVelocityIsTheForceOverTheMass) {
  const Coupling c;
  const CouplingState s{Vec3::Zero(), Vec3(1, 0, 0), Vec3(0.01, 0, 0), Vec3(0.5, 0, 0)};
  // 0.01 N of the spring less 0.004 N of the drag on 8 g for a ms.
  const Vec3 v = explicit_velocity(c, 1e-3, s, -0.004 * Mat3::Identity(), Vec3::Zero());
  EXPECT_NEAR(v.x(), 1 + 1e-3 / 8e-6 * (0.01 - 0.004), 1e-9);
}

std::vector<FigureReport> run_in(const ScratchFolder& folder) {
  FigureOptions o;
  o.experiments = find_experiments(folder / "in", {});
  o.voxel = 0.15;
  o.base = preset_parameters("paper");
  o.version = "test";
  o.output = folder / "out";
  std::filesystem::create_directories(o.output);
  return run_figures(o);
}

TEST(Ablations, ASmallExperimentHasOneRowOfFiguresPerRun) {
  const ScratchFolder folder("ablations");
  folder.write("in/small/experiment.toml",
               "kind = 'ablations'\nbur = 'ball:D1.2'\ntrajectory = 'path.toml'\n"
               "params = 'params.toml'\n[block]\nsize_mm = [2.0, 4.0, 2.0]\nenamel_mm = 0.0\n"
               "[[run]]\nname = 'direct'\ndrive = 'direct'\n"
               "[[run]]\nname = 'met'\ndrive = 'direct'\nlayers = 'met'\n"
               "[[run]]\nname = 'explicit'\nintegrator = 'explicit'\n"
               "[[run]]\nname = 'filtered'\ndrive = 'direct'\nengine = 'levelset'\n"
               "filter_hz = 10.0\n");
  folder.write("in/small/params.toml", "[handpiece]\nstall_torque_mnm = inf\n");
  folder.write("in/small/path.toml",
               "start_mm = [0.0, 0.62, -0.6]\n[[segment]]\nkind = 'line'\n"
               "to_mm = [0.0, -1.4, -0.6]\nspeed_mm_s = 0.5\n"
               "[[segment]]\nkind = 'hold'\nduration_s = 0.2\n");
  const FigureReport report = run_in(folder).at(0);
  ASSERT_EQ(report.tables.size(), 1u);
  ASSERT_EQ(report.tables[0].rows.size(), 4u);
  for (const MetricTable::Row& row : report.tables[0].rows)
    EXPECT_EQ(row.values.size(), report.tables[0].columns.size());
  const std::vector<double>& explicitly = report.tables[0].rows[2].values;
  EXPECT_TRUE(std::isnan(explicitly.front()));  // nothing to judge
  EXPECT_GT(explicitly.back(), 0);              // it diverges after this time
  for (const Claim& c : report.claims)
    EXPECT_TRUE(c.holds) << c.claim << ": " << c.quantity << ": " << c.expected << " "
                         << c.measured;
  for (const char* file : {"small/direct.csv", "small/met.csv", "figures.md"})
    EXPECT_TRUE(std::filesystem::exists(folder / ("out/" + std::string(file)))) << file;
}

TEST(Feasibility, TheMapHoldsWhatTheClosedFormsSay) {
  const ScratchFolder folder("feasibility");
  folder.write("in/small/experiment.toml",
               "kind = 'feasibility'\nbur = 'cylinder:D1.2xL1.0'\ntrajectory = 'path.toml'\n"
               "params = 'params.toml'\n[block]\nsize_mm = [2.0, 4.0, 2.0]\nenamel_mm = 1.0\n"
               "[stated]\nstall_torque_mnm = 0.4\n"
               "[map]\nrotation_rates_rev_s = [50.0, 100.0]\nstiffnesses_n_per_mm = [1.0, 2.0]\n"
               "engaged_mm = [1.0, 0.5]\n");
  folder.write("in/small/params.toml", "[handpiece]\nstall_torque_mnm = inf\n");
  folder.write("in/small/path.toml",
               "start_mm = [0.0, 0.65, -0.5]\n[[segment]]\nkind = 'line'\n"
               "to_mm = [0.0, -3.0, -0.5]\nspeed_mm_s = 0.5\n");
  const FigureReport report = run_in(folder).at(0);
  ASSERT_EQ(report.maps.size(), 2u);
  // Half the length at half the rate is the same; so is twice the stiffness at half of N/L.
  EXPECT_NEAR(report.maps[0].values[0][1], report.maps[1].values[0][0], 1e-3);
  EXPECT_NEAR(report.maps[0].values[1][0], report.maps[0].values[0][1], 1e-3);
  for (const Claim& c : report.claims)
    if (c.claim.find("is exact") != std::string::npos ||
        c.claim.find("gives N only") != std::string::npos) {
      EXPECT_TRUE(c.holds) << c.claim << ": " << c.quantity << ": " << c.expected << " "
                           << c.measured;
    }
  // pi tau_s/(4 alpha R v) = 2.244 N·s/mm whatever N and L: not the stated 4.
  for (const Claim& c : report.claims)
    if (c.claim == "Stall and resistance agree") {
      EXPECT_NEAR(c.measured, units::kPi * 0.4 / (4 * 0.25 * 0.6 * 0.7), 1e-9);
      EXPECT_FALSE(c.holds);
    }
  EXPECT_TRUE(std::filesystem::exists(folder / "out/small/map.csv"));
}

}  // namespace
}  // namespace toothprep::figures
