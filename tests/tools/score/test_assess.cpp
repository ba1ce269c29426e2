// The whole assessment, through files, against preparations known in closed form: volumes within
// 1 %, the deviation of a shell of known thickness within 0.02 mm, and the same figures whichever
// way the teeth come in: as voxels, as meshes, moved, with one thread or many.
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <ctime>
#include <random>

#include "../compare/cut_teeth.h"
#include "teeth_in_files.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/score/definitions.h"

namespace toothprep {
namespace {

struct Case {
  std::string name;
  PreparationType type;
  CavityOptions cavity;
};

class ExactCavities : public TeethInFiles,
                      public testing::WithParamInterface<std::tuple<double, bool>> {
 protected:
  double voxel() const { return std::get<0>(GetParam()); }
  void place(CavityOptions& cavity) const {
    cavity.voxel = voxel();
    if (std::get<1>(GetParam())) cavity.pose = turned_pose();
  }
};

std::vector<Case> volume_cases() {
  CavityOptions pulp = class1_box(5), tilted = class1_box(5), damage = class2_box();
  pulp.pulp_depth = 1.6;
  pulp.pulp_size = Vec3(2, 1, 1.5);
  tilted.floor_tilt_u = 6;
  damage.neighbour_damage = 0.3;
  return {{"box, parallel walls", PreparationType::kClass1, class1_box(0)},
          {"box, tilted floor", PreparationType::kClass1, tilted},
          {"dovetail, -8 deg", PreparationType::kClass1, class1_box(-8)},
          {"box into the pulp", PreparationType::kClass1, pulp},
          {"class II, neighbour cut", PreparationType::kClass2, damage},
          {"round stump", PreparationType::kCrown, round_stump(12)}};
}

TEST_P(ExactCavities, VolumesAreWithinOnePercentInAllAndPerTissue) {
  std::printf("%-24s %-22s %9s %9s %8s\n", "preparation", "mm^3", "truth", "measured", "error");
  for (Case c : volume_cases()) {
    if (voxel() < 0.07 && c.cavity.neighbour_gap) continue;  // time: twice the tooth
    place(c.cavity);
    const CavityTruth truth = cavity_truth(c.cavity);
    const Assessment assessment = assess(files_of(c.cavity, c.type));
    int compared = 0;
    for (const TruthFigure& t : truth) {
      if (t.key.find("mm3") == std::string::npos) continue;
      const double got = value_of(assessment, t.key);
      if (t.value == 0 && std::isnan(got)) continue;  // the tooth has none of that tissue
      std::printf("%-24s %-22s %9.4f %9.4f %+7.3f%%\n", c.name.c_str(), t.key.c_str(), t.value, got,
                  t.value > 0 ? 100 * (got / t.value - 1) : 100 * got);
      EXPECT_NEAR(got, t.value, 0.01 * t.value) << c.name << ' ' << t.key;
      ++compared;
    }
    EXPECT_GE(compared, 3) << c.name;
  }
}

// The share of the region's area whose deviation is within `range` of d.
double share_near(const Assessment& assessment, double d, double range) {
  const std::vector<double> area = vertex_areas(assessment.prepared.surface);
  double near = 0;
  for (std::size_t v = 0; v < area.size(); ++v)
    if (std::abs(static_cast<double>(assessment.deviation->per_vertex[v]) - d) < range)
      near += area[v];
  return near / assessment.deviation->area_mm2;
}

TEST_P(ExactCavities, AShellOfKnownThicknessDeviatesByIt) {
  std::printf("%-14s %6s %9s %9s %9s %9s %9s %9s\n", "preparation", "offset", "mean", "p95", "RMS",
              "Hausdorff", "over mm^3", "dice");
  for (const double offset : {0.1, 0.2})
    for (const bool crown : {false, true}) {
      if (voxel() < 0.07 && (crown || offset > 0.1)) continue;  // time
      CavityOptions cavity = crown ? round_stump(12) : class1_box(6);
      place(cavity);
      const CavitySpecimen target = make_cavity(cavity);
      cavity.offset = offset;
      AssessmentOptions options =
          files_of(cavity, crown ? PreparationType::kCrown : PreparationType::kClass1);
      options.target = put("target.vdb", target.prepared);
      const Assessment assessment = assess(options);
      const CavityTruth truth = cavity_truth(cavity);
      const auto got = [&](const char* key) { return value_of(assessment, key); };
      const auto expected = [&](const char* key) { return truth_value(truth, key).value(); };
      std::printf("%-14s %6.2f %+9.4f %9.4f %9.4f %9.4f %9.4f %9.5f\n", crown ? "stump" : "box",
                  offset, got("deviation_mean_mm"), got("deviation_p95_mm"),
                  got("deviation_rms_mm"), got("hausdorff_mm"), got("over_prepared_mm3"),
                  got("dice"));
      // At the rim the target's uncut surface is nearer than its wall: the distance falls to zero
      // over a strip as high as the offset, of some 7 % of the area.
      for (const char* key : {"deviation_mean_mm", "deviation_rms_mm"})
        EXPECT_NEAR(got(key), expected(key), 0.02) << key << ' ' << crown << ' ' << offset;
      // Bevelled line angles would make the shell thicker beside them, by up to 0.7 voxels in the
      // corners; more than 5 % of this small box lie there.
      EXPECT_NEAR(got("deviation_p95_mm"), offset, 0.02 * voxel());
      EXPECT_GT(share_near(assessment, -offset, 0.02), 0.8) << crown << ' ' << offset;
      if (!crown) {
        EXPECT_NEAR(got("hausdorff_mm"), offset, voxel());
      }
      EXPECT_NEAR(got("required_mm3"), expected("required_mm3"), 0.01 * expected("required_mm3"));
      // 1 % of what was removed: the shell is the small difference of two large volumes.
      EXPECT_NEAR(got("over_prepared_mm3"), expected("over_prepared_mm3"),
                  0.01 * expected("removed_mm3.total"));
      EXPECT_NEAR(got("under_prepared_mm3"), 0, 0.001 * expected("required_mm3"));
      EXPECT_NEAR(got("dice"), expected("dice"), 0.005);
      EXPECT_GT(got("deviation_within_0_2mm"), 0.02);

      // The other way round, what was over-prepared is missing.
      std::swap(options.prepared, options.target);
      const Assessment timid = assess(options);
      EXPECT_NEAR(value_of(timid, "under_prepared_mm3"), got("over_prepared_mm3"),
                  1e-9 * got("over_prepared_mm3"));
      EXPECT_NEAR(value_of(timid, "over_prepared_mm3"), got("under_prepared_mm3"), 1e-9);
      EXPECT_NEAR(value_of(timid, "dice"), got("dice"), 1e-9);
      EXPECT_NEAR(value_of(timid, "hausdorff_mm"), got("hausdorff_mm"), 1e-6);
      EXPECT_GT(value_of(timid, "deviation_mean_mm"), 0);
    }
}

INSTANTIATE_TEST_SUITE_P(VoxelsAndPoses, ExactCavities,
                         testing::Combine(testing::Values(0.1, 0.05), testing::Bool()),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param) > 0.07 ? "Coarse" : "Fine") +
                                  (std::get<1>(test.param) ? "Turned" : "Straight");
                         });

class Assess : public TeethInFiles {};

TEST_F(Assess, AFigureIsFromTheTruthByLessThanItsStatedUncertainty) {
  CavityOptions cavity = class1_box(6);
  cavity.pose = turned_pose();
  cavity.floor_tilt_u = 3;
  const Assessment assessment = assess(files_of(cavity, PreparationType::kClass1));
  int compared = 0;
  for (const TruthFigure& t : cavity_truth(cavity)) {
    const Quantity* q = find_quantity(assessment.sheet.quantities, t.key);
    if (!q || !std::isfinite(q->uncertainty)) continue;
    EXPECT_NEAR(q->value, t.value, q->uncertainty) << t.key;
    EXPECT_GT(q->uncertainty, 0) << t.key;
    ++compared;
  }
  EXPECT_GT(compared, 12);
}

// What a scan of a tooth would give: its surface with noise, another at each scan.
LayeredTooth scanned(const LayeredTooth& tooth, const std::string& scan, unsigned seed) {
  LevelSet solid = tooth.solid;
  std::mt19937_64 random(seed);
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < solid.table_size(); ++b) {
    if (solid.is_uniform(b)) continue;
    std::copy_n(solid.brick(b), kBrickVoxels, values.begin());
    for (float& v : values) {  // a sum of four evens, near enough to a bell: 0.0035 mm
      float sum = 0;
      for (int k = 0; k < 4; ++k) sum += static_cast<float>(random() >> 40) * 0x1p-24F - 0.5F;
      v += 0.006F * sum;
    }
    solid.set_brick(b, values.data());
  }
  LayeredTooth result = tooth;
  apply_remaining_solid(result, std::move(solid));
  result.provenance["threshold_dentin"] = "800";
  result.provenance["source_sha256"] = scan;
  return result;
}

TEST_F(Assess, TheNoiseOfTwoScansIsNoRemovalNorUndercut) {
  CavityOptions cavity = class1_box(6);
  cavity.pose = turned_pose();
  const CavitySpecimen specimen = make_cavity(cavity);
  const double removed = truth_value(cavity_truth(cavity), "removed_mm3.total").value();
  const auto assessed = [&](const std::string& scan_of_prepared) {
    return assess(files_of(scanned(specimen.original, "first", 1),
                           scanned(specimen.prepared, scan_of_prepared, 2),
                           PreparationType::kClass1));
  };
  const Assessment two_scans = assessed("second");
  const Quantity* total = find_quantity(two_scans.sheet.quantities, "removed_mm3.total");
  ASSERT_TRUE(total);
  EXPECT_NEAR(total->value, removed, total->uncertainty);
  EXPECT_LT(value_of(two_scans, "undercut_max_mm"), 0.1);
  // Taken for one scan, all that differs counts as cut.
  EXPECT_GT(value_of(assessed("first"), "removed_mm3.total") - removed, 1.5 * total->uncertainty);
}

TEST_F(Assess, WhatIsTheTargetDeviatesByNothing) {
  CavityOptions cavity = class1_box(6);
  cavity.pose = turned_pose();
  AssessmentOptions options = files_of(cavity, PreparationType::kClass1);
  options.target = options.prepared;
  const Assessment assessment = assess(options);
  EXPECT_EQ(value_of(assessment, "dice"), 1);
  EXPECT_EQ(value_of(assessment, "over_prepared_mm3"), 0);
  EXPECT_EQ(value_of(assessment, "under_prepared_mm3"), 0);
  EXPECT_EQ(value_of(assessment, "deviation_within_0_1mm"), 1);
  for (const char* key :
       {"deviation_mean_mm", "deviation_rms_mm", "deviation_p95_mm", "hausdorff_mm"})
    EXPECT_NEAR(value_of(assessment, key), 0, 1e-6) << key;
}

// Angles within 1°, lengths within half a voxel, volumes within 1 %, of every figure that both
// have.
void expect_same_figures(const Assessment& got, const Assessment& expected, double voxel,
                         const std::string& route) {
  int compared = 0;
  for (const Quantity& q : expected.sheet.quantities) {
    const double value = value_of(got, q.key);
    if (q.unit == "mm" || q.unit == "deg") {
      EXPECT_NEAR(value, q.value, q.unit == "mm" ? voxel / 2 : 1) << route << ' ' << q.key;
      ++compared;
    } else if (q.unit == "mm^3" && !std::isnan(value)) {  // a mesh has no tissues
      EXPECT_NEAR(value, q.value,
                  std::max(0.01 * q.value, 0.002 * value_of(expected, "removed_mm3.total")))
          << route << ' ' << q.key;
    }
  }
  EXPECT_GT(compared, 10);
  EXPECT_EQ(got.sheet.type, expected.sheet.type);
}

TEST_F(Assess, MeshesGiveTheFiguresOfTheVoxelsThatTheyCameFrom) {
  for (Case c : {Case{"dovetail", PreparationType::kClass1, class1_box(-8)},
                 Case{"stump", PreparationType::kCrown, round_stump(12)}}) {
    c.cavity.pose = turned_pose();
    const CavitySpecimen specimen = make_cavity(c.cavity);
    AssessmentOptions options = files_of(specimen.original, specimen.prepared, c.type);
    const Quat& turn = c.cavity.pose.orientation;
    options.preparation.occlusal = turn * Vec3::UnitY();
    options.preparation.mesial = turn * Vec3::UnitX();
    options.preparation.buccal = turn * -Vec3::UnitZ();
    const Assessment voxels = assess(options);
    const TriangleMesh before = extract_surface(specimen.original, SurfaceOf::kAll),
                       after = sharpest_surface(specimen.prepared);
    options.prepared = put("prepared.stl", after);
    if (c.type == PreparationType::kClass1) {
      const Assessment mixed = assess(options);
      expect_same_figures(mixed, voxels, c.cavity.voxel, c.name + ", prepared .stl");
      EXPECT_GT(value_of(mixed, "removed_mm3.dentin"), 1) << "tissues are the original's";
    }
    options.original = put("original.ply", before);
    expect_same_figures(assess(options), voxels, c.cavity.voxel, c.name + ", both meshes");
  }
}

TEST_F(Assess, ATargetGivenAsAMeshGivesTheSameDeviation) {
  CavityOptions cavity = class1_box(6);
  const TriangleMesh target = extract_surface(make_cavity(cavity).prepared, SurfaceOf::kAll);
  cavity.offset = 0.1;
  AssessmentOptions options = files_of(cavity, PreparationType::kClass1);
  options.target = put("target.stl", target);
  const Assessment assessment = assess(options);
  EXPECT_NEAR(value_of(assessment, "deviation_mean_mm"), -0.1, 0.02);
  EXPECT_NEAR(value_of(assessment, "deviation_rms_mm"), 0.1, 0.02);
  EXPECT_NEAR(value_of(assessment, "dice"), truth_value(cavity_truth(cavity), "dice").value(),
              0.005);
}

TEST_F(Assess, ATargetInAMovedFrameIsLaidOnTheOriginalToo) {
  const Pose motion = pose_of(Vec3(4, -7, 3), Vec3(0.2, 1, 0.5), 35);
  const LayeredTooth original = molar(0.15);
  const LayeredTooth prepared = carved(original, class_one(0.1)),
                     target = carved(original, class_one());
  AssessmentOptions options = files_of(original, prepared, PreparationType::kClass1);
  options.target = put("target.vdb", target);
  const Assessment straight = assess(options);
  options.prepared = put("prepared.stl", moved(extract_surface(prepared, SurfaceOf::kAll), motion));
  options.target = put("target.stl", moved(extract_surface(target, SurfaceOf::kAll), odd_pose()));
  options.register_teeth = true;
  const Assessment registered = assess(options);
  expect_same_figures(registered, straight, 0.15, "registered");
  EXPECT_NEAR(value_of(registered, "dice"), value_of(straight, "dice"), 0.01);
  EXPECT_LT(value_of(registered, "registration_rms_mm"), 0.02);
  EXPECT_TRUE(std::isnan(value_of(straight, "registration_rms_mm")));
}

TEST_F(Assess, TheSameScoreToTheLetterForAnyNumberOfThreads) {
  CavityOptions cavity = class1_box(-8);
  cavity.voxel = 0.15;
  cavity.pose = turned_pose();
  cavity.pulp_depth = 2.4;
  cavity.pulp_size = Vec3(2, 1, 1.5);
  const CavitySpecimen specimen = make_cavity(cavity);
  CavityOptions deeper = cavity;
  deeper.offset = 0.1;
  AssessmentOptions options = files_of(deeper, PreparationType::kClass1);
  options.target = put("target.vdb", specimen.prepared);
  // A small turn about the tooth's own place: a block looks alike after four large ones.
  const Pose motion = pose_of(Vec3(0.5, 0.2, -0.3), Vec3(0.2, 1, 0.5), 4);
  options.prepared = put(
      "moved.ply", moved(extract_surface(make_cavity(deeper).prepared, SurfaceOf::kAll), motion));
  options.register_teeth = true;
  options.rubric = read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/class1.toml");
  const auto text = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return score_json(assess(options).sheet);
  };
  const std::string one = text(1);
  EXPECT_EQ(one, text(5));
}

TEST_F(Assess, AMolarOfFineVoxelsTakesSeconds) {
  const LayeredTooth original = molar(0.05);
  const AssessmentOptions options =
      files_of(original, carved(original, class_one()), PreparationType::kClass1);
  timespec begin{}, end{};
  clock_gettime(CLOCK_MONOTONIC, &begin);
  const std::clock_t cpu = std::clock();
  const Assessment assessment = assess(options);
  clock_gettime(CLOCK_MONOTONIC, &end);
  std::printf("molar, 0.05 mm, %zu facets: %.1f s, CPU %.1f s\n",
              assessment.preparation_surface.triangles.size(),
              static_cast<double>(end.tv_sec - begin.tv_sec) +
                  1e-9 * static_cast<double>(end.tv_nsec - begin.tv_nsec),
              static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC);
  EXPECT_NEAR(value_of(assessment, "width_mm"), 2, 0.025);
  EXPECT_NEAR(value_of(assessment, "length_mm"), 4, 0.025);
  EXPECT_EQ(assessment.sheet.axis_from, "recorded");
}

// A mesh has no tissues and no recorded axis: the original's voxels are a surface's, too.
TEST_F(Assess, AnOriginalMeshAgainstVoxelsHasASkinOfNoise) {
  const CavitySpecimen specimen = make_cavity(class1_box(6));
  AssessmentOptions options =
      files_of(specimen.original, specimen.prepared, PreparationType::kClass1);
  const double removed = value_of(assess(options), "removed_mm3.total");
  options.original = put("original.ply", extract_surface(specimen.original, SurfaceOf::kAll));
  const Assessment assessment = assess(options);
  EXPECT_NEAR(value_of(assessment, "removed_mm3.total"), removed, 0.01 * removed);
  EXPECT_NEAR(value_of(assessment, "wall_angles_deg.v_plus"), 6, 1);
  EXPECT_EQ(assessment.sheet.axis_from, "found");
}

// One cavity in five poses, as voxels of their own lattice, as meshes with their axis, and as meshes
// alone.
TEST_F(Assess, PointsAgreeToOneWhateverPoseTheFilesHave) {
  const Rubric rubric = read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/class1.toml");
  const CavityOptions upright = class1_box(4);
  const CavitySpecimen exact = make_cavity(upright);
  const TriangleMesh before = extract_surface(exact.original, SurfaceOf::kAll),
                     after = extract_surface(exact.prepared, SurfaceOf::kAll);
  enum Files { kVoxels, kMeshesWithAxis, kMeshes };
  std::array<double, 3> least = {1e30, 1e30, 1e30}, most = {-1e30, -1e30, -1e30};
  for (const Vec3& axis : {Vec3(0, 0, 1), Vec3(0.31, -0.52, 0.79), Vec3(-0.8, 0.1, -0.3),
                           Vec3(0.5, 0.5, 0.7), Vec3(0, -1, 0.05)}) {
    CavityOptions cavity = upright;
    cavity.pose.orientation = orientation_of_axis(axis, axis.x() * 3).normalized();
    cavity.pose.position = 7 * axis;
    for (const Files files : {kVoxels, kMeshesWithAxis, kMeshes}) {
      AssessmentOptions options = files_of(cavity, PreparationType::kClass1);
      if (files != kVoxels) {
        options.original = put("original.ply", moved(before, cavity.pose));
        options.prepared = put("prepared.ply", moved(after, cavity.pose));
        options.preparation.occlusal.reset();
      }
      if (files == kMeshesWithAxis)
        options.preparation.occlusal = cavity.pose.orientation * Vec3::UnitY();
      options.rubric = rubric;
      options.voxel = cavity.voxel;
      const Assessment assessment = assess(options);
      const double points = *assessment.sheet.result->points_percent;
      std::printf("pose %+.2f %+.2f %+.2f %s: %.2f %%\n", axis.x(), axis.y(), axis.z(),
                  std::array{"voxels", "meshes with axis", "meshes"}[files], points);
      EXPECT_TRUE(files != kMeshes || !assessment.sheet.result->certain);
      least[files] = std::min(least[files], points);
      most[files] = std::max(most[files], points);
    }
  }
  for (const Files files : {kVoxels, kMeshesWithAxis, kMeshes})
    EXPECT_LT(most[files] - least[files], 1) << files;
}

TEST_F(Assess, EveryFigureHasItsDefinitionAndItsUnit) {
  const std::pair<CavityOptions, PreparationType> forms[] = {
      {class1_box(5), PreparationType::kClass1},
      {class2_box(), PreparationType::kClass2},
      {round_stump(12), PreparationType::kCrown}};
  for (const auto& [cavity, type] : forms) {
    AssessmentOptions options = files_of(cavity, type);
    options.target = options.prepared;
    for (const Quantity& q : assess(options).sheet.quantities) {
      const QuantityDefinition* definition = find_definition(q.key);
      ASSERT_NE(definition, nullptr) << q.key;
      EXPECT_EQ(definition->unit, q.unit) << q.key;
    }
  }
}

TEST_F(Assess, TheTypeIsTheRubricsUnlessAnotherIsGiven) {
  AssessmentOptions options = files_of(class1_box(6), PreparationType::kCrown);
  options.rubric = read_rubric(TOOTHPREP_SOURCE_DIR "/data/rubrics/class1.toml");
  EXPECT_THROW(static_cast<void>(assess(options)), Error);
  options.type.reset();
  EXPECT_EQ(assess(options).sheet.type, "class1");
  EXPECT_EQ(assess(options).sheet.type_from, "the rubric");
  options.rubric.reset();
  EXPECT_EQ(assess(options).sheet.type_from, "found");
}

}  // namespace
}  // namespace toothprep
