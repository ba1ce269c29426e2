// Preparations that are known exactly, as a segmentation has them: a tissue's number in every voxel
// whose centre lies in it. What `score` makes of the surfaces that come of such labels.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/io/label_source.h"
#include "toothprep/tools/preparation/preparation.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

const std::map<std::uint16_t, Tissue> kLabelMap = {{1, Tissue::kEnamel}, {2, Tissue::kDentin}};

ImageVolume<std::uint16_t> labels_of(const LayeredTooth& tooth) {
  const LabelGrid& grid = tooth.tissue;
  Index3 low = Index3::Constant(1 << 30), high = -low;
  const auto each = [&](const auto& visit) {
    for (std::size_t b = 0; b < grid.table_size(); ++b)
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 i = grid.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7);
        if (grid.value(i.x(), i.y(), i.z()) != 0) visit(i);
      }
  };
  each([&](const Index3& i) {
    low = low.cwiseMin(i);
    high = high.cwiseMax(i);
  });
  ImageVolume<std::uint16_t> labels;
  low -= Index3::Constant(2);
  labels.size = high - low + Index3::Constant(3);
  labels.spacing = Vec3::Constant(tooth.lattice.voxel);
  labels.origin = tooth.lattice.to_world(low);
  labels.data.assign(labels.voxels(), 0);
  each([&](const Index3& i) {
    if (tooth.solid.value(i.x(), i.y(), i.z()) < 0)
      labels.at(i.x() - low.x(), i.y() - low.y(), i.z() - low.z()) =
          grid.value(i.x(), i.y(), i.z());
  });
  return labels;
}

struct Case {
  std::string name;
  PreparationType type = PreparationType::kClass1;
  CavityOptions cavity;
};

CavityOptions box(double taper_u, double taper_v) {
  CavityOptions o;
  o.size = Vec3(6.5, 4, 5.5);
  o.length = 3.6;
  o.width = 2.4;
  o.enamel = 1.5;
  o.taper_u_plus = o.taper_u_minus = taper_u;
  o.taper_v_plus = o.taper_v_minus = taper_v;
  return o;
}

CavityOptions stump(double convergence) {
  CavityOptions o;
  o.kind = CavityKind::kStump;
  o.size = Vec3(8, 8, 8);
  o.corner = 4;
  o.shoulder_width = 1;
  o.enamel = 3;
  o.convergence_u = o.convergence_v = convergence;
  return o;
}

double dovetail(double mm) { return -std::atan(mm / 2) / units::from_degree(1); }  // 2 mm deep

// Labels and lattice coincide, as where a tooth is voxelized at its segmentation's spacing. Straight
// cavities stand at an odd place: where a wall passes through voxels' centres chance decides.
Preparation measured(Case c, double spacing, bool turned, bool smooth = true) {
  c.cavity.voxel = spacing;
  c.cavity.pose.position = spacing * Vec3(0.37, 0.11, -0.23);
  if (turned)
    c.cavity.pose.orientation = orientation_of_axis(Vec3(0.31, -0.52, 0.79), 0.7).normalized();
  const CavitySpecimen specimen = make_cavity(c.cavity);
  VoxelizeOptions how;
  how.voxel = spacing;
  how.smooth_labels = smooth;
  LayeredTooth original = voxelize_labels(labels_of(specimen.original), kLabelMap, how);
  const LayeredTooth prepared = voxelize_labels(labels_of(specimen.prepared), kLabelMap, how);
  original.provenance.insert(specimen.original.provenance.begin(),
                             specimen.original.provenance.end());
  PreparationOptions options;
  options.type = c.type;
  return measure_preparation(original, prepared, extract_surface(prepared, SurfaceOf::kAll),
                             options);
}

// Angles within 1°, lengths and undercuts within a third of a voxel, no undercut where there is none.
void expect_truth(const Case& c, double spacing, bool turned) {
  const Preparation found = measured(c, spacing, turned);
  CavityOptions cavity = c.cavity;
  cavity.voxel = spacing;
  const CavityTruth truth = cavity_truth(cavity);
  for (const char* key :
       {"undercut_along_axis_mm", "undercut_max_mm", "wall_angles_deg.mesial",
        "wall_angles_deg.distal", "wall_angles_deg.buccal", "wall_angles_deg.lingual",
        "convergence_deg.buccolingual", "width_mm", "length_mm", "depth_mm", "margin_width_mm"}) {
    const Quantity* q = find_quantity(found.quantities, key);
    const auto expected = truth_value(truth, key);
    if (!q || !expected) continue;
    const std::string name = key;
    std::printf("%.2f %-8s %-13s %-30s %8.3f %8.3f %+7.3f\n", spacing,
                turned ? "turned" : "straight", c.name.c_str(), key, *expected, q->value,
                q->value - *expected);
    const bool undercut = name.find("undercut") == 0, angle = name.find("deg") != name.npos;
    const double tolerance = undercut && *expected == 0        ? 0
                             : angle && name.find("conv") == 0 ? 2  // two walls
                             : angle                           ? 1
                                                               : spacing / 3;
    EXPECT_NEAR(q->value, *expected, tolerance) << c.name << ' ' << key << ' ' << turned;
  }
}

TEST(LabelSurfaces, WallsAtAnOddAngleHaveTheirAnglesWidthsAndNoFalseUndercut) {
  expect_truth({"parallel", PreparationType::kClass1, box(0, 0)}, 0.1, true);
  expect_truth({"taper 6 and 2", PreparationType::kClass1, box(6, 2)}, 0.1, true);
}

TEST(LabelSurfaces, ADovetailIsStillOne) {
  for (const double mm : {0.1, 0.2})
    expect_truth({"dovetail", PreparationType::kClass1, box(3, dovetail(mm))}, 0.1, true);
  // Its floor has ripples of some µm, from which every way but up is barred.
  expect_truth({"dovetail 0.2", PreparationType::kClass1, box(3, dovetail(0.2))}, 0.05, true);
}

TEST(LabelSurfaces, WallsAlongTheVoxelsStayWhereTheyAre) {
  expect_truth({"parallel", PreparationType::kClass1, box(0, 0)}, 0.1, false);
  // A slope of two steps in the wall's height.
  expect_truth({"taper 6", PreparationType::kClass1, box(6, 6)}, 0.1, false);
}

TEST(LabelSurfaces, AStumpHasItsConvergence) {
  for (const bool turned : {false, true})
    expect_truth({"stump 8", PreparationType::kCrown, stump(8)}, 0.1, turned);
}

TEST(LabelSurfaces, WithTheirStepsTheyHaveAFalseUndercut) {  // or these cavities would show nothing
  const Preparation found =
      measured({"parallel", PreparationType::kClass1, box(0, 0)}, 0.1, true, false);
  EXPECT_GT(find_quantity(found.quantities, "undercut_along_axis_mm")->value, 0.03);
}

// ---- Tissues

// A block of dentin under enamel, with pulp that touches both, cut by planes at odd angles.
ImageVolume<std::uint16_t> three_tissues(double spacing) {
  ImageVolume<std::uint16_t> labels;
  labels.size = Index3(34, 32, 30);
  labels.spacing = Vec3::Constant(spacing);
  labels.origin = Vec3(1.23, -4.56, 7.89);
  labels.data.assign(labels.voxels(), 0);
  const Vec3 enamel = Vec3(0.3, -0.2, 1).normalized(), pulp = Vec3(1, 0.5, 0.2).normalized();
  for (int k = 3; k < 27; ++k)
    for (int j = 4; j < 28; ++j)
      for (int i = 3; i < 31; ++i) {
        const Vec3 x = Vec3(i, j, k) - Vec3(17, 16, 15);
        labels.at(i, j, k) = x.dot(pulp) > 5 ? 3 : x.dot(enamel) > 3 ? 1 : 2;
      }
  return labels;
}
const std::map<std::uint16_t, Tissue> kThree = {
    {1, Tissue::kEnamel}, {2, Tissue::kDentin}, {3, Tissue::kPulp}};

template <class Grid>
auto value(const Grid& grid, const Index3& i) {
  return grid.value(i.x(), i.y(), i.z());
}

TEST(LabelSurfaces, TouchingTissuesLeaveNoGapsNorOverlapsAndKeepTheirVolumes) {
  for (const double spacing : {0.1, 0.07, 0.04}) {
    const auto labels = three_tissues(spacing);
    VoxelizeOptions how;
    how.voxel = 0.1;
    const LayeredTooth tooth = voxelize_labels(labels, kThree, how);
    for (std::size_t b = 0; b < tooth.tissue.table_size(); ++b)
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 i = tooth.tissue.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7);
        const auto label = value(tooth.tissue, i);
        ASSERT_EQ(label != 0, value(tooth.solid, i) < 0);
        int inside = 0;
        for (std::uint8_t k = 1; k <= 3; ++k) {
          ASSERT_EQ(label == k, value(tooth.remains[k - 1], i) < 0) << int{k};
          inside += value(tooth.remains[k - 1], i) < 0;
        }
        ASSERT_EQ(inside, label != 0 ? 1 : 0);
      }
    const auto volumes = remaining_volumes_mm3(tooth);
    for (const auto& [label, tissue] : kThree) {
      const double input =
          static_cast<double>(std::count(labels.data.begin(), labels.data.end(), label)) *
          std::pow(spacing, 3);
      if (spacing < how.voxel) continue;  // a block of ten voxels has more edges than surface
      EXPECT_NEAR(volumes[tissue_index(tissue)] / input, 1, 0.005) << label;
    }
  }
}

TEST(LabelSurfaces, ASheetOfOneVoxelIsNotLost) {
  ImageVolume<std::uint16_t> labels;
  labels.size = Index3(30, 30, 12);
  labels.spacing = Vec3::Constant(0.1);
  labels.origin = Vec3::Constant(0.05);
  labels.data.assign(labels.voxels(), 0);
  for (int j = 4; j < 26; ++j)
    for (int i = 4; i < 26; ++i) labels.at(i, j, 5) = 1;
  for (const double place : {0.05, 0.07, 0.09}) {  // of the labels between the lattice's voxels
    labels.origin = Vec3::Constant(place);
    VoxelizeOptions how;
    how.voxel = 0.1;
    const LayeredTooth tooth = voxelize_labels(labels, {{1, Tissue::kEnamel}}, how);
    const double input = 22 * 22 * 1e-3;
    // Between two voxels of the lattice a level set has a sheet of one voxel too thin.
    EXPECT_GT(remaining_volumes_mm3(tooth)[0] / input, place == 0.05 ? 0.95 : 0.6) << place;
    EXPECT_LT(remaining_volumes_mm3(tooth)[0] / input, 1.05) << place;
    for (double x = 0.7; x < 2.3; x += 0.1) {  // no holes
      double least = 1;
      for (int k = 0; k < 12; ++k) {
        Index3 i = tooth.lattice.to_index(labels.origin + Vec3(x, 1.4, 0.1 * k))
                       .array()
                       .round()
                       .cast<int>();
        least = std::min<double>(least, value(tooth.solid, i));
      }
      EXPECT_LT(least, 0) << x << ' ' << place;
    }
  }
}

TEST(LabelSurfaces, EveryCentreStaysInItsTissue) {
  const auto labels = three_tissues(0.1);
  VoxelizeOptions how;
  how.voxel = 0.025;  // fine enough to see
  const LayeredTooth tooth = voxelize_labels(labels, kThree, how);
  std::size_t elsewhere = 0;
  for (int k = 1; k < labels.size.z(); ++k)
    for (int j = 1; j < labels.size.y(); ++j)
      for (int i = 1; i < labels.size.x(); ++i) {
        const Index3 at =
            tooth.lattice.to_index(labels.to_world(Vec3(i, j, k))).array().round().cast<int>();
        const std::uint16_t wanted = labels.at(i, j, k);  // labels are the tissues' numbers here
        if (value(tooth.tissue, at) == wanted) continue;
        // A surface may touch a centre, and the lattice's nearest voxel is not at it.
        const float solid = value(tooth.solid, at);
        float nearest = std::abs(solid);
        for (const PackedLevelSet& remains : tooth.remains)
          nearest = std::min(nearest, std::abs(value(remains, at)));
        elsewhere += nearest > 0.025f;
      }
  EXPECT_EQ(elsewhere, 0u);
}

TEST(LabelSurfaces, AreTheSameBitsWhateverTheThreads) {
  const auto labels = three_tissues(0.1);
  std::vector<std::string> hashes;
  for (const std::size_t threads : {1, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    hashes.push_back(tooth_sha256(voxelize_labels(labels, kThree, {})));
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(LabelSurfaces, TheToothSaysWhatLabelsItComesFrom) {
  const auto labels = three_tissues(0.1);
  VoxelizeOptions how;
  for (const bool smooth : {true, false}) {
    how.smooth_labels = smooth;
    const auto source = recorded_labels(voxelize_labels(labels, kThree, how).provenance);
    ASSERT_TRUE(source);
    EXPECT_EQ(source->spacing_mm, 0.1);
    EXPECT_EQ(source->smooth, smooth);
  }
  EXPECT_FALSE(recorded_labels({{"source", "scan.nrrd"}}));
}

TEST(LabelSurfaces, LengthsAreAsUncertainAsTheLabels) {
  const CavitySpecimen specimen = make_cavity(box(6, 6));
  PreparationOptions options;
  const auto uncertainty = [&](const char* key) {
    const Preparation found =
        measure_preparation(specimen.original, specimen.prepared,
                            extract_surface(specimen.prepared, SurfaceOf::kAll), options);
    return find_quantity(found.quantities, key)->uncertainty;
  };
  const double width = uncertainty("width_mm"), angle = uncertainty("wall_angles_deg.mesial");
  EXPECT_NEAR(width, 0.05, 0.01);  // half a voxel; an axis that is given adds nothing
  options.cut_label_spacing = options.original_label_spacing = 0.3;
  EXPECT_NEAR(uncertainty("width_mm"), 0.3, 0.01);
  EXPECT_NEAR(uncertainty("wall_angles_deg.mesial") / angle, 3.25, 0.3);  // tan is nearly linear
  EXPECT_NEAR(uncertainty("convergence_deg.mesiodistal") / angle, 2 * 3.25, 0.6);
  options.cut_label_spacing = 0;  // cut here: only what it is measured against comes from labels
  EXPECT_NEAR(uncertainty("width_mm"), 0.15, 0.01);
  EXPECT_NEAR(uncertainty("wall_angles_deg.mesial"), angle, 1e-9);
  EXPECT_NEAR(uncertainty("convergence_deg.mesiodistal") / angle, std::sqrt(2), 0.01);
}

}  // namespace
}  // namespace toothprep
