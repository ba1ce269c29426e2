#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/score/definitions.h"
#include "toothprep/tools/score/rubric.h"

namespace toothprep {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kHead = "name = 'Test'\ntype = 'class1'\nsource = 'made up'\npass_points = 60\n";
// The floor's tilt: full points to 5 degrees, none from 10, failed from 20.
const std::string kTilt =
    "[[criterion]]\nkey = 'floor_tilt_deg'\nunit = 'deg'\nideal = [-inf, 5]\ntolerated = [-inf, "
    "10]\n"
    "hard_fail = [-inf, 20]\nweight = 2\nsource = 's'\ntoo_high = 'the floor is tilted'\n";
const std::string kDepth =
    "[[criterion]]\nkey = 'depth_mm'\nname = 'depth'\nunit = 'mm'\nideal = [1.5, 2.0]\n"
    "tolerated = [1.0, 2.5]\nweight = 3\nsource = 's'\ntoo_low = 'cut too shallow'\n"
    "too_high = 'cut too deep'\n";
const std::string kWalls =
    "[[criterion]]\nkey = 'wall_angles_deg.*'\nname = 'wall angle'\nunit = 'deg'\nideal = [-6, 6]\n"
    "tolerated = [-12, 20]\nweight = 1\nsource = 's'\n";

Rubric rubric(const std::string& criteria) { return parse_rubric(kHead + criteria, "r.toml"); }

Quantity tilt(double value, double u = NAN) { return {"floor_tilt_deg", value, u, "deg"}; }
Quantity depth(double value, double u = NAN) { return {"depth_mm", value, u, "mm"}; }

CriterionResult judged(const std::string& criterion, const Quantities& quantities) {
  return judge(rubric(criterion), quantities).criteria.at(0);
}

std::string error_of(const std::string& toml) {
  try {
    static_cast<void>(parse_rubric(toml, "r.toml"));
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

// ---- Credit

TEST(Rubric, IdealGivesFullPointsToItsVeryEnds) {
  for (const double x : {1.5, 1.7, 2.0}) {
    const CriterionResult r = judged(kDepth, {depth(x)});
    EXPECT_EQ(r.points, 3);
    EXPECT_EQ(r.verdict, CriterionVerdict::kIdeal);
  }
}

TEST(Rubric, PointsFallLinearlyFromIdealToTolerated) {
  // On either side, 1/5 of the way out costs 1/5 of the points.
  EXPECT_NEAR(judged(kDepth, {depth(2.1)}).points, 3 * 0.8, 1e-12);
  EXPECT_NEAR(judged(kDepth, {depth(1.4)}).points, 3 * 0.8, 1e-12);
  EXPECT_NEAR(judged(kDepth, {depth(2.4)}).points, 3 * 0.2, 1e-12);
  EXPECT_EQ(judged(kDepth, {depth(2.4)}).verdict, CriterionVerdict::kTolerated);
  EXPECT_NEAR(judged(kDepth, {depth(2.5)}).points, 0, 1e-12);
}

TEST(Rubric, OutsideToleratedGivesNothing) {
  for (const double x : {0.0, 0.99, 2.51, 100.0}) {
    const CriterionResult r = judged(kDepth, {depth(x)});
    EXPECT_EQ(r.points, 0);
    EXPECT_EQ(r.verdict, CriterionVerdict::kOutside);
    EXPECT_FALSE(r.failed);
  }
}

TEST(Rubric, AnOpenEndHasNoLimit) {
  EXPECT_EQ(judged(kTilt, {tilt(-40)}).points, 2);
  EXPECT_EQ(judged(kTilt, {tilt(0)}).points, 2);
}

TEST(Rubric, WithoutToleratedItIsAllOrNothing) {
  const std::string c = with(kDepth, "tolerated = [1.0, 2.5]\n", "");
  EXPECT_EQ(judged(c, {depth(2.0)}).points, 3);
  EXPECT_EQ(judged(c, {depth(2.001)}).points, 0);
}

TEST(Rubric, TheTotalIsPointsOverWeightsInPercent) {
  // 3 * 0.8 + 2 * 1 of 5 points.
  const RubricResult r = judge(rubric(kDepth + kTilt), {tilt(3), depth(2.1)});
  ASSERT_TRUE(r.points_percent.has_value());
  EXPECT_NEAR(*r.points_percent, 88, 1e-9);
  EXPECT_TRUE(r.passed);
  EXPECT_TRUE(r.certain);
  EXPECT_TRUE(r.fail_reasons.empty());
  EXPECT_TRUE(r.notes.empty());
}

TEST(Rubric, ThePassLimitItselfPasses) {
  // 3 of 5 points are 60 %.
  const RubricResult r = judge(rubric(kDepth + kTilt), {tilt(12), depth(1.7)});
  EXPECT_NEAR(*r.points_percent, 60, 1e-9);
  EXPECT_TRUE(r.passed);
}

// Neither won nor lost, also where the rubric requires it and would fail the whole by it.
TEST(Rubric, WhatTheInputHasNotGotIsNotJudgedThoughRequired) {
  const std::string text = kDepth + kTilt + "required = true\n";
  const RubricResult r =
      judge(rubric(text), {depth(1.7)}, {{"floor_tilt_deg", "the original has no floor"}});
  const CriterionResult& c = r.criteria.at(1);
  EXPECT_EQ(c.verdict, CriterionVerdict::kNotJudged);
  EXPECT_EQ(c.of, 0);
  EXPECT_EQ(c.reason,
            "floor tilt is not judged: the original has no floor; its weight is left out");
  EXPECT_NEAR(*r.points_percent, 100, 1e-9);
  EXPECT_TRUE(r.passed);
  EXPECT_THAT(r.notes, ::testing::Contains(c.reason));
  // Of a figure that is there nothing changes.
  EXPECT_EQ(
      judge(rubric(text), {depth(1.7), tilt(25)}, {{"floor_tilt_deg", "x"}}).criteria.at(1).verdict,
      CriterionVerdict::kOutside);
}

TEST(Rubric, TooFewPointsFailAndSaySo) {
  const RubricResult r = judge(rubric(kDepth + kTilt), {tilt(3), depth(9)});
  EXPECT_FALSE(r.passed);
  EXPECT_THAT(r.fail_reasons, ElementsAre("40.0 % of the points, below the 60.0 % that pass"));
}

TEST(Rubric, AHardFailFailsWhateverThePoints) {
  const std::string light = with(kTilt, "weight = 2", "weight = 0.01");
  const RubricResult r = judge(rubric(kDepth + light), {tilt(25), depth(1.7)});
  EXPECT_GT(*r.points_percent, 99);
  EXPECT_FALSE(r.passed);
  EXPECT_THAT(r.fail_reasons, ElementsAre("floor tilt is 25.0°, above the most that can pass, "
                                          "20.0°: the floor is tilted"));
}

TEST(Rubric, HardFailTrueTakesTheTolerated) {
  const std::string c = with(kTilt, "hard_fail = [-inf, 20]", "hard_fail = true");
  EXPECT_FALSE(judged(c, {tilt(10)}).failed);
  EXPECT_TRUE(judged(c, {tilt(10.01)}).failed);
  const std::string never = with(kTilt, "hard_fail = [-inf, 20]", "hard_fail = false");
  EXPECT_FALSE(judged(never, {tilt(90)}).failed);
}

// ---- Groups

TEST(Rubric, AGroupIsJudgedByItsWorstMember) {
  const CriterionResult r = judged(kWalls, {{"wall_angles_deg.mesial", 3, NAN, "deg"},
                                            {"wall_angles_deg.distal", 13, NAN, "deg"},
                                            {"wall_angles_deg.buccal", -9, NAN, "deg"}});
  // Distal: (20 - 13)/14 = 0.5; buccal: (12 - 9)/6 = 0.5 as well, but less far out.
  EXPECT_EQ(r.key, "wall_angles_deg.distal");
  EXPECT_NEAR(r.points, 0.5, 1e-12);
  EXPECT_THAT(r.reason, HasSubstr("wall angle (distal) is 13.0°, above the ideal 6.0°"));
}

TEST(Rubric, AFailedMemberIsWorseThanOneFurtherOut) {
  const std::string c = kWalls + "hard_fail = [-15, 90]\n";
  const CriterionResult r = judged(
      c, {{"wall_angles_deg.mesial", 40, NAN, "deg"}, {"wall_angles_deg.distal", -16, NAN, "deg"}});
  EXPECT_EQ(r.key, "wall_angles_deg.distal");
  EXPECT_TRUE(r.failed);
}

// ---- What is missing

TEST(Rubric, AMissingQuantityIsLeftOutAndSaid) {
  const RubricResult r = judge(rubric(kDepth + kTilt), {depth(2.1)});
  EXPECT_NEAR(*r.points_percent, 80, 1e-9);
  EXPECT_EQ(r.criteria[1].verdict, CriterionVerdict::kNotJudged);
  EXPECT_EQ(r.criteria[1].of, 0);
  EXPECT_THAT(r.criteria[1].reason, HasSubstr("was not measured"));
  EXPECT_THAT(r.notes, ElementsAre("1 of 2 criteria could not be judged; their weight, 2, is left "
                                   "out of the total"));
}

TEST(Rubric, AMissingRequiredQuantityCostsItsPoints) {
  const RubricResult r = judge(rubric(kDepth + kTilt + "required = true\n"), {depth(1.7)});
  EXPECT_NEAR(*r.points_percent, 60, 1e-9);
  EXPECT_EQ(r.criteria[1].verdict, CriterionVerdict::kOutside);
  EXPECT_THAT(r.criteria[1].reason, HasSubstr("requires it"));
}

TEST(Rubric, ANumberThatIsNotFiniteCountsAsMissing) {
  EXPECT_EQ(judged(kTilt, {tilt(NAN)}).verdict, CriterionVerdict::kNotJudged);
  EXPECT_EQ(judged(kTilt, {tilt(INFINITY)}).verdict, CriterionVerdict::kNotJudged);
}

TEST(Rubric, NothingToJudgeIsNoPass) {
  const RubricResult r = judge(rubric(kTilt), {});
  EXPECT_FALSE(r.points_percent.has_value());
  EXPECT_FALSE(r.passed);
  EXPECT_EQ(r.fail_reasons.size(), 1u);
}

// ---- Uncertainty

TEST(Rubric, ALimitWithinTheUncertaintyMarksTheCriterion) {
  const CriterionResult r = judged(kTilt, {tilt(9, 2)});
  EXPECT_TRUE(r.uncertain);
  EXPECT_THAT(r.reason, HasSubstr("the limit of 10.0° is within its uncertainty, ±2.0°"));
  // Credit: 1/5 at 9; 0 at 11; 3/5 at 7.
  EXPECT_NEAR(r.points, 2 * 0.2, 1e-12);
  EXPECT_NEAR(r.points_low, 0, 1e-12);
  EXPECT_NEAR(r.points_high, 2 * 0.6, 1e-12);
  EXPECT_FALSE(judged(kTilt, {tilt(9, 0.5)}).uncertain);
  EXPECT_FALSE(judged(kTilt, {tilt(9)}).uncertain);
}

TEST(Rubric, AnIntervalOverTheWholeIdealRangeCanBeAllOfIt) {
  const CriterionResult r = judged(kDepth, {depth(1.2, 1.2)});  // 0 to 2.4
  EXPECT_NEAR(r.points_high, 3, 1e-12);
  EXPECT_NEAR(r.points_low, 0, 1e-12);
}

TEST(Rubric, TheVerdictSaysWhenItCouldHaveBeenTheOther) {
  // 3 of 5 points are sure, the tilt's two lie anywhere: pass by 60 %, whatever they are.
  EXPECT_TRUE(judge(rubric(kDepth + kTilt), {depth(1.7), tilt(9, 4)}).certain);
  // A hard fail within reach.
  const RubricResult r = judge(rubric(kDepth + kTilt), {depth(1.7), tilt(18, 4)});
  EXPECT_TRUE(r.passed);
  EXPECT_FALSE(r.certain);
  EXPECT_THAT(r.notes.back(), HasSubstr("could also have been a fail"));
  // Beyond it for sure.
  const RubricResult failed = judge(rubric(kDepth + kTilt), {depth(1.7), tilt(30, 4)});
  EXPECT_FALSE(failed.passed);
  EXPECT_TRUE(failed.certain);
}

// ---- Reasons

TEST(Rubric, ReasonsSayWhatIsWrongInPlainWords) {
  EXPECT_EQ(judged(kTilt, {tilt(12.3)}).reason,
            "floor tilt is 12.3°, above the tolerated 10.0°: the floor is tilted");
  EXPECT_EQ(judged(kTilt, {tilt(7)}).reason,
            "floor tilt is 7.0°, above the ideal 5.0°: the floor is tilted");
  EXPECT_EQ(judged(kDepth, {depth(0.5)}).reason,
            "depth is 0.50 mm, below the tolerated 1.00 mm: cut too shallow");
  EXPECT_EQ(judged(kDepth, {depth(1.7)}).reason,
            "depth is 1.70 mm, as it should be (1.50 to 2.00 mm)");
}

TEST(Rubric, ARoundedValueNeverEqualsTheLimitThatItMisses) {
  EXPECT_EQ(judged(kTilt, {tilt(10.004)}).reason,
            "floor tilt is 10.004°, above the tolerated 10.000°: the floor is tilted");
}

TEST(Rubric, LimitsAreToldAsTheyStandInTheFile) {
  const std::string c = with(kDepth, "[1.5, 2.0]\ntolerated = [1.0, 2.5]", "[1.5, 1.994]");
  // Not "1.99 mm, above the tolerated 1.994 mm".
  EXPECT_EQ(judged(c, {depth(1.9944)}).reason,
            "depth is 1.9944 mm, above the tolerated 1.9940 mm: cut too deep");
  EXPECT_EQ(judged(c, {depth(1.996)}).reason,
            "depth is 1.996 mm, above the tolerated 1.994 mm: cut too deep");
  EXPECT_EQ(range_text({-INFINITY, 0.005}, "mm^3"), "at most 0.005 mm³");
}

TEST(Rubric, YesAndNoAreJudgedToo) {
  const std::string c =
      "[[criterion]]\nkey = 'pulp_exposed'\nunit = 'yes/no'\nideal = [-inf, 0]\nhard_fail = true\n"
      "weight = 1\nsource = 's'\ntoo_high = 'the pulp is open'\n";
  const CriterionResult r = judged(c, {{"pulp_exposed", 1, NAN, "yes/no"}});
  EXPECT_TRUE(r.failed);
  EXPECT_EQ(r.reason, "pulp exposed: yes, must be no: the pulp is open");
  EXPECT_EQ(judged(c, {{"pulp_exposed", 0, NAN, "yes/no"}}).points, 1);
}

// ---- Files

TEST(Rubric, MistakesAreNamedWithTheirPlace) {
  const auto bad = [](const std::string& criterion, const std::string& from,
                      const std::string& to) {
    return error_of(kHead + with(criterion, from, to));
  };
  EXPECT_THAT(error_of("name = "), HasSubstr("r.toml: line 1"));
  EXPECT_THAT(error_of(kHead), HasSubstr("criterion: is missing"));
  EXPECT_THAT(error_of("criterion = []\n" + kHead), HasSubstr("criterion: is missing"));
  EXPECT_THAT(error_of(with(kHead, "class1", "clas1") + kTilt),
              HasSubstr("did you mean \"class1\""));
  EXPECT_THAT(error_of(with(kHead, "= 60", "= 101") + kTilt), HasSubstr("must be 0 to 100"));
  EXPECT_THAT(error_of(with(kHead, "= 60", "= nan") + kTilt), HasSubstr("must be 0 to 100"));
  EXPECT_THAT(error_of("pas_points = 3\n" + kHead + kTilt), HasSubstr("'pass_points'"));
  EXPECT_THAT(
      bad(kTilt, "floor_tilt_deg", "floor_tild_deg"),
      HasSubstr("criterion[0].key: \"floor_tild_deg\" is not a quantity of a score; did you "
                "mean \"floor_tilt_deg\"?"));
  EXPECT_THAT(bad(kWalls, "wall_angles_deg.*", "wall_angles_deg"), HasSubstr("wall_angles_deg.*"));
  EXPECT_THAT(bad(kTilt, "unit = 'deg'", "unit = 'rad'"), HasSubstr("is not the unit of"));
  EXPECT_THAT(bad(kTilt, "weight = 2", "weigth = 2"), HasSubstr("weight: is missing"));
  EXPECT_THAT(bad(kTilt, "weight = 2", "weight = 2\nidael = 3"),
              HasSubstr("did you mean 'ideal'?"));
  for (const char* weight : {"0", "-1", "nan", "inf"})
    EXPECT_THAT(bad(kTilt, "weight = 2", std::string("weight = ") + weight),
                HasSubstr("must be above 0"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = [2.0, 1.5]"), HasSubstr("low not above"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = [nan, 1.5]"), HasSubstr("low not above"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = [1.5]"), HasSubstr("two numbers"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = 1.5"), HasSubstr("two numbers"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = ['a', 2]"), HasSubstr("two numbers"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]\n", ""), HasSubstr("ideal: is missing"));
  EXPECT_THAT(bad(kDepth, "ideal = [1.5, 2.0]", "ideal = [0.9, 2.0]"),
              HasSubstr("does not lie inside tolerated"));
  EXPECT_THAT(bad(kTilt, "ideal = [-inf, 5]\ntolerated = [-inf, 10]", "ideal = [-inf, inf]"),
              HasSubstr("judges nothing"));
  EXPECT_THAT(bad(kTilt, "tolerated = [-inf, 10]", "tolerated = [-inf, inf]"),
              HasSubstr("points can't fall"));
  EXPECT_THAT(bad(kTilt, "hard_fail = [-inf, 20]", "hard_fail = [-inf, 9]"),
              HasSubstr("fails what is tolerated"));
  EXPECT_THAT(bad(kTilt, "hard_fail = [-inf, 20]", "hard_fail = 3"), HasSubstr("true or false"));
  EXPECT_THAT(bad(kTilt, "source = 's'\n", ""), HasSubstr("source: is missing"));
  EXPECT_THAT(error_of(kHead + kTilt + kTilt),
              HasSubstr("criterion[1].key: floor_tilt_deg is judged "
                        "twice"));
  EXPECT_THAT(error_of(kHead + kWalls + with(kTilt, "floor_tilt_deg", "wall_angles_deg.mesial")),
              HasSubstr("also by wall_angles_deg.*"));
  EXPECT_THROW(static_cast<void>(read_rubric("/no/such/rubric.toml")), InputError);
}

TEST(Rubric, TheShippedOnesAreReadAndEachCriterionHasASource) {
  std::vector<std::string> names = preparation_types();
  names.push_back("crown_chamfer");
  for (const std::string& name : names) {
    const Rubric r = read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/" + name + ".toml");
    EXPECT_EQ(r.type, name.substr(0, name.find('_')));
    EXPECT_GE(r.criteria.size(), 10u);
    for (const Criterion& c : r.criteria) {
      EXPECT_GT(c.source.size(), 9u) << c.key;
      // What a student reads is there for each side that has a limit.
      if (std::isfinite(c.ideal.low)) {
        EXPECT_FALSE(c.too_low.empty()) << c.key;
      }
      if (std::isfinite(c.ideal.high)) {
        EXPECT_FALSE(c.too_high.empty()) << c.key;
      }
    }
  }
}

// A textbook preparation gets all points by the rubric of its kind.
TEST(Rubric, ATextbookCrownGetsAllPoints) {
  const Rubric r = read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/crown.toml");
  const RubricResult result = judge(r, {{"convergence_deg.buccolingual", 12, 1, "deg"},
                                        {"convergence_deg.mesiodistal", 13, 1, "deg"},
                                        {"wall_height_mm", 4.5, 0.05, "mm"},
                                        {"occlusal_reduction_mm", 1.8, 0.05, "mm"},
                                        {"margin_width_mm", 1.1, 0.05, "mm"},
                                        {"undercut_max_mm", 0, 0.03, "mm"},
                                        {"pulp_exposed", 0, NAN, "yes/no"},
                                        {"neighbour_damage_mm3", 0, NAN, "mm^3"}});
  EXPECT_EQ(result.points_percent, 100.0);
  EXPECT_TRUE(result.passed && result.certain);
  EXPECT_EQ(result.points_percent_low, 100.0);
}

TEST(Rubric, RangesAreToldInWords) {
  EXPECT_EQ(range_text({1.5, 2}, "mm"), "1.50 to 2.00 mm");
  EXPECT_EQ(range_text({-6, 6}, "deg"), "-6.0° to 6.0°");
  EXPECT_EQ(range_text({4, INFINITY}, "mm"), "at least 4.00 mm");
  EXPECT_EQ(range_text({-INFINITY, 10}, "deg"), "at most 10.0°");
  EXPECT_EQ(range_text({-INFINITY, 0}, "yes/no"), "no");
}

}  // namespace
}  // namespace toothprep
