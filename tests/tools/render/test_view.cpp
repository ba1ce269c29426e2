#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/render/view.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

void expect_near(const Vec3& a, const Vec3& b) { EXPECT_LT((a - b).norm(), 1e-12) << a << b; }

TEST(View, AxesAreThoseOfTheFileAndSquare) {
  const ToothAxes axes = tooth_axes(
      {{"axis_occlusal", "0 0 -2"}, {"axis_mesial", "1 0 0.1"}, {"axis_buccal", "0,-3,0"}});
  expect_near(axes.occlusal, -Vec3::UnitZ());
  expect_near(axes.mesial, Vec3::UnitX());
  expect_near(axes.buccal, -Vec3::UnitY());
}

TEST(View, AxesThatAreMissingAreMadeUp) {
  const ToothAxes axes = tooth_axes({});
  expect_near(axes.occlusal, Vec3::UnitZ());
  expect_near(axes.mesial, -Vec3::UnitY());
  expect_near(axes.buccal, Vec3::UnitX());
  const ToothAxes block = tooth_axes({{"axis_occlusal", "0 1 0"}});
  EXPECT_NEAR(block.mesial.dot(block.occlusal), 0, 1e-12);
  EXPECT_NEAR(block.buccal.dot(block.mesial), 0, 1e-12);
}

TEST(View, AxesThatAreNoneAreRefused) {
  EXPECT_THAT(
      [] {
        static_cast<void>(tooth_axes({{"axis_mesial", "1 2"}}));
      },
      ThrowsMessage<Error>(HasSubstr("axis_mesial")));
  EXPECT_THROW(static_cast<void>(tooth_axes({{"axis_mesial", "0 0 0"}})), Error);
  EXPECT_THROW(
      static_cast<void>(tooth_axes({{"axis_mesial", "0 0 1"}, {"axis_occlusal", "0 0 1"}})), Error);
  EXPECT_THROW(static_cast<void>(tooth_axes({{"axis_mesial", "nan 0 1"}})), Error);
}

TEST(View, NamesAreSidesOfTheTooth) {
  const ToothAxes axes;
  expect_near(view_of("mesial", axes).direction, -axes.mesial);
  expect_near(view_of("lingual", axes).direction, axes.buccal);
  expect_near(view_of("mesial", axes).up, axes.occlusal);
  expect_near(view_of("occlusal", axes).direction, -axes.occlusal);
  expect_near(view_of("occlusal", axes).up, axes.buccal);
  expect_near(view_of("0,-2,0", axes).direction, Vec3::UnitY());
  for (const char* wrong : {"palatal", "1,2", "1,2,nan", "0,0,0", "", "1,2,3x"})
    EXPECT_THROW(static_cast<void>(view_of(wrong, axes)), Error) << wrong;
}

TEST(View, CutsAreSidesOrPlanes) {
  const ToothAxes axes;
  const CutPlane side = cut_of("buccal", axes, Vec3(1, 2, 3));
  expect_near(side.point, Vec3(1, 2, 3));
  expect_near(side.normal, axes.buccal);
  const CutPlane plane = cut_of("1,2,3,0,0,-4", axes, Vec3::Zero());
  expect_near(plane.point, Vec3(1, 2, 3));
  expect_near(plane.normal, -Vec3::UnitZ());
  for (const char* wrong : {"oblique", "1,2,3", "1,2,3,0,0,0"})
    EXPECT_THROW(static_cast<void>(cut_of(wrong, axes, Vec3::Zero())), Error) << wrong;
}

TEST(View, EverythingIsInThePictureAndBeforeTheCamera) {
  const TriangleMesh mesh = make_sphere(Vec3(5, 5, 5), 2, 20);
  for (const char* text : {"oblique", "apical", "3,-1,0.2"}) {
    Fit fit;
    fit.width = 90;
    fit.height = 50;
    const Camera c = fit_camera(view_of(text, {}), {&mesh}, fit);
    EXPECT_NEAR(c.right.dot(c.up), 0, 1e-12);
    EXPECT_NEAR(c.right.cross(c.up).dot(c.forward), -1, 1e-12);
    for (const auto& v : mesh.vertices) {
      const Vec3 x = v.cast<double>() - c.origin;
      EXPECT_LT(std::abs(x.dot(c.right)), 0.441 * 90 * c.mm_per_pixel);
      EXPECT_LT(std::abs(x.dot(c.up)), 0.441 * 50 * c.mm_per_pixel);
      EXPECT_GE(x.dot(c.forward), 0);
    }
    fit.zoom = 2;
    EXPECT_NEAR(fit_camera(view_of(text, {}), {&mesh}, fit).mm_per_pixel, c.mm_per_pixel / 2,
                1e-12);
  }
}

TEST(View, AbsurdPicturesAreRefused) {
  const TriangleMesh mesh = make_sphere(Vec3::Zero(), 1, 10);
  const auto with = [&](auto change) {
    Fit fit;
    change(fit);
    return fit_camera({}, {&mesh}, fit);
  };
  EXPECT_THROW(with([](Fit& f) { f.width = 15; }), Error);
  EXPECT_THROW(with([](Fit& f) { f.height = 16385; }), Error);
  EXPECT_THROW(with([](Fit& f) { f.width = f.height = 16384; }), Error);
  EXPECT_THROW(with([](Fit& f) { f.zoom = 0; }), Error);
  EXPECT_THROW(with([](Fit& f) { f.zoom = std::nan(""); }), Error);
  EXPECT_THROW(with([](Fit& f) { f.centre = Vec3(0, 0, std::nan("")); }), Error);
  EXPECT_THROW(static_cast<void>(fit_camera({}, {}, Fit{})), Error);
}

}  // namespace
}  // namespace toothprep
