// Experiments as data: what is read, and what is refused with which words.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "scratch_folder.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep::figures {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using toothprep::testing::ScratchFolder;

const std::string kShipped = std::string(TOOTHPREP_SOURCE_DIR) + "/data/figures";

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(Experiment, EveryShippedOneIsWholeAndItsFilesRead) {
  const auto folders = find_experiments(kShipped, {});
  EXPECT_GE(folders.size(), 10u);
  for (const std::string& folder : folders) {
    const Experiment e = read_experiment(folder);
    EXPECT_FALSE(e.title.empty());
    for (const figures::Run& run : e.runs) {
      const Parameters p = parameters_of(run, preset_parameters("paper"), !run.literal.empty());
      EXPECT_NO_THROW(validate(p)) << e.name;
      if (e.kind == Kind::kTransparency) continue;  // its paths are its own
      EXPECT_GT(read_script(run.trajectory).samples.size(), 100u) << e.name;
    }
  }
}

TEST(Experiment, IsChosenByNumberOrByName) {
  const auto names = [](const std::vector<std::string>& only) {
    std::vector<std::string> result;
    for (const std::string& path : find_experiments(kShipped, only))
      result.push_back(path.substr(path.rfind('/') + 1));
    return result;
  };
  EXPECT_THAT(names({"9", "16"}), ElementsAre("figure-09", "figure-16"));
  EXPECT_THAT(names({"figure-12", "handpiece"}), ElementsAre("figure-12", "handpiece"));
}

TEST(Experiment, AChoiceThatNothingMatchesNamesWhatThereIs) {
  EXPECT_THAT(error_of([] { find_experiments(kShipped, {"17"}); }),
              ::testing::AllOf(HasSubstr("\"17\""), HasSubstr("figure-09")));
  EXPECT_THAT(error_of([] { find_experiments(kShipped, {""}); }), HasSubstr("no experiment"));
  EXPECT_THAT(error_of([] { find_experiments("absent", {}); }), HasSubstr("absent"));
}

TEST(Experiment, WhatIsWrongIsNamedByItsKey) {
  const std::string whole =
      "kind = 'plateaus'\nbur = 'ball:D1.2'\ntrajectory = 'path.toml'\ndrive = 'direct'\n";
  const std::vector<std::pair<std::string, std::string>> table = {
      {"", "kind: is missing"},
      {"kind = 'plateau'", "did you mean \"plateaus\"?"},
      {"kind = 'plateaus'\nbur = 'ball:D1'", "trajectory: is missing"},
      {"kind = 'plateaus'\ntrajectory = 'p'", "bur: is missing"},
      {whole + "drives = 'direct'", "did you mean 'drive'?"},
      {whole + "[block]\nenamel = 2", "did you mean 'enamel_mm'?"},
      {whole + "specimen = 'molar'\n[block]\nenamel_mm = 2", "block: stands beside"},
      {whole + "[[run]]\nname = '../x'", "run[0].name: must be letters"},
      {whole + "[[run]]\nname = 'a'\n[[run]]\nname = 'a'", "run[1].name: \"a\" stands twice"},
      {whole + "[[run]]\nname = 'a'\nafter = 'b'", "run[0].after: \"b\" is no earlier run"},
      {"kind = 'literal'\nbur = 'ball:D1'\ntrajectory = 'p'", "literal: is missing"},
      {"kind = 'closed-loop'\nbur = 'ball:D1'\ntrajectory = 'p'", "map: is missing"},
      {"kind = 'feasibility'\nbur = 'ball:D1'\ntrajectory = 'p'", "map: is missing"},
      {"kind = 'feasibility'\n[map]\nengaged_mm = [1.0]", "map.rotation_rates_rev_s: is missing"},
      {"kind = 'transparency'\nbur = 'b'", "device: is missing"},
      {"kind = 'transparency'\n[[device]]\nname = 'a/b'", "device[0].name: must be letters"},
      {"kind = 'transparency'\n[[device]]\nname = 'a'\nencoder_count_mm = 0.0",
       "device[0].encoder_count_mm: must be positive"},
      {"kind = 'transparency'\n[[device]]\nname = 'a'\nrecommended_damping_n_s_per_m = -1",
       "device[0].recommended_damping_n_s_per_m: must not be negative"},
      {"kind = 'transparency'\n[[device]]\nname = 'a'", "grid: is missing"},
      {"kind = 'ablations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\nlayers = 'one'",
       "layers: \"one\" is not known"},
      {"kind = 'ablations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\nlayers = 'met'\n"
       "engine = 'levelset'",
       "layers: must be \"two\""},
      {"kind = 'ablations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\nfilter_hz = 3",
       "filter_hz: is of direct drive only"},
      {"kind = 'ablations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\ndrive = 'direct'\n"
       "integrator = 'explicit'",
       "integrator: must be \"backward\""},
      {"kind = 'ablations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\nequal_area = 8",
       "equal_area: must be 6, 18 or 26"},
      {"kind = 'preparations'\nbur = 'b'\ntrajectory = 'p'\n[[run]]\nname = 'a'\n"
       "block = { enamel_mm = 1.0 }",
       "block: stands at the top"},
      {whole + "[[run]]\nname = 'a'\nlayers = 'met'", "layers"},
      {whole + "[device]\napparent_mass_g = -1", "mass"},
      {whole + "[hand]\nstiffness_n_per_m = nan", "stiffness"},
      {whole + "[map]\ndampings_n_s_per_m = [0.0]", "map.dampings_n_s_per_m: must be positive"},
  };
  for (const auto& [text, words] : table) {
    const ScratchFolder folder("experiment");
    folder.write("mine/experiment.toml", text);
    EXPECT_THAT(error_of([&] { read_experiment(folder / "mine"); }),
                ::testing::AllOf(HasSubstr("experiment.toml"), HasSubstr(words)))
        << text;
  }
}

TEST(Experiment, RunsInheritWhatStandsAtTheTop) {
  const ScratchFolder folder("inherit");
  folder.write("mine/experiment.toml",
               "kind = 'stall'\nbur = 'ball:D1.2'\nparams = 'p.toml'\n"
               "block = { size_mm = [4.0, 5.0, 6.0], enamel_mm = 3.0 }\n"
               "[[run]]\nname = 'one'\ntrajectory = 'a.toml'\n"
               "[[run]]\nname = 'two'\ntrajectory = 'b.toml'\nbur = 'ball:D1.0'\nafter = 'one'\n"
               "block = { enamel_mm = 1.0 }\n");
  const Experiment e = read_experiment(folder / "mine");
  ASSERT_EQ(e.runs.size(), 2u);
  EXPECT_EQ(e.runs[0].bur, "ball:D1.2");
  EXPECT_EQ(e.runs[1].bur, "ball:D1.0");
  EXPECT_EQ(e.runs[1].params, folder / "mine/p.toml");
  EXPECT_EQ(e.runs[1].after, "one");
  EXPECT_EQ(e.runs[0].block.enamel, 3.0);
  EXPECT_EQ(e.runs[0].block.size, Vec3(4, 5, 6));
  EXPECT_EQ(e.runs[1].block.enamel, 1.0);
  EXPECT_EQ(e.runs[1].block.size, Vec3(4, 5, 6));
}

TEST(Experiment, ItsParametersWinOverTheUsersAndOthersStay) {
  const ScratchFolder folder("params");
  folder.write("p.toml", "[handpiece]\nstall_torque_mnm = inf\n");
  Parameters base = preset_parameters("paper");
  base.tissue[0].specific_energy = 600;
  figures::Run run;
  run.params = folder / "p.toml";
  const Parameters p = parameters_of(run, base);
  EXPECT_TRUE(std::isinf(p.handpiece.stall_torque));
  EXPECT_EQ(p.tissue[0].specific_energy, 600);
}

}  // namespace
}  // namespace toothprep::figures
