#include "toothprep/tools/mesh/tissue_levels.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <vector>

namespace toothprep {
namespace {

constexpr int kGrids = 3;  // tissues with a level set of their own
constexpr int kOther = tissue_index(Tissue::kOther);
constexpr int kReach = 2;  // voxels
constexpr std::size_t kFewest =
    8;  // of these voxels; else, as in a sharp wedge, those farther away
constexpr int kFarReach = 4;
constexpr double kRidge = 1e-3;  // keeps the fit's slope small where voxels leave it open

struct Remains {  // at a voxel inside of the solid
  Vec3 offset;
  double weight = 0;
  std::array<double, kGrids> level{};  // voxels
  int home = kOther;
};

Remains remains_at(const LayeredTooth& tooth, const Index3& i) {
  Remains r;
  for (int k = 0; k < kGrids; ++k)
    r.level[k] =
        static_cast<double>(tooth.remains[k].value(i.x(), i.y(), i.z())) / tooth.lattice.voxel;
  const auto least = std::min_element(r.level.begin(), r.level.end());
  constexpr double kFarthestHome = 0.5;
  if (*least < kFarthestHome &&
      tooth.tissue.value(i.x(), i.y(), i.z()) != static_cast<std::uint8_t>(Tissue::kOther))
    r.home = static_cast<int>(least - r.level.begin());
  return r;
}

// The distances that the voxel knows. `other` has no level set: it is where none of the others is.
TissueDistances distances_of(const Remains& r, bool any_other) {
  TissueDistances d{};
  std::copy(r.level.begin(), r.level.end(), d.begin());
  if (r.home == kOther) {
    d[kOther] = -*std::min_element(r.level.begin(), r.level.end());
    return d;
  }
  double next = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kGrids; ++k)
    if (k != r.home) next = std::min(next, r.level[k]);
  d[kOther] = kBandVoxels;
  if (any_other) d[kOther] = -r.level[r.home];
  if (next > 0 && r.level[r.home] < 0)
    d[r.home] = any_other ? std::max(-next, r.level[r.home]) : -next;
  return d;
}

// The voxels inside of the solid nearer than `reach` voxels.
std::vector<Remains> voxels_near(const LayeredTooth& tooth, const Vec3& at, int reach) {
  std::vector<Remains> near;
  const Index3 base = at.array().floor().cast<int>() - (reach - 1);
  near.reserve(64);
  for (int x = 0; x < 2 * reach; ++x)
    for (int y = 0; y < 2 * reach; ++y)
      for (int z = 0; z < 2 * reach; ++z) {
        const Index3 i = base + Index3(x, y, z);
        const Vec3 offset = i.cast<double>() - at;
        const double left = 1 - offset.squaredNorm() / (reach * reach);
        if (left <= 0 || tooth.solid.value(i.x(), i.y(), i.z()) >= 0) continue;
        near.push_back(remains_at(tooth, i));
        near.back().offset = offset;
        near.back().weight = left * left;
      }
  return near;
}

}  // namespace

std::optional<TissueDistances> tissue_distances(const LayeredTooth& tooth, const Vec3& at) {
  std::vector<Remains> near = voxels_near(tooth, at, kReach);
  if (near.size() < kFewest) near = voxels_near(tooth, at, kFarReach);
  if (near.empty()) return std::nullopt;
  const bool any_other =
      std::any_of(near.begin(), near.end(), [](const Remains& r) { return r.home == kOther; });
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Matrix4d right = Eigen::Matrix4d::Zero();  // a column per tissue
  for (const Remains& r : near) {
    const TissueDistances d = distances_of(r, any_other);
    const Eigen::Vector4d row(1, r.offset.x(), r.offset.y(), r.offset.z());
    normal += r.weight * row * row.transpose();
    right += r.weight * row * Eigen::RowVector4d(d[0], d[1], d[2], d[3]);
  }
  for (int k = 1; k < 4; ++k) normal(k, k) += kRidge * normal(0, 0);
  const Eigen::RowVector4d fit = normal.ldlt().solve(right).row(0);
  return TissueDistances{fit[0], fit[1], fit[2], fit[3]};
}

Tissue nearest_tissue(const TissueDistances& distances) {
  return tissue_at(
      static_cast<int>(std::min_element(distances.begin(), distances.end()) - distances.begin()));
}

Tissue tissue_near(const LayeredTooth& tooth, const Vec3& at) {
  const Index3 base = at.array().floor().cast<int>();
  int first = -1;
  bool same = true;
  for (int n = 0; n < 8; ++n) {
    const Index3 i = base + Index3(n & 1, n >> 1 & 1, n >> 2);
    if (tooth.solid.value(i.x(), i.y(), i.z()) >= 0) continue;
    const int home = remains_at(tooth, i).home;
    if (first < 0) first = home;
    same = same && home == first;
  }
  if (same && first >= 0) return tissue_at(first);
  if (const auto distances = tissue_distances(tooth, at)) return nearest_tissue(*distances);
  const Index3 i = at.array().round().cast<int>();
  const std::uint8_t label = tooth.tissue.value(i.x(), i.y(), i.z());
  return label == 0 ? Tissue::kOther : static_cast<Tissue>(label);
}

}  // namespace toothprep
