// Whole experiments, small: what they write, that they repeat, and that they see what is wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <filesystem>
#include <sstream>

#include "scratch_folder.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/proof/figures/figures.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::figures {
namespace {

using toothprep::testing::ScratchFolder;
using toothprep::testing::text_of;

// A ball through 1 mm of enamel into dentin, coarse and quick.
void write_small(const ScratchFolder& folder, const std::string& extra = "") {
  folder.write("in/small/experiment.toml",
               "kind = 'plateaus'\ndrive = 'direct'\nbur = 'ball:D1.2'\ntrajectory = 'path.toml'\n"
               "params = 'params.toml'\n[block]\nsize_mm = [3.0, 6.0, 3.0]\nenamel_mm = 3.0\n");
  folder.write("in/small/params.toml", "[handpiece]\nstall_torque_mnm = inf\n" + extra);
  folder.write(
      "in/small/path.toml",
      "start_mm = [0.0, 0.7, -0.6]\n[[segment]]\nkind = 'line'\nto_mm = [0.0, -5.2, -0.6]\n"
      "speed_mm_s = 1.5\n");
}

FigureOptions options_of(const ScratchFolder& folder, const std::string& output) {
  FigureOptions o;
  o.experiments = find_experiments(folder / "in", {});
  o.voxel = 0.1;
  o.base = preset_parameters("paper");
  o.version = "test";
  o.output = folder / output;
  std::filesystem::create_directories(o.output);
  return o;
}

TEST(Figures, ASmallExperimentHoldsAndLeavesItsFiles) {
  const ScratchFolder folder("small");
  write_small(folder);
  const std::vector<FigureReport> reports = run_figures(options_of(folder, "out"));
  ASSERT_EQ(reports.size(), 1u);
  EXPECT_GT(reports[0].claims.size(), 10u);
  for (const Claim& c : reports[0].claims)
    if (c.engine != "voxel") {
      EXPECT_TRUE(c.holds) << c.claim << ": " << c.quantity << ": " << c.expected << " "
                           << c.measured;
    }
  ASSERT_EQ(reports[0].runs.size(), 6u);  // two engines at three voxel sizes
  for (const char* file : {"figures.json", "figures.md", "small/levelset.h5", "small/voxel.h5",
                           "small/exact.csv", "small/levelset.ply", "small/voxel.ply"})
    EXPECT_TRUE(std::filesystem::exists(folder / ("out/" + std::string(file)))) << file;
}

TEST(Figures, EveryRowOfTheTablesHasAsManyCellsAsItsHead) {
  const ScratchFolder folder("table");
  write_small(folder);
  run_figures(options_of(folder, "out"));
  std::istringstream lines(text_of(folder / "out/figures.md"));
  std::ptrdiff_t wanted = 0;
  int rows = 0;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_EQ(line.find(" 1 1 |"), std::string::npos) << "a pure number has no unit: " << line;
    std::ptrdiff_t cells = 0;
    for (std::size_t i = 0; i < line.size(); ++i)
      cells += line[i] == '|' && (i == 0 || line[i - 1] != '\\');
    if (line.starts_with("|")) {
      if (wanted == 0) wanted = cells;
      EXPECT_EQ(cells, wanted) << line;
      ++rows;
    } else {
      wanted = 0;
    }
  }
  EXPECT_GT(rows, 10);
}

TEST(Figures, ResultsDoNotDependOnTheNumberOfThreads) {
  const ScratchFolder folder("threads");
  write_small(folder);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    run_figures(options_of(folder, "one"));
  }
  run_figures(options_of(folder, "all"));
  for (const char* file :
       {"figures.json", "figures.md", "small/levelset.h5", "small/exact.csv", "small/voxel.ply"})
    EXPECT_EQ(text_of(folder / ("one/" + std::string(file))),
              text_of(folder / ("all/" + std::string(file))))
        << file;
}

TEST(Figures, AskedForOneEngineRunsOnlyThat) {
  const ScratchFolder folder("one-engine");
  write_small(folder);
  FigureOptions o = options_of(folder, "out");
  o.engines = {EngineKind::kVoxel};
  const std::vector<FigureReport> reports = run_figures(o);
  for (const RunReport& r : reports[0].runs) EXPECT_EQ(r.engine, "voxel");
  EXPECT_FALSE(std::filesystem::exists(folder / "out/small/levelset.h5"));
}

TEST(Figures, ClaimsFollowTheParameters) {
  // Twice the specific energy, twice the force: expected and measured alike.
  const ScratchFolder folder("params");
  write_small(folder);
  FigureOptions o = options_of(folder, "out");
  o.engines = {EngineKind::kLevelset};
  const double once = run_figures(o)[0].claims[0].measured;
  o.base.tissue[0].specific_energy *= 2;
  const Claim twice = run_figures(o)[0].claims[0];
  EXPECT_NEAR(twice.measured, 2 * once, 1e-6 * once);
  EXPECT_TRUE(twice.holds);
}

TEST(Figures, ABurTooThinForTheVoxelsIsRefused) {
  const ScratchFolder folder("thin");
  write_small(folder);
  FigureOptions o = options_of(folder, "out");
  o.voxel = 0.7;
  EXPECT_THROW(run_figures(o), Error);
}

TEST(Figures, AWrongParameterIsRefusedBeforeAnythingRuns) {
  const ScratchFolder folder("wrong");
  write_small(folder, "clockwice = true\n");
  try {
    run_figures(options_of(folder, "out"));
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("did you mean 'clockwise'?"));
  }
}

TEST(Figures, ADroopingHandpieceIsRefusedWhereTheExactAnswerKnowsNone) {
  const ScratchFolder folder("droop");
  write_small(folder);
  FigureOptions o = options_of(folder, "out");
  o.base = preset_parameters("physical");
  EXPECT_NO_THROW(run_figures(o));  // its own parameters never stall: no droop either
  folder.write("in/small/params.toml", "");
  try {
    run_figures(o);
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("small: its exact answer knows a fixed"));
  }
}

TEST(Figures, AnotherLawIsRefusedWhereTheExactAnswerKnowsThePapersOnly) {
  const ScratchFolder folder("law");
  write_small(folder);
  FigureOptions o = options_of(folder, "out");
  o.base.tissue[1].up_cutting = 0.2;
  try {
    run_figures(o);
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("small: what it is held against knows the paper's"));
  }
}

// Two passes of a ball side by side, right through the block.
void write_passes(const ScratchFolder& folder, double start) {
  const std::string x = std::to_string(start);
  folder.write("in/small/experiment.toml",
               "kind = 'passes'\ndrive = 'direct'\nbur = 'ball:D1.2'\ntrajectory = 'path.toml'\n"
               "params = 'params.toml'\n[block]\nsize_mm = [2.0, 2.0, 3.0]\nenamel_mm = 2.0\n");
  folder.write("in/small/params.toml", "[handpiece]\nstall_torque_mnm = inf\n");
  const auto line = [](const std::string& to) {
    return "[[segment]]\nkind = 'line'\nto_mm = [" + to + "]\nspeed_mm_s = 8.0\n";
  };
  folder.write("in/small/path.toml", "axis = [0.0, 1.0, 0.0]\nstart_mm = [-" + x +
                                         ", -0.3, 0.0]\n" + line(x + ", -0.3, 0.0") +
                                         line(x + ", -0.3, 0.3") + line("-" + x + ", -0.3, 0.3"));
}

TEST(Figures, OverlappingPassesHoldAgainstWhatTheyNewlySweep) {
  const ScratchFolder folder("passes");
  write_passes(folder, 2.5);
  const FigureReport report = run_figures(options_of(folder, "out")).at(0);
  ASSERT_EQ(report.claims.size(), 8u);  // work and force of two passes at two voxel sizes
  for (const Claim& c : report.claims)
    EXPECT_TRUE(c.holds) << c.claim << ": " << c.quantity << ": " << c.expected << " "
                         << c.measured;
}

TEST(Figures, APassThatEndsInTheBlockIsRefused) {
  const ScratchFolder folder("passes-inside");
  write_passes(folder, 1.5);
  try {
    run_figures(options_of(folder, "out"));
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), ::testing::HasSubstr("a pass must start and end at least"));
  }
}

}  // namespace
}  // namespace toothprep::figures
