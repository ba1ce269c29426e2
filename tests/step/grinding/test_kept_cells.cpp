// Cells of the cut that are kept from step to step against the field itself, bit for bit.
#include <gtest/gtest.h>

#include <array>
#include <random>

#include "../session/experiment.h"
#include "toothprep/step/grinding/contact_frame.h"
#include "toothprep/step/grinding/removal.h"

namespace toothprep::testing {
namespace {

TEST(CellCorners, AreTheFieldsValuesWithinItsBoxAndBesideIt) {
  LevelSet field(Index3(-1, 0, 2), Index3(2, 1, 3), 3.0f);
  for (std::size_t b = 0; b < field.table_size(); ++b) {
    float* values = field.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) values[v] = static_cast<float>(b) + 1e-3f * v;
  }
  for (int i = -18; i < 18; ++i)
    for (int j = -10; j < 18; ++j)
      for (int k = 6; k < 50; ++k) {
        float c[8];
        cell_corners(field, i, j, k, c);
        for (int n = 0; n < 8; ++n)
          ASSERT_EQ(c[n], field.value(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1)))
              << i << ' ' << j << ' ' << k;
      }
}

// Four points that creep, and leap now and then, over a block, its border of bricks, its edge and the
// air beside it, while a ball cuts.
TEST(KeptCells, OnAPathWithCutsAreThoseOfTheField) {
  const LayeredTooth tooth = block(0.1, 1, Vec3(4, 3, 4));
  Workpiece workpiece(tooth);
  const Bur bur = paper_ball();
  const auto place = [](int i) {
    return Pose{Vec3(-1 + 1e-3 * i, -0.2, 0.3e-3 * i), Quat::Identity()};
  };
  Removal removal(bur, workpiece, place(0));
  std::mt19937 random(7);
  std::uniform_real_distribution<float> at(-27, 27), creep(-0.02f, 0.02f), chance(0, 1);
  Eigen::Vector3f points[4];
  for (auto& p : points) p = {at(random), at(random), at(random)};
  KeptCells four;
  KeptCell one;
  const Index3 base(3, -5, 2);
  int live = 0, kept = 0, changed = 0;
  std::uint64_t cuts = 0;
  for (int i = 0; i < 2000; ++i) {
    removal.advance(place(i));
    removal.carve();
    Int4 wanted{-1, -1, -1, -1};
    for (int p = 0; p < 4; ++p) {
      points[p] += Eigen::Vector3f(creep(random), creep(random), creep(random));
      if (chance(random) < 0.02f) points[p] = {at(random), at(random), at(random)};
      wanted[p] = chance(random) < 0.02f ? 0 : -1;
    }
    const FourPlaces places(Float4{points[0].x(), points[1].x(), points[2].x(), points[3].x()},
                            Float4{points[0].y(), points[1].y(), points[2].y(), points[3].y()},
                            Float4{points[0].z(), points[1].z(), points[2].z(), points[3].z()});
    const Int4 x = places.x + base.x(), y = places.y + base.y(), z = places.z + base.z();
    kept += four.cuts == removal.cuts_made() && !any((four.x != x) | (four.y != y) | (four.z != z));
    changed += removal.cuts_made() != cuts;
    cuts = removal.cuts_made();
    four.read(workpiece, x, y, z, wanted, cuts);
    const FourSamples found = four.cells.at(places.fx, places.fy, places.fz);
    for (int p = 0; p < 4; ++p) {
      const std::int64_t brick = workpiece.cut().brick_index(x[p], y[p], z[p]);
      const bool lives = brick >= 0 && !workpiece.air(static_cast<std::size_t>(brick));
      ASSERT_EQ(four.live[p] != 0, lives && wanted[p] != 0) << i;
      if (!four.live[p]) continue;
      ++live;
      const FieldSample s = field_at(workpiece.cut(), base, points[p]);
      ASSERT_EQ(four.brick[p], brick);
      ASSERT_EQ(found.value[p], s.value) << i;
      ASSERT_EQ(found.gx[p], s.gx) << i;
      ASSERT_EQ(found.gy[p], s.gy) << i;
      ASSERT_EQ(found.gz[p], s.gz) << i;
    }
    one.read(workpiece, Int4{x[0], y[0], z[0], 0}, cuts);
    ASSERT_EQ(one.brick >= 0 && wanted[0] != 0, four.live[0] != 0) << i;
    if (one.brick < 0) continue;
    float corners[8];
    cell_corners(workpiece.cut(), x[0], y[0], z[0], corners);
    for (int c = 0; c < 8; ++c) ASSERT_EQ(one.corners[c], corners[c]) << i;
  }
  EXPECT_GT(live, 1000);
  EXPECT_GT(kept, 500);
  EXPECT_GT(changed, 10);
}

// Two points that creep over the border of the tissues, and come back; now one is asked for, now both.
TEST(KeptTissues, AreThoseOfTheToothsFields) {
  const LayeredTooth tooth = block(0.1, 1, Vec3(4, 3, 4));
  const Workpiece workpiece(tooth);
  const std::array<LevelSet, 4> fields = {tooth.solid, tooth.remains[0].unpacked(),
                                          tooth.remains[1].unpacked(), tooth.remains[2].unpacked()};
  KeptTissues kept;
  const Index3 base = tooth.lattice.to_index(Vec3(0, -0.8, 0)).array().floor().cast<int>();
  int by_fields = 0, others = 0;
  for (int i = 0; i < 1000; ++i) {
    const float s = 0.004f * static_cast<float>(i < 500 ? i : 1000 - i);
    const Eigen::Vector3f a(0.3f, 1 - 2 * s, s), b(-0.2f + s, -1.5f, 0.6f);
    const FourPlaces places(Float4{a.x(), b.x()}, Float4{a.y(), b.y()}, Float4{a.z(), b.z()});
    const Int4 wanted{i % 3 != 0 ? -1 : 0, i % 5 != 0 ? -1 : 0, 0, 0};
    kept.move_to(places.x + base.x(), places.y + base.y(), places.z + base.z());
    kept.read_solid(workpiece, wanted);
    kept.read_tissues(workpiece, wanted);
    for (int field = -1; field < KeptTissues::kFields; ++field) {
      const FourSamples found =
          (field < 0 ? kept.solid : kept.tissues[field]).at(places.fx, places.fy, places.fz);
      for (int p = 0; p < 2; ++p) {
        if (!wanted[p]) continue;
        const FieldSample exact =
            field_at(fields[static_cast<std::size_t>(field + 1)], base, p == 0 ? a : b);
        ASSERT_EQ(found.value[p], exact.value) << i;
        ASSERT_EQ(found.gx[p], exact.gx) << i;
        ASSERT_EQ(found.gy[p], exact.gy) << i;
        ASSERT_EQ(found.gz[p], exact.gz) << i;
      }
    }
    for (int p = 0; p < 2; ++p)
      if (wanted[p]) ++(kept.by_fields[p] ? by_fields : others);
  }
  EXPECT_GT(by_fields, 100);
  EXPECT_GT(others, 100);
}

}  // namespace
}  // namespace toothprep::testing
