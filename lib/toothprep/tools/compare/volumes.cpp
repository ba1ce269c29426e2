#include "toothprep/tools/compare/volumes.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/voxel_shape.h"

namespace toothprep {
namespace {

constexpr double kOtherAnatomy = 0.2;  // share of labels that differ
constexpr double kMostAdded = 0.005;   // of the original's volume, deeper than a voxel outside
constexpr double kFewestVoxels = 8;    // that must be missing from a preparation or target

double fraction(float phi, double voxel) {
  return std::clamp(0.5 - static_cast<double>(phi) / voxel, 0.0, 1.0);
}

bool is_other_or_beside(const LabelGrid& tissue, const Index3& i) {
  constexpr auto kOther = static_cast<std::uint8_t>(Tissue::kOther);
  const auto is = [&](int x, int y, int z) {
    return tissue.value(i.x() + x, i.y() + y, i.z() + z) == kOther;
  };
  return is(0, 0, 0) || is(1, 0, 0) || is(-1, 0, 0) || is(0, 1, 0) || is(0, -1, 0) || is(0, 0, 1) ||
         is(0, 0, -1);
}

// The fractions of one solid in one voxel: of all and of enamel, dentin, pulp.
using Fractions = std::array<double, 4>;

struct BrickView {
  const float* solid;
  std::array<PackedBrick, 3> remains;
  BrickView(const LayeredTooth& tooth, std::size_t b)
      : solid(tooth.solid.brick(b)),
        remains{tooth.remains[0].brick(b), tooth.remains[1].brick(b), tooth.remains[2].brick(b)} {}
  Fractions at(std::size_t v, double voxel) const {
    return {fraction(solid[v], voxel), fraction(remains[0][v], voxel),
            fraction(remains[1][v], voxel), fraction(remains[2][v], voxel)};
  }
};

// The volume fraction of a voxel below both, summed over its subcubes. With the fractions a and b
// below a plane of each it is min(a, b) for parallel normals, max(0, a + b - 1) for antiparallel
// ones and a b for perpendicular ones, exactly; in between interpolated by the cosine of the angle.
double share_below_both(const VoxelPlane& a, const VoxelShape& other, double voxel) {
  constexpr int kAll = kSubcubes * kSubcubes * kSubcubes;
  const double cube = voxel / kSubcubes;
  double sum = 0;
  for (int n = 0; n < kAll; ++n) {
    const Vec3 at = subcube(n);
    const VoxelPlane& b = other.plane_at(at);
    const double cosine = a.slope.dot(b.slope) / std::max(a.slope.norm() * b.slope.norm(), 1e-12);
    const double along = std::abs(cosine);
    const double fa = std::clamp(0.5 - a.at(at) / cube, 0.0, 1.0);
    const double fb = std::clamp(0.5 - b.at(at) / cube, 0.0, 1.0);
    const double parallel = cosine > 0 ? std::min(fa, fb) : std::max(fa + fb - 1, 0.0);
    sum += along * parallel + (1 - along) * fa * fb;
  }
  return sum / kAll;
}

// Sums of one region over one brick, in voxels: all, enamel, dentin, pulp, other.
using Sums = std::array<double, 5>;

enum Region {
  kRemoved,
  kAdded,
  kRequired,
  kOver,
  kUnder,
  kAddedDeep,
  kTargetAddedDeep,
  kAtEdges,
  kRegions
};
using BrickSums = std::array<Sums, kRegions>;

class Comparison {
 public:
  Comparison(const LayeredTooth& original, const LayeredTooth& prepared, const LayeredTooth* target,
             double noise)
      : original_(original),
        prepared_(prepared),
        target_(target),
        voxel_(original.lattice.voxel),
        gate_(noise / original.lattice.voxel) {}

  // Which bricks go to which thread does not matter: each has its own sums, added in order.
  BrickSums run() const {
    std::vector<BrickSums> bricks(original_.solid.table_size());
    tbb::parallel_for(std::size_t{0}, bricks.size(),
                      [&](std::size_t b) { bricks[b] = brick_sums(b); });
    BrickSums all{};
    for (const BrickSums& brick : bricks)
      for (std::size_t r = 0; r < kRegions; ++r)
        for (std::size_t k = 0; k < 5; ++k) all[r][k] += brick[r][k];
    const double cube = voxel_ * voxel_ * voxel_;
    for (Sums& region : all)
      for (double& sum : region) sum *= cube;
    return all;
  }

 private:
  bool all_alike(std::size_t b) const {
    const auto uniform = [b](const LevelSet& g) { return g.is_uniform(b); };
    if (!uniform(original_.solid) || !uniform(prepared_.solid)) return false;
    const float value = original_.solid.uniform_value(b);
    if (prepared_.solid.uniform_value(b) != value) return false;
    return !target_ || (uniform(target_->solid) && target_->solid.uniform_value(b) == value);
  }

  double solid_fraction(const LayeredTooth& tooth, const Index3& i) const {
    return fraction(tooth.solid.value(i.x(), i.y(), i.z()), voxel_);
  }

  // Of the region at a voxel, by the solid alone; for the neighbours that open the gate.
  double difference(Region region, const Index3& i) const {
    const double o = solid_fraction(original_, i);
    const double p = region == kRequired ? 0 : solid_fraction(prepared_, i);
    const double t = region == kRemoved || region == kAdded ? 0 : solid_fraction(*target_, i);
    switch (region) {
      case kRemoved:
        return o - p;
      case kAdded:
        return p - o;
      case kRequired:
        return o - t;
      case kOver:
        return std::min(o, t) - p;
      case kUnder:
        return std::min(o, p) - t;
      default:
        return 0;
    }
  }

  bool gate_open(Region region, const Index3& i, double own) const {
    if (own > gate_) return true;
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z)
          if ((x || y || z) && difference(region, i + Index3(x, y, z)) > gate_) return true;
    return false;
  }

  // Adds what region `r` has of one voxel: max(0, more - less) of all and of each tissue.
  void add(BrickSums& sums, Region r, const Index3& i, const Fractions& more,
           const Fractions& less) const {
    const double all = more[0] - less[0];
    if (all <= 0 || !gate_open(r, i, all)) return;
    sums[r][0] += all;
    double rest = all;
    for (std::size_t k = 1; k < 4; ++k) {
      const double part = std::max(0.0, more[k] - less[k]);
      sums[r][k] += part;
      rest -= part;
    }
    if (rest > 1e-6 && is_other_or_beside(original_.tissue, i)) sums[r][4] += rest;
  }

  // Remaining fractions in a voxel that the tooth filled and the cut crosses. The level sets
  // of remaining tissues, max(border, cut), overestimate a layer thinner than a voxel between border
  // and cut.
  Fractions left_of(const Fractions& o, const Fractions& own, const LevelSet& solid,
                    const Index3& i) const {
    if (o[0] < 1) return own;
    const VoxelShape cut(solid, i, voxel_);
    const double all = cut.has_edge() ? cut.share(voxel_) : own[0];
    if (all <= 0 || all >= 1) return !cut.has_edge() ? own : all >= 1 ? o : Fractions{};
    Fractions left = {all};
    double sum = 0, before = 0;
    for (std::size_t k = 1; k < 4; ++k) {
      left[k] = o[k] <= 0   ? 0
                : o[k] >= 1 ? all
                            : share_below_both(plane_of(original_.remains[k - 1], i), cut, voxel_);
      sum += left[k];
      before += o[k];
    }
    if (sum > 0 && before > 1 - 1e-6)
      for (std::size_t k = 1; k < 4; ++k) left[k] *= all / sum;
    return left;
  }

  BrickSums brick_sums(std::size_t b) const {
    BrickSums sums{};
    if (all_alike(b)) return sums;
    const BrickView original(original_, b), prepared(prepared_, b);
    const BrickView target = target_ ? BrickView(*target_, b) : prepared;
    const Index3 first = original_.solid.brick_origin(b);
    const auto lower = [](const Fractions& x, const Fractions& y) {
      Fractions both;
      for (std::size_t k = 0; k < 4; ++k) both[k] = std::min(x[k], y[k]);
      return both;
    };
    for (std::size_t v = 0; v < kBrickVoxels; ++v) {
      const float po = original.solid[v], pp = prepared.solid[v];
      const float pt = target_ ? target.solid[v] : po;
      if (po == pp && po == pt) continue;
      const Index3 i = first + Index3(static_cast<int>(v >> 6), static_cast<int>(v >> 3 & 7),
                                      static_cast<int>(v & 7));
      const Fractions o = original.at(v, voxel_);
      const Fractions even = prepared.at(v, voxel_), p = left_of(o, even, prepared_.solid, i);
      sums[kAtEdges][0] += p[0] - even[0];
      add(sums, kRemoved, i, o, p);
      add(sums, kAdded, i, p, o);
      if (po > voxel_) sums[kAddedDeep][0] += p[0];
      if (!target_) continue;
      const Fractions t = left_of(o, target.at(v, voxel_), target_->solid, i);
      add(sums, kRequired, i, o, t);
      add(sums, kOver, i, lower(o, t), p);
      add(sums, kUnder, i, lower(o, p), t);
      if (po > voxel_) sums[kTargetAddedDeep][0] += t[0];
    }
    return sums;
  }

  const LayeredTooth &original_, &prepared_;
  const LayeredTooth* target_;
  double voxel_, gate_;
};

TissueVolumes volumes_of(const Sums& sums) {
  TissueVolumes volumes;
  volumes.total = sums[0];
  for (std::size_t k = 0; k < kTissueCount; ++k) volumes.tissue[k] = sums[k + 1];
  return volumes;
}

TissueVolumes volumes_of(const LayeredTooth& tooth) {
  TissueVolumes volumes;
  volumes.total = volume_mm3(tooth.solid, tooth.lattice.voxel);
  volumes.tissue = remaining_volumes_mm3(tooth);
  return volumes;
}

TissueVolumes minus(TissueVolumes a, const TissueVolumes& b) {
  a.total = std::max(0.0, a.total - b.total);
  for (std::size_t k = 0; k < kTissueCount; ++k)
    a.tissue[k] = std::max(0.0, a.tissue[k] - b.tissue[k]);
  return a;
}

double dice_of(double inside, double removed, double required) {
  const double sum = removed + required;
  return sum > 0 ? 2 * inside / sum : NAN;
}

struct SurfaceBox {
  Eigen::Vector3f low, high;
};
SurfaceBox box_of(const TriangleMesh& surface) {
  SurfaceBox box{surface.vertices.at(0), surface.vertices.at(0)};
  for (const auto& v : surface.vertices) {
    box.low = box.low.cwiseMin(v);
    box.high = box.high.cwiseMax(v);
  }
  return box;
}

std::string place(const SurfaceBox& box) {
  return fmt::format("x {:.1f}..{:.1f}, y {:.1f}..{:.1f}, z {:.1f}..{:.1f} mm",
                     static_cast<double>(box.low.x()), static_cast<double>(box.high.x()),
                     static_cast<double>(box.low.y()), static_cast<double>(box.high.y()),
                     static_cast<double>(box.low.z()), static_cast<double>(box.high.z()));
}

constexpr const char* kRegister = "are they in one frame (try --register), and of the same tooth?";

void check_place(const Solid& original, const Solid& solid, const char* what) {
  const SurfaceBox a = box_of(original.surface), b = box_of(solid.surface);
  if ((a.low.array() > b.high.array()).any() || (b.low.array() > a.high.array()).any())
    throw InputError(solid.file, "",
                     std::string("the ") + what + " lies wholly outside the original tooth: " +
                         place(b) + " against " + place(a) + " in " + original.file,
                     kRegister);
  if (solid.other_anatomy > kOtherAnatomy)
    throw InputError(solid.file, "",
                     fmt::format("{:.0f} % of its tissue labels differ from those of ",
                                 100 * solid.other_anatomy) +
                         original.file + ", so it is another tooth",
                     std::string("give the ") + what + " that was cut from the original");
}

void check_added(const Solid& original, const Solid& solid, const char* what, double deep_mm3,
                 double original_mm3) {
  const double voxel = original.tooth.lattice.voxel;
  const double most = std::max(kMostAdded * original_mm3, 27 * voxel * voxel * voxel);
  const double added = deep_mm3 + solid.beyond_box_mm3;
  if (added > most)
    throw InputError(solid.file, "",
                     fmt::format("{:.3g} mm³ of the {} stand out of the original tooth by more "
                                 "than a voxel ({:.2g} % of the tooth), so it was not cut from ",
                                 added, what, 100 * added / original_mm3) +
                         original.file,
                     kRegister);
}

}  // namespace

VolumeComparison compare_volumes(const Solid& original, const Solid& prepared, const Solid* target,
                                 double noise) {
  check_place(original, prepared, "prepared tooth");
  if (target) check_place(original, *target, "target");
  const Comparison comparison(original.tooth, prepared.tooth, target ? &target->tooth : nullptr,
                              noise);
  const BrickSums sums = comparison.run();
  VolumeComparison result;
  result.original = volumes_of(original.tooth);
  result.prepared = volumes_of(prepared.tooth);
  result.prepared.total += sums[kAtEdges][0];
  result.removed = volumes_of(sums[kRemoved]);
  result.added_mm3 = sums[kAdded][0] + prepared.beyond_box_mm3;

  const double voxel = original.tooth.lattice.voxel, cube = voxel * voxel * voxel;
  check_added(original, prepared, "prepared tooth", sums[kAddedDeep][0], result.original.total);
  if (result.removed.total < kFewestVoxels * cube)
    throw InputError(
        prepared.file, "",
        fmt::format(
            "nothing was removed from the original tooth ({:.2g} mm³, less than {:g} voxels): ",
            result.removed.total, kFewestVoxels) +
            "there is no preparation to score");
  constexpr int kPulp = tissue_index(Tissue::kPulp);
  result.pulp_exposed = result.removed.tissue[kPulp] > cube / 2;
  if (!target) return result;

  result.has_target = true;
  result.required = volumes_of(sums[kRequired]);
  result.over = volumes_of(sums[kOver]);
  result.under = volumes_of(sums[kUnder]);
  check_added(original, *target, "target", sums[kTargetAddedDeep][0], result.original.total);
  if (result.required.total < kFewestVoxels * cube)
    throw InputError(target->file, "",
                     fmt::format("the target removes nothing from the original tooth ({:.2g} mm³, "
                                 "less than {:g} voxels)",
                                 result.required.total, kFewestVoxels),
                     "give the tooth as it should look after the preparation");
  result.inside = minus(result.removed, result.over);
  result.dice = dice_of(result.inside.total, result.removed.total, result.required.total);
  for (std::size_t k = 0; k < kTissueCount; ++k)
    result.tissue_dice[k] =
        dice_of(result.inside.tissue[k], result.removed.tissue[k], result.required.tissue[k]);
  return result;
}

double volume_uncertainty_mm3(double volume_mm3, double voxel) {
  const double edge = std::cbrt(std::max(0.0, volume_mm3));
  return 0.01 * voxel * 6 * edge * edge + voxel * voxel / 12 * 12 * edge +
         0.5 * voxel * voxel * voxel;
}

}  // namespace toothprep
