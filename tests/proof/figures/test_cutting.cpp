// Published cutting tests: simulated cuts against closed forms, what is read, what is compared.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "scratch_folder.h"
#include "toothprep/proof/figures/cut_simulation.h"
#include "toothprep/proof/figures/experiment.h"
#include "toothprep/proof/figures/figures.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::figures {
namespace {

using ::testing::HasSubstr;
using toothprep::testing::ScratchFolder;

Parameters paper() {
  Parameters p = preset_parameters("paper");
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  return p;
}

TEST(Cutting, RemovalPerLoadOfSlotsIsTheClosedForm) {
  // Q/F = 4 alpha N D/u for a full slot; for half of it divided by 1 ± 2 alpha/pi, up or down.
  const double exact = 4 * 0.25 * 100 * 1.3 / 100;
  Cut cut;
  cut.diameter = 1.3;
  cut.length = 2;
  cut.load = 0.5;
  EXPECT_NEAR(simulate_cut(cut, paper()).removal_rate / 0.5, exact, 0.02 * exact);
  cut.geometry = CutGeometry::kHalfSlot;
  const double share = 2 * 0.25 / units::kPi;
  const double up = exact / (1 + share), down = exact / (1 - share);
  EXPECT_NEAR(simulate_cut(cut, paper()).removal_rate / 0.5, up, 0.03 * up);
  cut.climb = true;
  EXPECT_NEAR(simulate_cut(cut, paper()).removal_rate / 0.5, down, 0.03 * down);
}

TEST(Cutting, ShallowCutHasTheForcesOfItsPower) {
  // T omega = u a b v, F_t = T/R, F_n = F_t/alpha (a « R: one normal).
  Cut cut;
  cut.geometry = CutGeometry::kSkim;
  cut.tissue = Tissue::kEnamel;
  cut.length = 2;
  cut.depth = 0.05;
  cut.feed = 1;
  const double tangential = 300 * 0.05 * 2 * 1 / (2 * units::kPi * 100 * 0.6);
  const CutResult r = simulate_cut(cut, paper());
  EXPECT_NEAR(r.tangential, tangential, 0.03 * tangential);
  EXPECT_NEAR(r.normal, tangential / 0.25, 0.05 * tangential / 0.25);
  EXPECT_NEAR(r.energy_ratio, 1, 0.03);
}

TEST(Cutting, StallLoadIsThatOfTheFullSlot) {
  // F = pi tau/(4 alpha R).
  CuttingTest test;
  test.quantity = Quantity::kStallLoad;
  Cut cut;
  cut.load = 1;
  cut.length = 1;
  KnownCuts known;
  const std::vector<double> loads =
      predict(test, {cut}, preset_parameters("physical"), known).values;
  ASSERT_EQ(loads.size(), 1U);
  EXPECT_NEAR(loads[0], units::kPi / (4 * 0.25 * 0.6), 0.02 * loads[0]);
}

TEST(Cutting, KnownCutsAreThoseOfTheSameCutAndParameters) {
  Cut cut;
  cut.geometry = CutGeometry::kSkim;
  cut.depth = 0.1;
  cut.feed = 4;
  KnownCuts known;
  const double torque = simulate_cut(cut, paper()).torque;
  for (int times = 0; times < 2; ++times) EXPECT_EQ(known.simulate(cut, paper()).torque, torque);
  Parameters half = paper();
  for (GrindingProperties& tissue : half.tissue) tissue.specific_energy /= 2;
  EXPECT_NEAR(known.simulate(cut, half).torque, torque / 2, 1e-6 * torque);
  cut.length /= 2;
  EXPECT_NEAR(known.simulate(cut, paper()).torque, torque / 2, 0.02 * torque);
}

TEST(Cutting, AnElectricHandpieceReplacesOnlyOneThatDroops) {
  Cut cut;
  cut.electric_rate = 3333;
  EXPECT_EQ(parameters_for(cut, preset_parameters("physical")).handpiece.rotation_rate, 3333);
  EXPECT_EQ(parameters_for(cut, preset_parameters("physical")).handpiece.model,
            HandpieceModel::kFixed);
  EXPECT_EQ(parameters_for(cut, preset_parameters("paper")).handpiece.rotation_rate, 100);
}

// A folder with one test, run; its report.
nlohmann::json report_of(const std::string& test) {
  const ScratchFolder folder("cutting");
  folder.write("in/own/experiment.toml", "kind = \"validation\"\nmeasurements = \"m\"\n");
  folder.write("in/own/m/measurements.csv", "id,value\nM01,1\n");
  folder.write("in/own/m/tests/one.toml", test);
  folder.write("out/x", "");
  FigureOptions o;
  o.experiments = find_experiments(folder / "in", {});
  o.base = preset_parameters("paper");
  o.output = folder / "out";
  run_figures(o);
  return nlohmann::json::parse(
      toothprep::testing::text_of(folder / "out/figures.json"))["figures"][0];
}

const std::string kSlot =
    "[cut]\ntissue = 'dentin'\ndiameter_mm = [1.2]\nlength_mm = [1]\nload_n = [0.3]\n";

TEST(Cutting, WhatIsOutsideTheBandIsSaidToBe) {
  // `paper`: Q = 4 alpha N D F/u = 0.36 mm³/s; `physical`, without droop yet, 0.82 mm³/s.
  const auto j =
      report_of("quantity = 'removal_rate_mm3_s'\nrows = ['M01']\nmeasured = [0.3, 0.5]\n" + kSlot);
  ASSERT_EQ(j["comparisons"].size(), std::size(kPresets));
  EXPECT_EQ(j["comparisons"][0]["parameters"], "paper");
  EXPECT_EQ(j["comparisons"][0]["verdict"], "inside");
  EXPECT_NEAR(j["comparisons"][0]["ratio"], 0.36 / std::sqrt(0.15), 0.02);
  EXPECT_EQ(j["comparisons"][1]["verdict"], "above");
  EXPECT_EQ(j["comparisons"][1]["rows"], "M01");
}

TEST(Cutting, ATrendIsTheSignOfTheChange) {
  const auto j = report_of("quantity = 'feed_mm_s'\nobserved = 'level'\n" + kSlot +
                           "[second]\nrate_factor = [2]\n");
  ASSERT_EQ(j["trends"].size(), std::size(kPresets));
  EXPECT_EQ(j["trends"][0]["predicted"], "rises");
  EXPECT_NEAR(j["trends"][0]["factor"], 2, 0.02);
  EXPECT_FALSE(j["trends"][0]["agrees"]);
}

TEST(Cutting, TestsThatAreWrongAreRefusedWithTheKey) {
  const auto error_of = [](const std::string& text) -> std::string {
    try {
      report_of(text);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  };
  const std::string head = "quantity = 'feed_mm_s'\nmeasured = [1, 2]\n";
  EXPECT_THAT(error_of("measured = [1, 2]\n" + kSlot), HasSubstr("quantity"));
  EXPECT_THAT(error_of("quantity = 'feed_mm_s'\n" + kSlot), HasSubstr("measured"));
  EXPECT_THAT(error_of(head), HasSubstr("[cut]"));
  EXPECT_THAT(error_of("rows = ['M99']\n" + head + kSlot), HasSubstr("\"M99\" is not in"));
  EXPECT_THAT(error_of(head + kSlot + "feed_mm_s = [1]\n"), HasSubstr("load_n"));
  EXPECT_THAT(error_of(head + kSlot + "geometry = 'skim'\n"), HasSubstr("depth_mm"));
  EXPECT_THAT(error_of(head + kSlot + "way_mm = [0]\n"), HasSubstr("way_mm: must be positive"));
  EXPECT_THAT(error_of(head + kSlot + "density = [1]\n"), HasSubstr("density"));
}

TEST(Cutting, TheShippedTestsAreReadAndNameRowsThatThereAre) {
  const auto tests = read_cutting_tests(std::string(TOOTHPREP_SOURCE_DIR) + "/data/validation");
  EXPECT_GE(tests.size(), 25U);
  for (const CuttingTest& test : tests) EXPECT_FALSE(test.assumes.empty()) << test.name;
}

}  // namespace
}  // namespace toothprep::figures
