#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/render/renderer.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double kPi = 3.14159265358979323846;

Renderer renderer_of(TriangleMesh mesh) {
  std::vector<RenderPart> parts(1);
  parts[0].mesh = std::move(mesh);
  return Renderer(std::move(parts));
}

Camera camera_for(const Renderer& renderer, const View& view, int width, int height) {
  Fit fit;
  fit.width = width;
  fit.height = height;
  return fit_camera(view, renderer.meshes(), fit);
}

const View kFromTop = {"top", -Vec3::UnitZ(), Vec3::UnitY()};
const RenderOptions kQuick = {.samples = 1, .ambient_rays = 4};

Vec3 normal_at(const Image& image, std::size_t p) {
  return Vec3(image.normal[3 * p], image.normal[3 * p + 1], image.normal[3 * p + 2]);
}

// A square of side 2 a in the plane through `middle` with the given normal.
TriangleMesh make_square(const Vec3& middle, const Vec3& normal, double a) {
  const Vec3 u = normal.unitOrthogonal(), v = normal.cross(u);
  TriangleMesh mesh;
  for (const auto& c : {Vec3(-u - v), Vec3(u - v), Vec3(u + v), Vec3(-u + v)})
    mesh.vertices.push_back((middle + a * c).cast<float>());
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

TEST(Renderer, SphereHasItsDepthsNormalsAndOutline) {
  const Vec3 centre(4, -2, 7);
  const double radius = 3;
  const int steps = 128;
  std::vector<RenderPart> parts(1);
  parts[0].mesh = make_sphere(centre, radius, steps);
  parts[0].smoothing = 0;  // the mesh is exact
  const Renderer renderer(std::move(parts));
  const View view = {"aside", Vec3(-1, -2, -2), Vec3::UnitZ()};
  const Camera camera = camera_for(renderer, view, 301, 241);
  const Image image = renderer.render(camera, kQuick);
  const double sagitta = radius / (steps * steps);

  // The fit: the sphere takes 88 % of the shorter side, its middle stands in the middle.
  EXPECT_NEAR(camera.mm_per_pixel, 2 * radius / (0.88 * 241), 1e-4 * camera.mm_per_pixel);
  const double middle_depth = (centre - camera.origin).dot(camera.forward);
  const std::size_t middle = image.pixel(150, 120);
  EXPECT_NEAR(image.depth[middle], middle_depth - radius, sagitta + 1e-5);

  int seen = 0;
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      const std::size_t p = image.pixel(x, y);
      const Vec3 eye = camera.place(x + 0.5, y + 0.5);
      const Vec3 aside = centre - eye - (centre - eye).dot(camera.forward) * camera.forward;
      const double r = aside.norm();
      if (!std::isfinite(image.depth[p])) {
        EXPECT_GT(r, radius - sagitta - 1e-5);
        EXPECT_EQ(image.rgba[4 * p + 3], 0);
        continue;
      }
      ++seen;
      if (r > 0.95 * radius) continue;  // there depth is steep
      const double rise = std::sqrt(radius * radius - r * r);
      EXPECT_NEAR(image.depth[p], middle_depth - rise, sagitta * radius / rise + 1e-5);
      const Vec3 point = eye + image.depth[p] * camera.forward;
      // For small angles the difference of unit vectors, which single precision hurts less than
      // acos.
      const double angle = (normal_at(image, p) - (point - centre).normalized()).norm();
      EXPECT_LT(angle, 1e-3) << x << ' ' << y;
    }
  // Pixels whose centre lies in the circle: its area, to a pixel's width of half its rim at most
  // (the error of counting is far smaller than that).
  const double area = kPi * std::pow(radius / camera.mm_per_pixel, 2);
  EXPECT_NEAR(seen, area, 0.002 * area);
}

TEST(Renderer, TiltedPlaneHasTheDepthOfThePlane) {
  const Vec3 normal = Vec3(0.3, -0.4, 0.8).normalized(), middle(1, 2, 3);
  const Renderer renderer = renderer_of(make_square(middle, normal, 5));
  const Camera camera = camera_for(renderer, kFromTop, 64, 64);
  const Image image = renderer.render(camera, kQuick);
  int seen = 0;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      const std::size_t p = image.pixel(x, y);
      if (!std::isfinite(image.depth[p])) continue;
      ++seen;
      const Vec3 eye = camera.place(x + 0.5, y + 0.5);
      const double depth = normal.dot(middle - eye) / normal.dot(camera.forward);
      EXPECT_NEAR(image.depth[p], depth, 5e-6);  // single precision of the vertices and the channel
      EXPECT_LT((normal_at(image, p) - normal).norm(), 1e-6);
    }
  EXPECT_GT(seen, 1000);
}

TEST(Renderer, AnEdgeCoversAsMuchOfAPixelAsItDoes) {
  // The square's rim x = 0 stands upright in the picture at 0.3 of a pixel column: alpha 0.3 there.
  TriangleMesh mesh;
  for (const auto& v : {Vec3(-4, -4, 0), Vec3(0, -4, 0), Vec3(0, 4, 0), Vec3(-4, 4, 0)})
    mesh.vertices.push_back(v.cast<float>());
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  const Renderer renderer = renderer_of(mesh);
  Fit fit;
  fit.width = fit.height = 40;
  fit.mm_per_pixel = 0.1;
  fit.centre = Vec3(-0.03, 0, 0);  // pixel column 20 begins at x = -0.03
  const Camera camera = fit_camera(kFromTop, renderer.meshes(), fit);
  const Image image = renderer.render(camera, {.samples = 10, .ambient_rays = 0});
  EXPECT_FLOAT_EQ(image.rgba[4 * image.pixel(19, 20) + 3], 1);
  EXPECT_FLOAT_EQ(image.rgba[4 * image.pixel(20, 20) + 3], 0.3f);
  EXPECT_FLOAT_EQ(image.rgba[4 * image.pixel(21, 20) + 3], 0);
  // The data are those of the pixel's centre, which sees the background.
  EXPECT_TRUE(std::isinf(image.depth[image.pixel(20, 20)]));
}

TEST(Renderer, CutFaceLiesInThePlaneAndShowsTheTissues) {
  const LayeredTooth tooth = make_ball(0.1);
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  // Seen from +x, what lies beyond x = 0.5 is gone. Right in the picture is +y, up is +z.
  const View view = {"from x", -Vec3::UnitX(), Vec3::UnitZ()};
  const Camera camera = camera_for(renderer, view, 200, 200);
  RenderOptions options = kQuick;
  options.cut = CutPlane{Vec3(0.5, 0, 0), Vec3(2, 0, 0)};
  const Image image = renderer.render(camera, options);
  const double plane = (Vec3(0.5, 0, 0) - camera.origin).dot(camera.forward);
  const double rim = std::sqrt(9 - 0.25), pulp = std::sqrt(1 - 0.25);
  for (int y = 0; y < 200; ++y)
    for (int x = 0; x < 200; ++x) {
      const std::size_t p = image.pixel(x, y);
      const Vec3 at = camera.place(x + 0.5, y + 0.5) + plane * camera.forward;
      const double r = std::hypot(at.y(), at.z());
      const double near_border = 0.03;  // of three tenths of a voxel
      if (r < rim - near_border) {
        EXPECT_NEAR(image.depth[p], plane, 1e-5);
        EXPECT_LT((normal_at(image, p) - Vec3::UnitX()).norm(), 1e-6);
        if (std::abs(r - pulp) < near_border) continue;
        if (r > pulp && std::abs(at.z()) < near_border) continue;
        const Tissue expected = r < pulp     ? Tissue::kPulp
                                : at.z() > 0 ? Tissue::kEnamel
                                             : Tissue::kDentin;
        EXPECT_EQ(image.tissue[p], static_cast<float>(expected)) << at.transpose();
      } else if (r > 3.01) {
        EXPECT_EQ(image.tissue[p], 0);
      } else if (r > rim + near_border && r < 2.99) {  // past the face: the ball behind the plane
        EXPECT_GT(image.depth[p], plane);
      }
    }
}

TEST(Renderer, CutOfAMeshIsClosedToo) {
  const Renderer renderer = renderer_of(make_sphere(Vec3::Zero(), 2, 60));
  const Camera camera = camera_for(renderer, kFromTop, 60, 60);
  RenderOptions options = kQuick;
  options.cut = CutPlane{Vec3(0, 0, 1), Vec3(0, 0, 1)};
  const Image image = renderer.render(camera, options);
  const std::size_t middle = image.pixel(30, 30);
  EXPECT_NEAR(camera.origin.z() - image.depth[middle], 1, 1e-5);
  EXPECT_LT((normal_at(image, middle) - Vec3::UnitZ()).norm(), 1e-6);
  // Tilted away from the eye, the cut removes what is behind it: the rest looks as before.
  options.cut = CutPlane{Vec3(0, 0, -1), Vec3(0, 0, -1)};
  EXPECT_NEAR(camera.origin.z() - renderer.render(camera, options).depth[middle], 2, 2e-2);
}

TEST(Renderer, ToothsOwnNormalsAreThoseOfTheBall) {
  const LayeredTooth tooth = make_ball(0.1);
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  const Camera camera = camera_for(renderer, kFromTop, 101, 101);
  const Image image = renderer.render(camera, kQuick);
  double worst = 0;
  for (int y = 0; y < 101; ++y)
    for (int x = 0; x < 101; ++x) {
      const std::size_t p = image.pixel(x, y);
      if (!std::isfinite(image.depth[p])) continue;
      const Vec3 point = camera.place(x + 0.5, y + 0.5) + image.depth[p] * camera.forward;
      if (std::hypot(point.x(), point.y()) > 2.8) continue;
      worst =
          std::max(worst, std::acos(std::min(1.0, normal_at(image, p).dot(point.normalized()))));
      EXPECT_EQ(image.tissue[p], static_cast<float>(Tissue::kEnamel));
    }
  // Central differences over D on a radius R: an error of about (D / R)^2 = 1e-3 rad.
  EXPECT_LT(worst, 2e-3);
}

// A ball of 3 mm into which one of 0.6 mm was cut at the top, about (0, 0, 2.9).
LayeredTooth make_cut_ball(double voxel) {
  LayeredTooth tooth = make_ball(voxel);
  const auto band = static_cast<float>(tooth.band());
  LevelSet cut(tooth.solid.first_brick(), tooth.solid.brick_counts(), -band, {band});
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x =
          tooth.lattice.to_world(cut.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7));
      values[v] = std::clamp(static_cast<float>(0.6 - (x - Vec3(0, 0, 2.9)).norm()), -band, band);
    }
    cut.set_brick(b, values.data());
  }
  apply_cut(tooth, cut);
  return tooth;
}

TEST(Renderer, AMarginIsAsSharpAsTheCutMadeIt) {
  const LayeredTooth tooth = make_cut_ball(0.1);
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  Fit fit;
  fit.width = fit.height = 300;
  fit.centre = Vec3(0, 0, 3);
  fit.mm_per_pixel = 0.005;
  const Camera camera = fit_camera(kFromTop, renderer.meshes(), fit);
  const Image image = renderer.render(camera, kQuick);
  const double height = (2.9 * 2.9 + 9 - 0.36) / (2 * 2.9), margin = std::sqrt(9 - height * height);
  int judged = 0;
  double most_angle = 0, most_depth = 0;
  for (int y = 0; y < 300; ++y)
    for (int x = 0; x < 300; ++x) {
      const std::size_t p = image.pixel(x, y);
      const Vec3 seen = camera.place(x + 0.5, y + 0.5) + image.depth[p] * camera.forward;
      const double r = std::hypot(seen.x(), seen.y());
      if (std::abs(r - margin) < 0.01) continue;  // a tenth of a voxel
      ++judged;
      const Vec3 exact(seen.x(), seen.y(),
                       r < margin ? 2.9 - std::sqrt(0.36 - r * r) : std::sqrt(9 - r * r));
      const Vec3 normal = r < margin ? Vec3((Vec3(0, 0, 2.9) - exact) / 0.6) : Vec3(exact / 3);
      most_angle = std::max(most_angle, std::acos(std::min(1.0, normal_at(image, p).dot(normal))));
      most_depth = std::max(most_depth, std::abs(exact.z() - seen.z()) * normal.z());
    }
  EXPECT_GT(judged, 80000);
  EXPECT_LT(most_angle, 0.05);    // (D / R)^2 of the small ball: 0.028
  EXPECT_LT(most_depth, 0.0063);  // 3/8 D^2 / R: that of tetrahedra
  // On a section the corner is as sharp.
  const Vec3 corner(margin, 0, height), out = Vec3(1, 0, 0.2).normalized();
  EXPECT_TRUE(inside(tooth, corner + Vec3(0.03, 0, -0.02)));
  EXPECT_FALSE(inside(tooth, corner + 0.01 * out));
  EXPECT_FALSE(inside(tooth, corner + Vec3(-0.01, 0, -0.002)));
}

TEST(Renderer, DeviationIsInterpolatedAndColoursEndAtTheRange) {
  RenderPart part;
  for (const auto& v : {Vec3(-1, -1, 0), Vec3(1, -1, 0), Vec3(1, 1, 0), Vec3(-1, 1, 0)})
    part.mesh.vertices.push_back(v.cast<float>());
  part.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  part.deviation = {-0.2f, 0.2f, 0.2f, -0.2f};  // 0.2 x
  part.colour = ColourBy::kDeviation;
  const Renderer renderer({part});
  const Camera camera = camera_for(renderer, kFromTop, 100, 100);
  const Image image = renderer.render(camera, {.samples = 1, .ambient_rays = 4, .range = 0.1});
  for (int x = 10; x < 90; ++x) {
    const std::size_t p = image.pixel(x, 40);
    EXPECT_NEAR(image.deviation[p], 0.2 * camera.place(x + 0.5, 40.5).x(), 1e-6);
    const bool red = image.rgba[4 * p] > image.rgba[4 * p + 2];
    EXPECT_EQ(red, image.deviation[p] > 0) << x;
  }
  EXPECT_TRUE(std::isnan(image.deviation[image.pixel(0, 0)]));
  EXPECT_TRUE((diverging_colour(1) == diverging_colour(7)).all());
  EXPECT_TRUE((diverging_colour(0) == colour_from_srgb(247, 247, 247)).all());
}

TEST(Renderer, TheFloorOfAWellIsDarkerThanOpenGround) {
  // A square floor at z = 0 beside nothing, and one with walls of twice its width around it.
  const auto brightness = [](bool walls) {
    TriangleMesh mesh = make_square(Vec3::Zero(), Vec3::UnitZ(), 1);
    if (walls)
      for (const Vec3& n : {Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, -1, 0)}) {
        const TriangleMesh wall = make_square(-n + Vec3(0, 0, 1), n, 1);
        const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
        mesh.vertices.insert(mesh.vertices.end(), wall.vertices.begin(), wall.vertices.end());
        for (auto t : wall.triangles)
          mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
      }
    const Renderer renderer = renderer_of(mesh);
    Fit fit;
    fit.width = fit.height = 21;
    const Camera camera = fit_camera(kFromTop, renderer.meshes(), fit);
    const Image image =
        renderer.render(camera, {.samples = 2, .ambient_rays = 64, .ambient_reach = 2});
    return image.rgba[4 * image.pixel(10, 10) + 1];
  };
  EXPECT_LT(brightness(true), 0.8f * brightness(false));
  EXPECT_GT(brightness(true), 0.15f);  // still to be seen
}

// Few rays where a pixel shows one surface; all samples of every pixel where the scene has a ghost,
// be it out of the picture. Four times as many here, of as many rays each, since light that is
// thrown to and fro is found for each by itself. A ball on a floor: open ground, a crease, a
// shadow, outlines.
TEST(Renderer, FewRaysGiveTheColourOfAllSamples) {
  const auto draw = [](bool all) {
    std::vector<RenderPart> parts(all ? 3 : 2);
    parts[0].mesh = make_sphere(Vec3(0, 0, 1), 1, 60);
    parts[1].mesh = make_square(Vec3::Zero(), Vec3::UnitZ(), 2);
    if (all) {
      parts[2].mesh = make_square(Vec3(0, 0, -9), Vec3::UnitZ(), 2);  // below the floor
      parts[2].ghost = true;
    }
    const Renderer renderer(std::move(parts));
    const std::vector<const TriangleMesh*> meshes = renderer.meshes();
    Fit fit;
    fit.width = 120, fit.height = 90;
    const View view = {"oblique", Vec3(0.3, 1, -1), Vec3::UnitZ()};
    return renderer.render(
        fit_camera(view, {meshes[0], meshes[1]}, fit),
        {.samples = all ? 8 : 4, .ambient_rays = all ? 384 : 96, .ambient_reach = 1.0});
  };
  const Image few = draw(false), all = draw(true);
  double sum = 0, most = 0;
  for (std::size_t i = 0; i < few.rgba.size(); ++i) {
    const double difference = std::abs(few.rgba[i] - all.rgba[i]);
    sum += difference;
    most = std::max(most, difference);
  }
  // 96 rays in layers know the open share of the sky to 0.05, 32 to the lamp its to 0.1; the sky
  // gives 0.4 of the light, the lamp 0.66.
  EXPECT_LT(most, 0.1);
  EXPECT_LT(sum / static_cast<double>(few.rgba.size()), 0.002);
  EXPECT_EQ(few.depth, all.depth);
}

TEST(Renderer, AGhostTintsButLeavesTheDataAlone) {
  std::vector<RenderPart> parts(2);
  parts[0].mesh = make_sphere(Vec3::Zero(), 1, 40);
  parts[1].mesh = make_sphere(Vec3::Zero(), 2, 40);
  parts[1].ghost = true;
  const Renderer both(std::move(parts));
  const Renderer alone = renderer_of(make_sphere(Vec3::Zero(), 1, 40));
  const Camera camera = camera_for(both, kFromTop, 80, 80);
  const Image glass = both.render(camera, kQuick), bare = alone.render(camera, kQuick);
  EXPECT_EQ(glass.tissue, bare.tissue);
  const std::size_t middle = glass.pixel(40, 40), rim = glass.pixel(40, 8);
  EXPECT_NEAR(glass.depth[middle], bare.depth[middle], 1e-5);
  EXPECT_TRUE(std::isinf(glass.depth[rim]));
  EXPECT_NE(glass.rgba[4 * middle], bare.rgba[4 * middle]);
  EXPECT_GT(glass.rgba[4 * rim + 3], 0.1f);
  EXPECT_LT(glass.rgba[4 * rim + 3], 0.9f);
}

TEST(Renderer, SameBitsWhateverTheThreads) {
  const LayeredTooth tooth = make_ball(0.2);
  const auto draw = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    std::vector<RenderPart> parts;
    parts.push_back(part_of(tooth));
    const Renderer renderer(std::move(parts));
    RenderOptions options{.samples = 2, .ambient_rays = 16};
    options.cut = CutPlane{Vec3(0.5, 0, 0), Vec3(1, 0.2, 0.1)};
    const View view = view_of("oblique", {});
    return renderer.render(camera_for(renderer, view, 120, 90), options);
  };
  const Image one = draw(1), four = draw(4);
  EXPECT_EQ(one.rgba, four.rgba);
  EXPECT_EQ(one.depth, four.depth);
  EXPECT_EQ(one.normal, four.normal);
  EXPECT_EQ(one.tissue, four.tissue);
}

TEST(Renderer, SharpEdgesStaySharp) {
  // A cube's faces keep their normals up to the edge.
  TriangleMesh cube;
  for (int c = 0; c < 8; ++c)
    cube.vertices.emplace_back(c & 1 ? 1.f : -1.f, c & 2 ? 1.f : -1.f, c & 4 ? 1.f : -1.f);
  cube.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  const Renderer renderer = renderer_of(cube);
  const View view = {"corner", Vec3(-1, -2, -3), Vec3::UnitZ()};
  const Image image = renderer.render(camera_for(renderer, view, 60, 60), kQuick);
  for (std::size_t p = 0; p < image.depth.size(); ++p)
    if (std::isfinite(image.depth[p])) {
      EXPECT_NEAR(normal_at(image, p).cwiseAbs().maxCoeff(), 1, 1e-6);
    }
}

TEST(Renderer, WhatCannotBeDrawnIsRefused) {
  EXPECT_THAT([] { renderer_of({}); }, ThrowsMessage<Error>(HasSubstr("no triangles")));
  EXPECT_THAT([] { Renderer({}); }, ThrowsMessage<Error>(HasSubstr("nothing to draw")));
  std::vector<RenderPart> parts(1);
  parts[0].mesh = make_sphere(Vec3::Zero(), 1, 10);
  parts[0].deviation = {1, 2};
  EXPECT_THAT([&] { Renderer{parts}; }, ThrowsMessage<Error>(HasSubstr("2 deviations")));
  const Renderer renderer = renderer_of(make_sphere(Vec3::Zero(), 1, 10));
  const Camera camera = camera_for(renderer, kFromTop, 20, 20);
  EXPECT_THROW(renderer.render(camera, {.samples = 0}), Error);
  EXPECT_THROW(renderer.render(camera, {.range = std::nan("")}), Error);
  RenderOptions options;
  options.cut = CutPlane{Vec3::Zero(), Vec3::Zero()};
  EXPECT_THROW(renderer.render(camera, options), Error);
}

}  // namespace
}  // namespace toothprep
