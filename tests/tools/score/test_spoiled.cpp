// Preparations spoiled on purpose lose points for what is wrong with them, and for nothing else.
#include <cstdio>
#include <functional>
#include <set>

#include "../compare/cut_teeth.h"
#include "teeth_in_files.h"

namespace toothprep {
namespace {

using Keys = std::set<std::string>;

// The criteria, by the key as the rubric has it, that cost points (more than 2 % of their own).
Keys lost(const Assessment& assessment) {
  Keys keys;
  for (const CriterionResult& c : assessment.sheet.result->criteria)
    if (c.of > 0 && c.points < 0.98 * c.of) keys.insert(c.criterion.key);
  return keys;
}

bool fails_hard(const Assessment& assessment, const std::string& key) {
  for (const CriterionResult& c : assessment.sheet.result->criteria)
    if (c.criterion.key == key) return c.failed;
  return false;
}

class Spoiled : public TeethInFiles {
 protected:
  Assessment judged(AssessmentOptions options) const {
    options.rubric = read_rubric(
        TOOTHPREP_SOURCE_DIR "/data/rubrics/" +
        std::string(kPreparationTypes[static_cast<std::size_t>(*options.type)]) + ".toml");
    Assessment assessment = assess(options);
    const RubricResult& result = *assessment.sheet.result;
    std::printf("%5.1f %% %s", *result.points_percent, result.passed ? "passed" : "failed");
    for (const CriterionResult& c : result.criteria)
      if (c.of > 0 && c.points < 0.98 * c.of) std::printf("\n        %s", c.reason.c_str());
    std::printf("\n");
    return assessment;
  }
  // `also` may lose points with `right`, for the same reason.
  void expect_lost(const Assessment& assessment, const Keys& right, const Keys& also = {}) const {
    const Keys keys = lost(assessment);
    for (const std::string& key : right) EXPECT_TRUE(keys.contains(key)) << key << " lost nothing";
    for (const std::string& key : keys)
      EXPECT_TRUE(right.contains(key) || also.contains(key)) << key << " lost points";
    EXPECT_LT(*assessment.sheet.result->points_percent, 99);
  }
  void expect_good(const Assessment& assessment) const {
    EXPECT_EQ(lost(assessment), Keys{});
    EXPECT_GT(*assessment.sheet.result->points_percent, 99);
    EXPECT_TRUE(assessment.sheet.result->passed);
    EXPECT_TRUE(assessment.sheet.result->certain);
  }
};

// ---- Class I, in the block

// A cavity for amalgam as the shipped rubric wants it: 1.75 mm deep, 1.3 mm wide at half its depth.
CavityOptions good_class1(double taper = 2, double depth = 1.75, double width = 1.3) {
  CavityOptions o = class1_box(taper);
  o.depth = depth;
  o.width = width - depth * std::tan(units::from_degree(taper));
  o.size = Vec3(6.5, 7.5, 4.5);
  o.pulp_depth = 5;
  o.pulp_size = Vec3(2, 1, 1);
  o.pose = turned_pose();
  return o;
}

class SpoiledClass1 : public Spoiled {
 protected:
  Assessment judged(const CavityOptions& cavity) const {
    return Spoiled::judged(files_of(cavity, PreparationType::kClass1));
  }
};

TEST_F(SpoiledClass1, AsItShouldBeItHasAllPoints) { expect_good(judged(good_class1())); }

TEST_F(SpoiledClass1, TooDeep) {
  const Assessment assessment = judged(good_class1(2, 2.7));
  expect_lost(assessment, {"depth_mm"});
  EXPECT_FALSE(fails_hard(assessment, "depth_mm"));
}

TEST_F(SpoiledClass1, TooShallow) {
  expect_lost(judged(good_class1(2, 1.1)), {"depth_mm", "depth_min_mm"});
}

TEST_F(SpoiledClass1, Undercut) {
  expect_lost(judged(good_class1(-12)), {"wall_angles_deg.*", "undercut_max_mm"});
}

TEST_F(SpoiledClass1, UndercutOnOneSide) {  // a tilted path frees the other wall: not both
  CavityOptions cavity = good_class1();
  cavity.taper_v_plus = -15;
  expect_lost(judged(cavity), {"wall_angles_deg.*"}, {"isthmus_width_mm"});
}

TEST_F(SpoiledClass1, OpenTooFar) { expect_lost(judged(good_class1(15)), {"wall_angles_deg.*"}); }

TEST_F(SpoiledClass1, TooWide) {
  expect_lost(judged(good_class1(2, 1.75, 2.3)), {"isthmus_width_mm"});
}

TEST_F(SpoiledClass1, TiltedFloor) {
  CavityOptions cavity = good_class1();
  cavity.floor_tilt_u = 9;  // by 0.28 mm at the ends of its 4 mm
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"floor_tilt_deg"});
  EXPECT_NEAR(value_of(assessment, "floor_tilt_deg"), 9, 0.5);
}

TEST_F(SpoiledClass1, BowedFloor) {
  CavityOptions cavity = good_class1();
  cavity.bow = 0.6;  // RMS 0.6 (2/√45) = 0.18 mm about its mean
  cavity.depth = 2;  // in its middle; half of the floor is less deep than 1.85 mm
  expect_lost(judged(cavity), {"floor_flatness_mm"});
}

TEST_F(SpoiledClass1, TiltedAsAWhole) {
  CavityOptions tooth = good_class1();
  tooth.pose = {};
  const LayeredTooth original = make_cavity(tooth).original;
  // A box 1.75 mm deep in its middle, turned by 10° about its width.
  const Shape cut = box_shape(Vec3(-2, 0, -0.65), Vec3(2, 4, 0.65),
                              pose_of(Vec3(0, -1.75, 0), Vec3::UnitZ(), 10));
  const Assessment assessment =
      Spoiled::judged(files_of(original, carved(original, cut), PreparationType::kClass1));
  expect_lost(assessment, {"floor_tilt_deg", "wall_angles_deg.*"});
  EXPECT_NEAR(value_of(assessment, "floor_tilt_deg"), 10, 0.5);
  EXPECT_NEAR(value_of(assessment, "path_of_draw_tilt_deg"), 10, 1.1);
  EXPECT_EQ(value_of(assessment, "undercut_max_mm"), 0) << "it can be drawn along its own axis";
}

TEST_F(SpoiledClass1, NearThePulp) {
  CavityOptions cavity = good_class1();
  cavity.pulp_depth = 2.75;
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"remaining_dentin_min_mm"});
  EXPECT_NEAR(value_of(assessment, "remaining_dentin_min_mm"), 1, 0.05);
}

// As from a mesh that has no pulp: the point for an unopened one is neither won nor lost.
TEST_F(SpoiledClass1, WithoutAPulpItIsNotJudgedByIt) {
  CavityOptions cavity = good_class1();
  cavity.pulp_depth.reset();
  const Assessment assessment = judged(cavity);
  expect_good(assessment);
  for (const char* key : {"pulp_exposed", "remaining_dentin_min_mm"}) {
    const auto& criteria = assessment.sheet.result->criteria;
    const auto c = std::find_if(criteria.begin(), criteria.end(),
                                [&](const CriterionResult& r) { return r.key == key; });
    ASSERT_NE(c, criteria.end());
    EXPECT_EQ(c->verdict, CriterionVerdict::kNotJudged) << key;
    EXPECT_NE(c->reason.find("the original has no pulp"), std::string::npos) << c->reason;
  }
}

TEST_F(SpoiledClass1, PulpOpened) {
  CavityOptions cavity = good_class1();
  cavity.pulp_depth = 1.6;
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"pulp_exposed", "remaining_dentin_min_mm"});
  EXPECT_TRUE(fails_hard(assessment, "pulp_exposed"));
  EXPECT_FALSE(assessment.sheet.result->passed);
  EXPECT_GT(*assessment.sheet.result->points_percent, assessment.sheet.result->pass_points)
      << "failed by the pulp, not by points";
  ASSERT_EQ(assessment.sheet.result->fail_reasons.size(), 1U);
  EXPECT_NE(assessment.sheet.result->fail_reasons[0].find("pulp"), std::string::npos);
}

// ---- Class II, in the block

CavityOptions good_class2() {
  CavityOptions o = class1_box(2);
  o.kind = CavityKind::kClass2;
  o.size = Vec3(8, 7, 6);
  o.length = 3.5;
  o.depth = 1.75;
  o.width = 1.25;
  o.proximal_width = 3;
  o.gingival_depth = 3.5;
  o.axial_depth = 1.4;
  o.axial_taper = 2;
  o.proximal_taper = 2;
  o.neighbour_gap = 0.5;
  o.pulp_depth = 5.8;
  o.pulp_size = Vec3(1, 1, 1);
  return o;
}

class SpoiledClass2 : public Spoiled {
 protected:
  Assessment judged(const CavityOptions& cavity) const {
    return Spoiled::judged(files_of(cavity, PreparationType::kClass2));
  }
};

TEST_F(SpoiledClass2, AsItShouldBeItHasAllPoints) { expect_good(judged(good_class2())); }

TEST_F(SpoiledClass2, NoClearance) {
  CavityOptions cavity = good_class2();
  cavity.neighbour_gap = 0.05;
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"box_clearance_mm"});
  EXPECT_NEAR(value_of(assessment, "box_clearance_mm"), 0.05, 0.05);
}

TEST_F(SpoiledClass2, NeighbourCut) {
  CavityOptions cavity = good_class2();
  cavity.neighbour_damage = 0.3;
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"neighbour_damage_mm3"});
  EXPECT_TRUE(fails_hard(assessment, "neighbour_damage_mm3"));
  EXPECT_FALSE(assessment.sheet.result->passed);
}

TEST_F(SpoiledClass2,
       NeighbourGrazed) {  // 0.02 mm deep over 11 mm²: 0.2 mm³, reported but no failure
  CavityOptions cavity = good_class2();
  cavity.neighbour_damage = 0.02;
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"neighbour_damage_mm3"});
  EXPECT_FALSE(fails_hard(assessment, "neighbour_damage_mm3"));
}

TEST_F(SpoiledClass2, BoxTooDeepTowardsThePulp) {
  CavityOptions cavity = good_class2();
  cavity.axial_depth = 2.1;
  expect_lost(judged(cavity), {"axial_depth_mm"});
}

TEST_F(SpoiledClass2, TooDeep) {
  CavityOptions cavity = good_class2();
  cavity.depth = 2.7;
  expect_lost(judged(cavity), {"depth_mm"});
}

// ---- Crown, of the block

// Shoulder 1.05 mm, walls 4.5 mm high: at half their height 1.05 + 2.25 tan 7° = 1.33 mm are off.
CavityOptions good_crown() {
  CavityOptions o = round_stump(14);
  o.size = Vec3(9, 8, 9);
  o.corner = 4.5;
  o.occlusal_reduction = 1.7;
  o.shoulder_level = 6.2;
  o.shoulder_width = 1.1;
  o.pulp_depth = 5;
  o.pulp_size = Vec3(0.8, 1, 0.8);
  return o;
}

class SpoiledCrown : public Spoiled {
 protected:
  Assessment judged(const CavityOptions& cavity) const {
    return Spoiled::judged(files_of(cavity, PreparationType::kCrown));
  }
};

TEST_F(SpoiledCrown, AsItShouldBeItHasAllPoints) { expect_good(judged(good_crown())); }

TEST_F(SpoiledCrown, Undercut) {
  CavityOptions cavity = good_crown();
  cavity.convergence_u = cavity.convergence_v = -7;  // 4.5 tan 3.5° = 0.28 mm at the shoulder
  cavity.shoulder_width = 1.17;                      // 1.03 mm off at half the height
  const Assessment assessment = judged(cavity);
  expect_lost(assessment, {"convergence_deg.*", "undercut_max_mm"});
  EXPECT_TRUE(fails_hard(assessment, "undercut_max_mm"));
  EXPECT_FALSE(assessment.sheet.result->passed);
}

TEST_F(SpoiledCrown, NoShoulder) {
  CavityOptions cavity = good_crown();
  cavity.shoulder_width = 0.1;
  // 0.1 + 2.25 tan 7° = 0.38 mm off at the sides, which is too little for the ceramic, too.
  expect_lost(judged(cavity), {"margin_width_mm", "margin_continuity", "axial_reduction_mm.*"});
}

TEST_F(SpoiledCrown, OverTapered) {
  CavityOptions cavity = good_crown();
  cavity.convergence_u = cavity.convergence_v = 40;
  cavity.pulp_depth = 5.5;
  // 1.1 + 2.25 tan 20° = 1.92 mm off at half the height.
  expect_lost(judged(cavity), {"convergence_deg.*", "axial_reduction_mm.*"},
              {"remaining_dentin_min_mm"});
}

TEST_F(SpoiledCrown, TooShort) {
  CavityOptions cavity = good_crown();
  cavity.shoulder_level = 4.2;
  expect_lost(judged(cavity), {"wall_height_mm"});
}

TEST_F(SpoiledCrown, TopNotReduced) {
  CavityOptions cavity = good_crown();
  cavity.occlusal_reduction = 0.7;
  expect_lost(judged(cavity), {"occlusal_reduction_mm", "occlusal_reduction_min_mm"},
              {"axial_reduction_mm.*"});
}

// ---- Class I, in the molar

// Floor 1.85 mm below the grooves (median), 1.3 mm wide, 3 mm long, turned about its width.
Shape molar_cavity(double deeper, double tilt_deg) {
  const Pose pose = pose_of(Vec3(6.1, 5.5, 15.1 - deeper), Vec3::UnitX(), tilt_deg);
  return box_shape(Vec3(-0.65, -1.5, 0), Vec3(0.65, 1.5, 8), pose);
}

class SpoiledMolar : public Spoiled {
 protected:
  Assessment judged(const Shape& cut) const {
    static const LayeredTooth original = molar(0.1);
    return Spoiled::judged(files_of(original, carved(original, cut), PreparationType::kClass1));
  }
};

TEST_F(SpoiledMolar, AsItShouldBeItHasNearlyAllPoints) {
  const Assessment assessment = judged(molar_cavity(0, 0));
  EXPECT_TRUE(assessment.sheet.result->passed);
  EXPECT_GT(*assessment.sheet.result->points_percent, 90);
}

TEST_F(SpoiledMolar, TooDeep) {
  expect_lost(judged(molar_cavity(0.8, 0)), {"depth_mm"}, {"remaining_dentin_min_mm"});
}

TEST_F(SpoiledMolar, TiltedAsAWhole) {
  const Assessment assessment = judged(molar_cavity(0, 11));
  expect_lost(assessment, {"floor_tilt_deg", "wall_angles_deg.*"}, {"remaining_dentin_min_mm"});
  EXPECT_NEAR(value_of(assessment, "floor_tilt_deg"), 11, 0.5);
}

TEST_F(SpoiledMolar, PulpOpened) {
  const Assessment assessment = judged(molar_cavity(3.5, 0));
  expect_lost(assessment, {"pulp_exposed", "remaining_dentin_min_mm", "depth_mm"});
  EXPECT_TRUE(fails_hard(assessment, "pulp_exposed"));
  EXPECT_FALSE(assessment.sheet.result->passed);
  EXPECT_GT(value_of(assessment, "removed_mm3.pulp"), 0);
}

}  // namespace
}  // namespace toothprep
