// Closed shells become the tooth they bound; shells that bound nothing are refused with the place.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include "known_shells.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using units::kPi;

// Twelve triangles; face 1 and 2 are the one at low z.
Shell box(const Vec3& low, const Vec3& high) {
  Shell shell;
  shell.file = "box.stl";
  for (int c = 0; c < 8; ++c)
    shell.points.emplace_back(c & 1 ? high.x() : low.x(), c & 2 ? high.y() : low.y(),
                              c & 4 ? high.z() : low.z());
  shell.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                     {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return numbered(shell);
}

void turn_inside_out(Shell& shell) {
  for (auto& t : shell.triangles) std::swap(t[1], t[2]);
}

LayeredTooth voxelized(const std::vector<TissueShell>& shells, double voxel,
                       std::vector<std::string>* notes = nullptr) {
  ShellOptions options;
  options.voxel = voxel;
  return voxelize_shells(shells, options, notes);
}

float value_at(const LevelSet& grid, const LayeredTooth& tooth, const Vec3& x) {
  const Index3 i = tooth.lattice.to_index(x).array().round().cast<int>();
  return grid.value(i.x(), i.y(), i.z());
}

class ShellFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::path(::testing::TempDir()) /
        ("shells_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string written(const std::string& name, const std::string& text) const {
    std::ofstream(path(name), std::ios::binary) << text;
    return path(name);
  }
  static std::string text_of(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  static void write(const Shell& shell, const std::string& file) {
    TriangleMesh mesh;
    for (const Vec3& p : shell.points) mesh.vertices.push_back(p.cast<float>());
    mesh.triangles = shell.triangles;
    mesh.tissue.assign(mesh.vertices.size(), 1);
    write_mesh(mesh, file);
  }
  static std::string refusal(const std::string& file) {
    try {
      static_cast<void>(read_shell(file));
    } catch (const InputError& e) {
      return e.what();
    }
    return "accepted";
  }

 private:
  std::filesystem::path folder_;
};

TEST(Shells, ABlockHasItsVolume) {
  // Faces lie on the lattice's voxel faces; only edges and corners are of second order.
  const LayeredTooth tooth = voxelized({{Tissue::kDentin, box({-4, -8, -4}, {4, 0, 4})}}, 0.1);
  EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), 512, 0.002 * 512);
  EXPECT_NEAR(remaining_volumes_mm3(tooth)[1], 512, 0.002 * 512);
  const Box bounds = bounds_of_solid(tooth);
  EXPECT_LT((bounds.min - Vec3(-4, -8, -4)).norm(), 1e-5);
  EXPECT_LT((bounds.max - Vec3(4, 0, 4)).norm(), 1e-5);
}

TEST(Shells, ABallHasItsVolumeAndItsDistances) {
  const double radius = 4;
  const Vec3 centre(10.013, -3.007, 25.021);
  const Shell shell = octahedral_ball(radius, centre, 7);
  ASSERT_THAT(shell_faults(shell), IsEmpty());
  const LayeredTooth tooth = voxelized({{Tissue::kEnamel, shell}}, 0.1);
  const double exact = 4.0 / 3 * kPi * std::pow(radius, 3);
  EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), exact, 0.002 * exact);
  // An octahedron's edge, pi/2 R, is halved seven times: edges are h = 0.05 mm, up to twice that in
  // the middle of its faces. A triangle lies up to h^2 / (6 R) = 0.4 um inside the sphere.
  double worst = 0;
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b)
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x =
          tooth.lattice.to_world(tooth.solid.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7));
      const double expected = std::clamp((x - centre).norm() - radius, -tooth.band(), tooth.band());
      worst = std::max(worst, std::abs(tooth.solid.brick(b)[v] - expected));
    }
  EXPECT_LT(worst, 5e-4);
  RecordProperty("worst_mm", std::to_string(worst));
}

TEST(Shells, AHullAndACapMakeTheSameTooth) {
  const Shell dentin = box({-3, -6, -3}, {3, 0, 3});
  const Shell hull = box({-3, -6, -3}, {3, 2, 3}), cap = box({-3, 0, -3}, {3, 2, 3});
  for (const Shell& enamel : {hull, cap}) {
    const LayeredTooth tooth =
        voxelized({{Tissue::kEnamel, enamel}, {Tissue::kDentin, dentin}}, 0.1);
    const auto volumes = remaining_volumes_mm3(tooth);
    EXPECT_NEAR(volumes[0], 72, 0.002 * 72);
    EXPECT_NEAR(volumes[1], 216, 0.002 * 216);
    EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), 288, 0.002 * 288);
    // No air layer along the shared face: the solid is deep there.
    EXPECT_FLOAT_EQ(value_at(tooth.solid, tooth, {0.05, 0.05, 0.05}), -0.3F);
    EXPECT_FLOAT_EQ(value_at(tooth.solid, tooth, {0.05, -0.05, 0.05}), -0.3F);
  }
}

TEST(Shells, TheInnermostShellWins) {
  const Shell enamel = octahedral_ball(4, Vec3::Zero(), 5),
              dentin = octahedral_ball(3, Vec3::Zero(), 5),
              pulp = octahedral_ball(1, Vec3::Zero(), 4);
  const LayeredTooth tooth =
      voxelized({{Tissue::kEnamel, enamel}, {Tissue::kPulp, pulp}, {Tissue::kDentin, dentin}}, 0.1);
  const auto sphere = [](double r) { return 4.0 / 3 * kPi * r * r * r; };
  const auto volumes = remaining_volumes_mm3(tooth);
  // 0.5 %: the balls are polyhedra (the pulp's edges are 0.1 of its radius, 0.3 % of its volume).
  EXPECT_NEAR(volumes[0], sphere(4) - sphere(3), 0.005 * sphere(4));
  EXPECT_NEAR(volumes[1], sphere(3) - sphere(1), 0.005 * sphere(3));
  EXPECT_NEAR(volumes[2], sphere(1), 0.01 * sphere(1));
}

TEST(Shells, AGapThinnerThanHalfAVoxelIsNone) {
  const Shell dentin = box({-3, -6, -3}, {3, 0, 3});
  for (const double gap : {0.01, 0.04}) {
    // The lattice has voxel centres at odd multiples of 0.05: one of them lies in the gap.
    for (const double base : {0.0, 0.03}) {
      Shell lower = dentin;
      for (Vec3& p : lower.points)
        if (p.y() > -1) p.y() = base;
      const LayeredTooth tooth = voxelized(
          {{Tissue::kDentin, lower}, {Tissue::kEnamel, box({-3, base + gap, -3}, {3, 2, 3})}}, 0.1);
      EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), 288, 0.002 * 288) << gap << " above " << base;
      const auto volumes = remaining_volumes_mm3(tooth);
      EXPECT_NEAR(volumes[1], 36 * (6 + base + gap / 2), 0.002 * 216);
      EXPECT_NEAR(volumes[0], 36 * (2 - base - gap / 2), 0.002 * 72);
    }
  }
  const LayeredTooth apart =
      voxelized({{Tissue::kDentin, dentin}, {Tissue::kEnamel, box({-3, 0.2, -3}, {3, 2, 3})}}, 0.1);
  EXPECT_NEAR(volume_mm3(apart.solid, 0.1), 288 - 0.2 * 36, 0.002 * 288) << "air of 0.2 mm stays";
}

TEST(Shells, ACavityIsAPartThatLooksInward) {
  Shell shell = box({-4, -4, -4}, {4, 4, 4});
  Shell hollow = box({-2, -2, -2}, {2, 2, 2});
  append(shell, hollow);
  EXPECT_THAT(shell_faults(shell), ElementsAre(AllOf(HasSubstr("part of 12 faces, with face 13"),
                                                     HasSubstr("inside out"))));
  const SoundShell sound = close_shell(shell);
  ASSERT_THAT(sound.notes, ElementsAre(HasSubstr("turned 12 faces")));
  ASSERT_THAT(shell_faults(sound.shell), IsEmpty());
  EXPECT_NEAR(volume_mm3(voxelized({{Tissue::kOther, sound.shell}}, 0.1).solid, 0.1), 512 - 64, 1);
}

TEST(Shells, AHoleIsNamedWithItsPlace) {
  Shell shell = box({0, 0, 0}, {8, 8, 8});
  shell.triangles.pop_back();  // corners (8,8,0), (8,8,8), (8,0,8)
  const auto faults = shell_faults(shell);
  ASSERT_THAT(faults, ElementsAre(AllOf(HasSubstr("has a hole: 3 border edges"),
                                        HasSubstr("near (8.000, 5.333, 5.333) mm"))));
}

TEST(Shells, AFlippedFaceIsNamedAndRepaired) {
  Shell shell = box({0, 0, 0}, {8, 8, 8});
  std::swap(shell.triangles[4][0], shell.triangles[4][1]);
  EXPECT_THAT(shell_faults(shell),
              ElementsAre(HasSubstr("face 5 at (2.667, 0.000, 2.667) mm is flipped")));
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("turned 1 flipped face")));
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
}

TEST(Shells, InsideOutIsToldAndRepaired) {
  Shell shell = box({0, 0, 0}, {8, 8, 8});
  turn_inside_out(shell);
  EXPECT_THAT(shell_faults(shell), ElementsAre(HasSubstr("inside out")));
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, ElementsAre(HasSubstr("turned 12 faces")));
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
}

TEST(Shells, IntersectingFacesAreNamed) {
  Shell shell = box({0, 0, 0}, {4, 4, 4});
  append(shell, box({2, 2, 2}, {6, 6, 6}));
  const auto faults = shell_faults(shell);
  ASSERT_EQ(faults.size(), 4U) << "three and the rest";
  EXPECT_THAT(faults[0], AllOf(HasSubstr("faces 3 and "), HasSubstr(" intersect at (")));
  EXPECT_THAT(faults[3], HasSubstr("more like it"));
  EXPECT_THROW(static_cast<void>(close_shell(shell)), InputError)
      << "which part is meant is not guessed";
}

TEST(Shells, FacesWithoutAreaOrGivenTwiceAreNamedAndRemoved) {
  Shell shell = box({0, 0, 0}, {8, 8, 8});
  shell.triangles.push_back({0, 1, 1});
  shell.triangles.push_back(shell.triangles[2]);
  shell = numbered(shell);
  const auto faults = shell_faults(shell);
  ASSERT_GE(faults.size(), 2U);
  EXPECT_THAT(faults[0], HasSubstr("face 13 at (5.333, 0.000, 0.000) mm has no area"));
  EXPECT_THAT(faults[1], AllOf(HasSubstr("face 14 at"), HasSubstr("is face 3 again")));
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, ElementsAre("removed 2 faces without area or given twice"));
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
}

TEST(Shells, ANeedleWithoutAreaIsRemoved) {
  // The edge (0,0,0)-(8,0,0) of the box has a point in its middle on one side only, and a triangle
  // without area closes the seam.
  Shell shell = box({0, 0, 0}, {8, 8, 8});
  shell.points.emplace_back(4, 0, 0);
  shell.triangles[0] = {0, 2, 8};
  shell.triangles.push_back({8, 2, 1});
  shell.triangles.push_back({0, 8, 1});
  shell = numbered(shell);
  EXPECT_THAT(shell_faults(shell),
              ElementsAre(HasSubstr("face 14 at (4.000, 0.000, 0.000) mm has no area")));
  const SoundShell sound = close_shell(shell);
  EXPECT_THAT(sound.notes, ElementsAre("removed 1 face without area"));
  EXPECT_THAT(shell_faults(sound.shell), IsEmpty());
}

TEST(Shells, PartsThatTouchInOnePointAreFit) {
  Shell shell = box({0, 0, 0}, {4, 4, 4});
  const Shell other = box({4, 4, 4}, {8, 8, 8});
  // Point 0 of the other box is point 7 of the first.
  for (auto t : other.triangles) {
    for (auto& v : t) v = v == 0 ? 7 : v + 7;
    shell.triangles.push_back(t);
  }
  shell.points.insert(shell.points.end(), other.points.begin() + 1, other.points.end());
  shell = numbered(shell);
  EXPECT_THAT(shell_faults(shell), IsEmpty());
}

TEST(Shells, NotesTellOfShellsThatDoNotMeetOrVanish) {
  std::vector<std::string> notes;
  voxelized({{Tissue::kDentin, box({0, 0, 0}, {4, 4, 4})},
             {Tissue::kEnamel, box({1, 1, 1}, {2, 2, 2})},
             {Tissue::kPulp, box({6, 6, 6}, {7, 7, 7})}},
            0.2, &notes);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("touches none"), HasSubstr("nothing of it is left")));
  EXPECT_THROW(voxelized({}, 0.1), Error);
  EXPECT_THROW(voxelized({{Tissue::kDentin, box({0, 0, 0}, {4, 4, 4})},
                          {Tissue::kDentin, box({0, 0, 0}, {4, 4, 4})}},
                         0.1),
               Error);
  EXPECT_THROW(voxelized({{Tissue::kDentin, box({0, 0, 0}, {100, 100, 100})}}, 0.01), Error);
}

TEST(Shells, TheSameBitsWhateverTheThreadCount) {
  const std::vector<TissueShell> shells{{Tissue::kEnamel, octahedral_ball(3, Vec3(1, 2, 3), 4)},
                                        {Tissue::kDentin, octahedral_ball(2, Vec3(1, 2, 3), 4)}};
  const std::string many = tooth_sha256(voxelized(shells, 0.1));
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(tooth_sha256(voxelized(shells, 0.1)), many);
}

TEST_F(ShellFiles, EveryFormatGivesTheSameShell) {
  const Shell shell = octahedral_ball(4, Vec3(1, 2, 3), 2);
  std::string text = "solid ball\n";
  std::string off = "OFF\n# a ball\n" + std::to_string(shell.points.size()) + " " +
                    std::to_string(shell.triangles.size()) + " 0\n";
  const auto line = [](const Vec3& p) {
    return std::to_string(p.x()) + " " + std::to_string(p.y()) + " " + std::to_string(p.z()) + "\n";
  };
  for (const Vec3& p : shell.points) off += line(p);
  for (const auto& t : shell.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const auto v : t) text += "vertex " + line(shell.points[v]);
    text += "endloop\nendfacet\n";
    off += "3 " + std::to_string(t[0]) + " " + std::to_string(t[1]) + " " + std::to_string(t[2]) +
           "\n";
  }
  written("text.stl", text + "endsolid ball\n");
  written("ball.off", off);
  for (const char* name : {"ball.stl", "ball.ply", "ball.obj", "BALL.STL"}) {
    // write_mesh wants lower case
    write(shell, path(name[0] == 'B' ? "x.stl" : name));
    if (name[0] == 'B') std::filesystem::rename(path("x.stl"), path(name));
  }
  for (const char* name :
       {"ball.stl", "ball.ply", "ball.obj", "BALL.STL", "text.stl", "ball.off"}) {
    const Shell read = read_shell(path(name));
    EXPECT_EQ(read.points.size(), shell.points.size()) << name;
    EXPECT_EQ(read.triangles.size(), shell.triangles.size()) << name;
    EXPECT_THAT(shell_faults(read), IsEmpty()) << name;
    EXPECT_NEAR((read.points[read.triangles[5][0]] - shell.points[shell.triangles[5][0]]).norm(), 0,
                2e-6)
        << name;
  }
}

TEST_F(ShellFiles, DamagedFilesAreRefused) {
  write(octahedral_ball(4, Vec3::Zero(), 2), path("good.stl"));
  write(octahedral_ball(4, Vec3::Zero(), 2), path("good.ply"));
  const std::string stl = text_of(path("good.stl")), ply = text_of(path("good.ply"));
  EXPECT_THAT(refusal(path("absent.stl")), HasSubstr("does not exist"));
  EXPECT_THAT(refusal(written("empty.stl", "")), HasSubstr("is empty"));
  EXPECT_THAT(refusal(written("cut.stl", stl.substr(0, stl.size() / 2))), HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("head.stl", stl.substr(0, 40))), HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("cut.ply", ply.substr(0, ply.size() / 2))), HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("nearly.ply", ply.substr(0, ply.size() - 9))),
              HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("head.ply", ply.substr(0, 60))), HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("text.stl", "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0")),
              HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("none.stl", "solid x\nendsolid x\n")), HasSubstr("no faces"));
  EXPECT_THAT(refusal(written("claims.off", "OFF\n1000000000 2000000000 0\n0 0 0\n")),
              HasSubstr("truncated"));
  EXPECT_THAT(refusal(written("beyond.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")),
              AllOf(HasSubstr("beyond.obj")));
  EXPECT_THAT(refusal(written("noise.obj", std::string(1000, '\x7f'))), HasSubstr("noise.obj"));
  EXPECT_THAT(refusal(written("x.txt", "hello")), HasSubstr("none of .stl"));
  std::string nan = stl;
  const float value = std::numeric_limits<float>::quiet_NaN();
  nan.replace(84 + 12, 4, reinterpret_cast<const char*>(&value), 4);
  EXPECT_THAT(refusal(written("nan.stl", nan)), HasSubstr("not finite"));
}

TEST_F(ShellFiles, SizesThatCannotBeMillimetresAreRefused) {
  write(octahedral_ball(4000, Vec3::Zero(), 2), path("um.stl"));
  write(octahedral_ball(0.004, Vec3::Zero(), 2), path("m.stl"));
  EXPECT_THAT(refusal(path("um.stl")), AllOf(HasSubstr("8000 mm"), HasSubstr("micrometres")));
  EXPECT_THAT(refusal(path("m.stl")), AllOf(HasSubstr("0.008 mm"), HasSubstr("metres")));
}

TEST_F(ShellFiles, AMolarsSurfacesGiveTheMolarBack) {
  const double voxel = 0.2;
  const LayeredTooth molar = make_molar({voxel});
  std::vector<TissueShell> shells;
  const std::array<SurfaceOf, 3> what{SurfaceOf::kEnamel, SurfaceOf::kDentin, SurfaceOf::kPulp};
  for (int k = 0; k < 3; ++k) {
    const std::string file = path(std::string(kTissueNames[k]) + ".stl");
    write_mesh(extract_surface(molar, what[k]), file);
    shells.push_back({tissue_at(k), read_shell(file)});
    EXPECT_THAT(shell_faults(shells.back().shell), IsEmpty()) << file;
  }
  const LayeredTooth again = voxelized(shells, voxel);
  std::array<double, 5> both{}, sum{};
  for (std::size_t b = 0; b < molar.tissue.table_size(); ++b)
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = molar.tissue.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7);
      const std::uint8_t before = molar.tissue.brick(b)[v];
      const std::uint8_t after = again.tissue.value(i.x(), i.y(), i.z());
      sum[before] += 1;
      sum[after] += 1;
      if (before == after) both[before] += 1;
    }
  const auto before = remaining_volumes_mm3(molar), after = remaining_volumes_mm3(again);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_GT(2 * both[k + 1] / sum[k + 1], 0.99) << kTissueNames[k];
    // Surfaces of second order in the voxel, out and in again: of a canal of radius r about
    // (D/r)^2/8, 2 % at r = 2.5 voxels. The pulp is mostly such.
    EXPECT_NEAR(after[k], before[k], (k == 2 ? 0.02 : 0.005) * before[k]) << kTissueNames[k];
    RecordProperty("dice_" + std::string(kTissueNames[k]),
                   std::to_string(2 * both[k + 1] / sum[k + 1]));
  }
  EXPECT_NEAR(volume_mm3(again.solid, voxel), volume_mm3(molar.solid, voxel),
              0.002 * volume_mm3(molar.solid, voxel));
}

}  // namespace
}  // namespace toothprep
