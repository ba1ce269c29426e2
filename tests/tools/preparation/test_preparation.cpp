// The scorer against preparations that are known in closed form, cut in a block and turned to odd
// angles. What is asked of it: angles within 1°, lengths within half a voxel, no undercut where
// there is none, every undercut deeper than 0.05 mm. The table of errors is in the output.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/preparation/preparation.h"

namespace toothprep {
namespace {

struct Case {
  std::string name;
  PreparationType type = PreparationType::kClass1;
  CavityOptions cavity;
};

CavityOptions box(double u_plus, double u_minus, double v_plus, double v_minus) {
  CavityOptions o;
  o.size = Vec3(8, 4.5, 7);
  o.enamel = 1.5;
  o.taper_u_plus = u_plus;
  o.taper_u_minus = u_minus;
  o.taper_v_plus = v_plus;
  o.taper_v_minus = v_minus;
  return o;
}

CavityOptions stump(double convergence, double shoulder, bool round) {
  CavityOptions o;
  o.kind = CavityKind::kStump;
  o.size = Vec3(8, 8, 8);
  o.corner = round ? 4 : 2.5;
  o.shoulder_width = shoulder;
  o.convergence_u = o.convergence_v = convergence;
  return o;
}

std::vector<Case> cases() {
  std::vector<Case> list = {
      {"box, parallel walls", PreparationType::kClass1, box(0, 0, 0, 0)},
      {"box, 3 5 10 20 deg", PreparationType::kClass1, box(3, 5, 10, 20)},
      {"box, 6 deg all round", PreparationType::kClass1, box(6, 6, 6, 6)},
      {"dovetail, -2 deg", PreparationType::kClass1, box(0, 0, -2, -2)},
      {"dovetail, -8 deg", PreparationType::kClass1, box(4, 4, -8, -8)},
      {"dovetail, -5 deg all round", PreparationType::kClass1, box(-5, -5, -5, -5)},
      {"dovetail, -10 deg all round", PreparationType::kClass1, box(-10, -10, -10, -10)},
      {"tilted floor", PreparationType::kClass1, box(5, 5, 5, 5)},
      {"bowed floor", PreparationType::kClass1, box(5, 5, 5, 5)},
      {"class II", PreparationType::kClass2, box(2, 2, 3, 3)},
      {"round stump, 12 deg", PreparationType::kCrown, stump(12, 1.0, true)},
      {"round stump, 20 deg, narrow", PreparationType::kCrown, stump(20, 0.5, true)},
      {"square stump, 6 deg", PreparationType::kCrown, stump(6, 1.2, false)},
      {"undercut stump, -4 deg", PreparationType::kCrown, stump(-4, 1.2, true)},
  };
  list[7].cavity.floor_tilt_u = 6;
  list[7].cavity.floor_tilt_v = -4;
  list[8].cavity.bow = 0.2;
  list[9].cavity.kind = CavityKind::kClass2;
  list[9].cavity.size = Vec3(9, 5.5, 7);
  list[9].cavity.axial_taper = 4;
  list[9].cavity.proximal_taper = 3;
  list[9].cavity.neighbour_gap = 0.4;
  for (Case& c : list)
    if (c.type == PreparationType::kClass1) {
      c.cavity.pulp_depth = 3.1;
      c.cavity.pulp_size = Vec3(2, 1, 2);
    }
  return list;
}

Preparation measured(const CavityOptions& cavity, PreparationType type,
                     const std::function<void(PreparationOptions&)>& change = {}) {
  const CavitySpecimen specimen = make_cavity(cavity);
  PreparationOptions options;
  options.type = type;
  if (change) change(options);
  return measure_preparation(specimen.original, specimen.prepared,
                             extract_surface(specimen.prepared, SurfaceOf::kAll), options);
}

double value_of(const Preparation& preparation, const std::string& key) {
  const Quantity* q = find_quantity(preparation.quantities, key);
  return q ? q->value : NAN;
}

// What is compared of a type; keys are those of score.json.
std::vector<std::string> compared(PreparationType type) {
  std::vector<std::string> list = {"wall_angles_deg.mesial",
                                   "wall_angles_deg.distal",
                                   "wall_angles_deg.buccal",
                                   "wall_angles_deg.lingual",
                                   "remaining_dentin_min_mm",
                                   "undercut_along_axis_mm",
                                   "undercut_max_mm",
                                   "depth_min_mm",
                                   "depth_max_mm"};
  const auto add = [&](std::initializer_list<const char*> more) {
    list.insert(list.end(), more.begin(), more.end());
  };
  if (type == PreparationType::kCrown)
    add({"convergence_deg.mesiodistal", "convergence_deg.buccolingual", "margin_width_mm",
         "wall_height_mm", "occlusal_reduction_mm", "occlusoaxial_angle_deg", "margin_gaps",
         "margin_form.shoulder", "axial_reduction_mm.mesial", "axial_reduction_mm.lingual"});
  else
    add({"depth_mm", "floor_tilt_deg", "floor_flatness_mm"});
  if (type == PreparationType::kClass1)
    add({"convergence_deg.mesiodistal", "convergence_deg.buccolingual", "width_mm", "width_mm",
         "length_mm"});
  if (type == PreparationType::kClass2)
    add({"wall_angles_deg.axial", "wall_angles_deg.proximal_buccal",
         "wall_angles_deg.proximal_lingual", "gingival_depth_mm", "axial_wall_height_mm",
         "box_width_mm", "box_width_floor_mm", "gingival_floor_width_mm", "axial_depth_mm",
         "axiopulpal_radius_mm", "convergence_deg.proximal", "isthmus_width_mm", "width_mm",
         "box_clearance_mm"});
  return list;
}

class ExactPreparations : public testing::TestWithParam<std::tuple<double, bool>> {};

TEST_P(ExactPreparations, AreMeasuredWithinADegreeAndHalfAVoxel) {
  const auto [voxel, turned] = GetParam();
  std::printf("%-28s %-34s %9s %9s %8s  (%.3g mm, %s)\n", "preparation", "figure", "truth",
              "measured", "error", voxel, turned ? "turned" : "straight");
  for (Case c : cases()) {
    c.cavity.voxel = voxel;
    if (turned) {
      c.cavity.pose.orientation = orientation_of_axis(Vec3(0.31, -0.52, 0.79), 0.7).normalized();
      c.cavity.pose.position = Vec3(3.13, -2.27, 11.41);
    }
    const CavityTruth truth = cavity_truth(c.cavity);
    const Preparation preparation = measured(c.cavity, c.type);
    EXPECT_EQ(preparation.frame.axis_source, "recorded");
    for (const std::string& key : compared(c.type)) {
      const std::optional<double> expected = truth_value(truth, key);
      const double got = value_of(preparation, key);
      if (!expected) continue;
      std::printf("%-28s %-34s %9.4f %9.4f %8.4f\n", c.name.c_str(), key.c_str(), *expected, got,
                  got - *expected);
      const bool angle = key.find("deg") != std::string::npos;
      const bool radius = key.ends_with("radius_mm");  // of a sharp edge that voxels bevel
      const double length = radius ? voxel : key.starts_with("undercut") ? voxel / 3 : voxel / 2;
      EXPECT_NEAR(got, *expected, angle ? 1.0 : length) << c.name << ' ' << key;
    }
    if (c.type == PreparationType::kCrown) {
      std::printf("%-28s %-34s %9.4f %9.4f\n", c.name.c_str(), "finish_line_roughness_mm", 0.0,
                  value_of(preparation, "finish_line_roughness_mm"));
      EXPECT_LT(value_of(preparation, "finish_line_roughness_mm"), voxel / 4) << c.name;
    }
    // A false undercut would be one of noise; a true one may not be missed.
    if (const auto undercut = truth_value(truth, "undercut_along_axis_mm");
        !undercut || *undercut == 0) {
      EXPECT_EQ(value_of(preparation, "undercut_along_axis_mm"), 0) << c.name;
      EXPECT_EQ(value_of(preparation, "undercut_area_mm2"), 0) << c.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(VoxelsAndPoses, ExactPreparations,
                         testing::Combine(testing::Values(0.1, 0.05), testing::Bool()),
                         [](const auto& test) {
                           return std::string(std::get<0>(test.param) > 0.07 ? "Coarse" : "Fine") +
                                  (std::get<1>(test.param) ? "Turned" : "Straight");
                         });

// A scan blurs the corner between isthmus and box, and its noise leaves facets of the box's walls
// whose way down ends on the axial wall.
TEST(ClassII, WidthOfABlurredCavityIsThatOfTheIsthmus) {
  CavityOptions o = box(3, 3, 3, 3);
  o.kind = CavityKind::kClass2;
  o.size = Vec3(9, 5.5, 7);
  const CavityTruth truth = cavity_truth(o);
  const auto cavity = cavity_distance(o);
  Lattice lattice;
  const double voxel = lattice.voxel = 0.1;
  lattice.origin = Vec3(0.013, -0.021, 0.037);
  const auto scanned = [&](bool cut) {
    return build_tooth(
        lattice, Index3(-48, -58, -38), Index3(48, 3, 38),
        [=](const Vec3& x) {
          double sum = 0;
          for (const Vec3& way :
               {Vec3(1, 1, 1), Vec3(1, -1, -1), Vec3(-1, 1, -1), Vec3(-1, -1, 1), Vec3(-1, -1, -1),
                Vec3(-1, 1, 1), Vec3(1, -1, 1), Vec3(1, 1, -1)}) {
            const Vec3 p = x + 0.5 * voxel * way;
            const double tooth =
                std::max({std::abs(p.x()) - 4.5, std::abs(p.z()) - 3.5, p.y(), -5.5 - p.y()});
            const double solid = cut ? std::max(tooth, -cavity(p)) : tooth;
            sum += std::clamp(solid, -voxel, voxel);
          }
          // Noise of a fifteenth of a voxel, the same each time.
          const double noise = std::sin(91.7 * x.x() / voxel + 13.1 * x.y() / voxel +
                                        57.3 * x.z() / voxel + (cut ? 1 : 2));
          ToothSample s;
          s.solid = static_cast<float>(sum / 8 + voxel / 15 * noise);
          s.tissue = {s.solid, 3.f, 3.f};
          s.label = s.solid < 0 ? Tissue::kEnamel : Tissue::kAir;
          return s;
        },
        false);
  };
  const LayeredTooth original = scanned(false), prepared = scanned(true);
  PreparationOptions options;
  options.type = PreparationType::kClass2;
  options.occlusal = Vec3::UnitY();
  options.mesial = Vec3::UnitX();
  options.buccal = -Vec3::UnitZ();
  options.cut_tolerance = 0.3 * voxel;
  const Preparation preparation =
      measure_preparation(original, prepared, extract_surface(prepared, SurfaceOf::kAll), options);
  for (const char* key : {"width_mm", "isthmus_width_mm", "box_width_mm"})
    EXPECT_NEAR(value_of(preparation, key), *truth_value(truth, key), voxel) << key;
}

// Stumps whose margin and top are shaped: what is found of their profile, and how near.
CavityOptions shaped_stump(double shoulder_radius, double slope, double occlusal_radius,
                           double width = 1) {
  CavityOptions o = stump(12, width, true);
  o.size = Vec3(6.5, 6, 6.5);
  o.corner = 3.25;
  o.enamel = 1;
  o.occlusal_reduction = 1;
  o.shoulder_level = 4.5;
  o.shoulder_radius = shoulder_radius;
  o.shoulder_slope = slope;
  o.occlusal_radius = occlusal_radius;
  return o;
}

TEST(Profile, OfAMarginAndOfTheOcclusoaxialEdge) {
  const std::pair<const char*, CavityOptions> stumps[] = {
      {"rounded shoulder", shaped_stump(0.3, 0, 0.5)},
      {"deep chamfer", shaped_stump(0.8, 0, 0.8, 0.8)},
      {"chamfer", shaped_stump(1.2, 0, 0.3, 0.6)},
      {"bevel", shaped_stump(0, 45, 0.2, 0.8)}};
  for (const double voxel : {0.1, 0.05})
    for (auto [name, o] : stumps) {
      if (voxel < 0.07 && std::string(name) != "rounded shoulder") continue;
      o.voxel = voxel;
      o.pose.orientation = orientation_of_axis(Vec3(0.31, -0.52, 0.79), 0.7).normalized();
      const CavityTruth truth = cavity_truth(o);
      const Preparation preparation = measured(o, PreparationType::kCrown);
      const auto near = [&](const char* key, double bound) {
        const double expected = *truth_value(truth, key), got = value_of(preparation, key);
        std::printf("%-18s %-34s %9.4f %9.4f %8.4f  (%.3g mm)\n", name, key, expected, got,
                    got - expected, voxel);
        EXPECT_NEAR(got, expected, bound) << name << ' ' << key;
      };
      near("margin_form.shoulder", 0.05);
      near("margin_form.chamfer", 0.05);
      near("margin_form.bevel", 0.05);
      near("margin_width_mm", voxel / 2);
      near("cavosurface_angle_deg", 5);
      for (const char* key : {"line_angle_radius_mm", "occlusoaxial_radius_mm"})
        near(key, find_quantity(preparation.quantities, key)->uncertainty);
      near("occlusoaxial_angle_deg", 2);
      near("margin_gaps", 0);
      EXPECT_EQ(value_of(preparation, "margin_gap_deg"), 0) << name;
      EXPECT_NEAR(value_of(preparation, "occlusoaxial_sharp"), o.occlusal_radius < 0.15, 0.02)
          << name;
    }
}

TEST(Margin, IsInterruptedWhereTheToothWasNotCut) {
  // A stump of 2.8 mm within a cylinder of 4, but for a sector of 40 degrees towards +y.
  Lattice lattice;
  lattice.voxel = 0.1;
  lattice.origin = Vec3(0.013, -0.021, 0.037);
  const auto tooth_of = [&](bool cut) {
    return build_tooth(
        lattice, Index3::Constant(-45), Index3::Constant(45),
        [=](const Vec3& x) {
          const double r = std::hypot(x.x(), x.y());
          double solid = std::max(r - 4, std::abs(x.z()) - 4);
          // Negative in the sector, as far from its sides.
          const double half = 20 * M_PI / 180;
          const double sector = std::abs(x.x()) * std::cos(half) - x.y() * std::sin(half);
          const double removed = -std::min(std::max(2.8 - r, -1 - x.z()), 2.5 - x.z());
          if (cut) solid = std::max(solid, std::min(removed, sector));
          ToothSample s;
          s.solid = static_cast<float>(solid);
          s.tissue = {s.solid, 3.f, 3.f};
          s.label = solid < 0 ? Tissue::kEnamel : Tissue::kAir;
          return s;
        },
        false);
  };
  const LayeredTooth original = tooth_of(false), prepared = tooth_of(true);
  PreparationOptions options;
  options.type = PreparationType::kCrown;
  options.occlusal = Vec3::UnitZ();
  options.mesial = Vec3::UnitX();
  options.buccal = Vec3::UnitY();
  const Preparation preparation =
      measure_preparation(original, prepared, extract_surface(prepared, SurfaceOf::kAll), options);
  EXPECT_EQ(value_of(preparation, "margin_gaps"), 1);
  EXPECT_NEAR(value_of(preparation, "margin_gap_deg"), 40, 3);
  EXPECT_NEAR(value_of(preparation, "margin_gap_longest_mm"), 4 * 40 * M_PI / 180, 0.2);
  EXPECT_TRUE(std::any_of(preparation.notes.begin(), preparation.notes.end(), [](const auto& note) {
    return note.find("the margin is interrupted: buccal") != std::string::npos;
  }));
}

// A cylinder of 4 mm, 8 mm high, of which a stump of 2.8 mm is left above a shoulder whose height
// goes up and down `waves` times around, by `amplitude`.
double finish_line_roughness(double amplitude, int waves, double voxel, bool cut_here) {
  Lattice lattice;
  lattice.voxel = voxel;
  lattice.origin = Vec3(0.013, -0.021, 0.037);
  const int reach = static_cast<int>(std::ceil(5 / voxel));
  const auto sample_of = [](double solid) {
    ToothSample s;
    s.solid = static_cast<float>(solid);
    s.tissue = {s.solid, 3.f, 3.f};
    s.label = solid < 0 ? Tissue::kEnamel : Tissue::kAir;
    return s;
  };
  const auto removed_depth = [=](const Vec3& x) {
    const double r = std::hypot(x.x(), x.y()), phase = waves * std::atan2(x.y(), x.x());
    const double slope = amplitude * waves / std::max(r, 1.0) * std::cos(phase);
    const double above = (amplitude * std::sin(phase) - 1 - x.z()) / std::hypot(1, slope);
    return -std::min(std::max(2.8 - r, above), 2.5 - x.z());
  };
  const auto tooth_of = [&](bool cut) {
    return build_tooth(
        lattice, Index3::Constant(-reach), Index3::Constant(reach),
        [=](const Vec3& x) {
          const double solid = std::max(std::hypot(x.x(), x.y()) - 4, std::abs(x.z()) - 4);
          return sample_of(cut ? std::max(solid, removed_depth(x)) : solid);
        },
        false);
  };
  const LayeredTooth original = tooth_of(false);
  LayeredTooth prepared = tooth_of(true);
  if (cut_here) {
    LayeredTooth removed = build_tooth(
        lattice, Index3::Constant(-reach), Index3::Constant(reach),
        [=](const Vec3& x) { return sample_of(-removed_depth(x)); }, false);
    prepared.parts = ToothParts{original.solid, std::move(removed.solid)};
  }
  PreparationOptions options;
  options.type = PreparationType::kCrown;
  options.occlusal = Vec3::UnitZ();
  return value_of(
      measure_preparation(original, prepared, extract_surface(prepared, SurfaceOf::kAll), options),
      "finish_line_roughness_mm");
}

TEST(FinishLine, RoughnessIsThatOfTheWavesOfTheShoulder) {
  for (const bool cut_here : {false, true})
    for (const double voxel : {0.1, 0.05}) {
      EXPECT_LT(finish_line_roughness(0, 0, voxel, cut_here), (cut_here ? 0.05 : 0.2) * voxel)
          << voxel;
      for (const int waves : {16, 25}) {
        // Of cos(k s) a quadratic fit over |s| <= L keeps 3 / (8 L) times the integral of
        // (3 - 5 s^2 / L^2) cos(k s).
        const double kl = 0.75 * waves / 4.0, sine = std::sin(kl), cosine = std::cos(kl);
        const double kept =
            3 / (8 * kl) * (6 * sine - 10 * (sine + 2 * cosine / kl - 2 * sine / (kl * kl)));
        EXPECT_NEAR(finish_line_roughness(0.1, waves, voxel, cut_here),
                    0.1 / std::sqrt(2) * (1 - kept), 0.1 * voxel)
            << voxel << ", " << waves << ", " << cut_here;
      }
    }
}

}  // namespace
}  // namespace toothprep
