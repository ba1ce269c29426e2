// Open and damaged surface scans become the solids that they were made from; what would have to be
// invented is refused. The truth is that of the whole ball or box.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "known_shells.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::ThrowsMessage;
using units::kPi;

constexpr double kRadius = 4;

// Edges of 0.2 mm, 0.2 % less volume than the ball.
Shell ball(const Vec3& centre = Vec3::Zero()) { return octahedral_ball(kRadius, centre, 5); }

Vec3 middle_of(const Shell& shell, std::size_t t) {
  const auto& v = shell.triangles[t];
  return (shell.points[v[0]] + shell.points[v[1]] + shell.points[v[2]]) / 3;
}

template <class Gone>
Shell without(const Shell& shell, const Gone& gone) {
  Shell kept;
  kept.file = shell.file;
  kept.points = shell.points;
  for (std::size_t t = 0; t < shell.triangles.size(); ++t)
    if (!gone(middle_of(shell, t))) kept.triangles.push_back(shell.triangles[t]);
  return numbered(kept);
}

double volume_of(const Shell& shell) {
  double volume = 0;
  for (const auto& t : shell.triangles)
    volume += shell.points[t[0]].dot(shell.points[t[1]].cross(shell.points[t[2]])) / 6;
  return volume;
}

const Box kAbove{Vec3(-9, -9, -2), Vec3(9, 9, 9)};  // z of at least -2
// Of the ball above z = -2: a cap of height 6.
const double kVolumeAbove = kPi * 36 * (3 * kRadius - 6) / 3;

double relative_error(double volume, double truth) { return std::abs(volume / truth - 1); }

TEST(Closing, AClosedShellStaysAsItIs) {
  const Shell whole = ball();
  const SoundShell sound = close_shell(whole);
  EXPECT_EQ(sound.shell.triangles, whole.triangles);
  EXPECT_THAT(sound.notes, IsEmpty());
  EXPECT_THAT(sound.open_sides, IsEmpty());
}

TEST(Closing, AFlatNeckIsClosedByItsPlane) {
  const SoundShell sound = close_shell(clipped(ball(), kAbove));
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
  EXPECT_LT(relative_error(volume_of(sound.shell), kVolumeAbove), 0.003);
  ASSERT_THAT(sound.notes, ElementsAre(AllOf(HasSubstr("closed the open side, 6.9"),
                                             HasSubstr("-2.000) mm, by a plane"))));
  ASSERT_THAT(sound.open_sides, SizeIs(1));
  EXPECT_LT((sound.open_sides[0].outward + Vec3::UnitZ()).norm(), 1e-6);
  EXPECT_TRUE(sound.open_sides[0].beyond({0, 0, -2.1}));
  EXPECT_FALSE(sound.open_sides[0].beyond({3, 0, -1.9}));
}

TEST(Closing, AnUnevenNeckGetsABaseBelowIt) {
  // The rim rises and falls by 0.5 mm, as gum does, and is jagged by the triangles.
  const Shell open = without(ball(), [](const Vec3& p) {
    return p.z() < -2 + 0.5 * std::sin(2 * std::atan2(p.y(), p.x()));
  });
  const SoundShell sound = close_shell(open);
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
  EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("by a base of")));
  // Down to a plane at about -2.9, straight from the rim: less than the ball has there and 0.5 mm.
  EXPECT_GT(volume_of(sound.shell), kVolumeAbove - kPi * 12 * 0.1);
  EXPECT_LT(volume_of(sound.shell), kVolumeAbove + kPi * 12 * 1.1);
  double lowest = 0, scanned = 0;
  for (std::size_t t = 0; t < sound.shell.triangles.size(); ++t) {
    lowest = std::min(lowest, middle_of(sound.shell, t).z());
    if (!sound.added[t]) scanned = std::min(scanned, middle_of(sound.shell, t).z());
  }
  EXPECT_GT(scanned, -2.55) << "what was added is marked";
  EXPECT_LT(lowest, -2.6);
  // Beyond the rim depends on where: it is at -1.5 and at -2.5.
  const double up = kPi / 4, down = 3 * kPi / 4;
  EXPECT_TRUE(sound.open_sides[0].beyond({3 * std::cos(up), 3 * std::sin(up), -1.9}));
  EXPECT_FALSE(sound.open_sides[0].beyond({3 * std::cos(down), 3 * std::sin(down), -2.1}));
}

TEST(Closing, AHoleIsFilledAsTheSurfaceGoesOn) {
  for (const double width : {0.6, 1.5, 2.5}) {
    const Vec3 at = kRadius * Vec3(1, 1, 1).normalized();
    const Shell holed = without(ball(), [&](const Vec3& p) { return (p - at).norm() < width / 2; });
    const SoundShell sound = close_shell(holed);
    EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("filled a hole of")));
    double worst = 0;
    for (const Vec3& p : sound.shell.points) worst = std::max(worst, std::abs(p.norm() - kRadius));
    EXPECT_LT(worst, 0.02) << width << " mm wide, on a sphere whose cap there is "
                           << width * width / 8 / kRadius << " mm high";
    EXPECT_LT(relative_error(volume_of(sound.shell), volume_of(ball())), 2e-4);
  }
}

TEST(Closing, AFlatHoleIsClosedAsItWas) {
  Shell box;
  box.file = "box.stl";
  for (int c = 0; c < 8; ++c) box.points.emplace_back(c & 1 ? 8 : 0, c & 2 ? 8 : 0, c & 4 ? 8 : 0);
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}};
  const SoundShell sound = close_shell(numbered(box));
  EXPECT_NEAR(volume_of(sound.shell), 512, 1e-9);
}

TEST(Closing, ASeamOfDoublePointsIsJoined) {
  // Two halves with points of their own, some nanometres apart, as rounded text has them.
  Shell upper = without(ball(), [](const Vec3& p) { return p.z() < 0; });
  const Shell lower = without(ball(), [](const Vec3& p) { return p.z() > 0; });
  for (Vec3& p : upper.points) p *= 1 + 1e-5;
  append(upper, lower);
  const SoundShell sound = close_shell(upper);
  EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("of a seam")));
  EXPECT_LT(relative_error(volume_of(sound.shell), volume_of(ball())), 1e-4);
}

TEST(Closing, FlippedFacesFinsAndLoosePiecesAreMended) {
  Shell shell = ball();
  for (const std::size_t t : {100U, 101U, 4000U})
    std::swap(shell.triangles[t][0], shell.triangles[t][1]);
  // A fin on an edge, and a speck beside the scan.
  shell.points.push_back(1.2 * shell.points[shell.triangles[200][0]]);
  const auto fin = static_cast<std::uint32_t>(shell.points.size() - 1);
  shell.triangles.push_back({shell.triangles[200][0], shell.triangles[200][1], fin});
  Shell speck;
  speck.points = {Vec3(6, 0, 0), Vec3(6.1, 0, 0), Vec3(6, 0.1, 0)};
  speck.triangles = {{0, 1, 2}};
  append(shell, speck);
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, Contains(HasSubstr("cut out 1 face that share an edge")));
  EXPECT_THAT(sound.notes, Contains(HasSubstr("turned 3 flipped faces")));
  EXPECT_THAT(sound.notes, Contains(HasSubstr("left out 1 loose piece")));
  EXPECT_NEAR(volume_of(sound.shell), volume_of(ball()), 1e-9);
}

TEST(Closing, AFoldedSpotIsCutOutAndFilled) {
  Shell shell = ball();
  const std::uint32_t p = shell.triangles[1234][0];
  // Slid along the sphere beyond its neighbours: the faces around it fold.
  const Vec3 along = shell.points[p].unitOrthogonal();
  shell.points[p] = 1.0005 * kRadius * (shell.points[p] + 0.6 * along).normalized();
  ASSERT_THAT(shell_faults(shell), Contains(HasSubstr("intersect")));
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, Contains(HasSubstr("that intersect, near")));
  EXPECT_LT(relative_error(volume_of(sound.shell), volume_of(ball())), 2e-3);
}

TEST(Closing, AScanThatLooksInwardIsTurned) {
  Shell shell = clipped(ball(), kAbove);
  for (auto& t : shell.triangles) std::swap(t[0], t[1]);
  const SoundShell sound = close_shell(shell, 1.0);
  EXPECT_GT(volume_of(sound.shell), kVolumeAbove);
  EXPECT_LT((sound.open_sides.at(0).outward + Vec3::UnitZ()).norm(), 1e-6);
}

TEST(Closing, WhatWouldBeInventedIsRefused) {
  const auto refusal = [](const Shell& shell) {
    try {
      static_cast<void>(close_shell(shell));
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  const Shell tube = clipped(ball(), {Vec3(-9, -9, -2), Vec3(9, 9, 2)});
  EXPECT_THAT(refusal(tube), AllOf(HasSubstr("ball.stl: does not bound a solid"),
                                   HasSubstr("has a second opening, 6.9"), HasSubstr("--roi")));
  const Shell shallow = clipped(ball(), {Vec3(-9, -9, 3.6), Vec3(9, 9, 9)});
  EXPECT_THAT(refusal(shallow), HasSubstr("rises only 0.4 mm"));
  // A saddle that rises and falls by 3 mm is no neck's.
  const Shell saddle = without(ball(), [](const Vec3& p) {
    return p.z() < 3 * std::sin(2 * std::atan2(p.y(), p.x())) - 0.5;
  });
  EXPECT_THAT(refusal(saddle), AllOf(HasSubstr("is no neck"), HasSubstr("its rim strays")));
  // Two sheets through each other all along.
  Shell crossed = ball();
  append(crossed, ball(Vec3(3, 0, 0)));
  EXPECT_THAT(refusal(crossed), HasSubstr("intersect"));
}

class MeshFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::path(::testing::TempDir()) / "closing-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string written(const Shell& shell, const std::string& name, double scale = 1) const {
    TriangleMesh mesh;
    for (const Vec3& p : shell.points) mesh.vertices.push_back((scale * p).cast<float>());
    mesh.triangles = shell.triangles;
    mesh.tissue.assign(mesh.vertices.size(), 1);
    write_mesh(mesh, path(name));
    return path(name);
  }

 private:
  std::filesystem::path folder_;
};

TEST_F(MeshFiles, OneToothOfSeveralIsTakenByNumberByPlaceAndByBox) {
  Shell jaw = ball();
  Shell small = ball(Vec3(20, 0, 0));
  for (Vec3& p : small.points) p = Vec3(20, 0, 0) + 0.8 * (p - Vec3(20, 0, 0));
  append(jaw, small);
  const std::string file = written(jaw, "jaw.ply");
  const auto centre = [&](const ShellReading& how) {
    const ShellSurvey survey = survey_shell(read_sound_shell(file, how).shell);
    EXPECT_EQ(survey.parts.size(), 1U);
    return 0.5 * (survey.parts[0].bounds.min + survey.parts[0].bounds.max).x();
  };
  ShellReading second, there, box, none;
  second.tooth = 2;
  there.tooth_at = Vec3(15, 1, 0);
  box.roi = Box{Vec3(10, -9, -9), Vec3(30, 9, 9)};
  none.tooth = 3;
  EXPECT_NEAR(centre(second), 20, 1e-5);
  EXPECT_NEAR(centre(there), 20, 1e-5);
  EXPECT_NEAR(centre(box), 20, 1e-5);
  EXPECT_THAT([&] { static_cast<void>(read_sound_shell(file, none)); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("--tooth 3 is not there"),
                        HasSubstr("2: 6.4 x 6.4 x 6.4 mm at 20.0,0.0,0.0, 137 mm3"))));
  const SoundShell both = read_sound_shell(file, {});
  EXPECT_THAT(both.notes, ElementsAre(HasSubstr("all of its parts are taken, 2")));
}

TEST_F(MeshFiles, ABoxCutsAToothFree) {
  // What the box cuts through becomes the open side, in the box's plane.
  ShellReading how;
  how.roi = kAbove;
  const SoundShell sound = read_sound_shell(written(ball(), "ball.stl"), how);
  EXPECT_LT(relative_error(volume_of(sound.shell), kVolumeAbove), 0.003);
  EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("closed the open side")));
}

TEST_F(MeshFiles, AGzippedMeshIsReadAndADamagedOneRefused) {
  const std::string plain = written(ball(), "ball.stl");
  std::ifstream in(plain, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  gzFile out = gzopen(path("ball.STL.gz").c_str(), "wb");
  gzwrite(out, bytes.data(), static_cast<unsigned>(bytes.size()));
  gzclose(out);
  EXPECT_EQ(read_shell(path("ball.STL.gz")).triangles, read_shell(plain).triangles);
  std::ifstream packed_in(path("ball.STL.gz"), std::ios::binary);
  std::string packed{std::istreambuf_iterator<char>(packed_in), {}};
  const auto refused = [&](const std::string& content, const std::string& why) {
    std::ofstream(path("bad.stl.gz"), std::ios::binary) << content;
    EXPECT_THAT([&] { static_cast<void>(read_shell(path("bad.stl.gz"))); },
                ThrowsMessage<InputError>(HasSubstr(why)));
  };
  refused(packed.substr(0, packed.size() / 2), "truncated");
  refused("not gzip at all", "is no gzip file");
  packed[packed.size() / 2] = static_cast<char>(packed[packed.size() / 2] ^ 0x55);
  refused(packed, "");
}

TEST_F(MeshFiles, AnotherUnitIsRecognisedByTheSizeAndAskedFor) {
  EXPECT_THAT(
      [&] { static_cast<void>(read_shell(written(ball(), "m.stl", 1e-3))); },
      ThrowsMessage<InputError>(AllOf(HasSubstr("0.008 mm"), HasSubstr("--length-unit m "))));
  EXPECT_THAT(read_sound_shell(written(ball(), "cm.stl", 0.1), {}).notes,
              ElementsAre(AllOf(HasSubstr("0.8 mm, or 8 mm if"), HasSubstr("--length-unit cm"))));
  ShellReading how;
  how.mm_per_unit = 10;
  const SoundShell sound = read_sound_shell(path("cm.stl"), how);
  EXPECT_THAT(sound.notes, IsEmpty());
  EXPECT_LT(relative_error(volume_of(sound.shell), volume_of(ball())), 1e-5);
}

TEST_F(MeshFiles, TheEnamelModelHasItsThickness) {
  ShellReading how;
  how.roi = kAbove;
  std::vector<std::string> notes;
  ShellOptions options;
  options.voxel = 0.1;
  const LayeredTooth tooth =
      voxelize_bare_shell(written(ball(), "ball.stl"), 1.0, how, options, notes);
  EXPECT_THAT(notes, Contains(HasSubstr("are a model, not measured: enamel 1 mm thick")));
  EXPECT_EQ(tooth.provenance.at("enamel_model_mm"), "1");
  const auto label = [&](const Vec3& x) {
    const Index3 i = tooth.lattice.to_index(x).array().round().cast<int>();
    return tissue_at(static_cast<int>(tooth.tissue.value(i.x(), i.y(), i.z())) - 1);
  };
  // Full in the upper half of the crown's height of 6 mm (z > 1), and everywhere at right angles.
  EXPECT_EQ(label({0, 0, 3.15}), Tissue::kEnamel);
  EXPECT_EQ(label({0, 0, 2.85}), Tissue::kDentin);
  // A quarter of the height up (z = -0.5): half the thickness.
  const Vec3 out = Vec3(std::sqrt(16 - 0.25), 0, -0.5) / 4;
  EXPECT_EQ(label(3.6 * out), Tissue::kEnamel);
  EXPECT_EQ(label(3.3 * out), Tissue::kDentin);
  EXPECT_EQ(label({0, 0, -1.95}), Tissue::kDentin) << "at the cap there is none";
  const auto volumes = remaining_volumes_mm3(tooth);
  EXPECT_LT(relative_error(volumes[0] + volumes[1], kVolumeAbove), 0.005);
  EXPECT_EQ(volumes[2], 0);
}

TEST(Survey, NamesPartsAndOpenings) {
  Shell shell = clipped(ball(), kAbove);
  append(shell, ball(Vec3(10, 0, 0)));
  const ShellSurvey survey = survey_shell(shell);
  ASSERT_THAT(survey.parts, SizeIs(2));
  EXPECT_TRUE(survey.parts[0].closed);
  EXPECT_NEAR(survey.parts[0].volume_mm3, volume_of(ball()), 1e-6);
  EXPECT_FALSE(survey.parts[1].closed);
  ASSERT_THAT(survey.openings, SizeIs(1));
  EXPECT_NEAR(survey.openings[0].width, 2 * std::sqrt(12.0), 0.05);
  EXPECT_LT((survey.openings[0].centre - Vec3(0, 0, -2)).norm(), 0.02);
}

}  // namespace
}  // namespace toothprep
