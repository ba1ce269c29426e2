// Teeth come in from files, deviation maps go out to them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "cut_teeth.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/deviation.h"
#include "toothprep/tools/compare/deviation_file.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class Files : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("toothprep-compare-" + std::to_string(::getpid()) + "-" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const char* name) const { return folder_ / name; }
  static std::string bytes(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    std::ostringstream all;
    all << in.rdbuf();
    return all.str();
  }

 private:
  std::filesystem::path folder_;
};

// A square: two triangles, three deviations and one vertex outside the region.
TriangleMesh square() {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.tissue = {1, 1, 2, 2};
  return mesh;
}
const std::vector<float> kDeviation = {0.0F, 0.5F, -0.25F, NAN};

template <class T>
T at(const std::string& text, std::size_t place, bool big_endian = false) {
  std::array<char, sizeof(T)> b;
  std::copy_n(text.begin() + static_cast<std::ptrdiff_t>(place), sizeof(T), b.begin());
  if (big_endian) std::reverse(b.begin(), b.end());
  T value;
  std::memcpy(&value, b.data(), sizeof(T));
  return value;
}

TEST_F(Files, PlyHoldsDeviationQualityAndColourPerVertex) {
  write_deviation(square(), kDeviation, path("map.ply"), 0.5);
  const std::string text = bytes(path("map.ply"));
  EXPECT_THAT(text, AllOf(HasSubstr("property float deviation_mm\n"),
                          HasSubstr("property float quality\n"), HasSubstr("element vertex 4\n")));
  const std::size_t data = text.find("end_header\n") + 11, row = 12 + 1 + 3 + 8;
  ASSERT_EQ(text.size(), data + 4 * row + 2 * 13);
  for (std::size_t v = 0; v < 4; ++v) {
    const auto deviation = at<float>(text, data + v * row + 16),
               quality = at<float>(text, data + v * row + 20);
    if (v < 3) {
      EXPECT_EQ(deviation, kDeviation[v]);
      EXPECT_EQ(quality, kDeviation[v]);
    } else {
      EXPECT_TRUE(std::isnan(deviation));
      EXPECT_EQ(quality, 0);  // MeshLab takes no NaN
    }
    const Rgb colour = {at<std::uint8_t>(text, data + v * row + 13),
                        at<std::uint8_t>(text, data + v * row + 14),
                        at<std::uint8_t>(text, data + v * row + 15)};
    EXPECT_EQ(colour, deviation_colour(kDeviation[v], 0.5));
  }
  // It still is a mesh to whoever reads meshes.
  EXPECT_EQ(read_shell(path("map.ply")).triangles.size(), 2U);
}

TEST_F(Files, VtkHoldsTheDeviationAsPointData) {
  write_deviation(square(), kDeviation, path("map.vtk"));
  const std::string text = bytes(path("map.vtk"));
  EXPECT_EQ(text.rfind("# vtk DataFile Version 3.0\n", 0), 0U);
  const std::string points = "POINTS 4 float\n";
  EXPECT_EQ(at<float>(text, text.find(points) + points.size() + 12, true), 1.0F);
  const std::string faces = "POLYGONS 2 8\n";
  EXPECT_EQ(at<std::int32_t>(text, text.find(faces) + faces.size(), true), 3);
  const std::string scalar = "POINT_DATA 4\nSCALARS deviation_mm float 1\nLOOKUP_TABLE default\n";
  const std::size_t data = text.find(scalar) + scalar.size();
  ASSERT_LT(data, text.size());
  for (std::size_t v = 0; v < 3; ++v) EXPECT_EQ(at<float>(text, data + 4 * v, true), kDeviation[v]);
  EXPECT_TRUE(std::isnan(at<float>(text, data + 12, true)));
}

TEST(DeviationColour, IsBlueBelowWhiteAtZeroAndRedAbove) {
  const Rgb over = deviation_colour(-9), agree = deviation_colour(0), under = deviation_colour(9);
  EXPECT_GT(over[2], over[0]);
  EXPECT_GT(under[0], under[2]);
  EXPECT_EQ(over, (Rgb{33, 102, 172}));  // the colours of pictures of the same deviation
  EXPECT_EQ(agree, (Rgb{247, 247, 247}));
  EXPECT_EQ(deviation_colour(NAN)[0], deviation_colour(NAN)[2]);
  EXPECT_NE(deviation_colour(NAN), agree);
}

TEST_F(Files, ATargetMeansTheSameAsVoxelsAndAsAMesh) {
  const LayeredTooth tooth = block(0.1);
  const LayeredTooth cut = carved(tooth, box_shape(Vec3(-1.5, -2, -1), Vec3(1.5, 1, 1)));
  write_tooth(tooth, path("original.vdb"));
  write_tooth(cut, path("cut.vdb"));
  write_mesh(extract_surface(cut, SurfaceOf::kAll), path("cut.stl"));
  const Solid original = read_solid(path("original.vdb"), 0.1);
  EXPECT_TRUE(original.layered);
  EXPECT_EQ(original.sha256, tooth_sha256(tooth));
  const Solid voxels = on_lattice(read_solid(path("cut.vdb"), 0.1), original);
  const Solid mesh = read_solid(path("cut.stl"), 0.1);
  EXPECT_FALSE(mesh.layered);
  const Solid on = on_lattice(mesh, original);
  EXPECT_EQ(on.layered, true);
  EXPECT_NEAR(remaining_volumes_mm3(on.tooth)[0], remaining_volumes_mm3(voxels.tooth)[0],
              1e-3 * remaining_volumes_mm3(voxels.tooth)[0]);
  EXPECT_LT(measure_deviation(original, on, voxels).rms_mm, 1e-4);
}

TEST_F(Files, AMeshOfFewLargeTrianglesGetsVerticesEverywhere) {
  Shell box;
  const LayeredTooth tooth = block(0.4);  // any box; by hand: 12 triangles
  std::ofstream off(path("box.off"));
  off << "OFF\n8 12 0\n";
  for (int c = 0; c < 8; ++c)
    off << (c & 1 ? 4 : -4) << ' ' << (c & 2 ? 0 : -8) << ' ' << (c & 4 ? 4 : -4) << '\n';
  off << "3 0 2 1\n3 1 2 3\n3 4 5 6\n3 5 7 6\n3 0 1 4\n3 1 5 4\n3 2 6 3\n3 3 6 7\n3 0 4 2\n"
         "3 2 4 6\n3 1 3 5\n3 3 7 5\n";
  off.close();
  const Solid solid = read_solid(path("box.off"), 0.2);
  double longest = 0;
  for (const auto& t : solid.surface.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      longest = std::max<double>(
          longest, (solid.surface.vertices[t[k]] - solid.surface.vertices[t[(k + 1) % 3]]).norm());
  EXPECT_LE(longest, 0.4 + 1e-6);
  EXPECT_NEAR(mesh_volume_mm3(solid.surface), 512, 1e-3);  // the same body, still closed
  EXPECT_NEAR(volume_mm3(solid.tooth.solid, 0.2), 512, 1e-3);
}

// The part of a mesh above y = `lowest`: open there.
TriangleMesh open_below(TriangleMesh mesh, float lowest) {
  std::erase_if(mesh.triangles, [&](const auto& t) {
    return mesh.vertices[t[0]].y() < lowest || mesh.vertices[t[1]].y() < lowest ||
           mesh.vertices[t[2]].y() < lowest;
  });
  return mesh;
}

TEST_F(Files, BeyondAnOpenScansRimNothingCountsAsCut) {
  // A student's work as a scan of the crown alone, against the whole tooth and against a scan of
  // the crown before, cut at another height: the cavity is all that is missing.
  const LayeredTooth tooth = block(0.1);
  const LayeredTooth cut = carved(tooth, box_shape(Vec3(-1.5, -2, -1), Vec3(1.5, 1, 1)));
  const double cavity = volume_mm3(tooth.solid, 0.1) - volume_mm3(cut.solid, 0.1);
  const TriangleMesh before = extract_surface(tooth, SurfaceOf::kAll);
  const TriangleMesh after = extract_surface(cut, SurfaceOf::kAll);
  write_tooth(tooth, path("whole.vdb"));
  write_mesh(open_below(before, -5.03F), path("before.stl"));
  write_mesh(open_below(after, -4.03F), path("after.stl"));
  const Solid scan = read_solid(path("after.stl"), 0.1);
  ASSERT_EQ(scan.open_sides.size(), 1U);
  EXPECT_THAT(scan.warnings, ::testing::ElementsAre(HasSubstr("after.stl: closed the open side")));
  for (const char* original : {"whole.vdb", "before.stl"}) {
    const Solid whole = read_solid(path(original), 0.1);
    const Solid prepared = on_lattice(scan, whole);
    const double removed =
        volume_mm3(whole.tooth.solid, 0.1) - volume_mm3(prepared.tooth.solid, 0.1);
    EXPECT_NEAR(removed, cavity, 0.005 * cavity) << original;
  }
}

TEST_F(Files, AMeshThatWouldHaveToBeInventedIsRefusedWithItsOpenings) {
  // Open at the bottom and at one side: two wide openings in one piece.
  TriangleMesh open = open_below(extract_surface(block(0.5), SurfaceOf::kAll), -5);
  std::erase_if(open.triangles, [&](const auto& t) {
    const auto middle = (open.vertices[t[0]] + open.vertices[t[1]] + open.vertices[t[2]]) / 3;
    return middle.x() > 3.9F && middle.y() < -0.6F && middle.y() > -4.4F;
  });
  write_mesh(open, path("open.stl"));
  EXPECT_THAT(
      [&] { static_cast<void>(read_solid(path("open.stl"), 0.5)); },
      ThrowsMessage<InputError>(
          AllOf(HasSubstr("open.stl"), HasSubstr("does not bound a solid"), HasSubstr("opening"))));
  EXPECT_THAT([&] { static_cast<void>(read_solid(path("nothing.step"), 0.5)); },
              ThrowsMessage<InputError>(HasSubstr(".vdb, .stl")));
  EXPECT_THROW(static_cast<void>(read_solid(path("absent.vdb"), 0.5)), InputError);
}

}  // namespace
}  // namespace toothprep
