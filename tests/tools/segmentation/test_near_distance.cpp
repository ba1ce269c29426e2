// Distances near a mask, its parts, signed fields and smoothed bands against what counting says, or what
// the same takes of the whole array.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>
#include <random>

#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/iso_distance.h"
#include "toothprep/tools/segmentation/mask_parts.h"
#include "toothprep/tools/segmentation/near_distance.h"
#include "toothprep/tools/segmentation/signed_field.h"

namespace toothprep {
namespace {

const Index3 kSize(19, 14, 11);
constexpr std::size_t kVoxels = 19 * 14 * 11;

Mask random_mask(unsigned seed, double share) {
  std::mt19937 random(seed);
  Mask mask(kVoxels);
  for (auto& m : mask) m = random() < share * 4294967296.0;
  return mask;
}

float brute_distance(const Mask& mask, std::size_t v) {
  int least = std::numeric_limits<int>::max();
  for (std::size_t o = 0; o < kVoxels; ++o)
    if (mask[o]) least = std::min(least, (index_of(kSize, o) - index_of(kSize, v)).squaredNorm());
  return std::sqrt(static_cast<float>(least));
}

TEST(NearDistance, IsExactUpToItsReachAndInfiniteBeyond) {
  for (const double share : {0.0005, 0.003, 0.03, 0.5})
    for (const int reach : {1, 3, 6, 20}) {
      const Mask mask = random_mask(7, share);
      const NearDistance near(kSize, mask, reach);
      for (std::size_t v = 0; v < kVoxels; ++v) {
        const float truth = brute_distance(mask, v);
        if (truth <= static_cast<float>(reach))
          ASSERT_EQ(near[v], truth) << v;
        else
          ASSERT_TRUE(std::isinf(near[v])) << v << ": " << near[v] << " of " << truth;
      }
    }
}

TEST(NearDistance, BeyondIsWhereItIsMore) {
  Mask mask(kVoxels, 0);
  mask[700] = mask[1200] = 1;
  for (const int reach : {6, 30}) {  // in one byte, in two
    const NearDistance near(kSize, mask, reach);
    for (const double radius : {0.0, 2.5, 5.0, 5.99}) {
      const auto beyond = near.beyond(radius);
      for (std::size_t v = 0; v < kVoxels; ++v) EXPECT_EQ(beyond(v), near[v] > radius);
    }
  }
}

TEST(NearDistance, OfNothingIsInfinite) {
  const NearDistance near(kSize, Mask(kVoxels, 0), 5);
  for (std::size_t v = 0; v < kVoxels; ++v) ASSERT_TRUE(std::isinf(near[v]));
}

TEST(DepthBelowSurface, IsHalfAVoxelInTheOutermostVoxelsAndItsNegativeBesideThem) {
  Mask mask(kVoxels, 0);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const Index3 i = index_of(kSize, v);
    mask[v] = i.x() >= 5 && i.x() < 14 && i.y() >= 3 && i.y() < 11 && i.z() >= 2 && i.z() < 9;
  }
  const SurfaceDepth depth(kSize, mask, 3);
  const auto at = [&](int i, int j, int k) {
    return depth[(static_cast<std::size_t>(k) * 14 + static_cast<std::size_t>(j)) * 19 +
                 static_cast<std::size_t>(i)];
  };
  EXPECT_EQ(at(5, 6, 5), 0.5f);
  EXPECT_EQ(at(7, 6, 5), 2.5f);
  EXPECT_EQ(at(4, 6, 5), -0.5f);
  EXPECT_EQ(at(2, 6, 5), -2.5f);
  EXPECT_EQ(at(4, 2, 5), 0.5f - std::sqrt(2.0f));
  EXPECT_EQ(at(0, 6, 5), -std::numeric_limits<float>::infinity());
}

// Parts by flooding, numbered in the order in which they are met.
std::vector<int> flooded(const Mask& mask, int value) {
  std::vector<int> part(kVoxels, -1);
  int parts = 0;
  for (std::size_t start = 0; start < kVoxels; ++start) {
    if (mask[start] != value || part[start] >= 0) continue;
    std::queue<std::size_t> open({start});
    part[start] = parts;
    while (!open.empty()) {
      const Index3 at = index_of(kSize, open.front());
      open.pop();
      for (int a = 0; a < 6; ++a) {
        Index3 o = at;
        o[a / 2] += a % 2 ? 1 : -1;
        if (o.minCoeff() < 0 || (kSize - o).minCoeff() <= 0) continue;
        const auto v = static_cast<std::size_t>((o.z() * 14 + o.y()) * 19 + o.x());
        if (mask[v] != value || part[v] >= 0) continue;
        part[v] = parts;
        open.push(v);
      }
    }
    ++parts;
  }
  return part;
}

TEST(MaskParts, AreThoseThatFloodingFindsFromTheLargestDown) {
  for (const double share : {0.05, 0.3, 0.5, 0.9})
    for (const bool of_rest : {false, true}) {
      const Mask mask = random_mask(3, share);
      const MaskParts parts = parts_of(kSize, mask, of_rest);
      const auto row = [&](std::size_t r) { return mask.data() + 19 * r; };
      EXPECT_EQ(parts_of(kSize, row, of_rest).voxels, parts.voxels);
      const std::vector<int> truth = flooded(mask, of_rest ? 0 : 1);
      std::vector<std::size_t> size(parts.count(), 0), first(parts.count(), kVoxels);
      std::vector<std::uint8_t> at_edge(parts.count(), 0);
      std::vector<int> same(parts.count(), -1);
      std::size_t covered = 0;
      parts.for_each([&](std::size_t from, std::size_t end, std::size_t part) {
        for (std::size_t v = from; v < end; ++v, ++covered) {
          const Index3 i = index_of(kSize, v);
          ASSERT_GE(truth[v], 0);
          if (same[part] < 0) same[part] = truth[v], first[part] = v;
          ASSERT_EQ(same[part], truth[v]);
          ++size[part];
          if (i.minCoeff() == 0 || (kSize - i).minCoeff() == 1) at_edge[part] = 1;
        }
      });
      EXPECT_EQ(covered, static_cast<std::size_t>(std::count_if(truth.begin(), truth.end(),
                                                                [](int t) { return t >= 0; })));
      EXPECT_EQ(parts.count(),
                static_cast<std::size_t>(*std::max_element(truth.begin(), truth.end()) + 1));
      EXPECT_EQ(size, parts.voxels);
      EXPECT_EQ(at_edge, parts.at_edge);
      for (std::size_t p = 1; p < parts.count(); ++p)
        EXPECT_TRUE(size[p - 1] > size[p] || (size[p - 1] == size[p] && first[p - 1] < first[p]));
    }
}

TEST(MaskParts, WhatIsEnclosedIsFilledAndTheLargestKept) {
  Mask mask(kVoxels, 0);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const Index3 i = index_of(kSize, v);
    const int shell = (i - Index3(6, 6, 5)).cwiseAbs().maxCoeff();
    mask[v] = shell == 3 || i == Index3(16, 2, 2);
  }
  keep_largest_component(kSize, mask);
  fill_enclosed(kSize, mask);
  EXPECT_EQ(std::count(mask.begin(), mask.end(), 1), 7 * 7 * 7);
}

TEST(SignedField, GivesTheSameDistancesAsTheWholeField) {
  std::vector<float> values(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const Vec3 x = index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7);
    values[v] = static_cast<float>(4.1 - x.norm() + 0.3 * std::sin(x.x()));
  }
  const SignedField field(kSize, values);
  std::vector<float> copied(kVoxels);
  field.copy(0, 100, copied.data());
  field.copy(100, kVoxels - 100, copied.data() + 100);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    EXPECT_EQ(copied[v], field[v]);
    EXPECT_EQ(field[v] > 0, values[v] > 0);
  }
  EXPECT_EQ(iso_distance(kSize, copied, 3), iso_distance(kSize, values, 3));
}

TEST(SignedField, SaysWhereItsSignChanges) {
  std::vector<float> values(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v)
    values[v] =
        static_cast<float>(2.6 - (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm());
  const SignedField field(kSize, values);
  Mask positive(19);
  int without = 0;
  for (std::size_t row = 0; row < kVoxels; row += 19) {
    const RowPart part = field.signs(row, 19, positive.data());
    without += part.first >= part.end;
    for (int i = 0; i < 19; ++i) {
      EXPECT_EQ(positive[static_cast<std::size_t>(i)] != 0,
                values[row + static_cast<std::size_t>(i)] > 0);
      const bool changes = i > 0 && positive[static_cast<std::size_t>(i)] !=
                                        positive[static_cast<std::size_t>(i) - 1];
      EXPECT_TRUE(!changes || (part.first < i && i < part.end));
    }
  }
  EXPECT_GT(without, 20);
}

TEST(SignedField, OfLabelsTakesValuesOnlyBesideTheChangesOfSign) {
  std::vector<std::uint8_t> labels(kVoxels);
  std::vector<float> values(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const double r = (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm();
    labels[v] = r < 2.2 ? 2 : r < 4.1 ? 3 : 1;
    values[v] = static_cast<float>(std::min(4.1 - r, r - 2.2));  // positive in 3
  }
  std::vector<std::uint8_t> asked(kVoxels, 0);
  const SignedField field(kSize, labels, 3, [&](std::size_t v) {
    asked[v] = 1;
    return values[v];
  });
  std::vector<float> copied(kVoxels);
  field.copy(0, kVoxels, copied.data());
  EXPECT_EQ(iso_distance(kSize, copied, 3), iso_distance(kSize, values, 3));
  for (std::size_t v = 0; v < kVoxels; ++v) {
    EXPECT_EQ(field[v] > 0, labels[v] == 3);
    EXPECT_TRUE(!asked[v] || field[v] == values[v]);
  }
  EXPECT_LT(std::count(asked.begin(), asked.end(), 1), kVoxels / 2);
}

TEST(SurfaceDepth, AboveIsWhereTheDepthIsMore) {
  Mask ball(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v)
    ball[v] = (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm() < 3.2;
  const SurfaceDepth depth(kSize, ball, 4);
  for (const float least : {0.0f, -1.0f, -2.3f, -20.0f}) {
    const auto above = depth.above(least);
    for (std::size_t v = 0; v < kVoxels; ++v) EXPECT_EQ(above(v), depth[v] > least);
  }
}

TEST(SurfaceDepth, KeepsWhatIsNearAndTheSideOfTheRest) {
  Mask ball(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v)
    ball[v] = (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm() < 4.6;
  const SurfaceDepth all(kSize, ball, 5);
  SurfaceDepth near(kSize, ball, 5);
  near.keep(1.5f, 2);
  std::size_t given_up = 0;
  for (std::size_t v = 0; v < kVoxels; ++v) {
    given_up += near[v] != all[v];
    EXPECT_TRUE(near[v] == all[v] ||
                (all[v] >= 2 ? near[v] > 1e30f : all[v] <= -1.5f && near[v] < -1e30f));
  }
  EXPECT_GT(given_up, 100);
}

TEST(SurfaceDepth, ByChunksIsWhatItIsByVoxels) {
  Mask ball(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v)
    ball[v] = (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm() < 4.6;
  SurfaceDepth depth(kSize, ball, 5);
  depth.keep(1, 1);
  Mask above(kVoxels - 5);
  depth.above(-0.5f, 5, kVoxels, above.data());
  for (std::size_t v = 5; v < kVoxels; ++v) EXPECT_EQ(above[v - 5] != 0, depth[v] > -0.5f);
  const auto wanted = [](float d) { return d > -2 && d < 0.2f; };
  const Mask expected = chunks_where(kVoxels, [&](std::size_t v) { return wanted(depth[v]); });
  EXPECT_EQ(depth.chunks_where(wanted), expected);
  Mask seen(kVoxels, 0), far(kVoxels, 0);
  depth.for_each_chunk([&](std::size_t first, std::size_t end, bool all_far) {
    for (std::size_t v = first; v < end; ++v) {
      ++seen[v];
      far[v] = all_far;
    }
  });
  for (std::size_t v = 0; v < kVoxels; ++v) {
    EXPECT_EQ(seen[v], 1);
    EXPECT_TRUE(!far[v] || std::isinf(depth[v]));
  }
  EXPECT_GT(std::count(far.begin(), far.end(), 1), 100);
}

TEST(TrimmedField, HasItsValuesInTheChunksThatAreKeptAndOneForTheRest) {
  constexpr float kFar = -7;
  std::vector<float> values(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v) values[v] = static_cast<float>(v);
  const Mask chunks =
      chunks_where(kVoxels, [](std::size_t v) { return v % 50 == 3 || v + 1 == kVoxels; });
  const TrimmedField field(chunks, values, kFar);
  for (const float least : {-8.0f, 1500.0f}) {
    std::vector<std::uint8_t> ones(kVoxels);
    field.not_below(least, 5, kVoxels, ones.data() + 5);  // from within a chunk
    for (std::size_t v = 5; v < kVoxels; ++v) {
      const float value = chunks[v / BandField::kChunk] ? values[v] : kFar;
      ASSERT_EQ(field[v], value) << v;
      ASSERT_EQ(ones[v] != 0, value >= least) << v;
    }
  }
}

TEST(BandField, VisitsTheVoxelsThatItHas) {
  const BandField some(chunks_where(kVoxels, [](std::size_t v) { return v % 50 == 3; }));
  std::vector<std::size_t> visited;
  some.for_each(5, 700, [&](std::size_t v) { visited.push_back(v); });
  std::vector<std::size_t> expected;
  for (std::size_t v = 5; v < 700; ++v)
    if (some.has(v)) expected.push_back(v);
  EXPECT_EQ(visited, expected);
}

TEST(SmoothWhere, GivesTheSameBitsAsSmoothingTheWholeArray) {
  // Zero in most rows, which are skipped, and at one side up to the edge, which is continued.
  std::vector<float> values(kVoxels, 0.0f);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const Index3 i = index_of(kSize, v);
    if (i.x() < 6 && i.z() > 3) values[v] = static_cast<float>(std::sin(i.x() + 2 * i.y() * i.z()));
  }
  std::vector<float> whole = values;
  smooth(kSize, whole, 1.3);
  const auto wanted = [](std::size_t v) { return index_of(kSize, v).y() > 8; };
  BandField some(chunks_where(kVoxels, wanted));
  const std::size_t plane = 19 * 14;
  smooth_where(
      kSize, 1.3, some,
      [&](int k, float* out) {
        std::copy_n(values.data() + static_cast<std::size_t>(k) * plane, plane, out);
      },
      [&](std::size_t v, float value) { some[v] = value; });
  for (std::size_t v = 0; v < kVoxels; ++v) {
    EXPECT_TRUE(some.has(v) || !wanted(v));
    EXPECT_TRUE(!some.has(v) || some[v] == whole[v]);
  }
}

TEST(IsoDistance, InSomePlanesIsWhatItIsInAll) {
  std::vector<float> values(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v)
    values[v] =
        static_cast<float>(2.6 - (index_of(kSize, v).cast<double>() - Vec3(8.3, 6.1, 4.7)).norm());
  const std::vector<float> whole = iso_distance(kSize, values, 2);
  // Planes 4 and 5.
  const std::size_t plane = 19 * 14;
  std::vector<float> some(2 * plane);
  const SignedField field(kSize, values);
  iso_distance_in(kSize, {&field, some.data(), nullptr}, 2, 4, 6);
  EXPECT_TRUE(std::equal(some.begin(), some.end(), whole.begin() + 4 * plane));
}

// Two tissues and what is beside them both: its surface is theirs from the other side, but for where the two
// meet, and for some places where it isn't.
TEST(IsoDistance, OfFieldsOppositeEachOtherIsThatOfEach) {
  std::array<std::vector<float>, 3> values;
  for (auto& of : values) of.resize(kVoxels);
  for (std::size_t v = 0; v < kVoxels; ++v) {
    const Vec3 x = index_of(kSize, v).cast<double>();
    values[1][v] = static_cast<float>(3.6 - (x - Vec3(6.3, 6.1, 4.7)).norm());
    values[2][v] = static_cast<float>(2.9 - (x - Vec3(11.7, 7.2, 5.1)).norm());
    values[0][v] = -std::max(values[1][v], values[2][v]);
    if (v % 97 == 0) values[0][v] *= 1.1f;
  }
  const std::array<SignedField, 3> fields = {
      SignedField(kSize, values[0]), SignedField(kSize, values[1]), SignedField(kSize, values[2])};
  const std::size_t plane = 19 * 14;
  std::array<std::vector<float>, 3> together;
  for (auto& of : together) of.resize(4 * plane);
  iso_distance_in(
      kSize, {&fields[0], together[0].data(), nullptr}, 2, 3, 7,
      {{&fields[1], together[1].data(), nullptr}, {&fields[2], together[2].data(), nullptr}});
  for (std::size_t n = 0; n < 3; ++n) {
    const std::vector<float> alone = iso_distance(kSize, values[n], 2);
    EXPECT_TRUE(std::equal(together[n].begin(), together[n].end(), alone.begin() + 3 * plane));
  }
}

}  // namespace
}  // namespace toothprep
