// What is found when it isn't given: the kind of preparation, the occlusal axis, the sides; and
// what a neighbouring tooth must not change.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <sstream>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/preparation/preparation.h"

namespace toothprep {
namespace {

CavityOptions turned(CavityOptions o) {
  o.pose.orientation = orientation_of_axis(Vec3(0.31, -0.52, 0.79), 0.7).normalized();
  o.pose.position = Vec3(3.13, -2.27, 11.41);
  return o;
}

CavityOptions box() {
  CavityOptions o;
  o.size = Vec3(8, 4.5, 7);
  o.taper_u_plus = 3;
  o.taper_u_minus = 8;
  o.taper_v_plus = 5;
  o.taper_v_minus = 12;
  return turned(o);
}

CavityOptions class2(std::optional<double> gap = {}) {
  CavityOptions o = box();
  o.kind = CavityKind::kClass2;
  o.size = Vec3(9, 5.5, 7);
  o.taper_u_minus = o.taper_v_minus = o.taper_v_plus = 2;
  o.axial_taper = o.proximal_taper = 3;
  o.neighbour_gap = gap;
  return o;
}

CavityOptions stump(double corner, std::optional<double> gap = {}) {
  CavityOptions o;
  o.kind = CavityKind::kStump;
  o.size = Vec3(8, 8, 8);
  o.corner = corner;
  o.neighbour_gap = gap;
  return turned(o);
}

// A specimen that doesn't say where its axes point.
CavitySpecimen bare(const CavityOptions& cavity) {
  CavitySpecimen specimen = make_cavity(cavity);
  specimen.original.provenance.clear();
  specimen.prepared.provenance.clear();
  return specimen;
}

Preparation measured(const CavitySpecimen& specimen, const PreparationOptions& options) {
  return measure_preparation(specimen.original, specimen.prepared,
                             extract_surface(specimen.prepared, SurfaceOf::kAll), options);
}

Preparation measured(const CavitySpecimen& specimen, PreparationType type) {
  PreparationOptions options;
  options.type = type;
  return measured(specimen, options);
}

double value_of(const Preparation& preparation, const std::string& key) {
  const Quantity* q = find_quantity(preparation.quantities, key);
  return q ? q->value : NAN;
}

double degrees_between(const Vec3& a, const Vec3& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) * 180 / std::acos(-1.0);
}

PreparationType guessed(const CavityOptions& cavity, bool axes_known) {
  const CavitySpecimen specimen = axes_known ? make_cavity(cavity) : bare(cavity);
  return guess_type(specimen.original, specimen.prepared,
                    extract_surface(specimen.prepared, SurfaceOf::kAll), {});
}

TEST(FoundType, IsThatOfTheShape) {
  for (const bool axes_known : {true, false}) {
    EXPECT_EQ(guessed(box(), axes_known), PreparationType::kClass1) << axes_known;
    EXPECT_EQ(guessed(class2(), axes_known), PreparationType::kClass2) << axes_known;
    EXPECT_EQ(guessed(stump(4), axes_known), PreparationType::kCrown) << axes_known;
    EXPECT_EQ(guessed(stump(2.5), axes_known), PreparationType::kCrown) << axes_known;
  }
  CavityOptions dovetail = box(), narrow = box();
  dovetail.taper_v_plus = dovetail.taper_v_minus = -10;
  narrow.width = 0.8;
  narrow.taper_v_minus = 5;
  EXPECT_EQ(guessed(dovetail, false), PreparationType::kClass1);
  EXPECT_EQ(guessed(narrow, false), PreparationType::kClass1);
}

TEST(FoundType, IsNotChangedByANeighbour) {  // into which the open side and the stump look
  for (const bool axes_known : {true, false}) {
    EXPECT_EQ(guessed(class2(0.4), axes_known), PreparationType::kClass2) << axes_known;
    EXPECT_EQ(guessed(stump(4, 0.3), axes_known), PreparationType::kCrown) << axes_known;
  }
  CavityOptions cut = class2(0.4);
  cut.neighbour_damage = 0.3;
  EXPECT_EQ(guessed(cut, true), PreparationType::kClass2);
}

TEST(FoundFrame, IsWithinADegreeForACavityAndACrown) {
  for (const bool crown : {false, true}) {
    const CavityOptions cavity = crown ? stump(2.5) : box();
    const PreparationType type = crown ? PreparationType::kCrown : PreparationType::kClass1;
    const Preparation found = measured(bare(cavity), type);
    EXPECT_EQ(found.frame.axis_source, "found");
    EXPECT_FALSE(found.frame.sides_known);
    const Quat& turn = cavity.pose.orientation;
    EXPECT_LT(degrees_between(found.frame.d, turn * Vec3::UnitY()), 1) << crown;
    // The walls' own direction; which of its ends, and for the square stump which of two, is open.
    const double u = std::abs(found.frame.u.dot(turn * Vec3::UnitX())),
                 v = std::abs(found.frame.v.dot(turn * Vec3::UnitX()));
    EXPECT_GT(crown ? std::max(u, v) : u, std::cos(std::acos(-1.0) / 180)) << crown;
    EXPECT_EQ(found.notes.size(), 2U) << "that the axis was found, and the sides aren't known";

    // So the figures are those of the recorded axes.
    const Preparation recorded = measured(make_cavity(cavity), type);
    EXPECT_TRUE(recorded.notes.empty());
    for (const char* key : {"convergence_deg.mean", "depth_mm", "floor_tilt_deg", "length_mm",
                            "occlusal_reduction_mm", "margin_width_mm", "wall_height_mm"}) {
      const double value = value_of(recorded, key);
      if (std::isnan(value)) continue;
      EXPECT_NEAR(value_of(found, key), value, std::string(key).ends_with("deg") ? 1 : 0.05) << key;
    }
  }
}

TEST(FoundFrame, SaysThatTheTiltOfAClassTwoFloorSaysNothing) {
  CavityOptions cavity = class2();
  cavity.floor_tilt_v = 6;
  const Preparation found = measured(bare(cavity), PreparationType::kClass2);
  EXPECT_EQ(found.frame.axis_source, "found");
  ASSERT_FALSE(found.notes.empty());
  EXPECT_NE(found.notes[0].find("tilt says nothing"), std::string::npos);
  EXPECT_NEAR(value_of(measured(make_cavity(cavity), PreparationType::kClass2), "floor_tilt_deg"),
              6, 0.1);
}

TEST(FoundFrame, IsUncertainAndSoIsEveryAngleToIt) {
  const Preparation found = measured(bare(box()), PreparationType::kClass1),
                    recorded = measured(make_cavity(box()), PreparationType::kClass1);
  EXPECT_FALSE(found.frame.axis_known());
  EXPECT_GE(found.frame.axis_uncertainty_deg, 20);
  EXPECT_TRUE(recorded.frame.axis_known());
  EXPECT_EQ(recorded.frame.axis_uncertainty_deg, 0);
  const auto uncertainty = [](const Preparation& p, const char* key) {
    return find_quantity(p.quantities, key)->uncertainty;
  };
  const double u = found.frame.axis_uncertainty_deg;
  for (const char* key : {"floor_tilt_deg", "path_of_draw_tilt_deg"})
    EXPECT_GE(uncertainty(found, key), u) << key;
  // An axis off by u makes 2 mm look like 2 / cos(u).
  const double depth = find_quantity(found.quantities, "depth_mm")->value;
  EXPECT_GE(uncertainty(found, "depth_mm"), depth * (1 / std::cos(u * std::acos(-1.0) / 180) - 1));
  // Opposing walls stand to each other as they do.
  EXPECT_NEAR(uncertainty(found, "convergence_deg.mean"),
              uncertainty(recorded, "convergence_deg.mean"), 0.2);
}

TEST(FoundFrame, ThatOfTheToothIsTakenWithItsUncertainty) {
  const CavityOptions cavity = box();
  CavitySpecimen specimen = bare(cavity);
  const Vec3 d = cavity.pose.orientation * Vec3::UnitY();
  std::ostringstream text;
  text << d.x() << ' ' << d.y() << ' ' << d.z();
  specimen.original.provenance["frame_occlusal"] = text.str();
  specimen.original.provenance["frame_confidence"] = "occlusal 4.5 estimated; mesial not known";
  const Preparation p = measured(specimen, PreparationOptions{});
  EXPECT_EQ(p.frame.axis_source, "estimated");
  EXPECT_EQ(p.frame.axis_uncertainty_deg, 4.5);
  EXPECT_GE(find_quantity(p.quantities, "floor_tilt_deg")->uncertainty, 4.5);
}

// A box with upright walls in the middle of a block: what is left beside it is half the difference.
TEST(RemainingWalls, AreWhatTheBlockLeaves) {
  CavityOptions cavity = turned({});
  cavity.size = Vec3(8, 5, 6);
  cavity.length = 4.4;
  cavity.width = 2.6;
  const Preparation p = measured(make_cavity(cavity), PreparationType::kClass1);
  EXPECT_NEAR(value_of(p, "marginal_ridge_mm.mesial"), (8 - 4.4) / 2, 0.05);
  EXPECT_NEAR(value_of(p, "marginal_ridge_mm.distal"), (8 - 4.4) / 2, 0.05);
  EXPECT_NEAR(value_of(p, "wall_thickness_min_mm"), (6 - 2.6) / 2, 0.05);
  EXPECT_EQ(value_of(p, "breakthrough"), 0);
  // A class II looked at as a class I has come out at the side; its other ridge stands.
  const Preparation open = measured(make_cavity(class2()), PreparationType::kClass1);
  EXPECT_EQ(value_of(open, "breakthrough"), 1);
  const Preparation two = measured(make_cavity(class2()), PreparationType::kClass2);
  EXPECT_TRUE(std::isfinite(value_of(two, "marginal_ridge_mm.distal")));
  EXPECT_TRUE(std::isnan(value_of(two, "breakthrough")));
}

TEST(FoundFrame, WallsHaveNeutralNamesUntilTheSidesAreKnown) {
  const CavityOptions cavity = box();
  const CavitySpecimen specimen = bare(cavity);
  const Quat& turn = cavity.pose.orientation;
  PreparationOptions options;
  options.occlusal = turn * Vec3::UnitY();
  const Preparation unknown = measured(specimen, options);
  EXPECT_EQ(unknown.frame.axis_source, "given");
  for (const char* key : {"u_plus", "u_minus", "v_plus", "v_minus"})
    EXPECT_TRUE(std::isfinite(value_of(unknown, std::string("wall_angles_deg.") + key))) << key;
  EXPECT_TRUE(std::isnan(value_of(unknown, "wall_angles_deg.mesial")));

  // One of the two doesn't name the four walls, but turns the frame.
  options.buccal = turn * -Vec3::UnitZ();
  const Preparation half = measured(specimen, options);
  EXPECT_FALSE(half.frame.sides_known);
  EXPECT_NEAR(value_of(half, "wall_angles_deg.v_plus"), 5, 1);
  EXPECT_NEAR(value_of(half, "wall_angles_deg.v_minus"), 12, 1);

  options.mesial = turn * Vec3::UnitX();
  const Preparation known = measured(specimen, options);
  EXPECT_TRUE(known.frame.sides_known);
  EXPECT_TRUE(known.notes.empty());
  EXPECT_NEAR(value_of(known, "wall_angles_deg.mesial"), 3, 1);
  EXPECT_NEAR(value_of(known, "wall_angles_deg.distal"), 8, 1);
  EXPECT_NEAR(value_of(known, "wall_angles_deg.buccal"), 5, 1);
  EXPECT_NEAR(value_of(known, "wall_angles_deg.lingual"), 12, 1);
  // A tooth of the other side of the mouth: buccal is where lingual was.
  options.buccal = turn * Vec3::UnitZ();
  EXPECT_NEAR(value_of(measured(specimen, options), "wall_angles_deg.buccal"), 12, 1);
}

TEST(FoundFrame, DirectionsThatMakeNoFrameAreRefused) {
  const CavitySpecimen specimen = bare(box());
  const auto refused = [&](const std::function<void(PreparationOptions&)>& change) {
    PreparationOptions options;
    options.occlusal = Vec3::UnitY();
    change(options);
    EXPECT_THROW(measured(specimen, options), Error);
  };
  refused([](auto& o) { o.occlusal = Vec3::Zero(); });
  refused([](auto& o) { o.occlusal = Vec3(NAN, 0, 1); });
  refused([](auto& o) { o.occlusal = Vec3(INFINITY, 0, 1); });
  refused([](auto& o) { o.mesial = Vec3(0, -2, 0.01); });
  refused([](auto& o) { o.buccal = Vec3::UnitY(); });
  refused([](auto& o) {
    o.mesial = Vec3::UnitX();
    o.buccal = Vec3(-1, 0, 0.1);
  });
  refused([](auto& o) { o.undercut_threshold = NAN; });
}

// A groove in the neighbour is damage, no part of the preparation.
TEST(Neighbour, GeometryOfTheBoxIsTheSameWhetherItIsCutOrNot) {
  CavityOptions cavity = class2(0.4);
  const Preparation whole = measured(make_cavity(cavity), PreparationType::kClass2);
  cavity.neighbour_damage = 0.4;
  const Preparation cut = measured(make_cavity(cavity), PreparationType::kClass2);
  ASSERT_EQ(whole.quantities.size(), cut.quantities.size());
  for (const Quantity& q : whole.quantities)
    EXPECT_NEAR(value_of(cut, q.key), q.value, 1e-9) << q.key;
  EXPECT_NEAR(value_of(cut, "box_clearance_mm"), 0.4, 0.05);
}

}  // namespace
}  // namespace toothprep
