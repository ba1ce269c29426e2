#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {
namespace {

using units::kPi;

double box_distance(const Vec3& x, const Vec3& low, const Vec3& high) {
  const Vec3 q = (x - (low + high) / 2).cwiseAbs() - (high - low) / 2;
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

Lattice lattice_of(double voxel, const Vec3& origin = Vec3::Zero()) {
  Lattice lattice;
  lattice.voxel = voxel;
  lattice.origin = origin;
  return lattice;
}

// Dentin wherever `field` is negative, in voxels -n..n.
LayeredTooth dentin(const Lattice& lattice, int n, const std::function<double(const Vec3&)>& field,
                    bool lipschitz = true) {
  return build_tooth(
      lattice, Index3::Constant(-n), Index3::Constant(n),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(field(x));
        s.tissue = {1e3F, s.solid, 1e3F};
        if (s.solid < 0) s.label = Tissue::kDentin;
        return s;
      },
      lipschitz);
}

LayeredTooth ball(double radius, double voxel, bool lipschitz = true) {
  return dentin(
      lattice_of(voxel, Vec3(0.011, -0.023, 0.017)), static_cast<int>(radius / voxel) + 5,
      [radius](const Vec3& x) { return x.norm() - radius; }, lipschitz);
}

// A block, the upper `enamel` mm (in y) of it enamel.
LayeredTooth layers(double enamel) {
  const Vec3 low(-1, -1, -1), high(1, 1, 1);
  return build_tooth(
      lattice_of(0.1, Vec3::Constant(0.05)), Index3::Constant(-14), Index3::Constant(14),
      [&](const Vec3& x) {
        const double d = box_distance(x, low, high), border = high.y() - enamel;
        ToothSample s;
        s.solid = static_cast<float>(d);
        s.tissue = {static_cast<float>(std::max(d, border - x.y())),
                    static_cast<float>(std::max(d, x.y() - border)), 1e3F};
        if (d < 0) s.label = x.y() > border ? Tissue::kEnamel : Tissue::kDentin;
        return s;
      },
      true);
}

TEST(LayeredTooth, VolumeOfABoxIsExactWhereverItsFacesLieBetweenVoxels) {
  // Faces at any height between two layers of centres count by their fraction; edges and corners
  // are where fractions of two faces meet, of second order. With faces half-way they are exact too.
  for (const double half : {1.0, 1.2}) {
    const LayeredTooth tooth =
        dentin(lattice_of(0.1, Vec3::Constant(0.05)), 20, [half](const Vec3& x) {
          return box_distance(x, Vec3::Constant(-half), Vec3::Constant(half));
        });
    EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), 8 * half * half * half, 1e-5);
  }
}

TEST(LayeredTooth, VolumeUnderAPlaneAlongTheAxesIsExactAtAnyHeight) {
  for (const double height : {0.0, 0.013, 0.05, 0.0777, 0.1}) {
    const LayeredTooth tooth =
        dentin(lattice_of(0.1, Vec3::Constant(0.05)), 20, [height](const Vec3& x) {
          // The other five faces half-way between centres and square: Chebyshev distance.
          const Vec3 q = x.cwiseAbs() - Vec3::Ones();
          return std::max({q.x(), q.z(), -x.y() - 1, x.y() - height});
        });
    EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), 4 * (1 + height), 1e-5) << height;
  }
}

TEST(LayeredTooth, VolumeOfABallConvergesWithTheSquareOfTheVoxel) {
  const double r = 1.5, exact = 4 * kPi / 3 * r * r * r;
  // The fraction max(0, min(1, 1/2 - phi/D)) is the mean over shells at R - D/2 .. R + D/2; the
  // mean of (R + s)^3 over them is R^3 + R D^2/4: an excess of (D/R)^2/4, up to the chance of the
  // lattice.
  for (const double voxel : {0.2, 0.1, 0.05}) {
    const double excess = volume_mm3(ball(r, voxel).solid, voxel) / exact - 1;
    EXPECT_NEAR(excess / std::pow(voxel / r, 2), 0.25, 0.05) << voxel;
  }
}

TEST(LayeredTooth, VolumesPerTissueAddUpToTheSolid) {
  const LayeredTooth tooth = layers(0.6);
  const PerTissue<double> v = remaining_volumes_mm3(tooth);
  EXPECT_NEAR(v[0], 4 * 0.6, 1e-4);
  EXPECT_NEAR(v[1], 4 * 1.4, 1e-4);
  EXPECT_EQ(v[2], 0);
  EXPECT_EQ(v[3], 0) << "no voxel is labelled other";
}

TEST(LayeredTooth, WhatHasNoGridOfItsOwnCountsAsOtherIfItIsLabelledSo) {
  const LayeredTooth tooth = build_tooth(
      lattice_of(0.1, Vec3::Constant(0.05)), Index3::Constant(-14), Index3::Constant(14),
      [](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(box_distance(x, Vec3(-1, -1, -1), Vec3(1, 1, 1)));
        s.tissue = {1e3F, std::max(s.solid, static_cast<float>(x.y())), 1e3F};
        if (s.solid < 0) s.label = x.y() < 0 ? Tissue::kDentin : Tissue::kOther;
        return s;
      },
      true);
  EXPECT_NEAR(remaining_volumes_mm3(tooth)[3], 4, 1e-4);
}

TEST(LayeredTooth, LevelSetsAreClampedToTheBandAndTissuesLieWithinTheSolid) {
  const LayeredTooth tooth = layers(0.6);
  const auto band = static_cast<float>(tooth.band());
  EXPECT_FLOAT_EQ(band, 0.3F);
  for (int i = -16; i < 16; ++i)
    for (int j = -16; j < 16; ++j)
      for (int k = -16; k < 16; ++k) {
        const float solid = tooth.solid.value(i, j, k);
        ASSERT_LE(std::abs(solid), band);
        for (const PackedLevelSet& grid : tooth.remains) ASSERT_GE(grid.value(i, j, k), solid);
      }
}

TEST(LayeredTooth, SkippingBricksFarFromTheSurfaceChangesNothing) {
  EXPECT_EQ(tooth_sha256(ball(1.5, 0.1, true)), tooth_sha256(ball(1.5, 0.1, false)));
}

TEST(LayeredTooth, IsTheSameWhateverTheThreads) {
  const std::string many = tooth_sha256(ball(1.5, 0.1));
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(tooth_sha256(ball(1.5, 0.1)), many);
}

TEST(LayeredTooth, BoundsAreTheFacesOfTheSolid) {
  const Box box = bounds_of_solid(layers(0.6));
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(box.min[k], -1, 1e-7) << "faces are met to the rounding of a float";
    EXPECT_NEAR(box.max[k], 1, 1e-7);
  }
  const Box round = bounds_of_solid(ball(1.5, 0.1));
  EXPECT_NEAR(round.max.x(), 1.5, 0.05 * 0.05 / 1.4)
      << "the nearest centres lie 0.05 mm beside the pole";
  const Box none = bounds_of_solid(make_empty_tooth({}, Index3::Zero(), Index3::Ones()));
  EXPECT_EQ(none.min, Vec3::Zero());
  EXPECT_EQ(none.max, Vec3::Zero());
}

TEST(LayeredTooth, HashDoesNotDependOnTheBoxOrOnWhatIsStored) {
  const auto field = [](const Vec3& x) { return x.norm() - 1.0; };
  LayeredTooth tight = dentin(lattice_of(0.1), 14, field);
  const LayeredTooth wide = dentin(lattice_of(0.1), 40, field);
  EXPECT_EQ(tooth_sha256(tight), tooth_sha256(wide));
  for (std::size_t b = 0; b < tight.solid.table_size(); ++b) {  // store every brick explicitly
    tight.solid.writable_brick(b);
    tight.tissue.writable_brick(b);
  }
  EXPECT_EQ(tooth_sha256(tight), tooth_sha256(wide));
  tight.provenance["source"] = "elsewhere";
  EXPECT_EQ(tooth_sha256(tight), tooth_sha256(wide)) << "it is taken over grids and lattice";
}

TEST(LayeredTooth, HashSeesEveryChangeOfContent) {
  const LayeredTooth tooth = layers(0.6);
  const std::string hash = tooth_sha256(tooth);
  const auto changed = [&](const std::function<void(LayeredTooth&)>& change) {
    LayeredTooth other = tooth;
    change(other);
    return tooth_sha256(other);
  };
  const auto b = static_cast<std::size_t>(tooth.solid.brick_index(0, 0, 0));
  EXPECT_NE(changed([&](LayeredTooth& t) { t.solid.writable_brick(b)[17] += 1e-6F; }), hash);
  EXPECT_NE(changed([&](LayeredTooth& t) { t.tissue.writable_brick(b)[17] = 4; }), hash);
  for (int k = 0; k < 3; ++k)
    EXPECT_NE(changed([&](LayeredTooth& t) {
                std::array<float, kBrickVoxels> values;
                t.remains[k].brick(b).unpack(values.data());
                values[17] = 0.01F;
                t.remains[k].set_brick(b, values.data());
              }),
              hash);
  EXPECT_NE(changed([](LayeredTooth& t) { t.lattice.origin.x() += 1e-9; }), hash);
  EXPECT_NE(changed([](LayeredTooth& t) { t.lattice.voxel += 1e-9; }), hash);
  // The same values in another tissue are another tooth.
  EXPECT_NE(changed([](LayeredTooth& t) { std::swap(t.remains[0], t.remains[1]); }), hash);
}

TEST(LayeredTooth, CarvingTheSolidCarvesItsTissuesAndKeepsTheAnatomy) {
  LayeredTooth tooth = layers(0.6);
  const LayeredTooth intact = tooth;
  // A slot 0.4 wide through the top, 1 deep: 0.6 of it in enamel, 0.4 in dentin, 2 long.
  LevelSet carved = tooth.solid;
  for (std::size_t b = 0; b < carved.table_size(); ++b) {
    std::array<float, kBrickVoxels> phi;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x =
          tooth.lattice.to_world(carved.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7));
      const double slot = std::max(std::abs(x.x()) - 0.2, -x.y());
      phi[v] = static_cast<float>(
          std::clamp(std::max<double>(carved.brick(b)[v], -slot), -tooth.band(), tooth.band()));
    }
    carved.set_brick(b, phi.data());
  }
  const double solid_volume = volume_mm3(carved, 0.1);
  apply_remaining_solid(tooth, carved);
  const PerTissue<double> before = remaining_volumes_mm3(intact),
                          after = remaining_volumes_mm3(tooth);
  EXPECT_NEAR(before[0] - after[0], 0.4 * 0.6 * 2, 1e-3);
  EXPECT_NEAR(before[1] - after[1], 0.4 * 0.4 * 2, 1e-3);
  EXPECT_NEAR(volume_mm3(tooth.solid, 0.1), solid_volume, 0);
  for (int i = -14; i <= 14; ++i)
    for (int j = -14; j <= 14; ++j)
      ASSERT_EQ(tooth.tissue.value(i, j, 0), intact.tissue.value(i, j, 0));
  // Carving by what remains already changes nothing.
  LayeredTooth again = tooth;
  apply_remaining_solid(again, tooth.solid);
  EXPECT_EQ(tooth_sha256(again), tooth_sha256(tooth));
}

TEST(LayeredTooth, TwoCutsLeaveWhatTheirUnionLeavesAndKeepTheIntactSurface) {
  const LayeredTooth intact = layers(0.6);
  const auto band = static_cast<float>(intact.band());
  const auto ball = [&](const Vec3& centre) {  // as a bur's cut: negative where nothing was cut
    LevelSet cut(intact.solid.first_brick(), intact.solid.brick_counts(), -band, {band});
    std::array<float, kBrickVoxels> phi;
    for (std::size_t b = 0; b < cut.table_size(); ++b) {
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 i = cut.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7);
        phi[v] = std::clamp(static_cast<float>(0.5 - (intact.lattice.to_world(i) - centre).norm()),
                            -band, band);
      }
      cut.set_brick(b, phi.data());
    }
    return cut;
  };
  const LevelSet one = ball(Vec3(0, 1, 0)), two = ball(Vec3(0.3, 1, 0.2));
  LayeredTooth tooth = intact;
  apply_cut(tooth, one);
  apply_cut(tooth, two);
  ASSERT_TRUE(tooth.parts);
  EXPECT_LT(volume_mm3(tooth.solid, 0.1), volume_mm3(intact.solid, 0.1) - 0.2);
  for (std::size_t b = 0; b < one.table_size(); ++b)
    for (int v = 0; v < kBrickVoxels; ++v) {
      const float both = std::max(one.brick(b)[v], two.brick(b)[v]);
      ASSERT_EQ(tooth.parts->intact.brick(b)[v], intact.solid.brick(b)[v]);
      ASSERT_EQ(tooth.parts->cut.brick(b)[v], -both);
      ASSERT_EQ(tooth.solid.brick(b)[v], std::max(intact.solid.brick(b)[v], both));
    }
  // Of a solid whose history isn't known there are no parts.
  apply_remaining_solid(tooth, intact.solid);
  EXPECT_FALSE(tooth.parts);
}

TEST(LayeredTooth, LatticeConvertsBothWays) {
  const Lattice lattice = lattice_of(0.05, Vec3(-100, 20, 3));
  const Index3 i(7, -8, 9);
  EXPECT_LT((lattice.to_index(lattice.to_world(i)) - i.cast<double>()).norm(), 1e-9);
  EXPECT_LT((lattice.to_world(i) - Vec3(-99.65, 19.6, 3.45)).norm(), 1e-12);
}

TEST(LayeredTooth, RefusesLatticesAndSizesThatCannotBe) {
  const Index3 one = Index3::Ones();
  for (const double voxel :
       {0.0, -0.1, 10.1, std::nan(""), std::numeric_limits<double>::infinity()})
    EXPECT_THROW(static_cast<void>(make_empty_tooth(lattice_of(voxel), -one, one)), Error) << voxel;
  EXPECT_THROW(
      static_cast<void>(make_empty_tooth(lattice_of(0.1, Vec3(0, std::nan(""), 0)), -one, one)),
      Error);
  EXPECT_THROW(static_cast<void>(make_empty_tooth(lattice_of(0.1), one, -one)), Error);
  EXPECT_THROW(static_cast<void>(make_empty_tooth(lattice_of(0.1), -one, Index3::Constant(3000))),
               Error);
}

}  // namespace
}  // namespace toothprep
