#include <ImathVec.h>
#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfStringAttribute.h>
#include <gtest/gtest.h>
#include <half.h>
#include <png.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include "shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/render/renderer.h"

namespace toothprep {
namespace {

std::string scratch(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / name).string();
}

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream all;
  all << file.rdbuf();
  return all.str();
}

Image drawn_ball() {
  static const LayeredTooth tooth = make_ball(0.2);
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  parts[0].deviation.assign(parts[0].mesh.vertices.size(), 0.125f);
  const Renderer renderer(std::move(parts));
  Fit fit;
  fit.width = 67;
  fit.height = 41;
  return renderer.render(fit_camera(view_of("buccal", {}), renderer.meshes(), fit),
                         {.samples = 2, .ambient_rays = 8});
}

// A channel as floats, whatever it is stored as.
std::vector<float> channel_of(Imf::InputFile& file, const char* name, int width, int height) {
  std::vector<float> values(static_cast<std::size_t>(width) * height);
  Imf::FrameBuffer pixels;
  pixels.insert(name, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()), sizeof(float),
                                 sizeof(float) * width));
  file.setFrameBuffer(pixels);
  file.readPixels(0, height - 1);
  return values;
}

TEST(ExrFile, EveryChannelReadsBack) {
  const Image image = drawn_ball();
  const std::string path = scratch("ball.exr");
  write_exr(image, path, {{"software", "a test"}});
  Imf::InputFile file(path.c_str());
  std::set<std::string> names;
  for (auto c = file.header().channels().begin(); c != file.header().channels().end(); ++c)
    names.insert(c.name());
  EXPECT_EQ(names, (std::set<std::string>{"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "tissue.ID",
                                          "deviation.Y"}));
  const auto channel = [&](const char* name) { return channel_of(file, name, 67, 41); };
  EXPECT_EQ(channel("Z"), image.depth);
  EXPECT_EQ(channel("tissue.ID"), image.tissue);
  const char* const kColours[] = {"R", "G", "B", "A"};
  for (std::size_t k = 0; k < 4; ++k) {
    const std::vector<float> values = channel(kColours[k]);
    for (std::size_t p = 0; p < values.size(); ++p)
      EXPECT_EQ(values[p], static_cast<float>(half(image.rgba[4 * p + k])));
  }
  const char* const kNormal[] = {"N.X", "N.Y", "N.Z"};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::vector<float> values = channel(kNormal[k]);
    for (std::size_t p = 0; p < values.size(); ++p) EXPECT_EQ(values[p], image.normal[3 * p + k]);
  }
  const std::vector<float> deviation = channel("deviation.Y");
  int seen = 0;
  for (std::size_t p = 0; p < deviation.size(); ++p) {
    EXPECT_EQ(std::isnan(deviation[p]), std::isinf(image.depth[p]));
    if (!std::isnan(deviation[p])) {
      ++seen;
      EXPECT_NEAR(deviation[p], 0.125f, 1e-7);
    }
  }
  EXPECT_GT(seen, 500);
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("toothprep:view").value(), "buccal");
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("software").value(), "a test");
  EXPECT_FLOAT_EQ(file.header().typedAttribute<Imf::FloatAttribute>("toothprep:mmPerPixel").value(),
                  static_cast<float>(image.camera.mm_per_pixel));
}

TEST(ExrFile, SamePictureSameBytes) {
  const Image image = drawn_ball();
  write_exr(image, scratch("one.exr"));
  write_exr(drawn_ball(), scratch("two.exr"));
  EXPECT_EQ(bytes_of(scratch("one.exr")), bytes_of(scratch("two.exr")));
}

TEST(ExrFile, APlaceThatCannotBeWrittenIsTold) {
  EXPECT_THROW(write_exr(drawn_ball(), "/nowhere/ball.exr"), Error);
  EXPECT_THROW(write_png(picture_of(drawn_ball()), "/nowhere/ball.png"), Error);
}

TEST(PngFile, ReadsBackToTheBit) {
  Picture picture = picture_of(drawn_ball());
  draw_scale_bar(picture, 0.1);
  draw_colour_bar(picture, 0.25);
  const std::string bytes = png_bytes(picture);
  EXPECT_EQ(bytes, png_bytes(picture));
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()));
  EXPECT_EQ(png.width, 67u);
  EXPECT_EQ(png.height, 41u);
  png.format = PNG_FORMAT_RGB;
  std::vector<std::uint8_t> rgb(PNG_IMAGE_SIZE(png));
  ASSERT_TRUE(png_image_finish_read(&png, nullptr, rgb.data(), 0, nullptr));
  EXPECT_EQ(rgb, picture.rgb);
}

TEST(Picture, BackgroundShowsWhereNothingIs) {
  const Image image = drawn_ball();
  const Picture picture = picture_of(image, colour_from_srgb(10, 200, 30));
  EXPECT_EQ(picture.rgb[0], 10);
  EXPECT_EQ(picture.rgb[1], 200);
  EXPECT_EQ(picture.rgb[2], 30);
  const Picture pair = side_by_side({picture, picture});
  EXPECT_EQ(pair.width, 134);
  EXPECT_EQ(pair.height, 41);
  EXPECT_EQ(pair.rgb[3 * 67 + 1], 200);
  Picture low = picture;
  low.height = 40;
  EXPECT_THROW(static_cast<void>(side_by_side({picture, low})), Error);
}

TEST(PlyValues, PropertyFollowsItsVertex) {
  TriangleMesh mesh = make_sphere(Vec3::Zero(), 1, 6);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    mesh.tissue.push_back(static_cast<std::uint8_t>(1 + v % 4));
  const std::string path = scratch("tissue.ply");
  write_mesh(mesh, path);
  TriangleMesh backwards = mesh;
  std::reverse(backwards.vertices.begin(), backwards.vertices.end());
  const auto values = vertex_property(path, backwards, "tissue");
  ASSERT_TRUE(values);
  for (std::size_t v = 0; v < values->size(); ++v)
    EXPECT_EQ((*values)[v], mesh.tissue[values->size() - 1 - v]);
  EXPECT_FALSE(vertex_property(path, mesh, "quality"));
  EXPECT_FALSE(vertex_property(scratch("missing.ply"), mesh, "tissue"));
}

TEST(PlyValues, TextIsReadToo) {
  const std::string path = scratch("text.ply");
  std::ofstream(path) << "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                         "property float y\nproperty float z\nproperty float quality\n"
                         "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                         "0 0 0 0.5\n1 0 0 -0.25\n0 1 0 2\n3 0 1 2\n";
  TriangleMesh mesh;
  mesh.vertices = {{0, 1, 0}, {1, 0, 0}, {5, 5, 5}};
  const auto values = vertex_property(path, mesh, "quality");
  ASSERT_TRUE(values);
  EXPECT_EQ((*values)[0], 2);
  EXPECT_EQ((*values)[1], -0.25f);
  EXPECT_TRUE(std::isnan((*values)[2]));
}

}  // namespace
}  // namespace toothprep
