// The molar: anatomy that can be counted and measured.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <vector>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

// The cemento-enamel junction lies between these heights (it rises towards the neighbouring teeth).
constexpr double kLowestCej = 11.4, kHighestCej = 12.7;
constexpr int kEnamel = tissue_index(Tissue::kEnamel), kDentin = tissue_index(Tissue::kDentin),
              kPulp = tissue_index(Tissue::kPulp);

// Dense labels of the box, for counting connected parts.
struct Labels {
  Index3 size;
  double voxel;
  std::vector<Tissue> label;

  explicit Labels(double voxel_mm) : voxel(voxel_mm) {
    size = (molar_bounds().max / voxel).array().ceil().matrix().cast<int>() + Index3::Ones();
    for (int k = 0; k < size.z(); ++k)
      for (int j = 0; j < size.y(); ++j)
        for (int i = 0; i < size.x(); ++i)
          label.push_back(sample_molar(voxel * Vec3(i, j, k)).label);
  }
  int layer(double z) const { return static_cast<int>(std::lround(z / voxel)); }
};

// Connected parts (by faces) of the voxels between two layers for which `belongs` holds.
template <class Predicate>
int parts(const Labels& l, int first_layer, int last_layer, Predicate belongs) {
  const int plane = l.size.x() * l.size.y();
  std::vector<char> open(l.label.size(), 0);
  for (int v = first_layer * plane; v < (last_layer + 1) * plane; ++v)
    open[v] = belongs(l.label[v]);
  int count = 0;
  std::vector<int> stack;
  for (int start = 0; start < static_cast<int>(open.size()); ++start) {
    if (!open[start]) continue;
    ++count;
    stack.push_back(start);
    open[start] = 0;
    while (!stack.empty()) {
      const int v = stack.back();
      stack.pop_back();
      for (const int step : {1, -1, l.size.x(), -l.size.x(), plane, -plane}) {
        const int n = v + step;  // the box's faces are air, so that no line wraps around
        if (n >= 0 && n < static_cast<int>(open.size()) && open[n]) {
          open[n] = 0;
          stack.push_back(n);
        }
      }
    }
  }
  return count;
}

const Labels& labels() {
  static const Labels l(0.15);
  return l;
}

// Points on the outer surface, with the outward normal.
struct SurfacePoint {
  Vec3 x, normal;
};
Vec3 gradient(const Vec3& x) {
  constexpr double kStep = 1e-3;
  Vec3 g;
  for (int a = 0; a < 3; ++a)
    g[a] = (sample_molar(x + kStep * Vec3::Unit(a)).solid -
            sample_molar(x - kStep * Vec3::Unit(a)).solid) /
           (2 * kStep);
  return g;
}
const std::vector<SurfacePoint>& surface() {
  static const std::vector<SurfacePoint> points = [] {
    std::vector<SurfacePoint> found;
    const Box box = molar_bounds();
    for (double x = box.min.x(); x < box.max.x(); x += 0.25)
      for (double y = box.min.y(); y < box.max.y(); y += 0.25)
        for (double z = box.min.z(); z < box.max.z(); z += 0.25) {
          Vec3 p(x, y, z);
          if (std::abs(sample_molar(p).solid) > 0.12) continue;
          for (int pass = 0; pass < 3; ++pass)
            p -= sample_molar(p).solid * gradient(p).normalized();
          if (std::abs(sample_molar(p).solid) < 0.005)
            found.push_back({p, gradient(p).normalized()});
        }
    return found;
  }();
  return points;
}

// Thickness of the enamel along a line into the tooth, mm.
double enamel_below(const Vec3& x, const Vec3& inward) {
  double depth = 0;
  while (sample_molar(x + (depth + 0.01) * inward).label == Tissue::kEnamel) depth += 0.01;
  return depth;
}

double occlusal_height(double x, double y) {
  double z = molar_bounds().max.z();
  while (z > 0 && sample_molar({x, y, z}).label == Tissue::kAir) z -= 0.02;
  return z;
}

TEST(Molar, IsOneToothOfThreeTissuesEachInOnePiece) {
  const Labels& l = labels();
  const int top = l.size.z() - 1;
  EXPECT_EQ(parts(l, 0, top, [](Tissue t) { return t != Tissue::kAir; }), 1);
  for (const Tissue tissue : {Tissue::kEnamel, Tissue::kDentin, Tissue::kPulp})
    EXPECT_EQ(parts(l, 0, top, [tissue](Tissue t) { return t == tissue; }), 1)
        << kTissueNames[tissue_index(tissue)];
}

TEST(Molar, HasTheSizeOfALowerFirstMolarAndPositiveCoordinates) {
  Vec3 low = Vec3::Constant(1e9), high = Vec3::Constant(-1e9);
  for (const SurfacePoint& p : surface()) {
    low = low.cwiseMin(p.x);
    high = high.cwiseMax(p.x);
  }
  EXPECT_GT(low.minCoeff(), 0);
  EXPECT_TRUE((low.array() > molar_bounds().min.array()).all());
  EXPECT_TRUE((high.array() < molar_bounds().max.array()).all());
  // Textbook means: crown 11.0 mesiodistally, 10.5 buccolingually, 7.5 high, 21 long (17 to 27.7).
  EXPECT_NEAR(high.y() - low.y(), 11.0, 0.8);
  EXPECT_NEAR(high.x() - low.x(), 10.5, 0.8);
  EXPECT_NEAR(high.z() - kLowestCej, 7.5, 0.5);
  EXPECT_GT(high.z() - low.z(), 17.0);
  EXPECT_LT(high.z() - low.z(), 22.0);
}

TEST(Molar, HasTwoRootsWithThreeCanalsBelowOneTrunk) {
  const Labels& l = labels();
  const auto solid = [](Tissue t) { return t != Tissue::kAir; };
  const auto pulp = [](Tissue t) { return t == Tissue::kPulp; };
  EXPECT_EQ(parts(l, l.layer(10), l.layer(10), solid), 1);
  EXPECT_EQ(parts(l, l.layer(6), l.layer(6), solid), 2);
  EXPECT_EQ(parts(l, l.layer(2.5), l.layer(2.5), solid), 2);
  EXPECT_EQ(parts(l, l.layer(11), l.layer(11), pulp), 1);
  EXPECT_EQ(parts(l, l.layer(6), l.layer(6), pulp), 3);
}

TEST(Molar, HasFiveCuspsAroundAFossa) {
  // Local maxima of the occlusal height map, higher than the marginal ridges.
  constexpr double kStep = 0.1;
  constexpr int kWidth = 120;
  std::vector<double> height(kWidth * kWidth);
  for (int j = 0; j < kWidth; ++j)
    for (int i = 0; i < kWidth; ++i) {
      double z = 19.4;
      while (z > 17.5 && sample_molar({kStep * i, kStep * j, z}).solid > 0) z -= 0.02;
      height[j * kWidth + i] = z;
    }
  int cusps = 0;
  for (int j = 5; j < kWidth - 5; ++j)
    for (int i = 5; i < kWidth - 5; ++i) {
      const int v = j * kWidth + i;
      bool highest = height[v] > 18.1;
      for (int dj = -5; dj <= 5 && highest; ++dj)
        for (int di = -5; di <= 5 && highest; ++di) {
          const int n = v + dj * kWidth + di;
          highest = height[n] < height[v] || (height[n] == height[v] && n >= v);
        }
      cusps += highest;
    }
  EXPECT_EQ(cusps, 5);
  EXPECT_NEAR(occlusal_height(6.1, 5.25), 16.6, 0.3);
}

TEST(Molar, HasEnamelAllOverTheCrownAndNoneBelow) {
  int on_crown = 0, on_root = 0;
  for (const SurfacePoint& p : surface()) {
    const Tissue skin = sample_molar(p.x - 0.02 * p.normal).label;
    if (p.x.z() > kHighestCej + 0.2) {
      EXPECT_EQ(skin, Tissue::kEnamel) << p.x.transpose();
      ++on_crown;
    } else if (p.x.z() < kLowestCej) {
      EXPECT_EQ(skin, Tissue::kDentin) << p.x.transpose();
      ++on_root;
    }
  }
  EXPECT_GT(on_crown, 1000);
  EXPECT_GT(on_root, 1000);
  const Labels& l = labels();
  for (int v = 0; v < l.layer(kLowestCej) * l.size.x() * l.size.y(); ++v)
    ASSERT_NE(l.label[v], Tissue::kEnamel);
}

TEST(Molar, HasAnEnamelCapThatThinsFromTheCuspsToTheNeck) {
  const auto down = -Vec3::UnitZ();
  for (const auto& [x, y] : {std::pair{8.8, 3.0}, {9.0, 6.2}, {3.1, 3.2}, {3.2, 7.6}}) {
    const double depth = enamel_below({x, y, occlusal_height(x, y) - 0.02}, down);
    EXPECT_GT(depth, 1.9) << x << ' ' << y;
    EXPECT_LT(depth, 2.6) << x << ' ' << y;
  }
  const double fossa = enamel_below({6.1, 5.25, occlusal_height(6.1, 5.25) - 0.02}, down);
  EXPECT_GT(fossa, 0.9);
  EXPECT_LT(fossa, 1.6);

  double thickest_at_neck = 0;
  for (const SurfacePoint& p : surface())
    if (p.x.z() < kLowestCej + 0.3)
      thickest_at_neck = std::max(thickest_at_neck, enamel_below(p.x - 0.01 * p.normal, -p.normal));
  EXPECT_LT(thickest_at_neck, 0.3);
}

TEST(Molar, HasTheMeanEnamelThicknessOfAMolar) {
  // Mean thickness is the cap's volume over the area of its border with the dentin; that area is
  // the volume of a thin layer around the border over the layer's thickness.
  constexpr double kStep = 0.1, kHalfLayer = 0.2;
  const Box box = molar_bounds();
  int cap = 0, layer = 0;
  for (double x = box.min.x(); x < box.max.x(); x += kStep)
    for (double y = box.min.y(); y < box.max.y(); y += kStep)
      for (double z = 11; z < box.max.z(); z += kStep) {
        const ToothSample s = sample_molar({x, y, z});
        if (s.solid > 0) continue;
        cap += s.label == Tissue::kEnamel;
        layer +=
            std::max(s.tissue[kEnamel], s.tissue[kDentin]) < kHalfLayer && s.label != Tissue::kPulp;
      }
  const double mean = cap / (layer / (2 * kHalfLayer));
  EXPECT_NEAR(mean, 1.35, 0.15);  // published means for molars lie between 1.26 and 1.44 mm
}

TEST(Molar, HoldsItsPulpInsideTheDentin) {
  const Box box = molar_bounds();
  int inside = 0;
  for (double x = box.min.x(); x < box.max.x(); x += 0.1)
    for (double y = box.min.y(); y < box.max.y(); y += 0.1)
      for (double z = box.min.z(); z < box.max.z(); z += 0.1) {
        const ToothSample s = sample_molar({x, y, z});
        if (s.tissue[kPulp] >= 0) continue;
        ASSERT_EQ(s.label, Tissue::kPulp) << x << ' ' << y << ' ' << z;
        ASSERT_LT(s.solid, -0.3) << x << ' ' << y << ' ' << z;
        ASSERT_GT(s.tissue[kEnamel], 0.8) << x << ' ' << y << ' ' << z;
        ++inside;
      }
  EXPECT_GT(inside, 10000);
}

TEST(Molar, LabelsFollowTheDistances) {
  const Box box = molar_bounds();
  for (double x = box.min.x(); x < box.max.x(); x += 0.23)
    for (double y = box.min.y(); y < box.max.y(); y += 0.19)
      for (double z = box.min.z(); z < box.max.z(); z += 0.21) {
        const ToothSample s = sample_molar({x, y, z});
        if (std::abs(s.solid) < 1e-6) continue;
        ASSERT_EQ(s.label != Tissue::kAir, s.solid < 0);
        for (int k = 0; k < 3; ++k)
          if (std::abs(s.tissue[k]) > 1e-6) {
            ASSERT_EQ(s.label == tissue_at(k), s.tissue[k] < 0) << x << ' ' << y << ' ' << z;
          }
      }
}

TEST(Molar, LevelSetsHaveTheSlopeOfADistance) {
  const LayeredTooth tooth = make_molar({.voxel = 0.1});
  const auto expect_slope = [](const auto& grid) {
    double sum = 0;
    int n = 0;
    for (std::size_t b = 0; b < grid.table_size(); ++b) {
      if (grid.is_uniform(b)) continue;
      const Index3 first = grid.brick_origin(b);
      for (int v = 0; v < kBrickVoxels; ++v) {
        if (std::abs(grid.brick(b)[v]) > 0.15) continue;  // neighbours must be unclamped
        const Index3 i = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
        Vec3 g;
        for (int a = 0; a < 3; ++a) {
          const Index3 e = Index3::Unit(a);
          g[a] = (grid.value(i.x() + e.x(), i.y() + e.y(), i.z() + e.z()) -
                  grid.value(i.x() - e.x(), i.y() - e.y(), i.z() - e.z())) /
                 0.2;
        }
        sum += g.norm();
        ++n;
      }
    }
    EXPECT_GT(sum / n, 0.9);
    EXPECT_LT(sum / n, 1.05);
  };
  expect_slope(tooth.solid);
  for (const PackedLevelSet& remains : tooth.remains) expect_slope(remains);
}

TEST(Molar, HasVolumesThatHardlyDependOnTheVoxel) {
  const auto coarse = remaining_volumes_mm3(make_molar({.voxel = 0.2}));
  const auto fine = remaining_volumes_mm3(make_molar({.voxel = 0.1}));
  for (const int k : {kEnamel, kDentin, kPulp})
    EXPECT_NEAR(coarse[k], fine[k], 0.01 * fine[k]) << kTissueNames[k];
  EXPECT_EQ(fine[tissue_index(Tissue::kOther)], 0);
}

TEST(Molar, IsTheSameAsWhenEveryVoxelIsSampled) {
  const LayeredTooth tooth = make_molar({.voxel = 0.3});
  const Index3 lower = Index3::Zero(), upper = Index3(45, 45, 70);
  const LayeredTooth all = build_tooth(tooth.lattice, lower, upper, sample_molar, false);
  EXPECT_EQ(tooth_sha256(tooth), tooth_sha256(all));
}

TEST(Molar, IsTheSameForAnyNumberOfThreads) {
  const auto built_with = [](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return tooth_sha256(make_molar({.voxel = 0.25}));
  };
  EXPECT_EQ(built_with(1), built_with(2));
}

TEST(Molar, RefusesAnAbsurdVoxel) {
  for (const double bad : {0.0, -0.1, 0.6, 1e-9, std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity()})
    EXPECT_THROW(static_cast<void>(make_molar({.voxel = bad})), Error);
}

// A leaning tooth is the upright one, turned: every place has the sample of where it came from.
TEST(MolarVariants, ATiltedOneIsTheUprightOneTurned) {
  MolarOptions tilted;
  tilted.voxel = 0.4;
  tilted.tilt_deg = 25;
  const LayeredTooth tooth = make_molar(tilted);
  const auto axis = [&](const char* name) {
    std::istringstream in(tooth.provenance.at(name));
    Vec3 d;
    in >> d.x() >> d.y() >> d.z();
    return d;
  };
  const Vec3 occlusal = axis("axis_occlusal"), mesial = axis("axis_mesial"),
             buccal = axis("axis_buccal");
  EXPECT_NEAR(occlusal.z(), std::cos(units::from_degree(25)), 1e-5);
  EXPECT_NEAR(occlusal.x(), -occlusal.y(), 1e-5);  // towards buccal (+x) and mesial (-y) alike
  EXPECT_GT(occlusal.x(), 0);
  const Vec3 middle(6.1, 5.5, 14);
  for (const Vec3& upright : {Vec3(8.5, 3.0, 18.2), Vec3(6, 5, 11), Vec3(3, 9, 7), Vec3(9, 9, 3)}) {
    const Vec3 d = upright - middle;
    const Vec3 x = middle + d.x() * buccal - d.y() * mesial + d.z() * occlusal;
    const ToothSample there = sample_variant(x, tilted), here = sample_molar(upright);
    EXPECT_NEAR(there.solid, here.solid, 1e-4);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(there.tissue[k], here.tissue[k], 1e-4);
    EXPECT_EQ(there.label, here.label);
  }
  MolarOptions plain;
  plain.voxel = 0.4;
  const auto volume = remaining_volumes_mm3(tooth),
             truth = remaining_volumes_mm3(make_molar(plain));
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(volume[k] / truth[k], 1, 0.01) << k;
}

TEST(MolarVariants, AWornOneIsFlatAndARootlessOneEndsBelowTheNeck) {
  MolarOptions options;
  options.worn = 1.5;
  options.rootless = true;
  const double top = 19.1 - 1.5;
  EXPECT_LT(sample_variant({3.1, 3.2, top - 0.01}, options).solid, 0);
  EXPECT_EQ(sample_variant({3.1, 3.2, top - 0.01}, options).label, Tissue::kEnamel);
  EXPECT_NEAR(sample_variant({3.1, 3.2, top + 0.3}, options).solid, 0.3, 1e-5);
  EXPECT_EQ(sample_variant({3.1, 3.2, top + 0.3}, options).label, Tissue::kAir);
  EXPECT_GT(sample_variant({6.1, 5.5, 10.5}, options).solid, 0);
  EXPECT_LT(sample_variant({6.1, 7.5, 10.7}, options).solid, 0);
  // Between the cuts it is the molar.
  for (const Vec3& x : {Vec3(6, 5, 14), Vec3(1.2, 5, 14), Vec3(6, 5, 12)})
    EXPECT_EQ(sample_variant(x, options).solid,
              std::max({sample_molar(x).solid, static_cast<float>(x.z() - top),
                        static_cast<float>(10.6 - x.z())}));
}

TEST(MolarVariants, APremolarHasTwoCuspsOneRootAndThreeTissuesInOnePieceEach) {
  MolarOptions options;
  options.premolar = true;
  options.voxel = 0.2;
  const LayeredTooth tooth = make_molar(options);
  const auto volume = remaining_volumes_mm3(tooth);
  EXPECT_GT(volume[0], 80);
  EXPECT_GT(volume[1], 200);
  EXPECT_GT(volume[2], 5);
  double low = 1e9, high = -1e9, left = 1e9, right = -1e9;
  for (double z = 1; z < 19.4; z += 0.1)
    for (double v = 0; v < 11; v += 0.1) {
      if (sample_variant({6.1, v, z}, options).solid < 0) {
        low = std::min(low, v), high = std::max(high, v);
      }
      if (sample_variant({v, 5.5, z}, options).solid < 0) {
        left = std::min(left, v), right = std::max(right, v);
      }
    }
  EXPECT_NEAR(high - low, 7.0, 0.6);    // mesiodistally
  EXPECT_NEAR(right - left, 8.2, 0.7);  // buccolingually
  // Along the middle from buccal to lingual: two tips, a fissure between them.
  const auto height = [&](double x) {
    double z = 19.4;
    while (z > 12 && sample_variant({x, 5.5, z}, options).solid > 0) z -= 0.01;
    return z;
  };
  EXPECT_GT(height(6.1 + 0.8 * 2.85), height(6.1) + 1.5);
  EXPECT_GT(height(6.1 - 0.8 * 3.0), height(6.1) + 1.2);
  for (const double z : {3.0, 6.0, 8.0})  // one root, with its canal in the middle
    EXPECT_LT(sample_variant({6.1 + 1.0, 5.5, z}, options).solid, 0) << z;
  EXPECT_EQ(sample_variant({6.1, 5.5 + 0.67 * 0.1, 6.0}, options).label, Tissue::kPulp);
}

TEST(MolarVariants, RefuseWhatIsNoTooth) {
  MolarOptions options;
  options.worn = 5;
  EXPECT_THROW(static_cast<void>(make_molar(options)), Error);
  options.worn = 0;
  options.tilt_deg = 200;
  EXPECT_THROW(static_cast<void>(make_molar(options)), Error);
  options.tilt_deg = std::nan("");
  EXPECT_THROW(static_cast<void>(make_molar(options)), Error);
}

}  // namespace
}  // namespace toothprep
