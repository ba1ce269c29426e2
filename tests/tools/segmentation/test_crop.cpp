// A cropped scan: the same values in the same places.
#include <gtest/gtest.h>

#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/crop.h"

namespace toothprep {
namespace {

ImageVolume<float> numbered(const Mat3& direction) {
  ImageVolume<float> image;
  image.size = Index3(10, 12, 14);
  image.spacing = Vec3(0.2, 0.3, 0.4);
  image.origin = Vec3(1, -2, 3);
  image.direction = direction;
  for (int n = 0; n < image.size.prod(); ++n) image.data.push_back(static_cast<float>(n));
  return image;
}

TEST(Crop, KeepsValuesAndPlacesWhateverTheAxes) {
  const Mat3 turned = Eigen::AngleAxisd(0.4, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (const Mat3& direction : {Mat3(Mat3::Identity()), turned}) {
    const ImageVolume<float> image = numbered(direction);
    const Vec3 centre = image.to_world(Vec3(5, 6, 7));
    const Box box{centre - Vec3::Constant(0.5), centre + Vec3::Constant(0.5)};
    const auto cropped = crop(source_of(image), box);
    const ImageVolume<float> part = read_all(*cropped);
    EXPECT_LT(part.size.prod(), image.size.prod());
    // Every voxel of the image that lies in the box is there, with its value.
    int inside = 0;
    for (int k = 0; k < 14; ++k)
      for (int j = 0; j < 12; ++j)
        for (int i = 0; i < 10; ++i) {
          const Vec3 x = image.to_world(Vec3(i, j, k));
          if (((x - centre).array().abs() > 0.5).any()) continue;
          const Vec3 at = (direction.transpose() * (x - part.origin)).cwiseQuotient(part.spacing);
          const Index3 n = at.array().round().cast<int>();
          ASSERT_LT((at - n.cast<double>()).norm(), 1e-9);
          ASSERT_TRUE((n.array() >= 0).all() && (n.array() < part.size.array()).all());
          EXPECT_EQ(part.at(n.x(), n.y(), n.z()), image.at(i, j, k));
          ++inside;
        }
    EXPECT_GT(inside, 8);
  }
}

TEST(Crop, RefusesARegionBesideTheScanOrInsideOut) {
  const ImageVolume<float> image = numbered(Mat3::Identity());
  EXPECT_THROW(crop(source_of(image), {Vec3(50, 50, 50), Vec3(60, 60, 60)}), Error);
  EXPECT_THROW(crop(source_of(image), {Vec3(2, 0, 4), Vec3(1, 1, 5)}), Error);
  EXPECT_THROW(crop(source_of(image),
                    {Vec3(1, -2, 3), Vec3(2, std::numeric_limits<double>::quiet_NaN(), 5)}),
               Error);
}

}  // namespace
}  // namespace toothprep
