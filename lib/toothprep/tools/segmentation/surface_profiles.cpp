#include "toothprep/tools/segmentation/surface_profiles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kBefore = 3, kBehind = 5;  // of the profiles, in `blur`
constexpr double kAlong = 1.5;              // radius of the average, in `blur`
constexpr double kSameNormal = 0.9;         // cosine, of places that are averaged

// Keys' cubic convolution (a = -1/2); the scan's edge values are continued outside.
float cubic(const ImageVolume<float>& scan, const Vec3& index) {
  std::array<std::array<double, 4>, 3> weight;
  std::array<std::array<std::size_t, 4>, 3> offset;
  const std::array<std::size_t, 3> stride = {
      1, static_cast<std::size_t>(scan.size.x()),
      static_cast<std::size_t>(scan.size.x()) * static_cast<std::size_t>(scan.size.y())};
  for (int a = 0; a < 3; ++a) {
    const double x = std::clamp(index[a], 0.0, scan.size[a] - 1.0);
    const int base = static_cast<int>(x);
    const double f = x - base;
    weight[a] = {((-0.5 * f + 1) * f - 0.5) * f, (1.5 * f - 2.5) * f * f + 1,
                 ((-1.5 * f + 2) * f + 0.5) * f, (0.5 * f - 0.5) * f * f};
    for (int n = 0; n < 4; ++n)
      offset[a][n] =
          stride[a] * static_cast<std::size_t>(std::clamp(base + n - 1, 0, scan.size[a] - 1));
  }
  double sum = 0;
  for (int k = 0; k < 4; ++k)
    for (int j = 0; j < 4; ++j) {
      const float* row = scan.data.data() + offset[2][k] + offset[1][j];
      double line = 0;
      for (int i = 0; i < 4; ++i) line += weight[0][i] * row[offset[0][i]];
      sum += weight[2][k] * weight[1][j] * line;
    }
  return static_cast<float>(sum);
}

// Where the grey first exceeds `border` on the way inwards, from the voxel's centre.
std::optional<double> crossing(const WorkBox& box, const Field& grey, const Vec3& at,
                               const Vec3& inwards, double border, double reach) {
  constexpr double kStep = 0.5;
  double last = trilinear(box.size, grey, at - reach * inwards);
  if (last >= border) return {};
  for (double s = -reach + kStep; s <= reach; s += kStep) {
    const double here = trilinear(box.size, grey, at + s * inwards);
    if (here >= border) return s - kStep * (here - border) / (here - last);
    last = here;
  }
  return {};
}

void find_places(const WorkBox& box, const Field& grey, const Field& depth, const Field& level,
                 double border, double blur, SurfaceProfiles& profiles) {
  profiles.place.assign(box.voxels(), -1);
  std::size_t v = 0;
  for (int k = 0; k < box.size.z(); ++k)
    for (int j = 0; j < box.size.y(); ++j)
      for (int i = 0; i < box.size.x(); ++i, ++v) {
        if (!(depth[v] >= 0 && depth[v] < 1)) continue;
        const Index3 index(i, j, k);
        const Vec3 inwards = inwards_at(box, level, index);
        if (inwards.isZero()) continue;
        const auto zero = crossing(box, grey, index.cast<double>(), inwards, border, 1 + blur);
        if (!zero) continue;
        profiles.place[v] = static_cast<std::int32_t>(profiles.voxel.size());
        profiles.voxel.push_back(index);
        profiles.inwards.push_back(inwards);
        profiles.zero.push_back(*zero);
      }
}

std::vector<Index3> ball(double radius) {
  const int r = static_cast<int>(radius);
  std::vector<Index3> offsets;
  for (int k = -r; k <= r; ++k)
    for (int j = -r; j <= r; ++j)
      for (int i = -r; i <= r; ++i)
        if (i * i + j * j + k * k <= radius * radius) offsets.emplace_back(i, j, k);
  return offsets;
}

void average_along(const WorkBox& box, double blur, SurfaceProfiles& profiles) {
  const std::vector<Index3> near = ball(kAlong * blur);
  const auto samples = static_cast<std::size_t>(profiles.samples);
  std::vector<float> mean(profiles.grey.size());
  tbb::parallel_for(std::size_t{0}, profiles.count(), [&](std::size_t p) {
    std::vector<double> sum(samples);
    double weight = 0;
    for (const Index3& offset : near) {
      const Index3 at = profiles.voxel[p] + offset;
      if (at.minCoeff() < 0 || (box.size - at).minCoeff() <= 0) continue;
      const std::int32_t q = profiles.place[box.offset(at.x(), at.y(), at.z())];
      if (q < 0) continue;
      const auto other = static_cast<std::size_t>(q);
      if (profiles.inwards[p].dot(profiles.inwards[other]) < kSameNormal) continue;
      const float* grey = profiles.of(other);
      for (std::size_t s = 0; s < samples; ++s) sum[s] += grey[s];
      weight += 1;
    }
    for (std::size_t s = 0; s < samples; ++s)
      mean[p * samples + s] = static_cast<float>(sum[s] / weight);
  });
  profiles.grey.swap(mean);
}

}  // namespace

Field inward_level(const WorkBox& box, const Field& depth, double reach, double blur) {
  Field level(box.voxels());
  const auto far = static_cast<float>(reach + 2 * blur);
  for (std::size_t v = 0; v < level.size(); ++v) level[v] = std::clamp(depth[v], -far, far);
  smooth(box.size, level, std::max(1.0, 0.5 * blur));
  return level;
}

Vec3 inwards_at(const WorkBox& box, const Field& level, const Index3& index) {
  Vec3 inwards;
  for (int a = 0; a < 3; ++a) {
    Index3 p = index, q = index;
    p[a] = std::max(p[a] - 1, 0);
    q[a] = std::min(q[a] + 1, box.size[a] - 1);
    inwards[a] = level[box.offset(q.x(), q.y(), q.z())] - level[box.offset(p.x(), p.y(), p.z())];
  }
  if (inwards.squaredNorm() > 0) inwards.normalize();
  return inwards;
}

double SurfaceProfiles::mean(std::size_t p, double from, double to) const {
  double sum = 0;
  int count = 0;
  for (int s = 0; s < samples; ++s)
    if (x(s) >= from - 1e-9 && x(s) <= to + 1e-9) sum += of(p)[s], ++count;
  return sum / count;
}

std::optional<double> SurfaceProfiles::first_above(std::size_t p, double border) const {
  const float* g = of(p);
  for (int s = 1; s < samples; ++s)
    if (g[s] >= border && g[s - 1] < border)
      return x(s) - step * (g[s] - border) / (g[s] - g[s - 1]);
  return {};
}

SurfaceProfiles surface_profiles(const WorkBox& box, const ImageVolume<float>& scan,
                                 const Field& grey, const Field& depth, const Field& level,
                                 double border, double blur) {
  SurfaceProfiles profiles;
  profiles.step = 0.25 * blur;
  profiles.before = static_cast<int>(kBefore / 0.25);
  profiles.samples = profiles.before + static_cast<int>(kBehind / 0.25) + 1;
  find_places(box, grey, depth, level, border, blur, profiles);
  profiles.grey.resize(profiles.count() * static_cast<std::size_t>(profiles.samples));
  // From the box's lattice to the scan's.
  const Mat3 to_scan = scan.to_index();
  const Vec3 first = to_scan * (box.centre(Index3::Zero()) - scan.origin);
  tbb::parallel_for(std::size_t{0}, profiles.count(), [&](std::size_t p) {
    float* g = profiles.grey.data() + p * static_cast<std::size_t>(profiles.samples);
    for (int s = 0; s < profiles.samples; ++s) {
      const Vec3 at = profiles.voxel[p].cast<double>() +
                      (profiles.zero[p] + profiles.x(s)) * profiles.inwards[p];
      g[s] = cubic(scan, first + to_scan * at * box.lattice.voxel);
    }
  });
  average_along(box, blur, profiles);
  return profiles;
}

std::optional<double> edge_sigma(const SurfaceProfiles& profiles, const GreyClasses& classes,
                                 double blur) {
  constexpr std::size_t kFewest = 50;
  constexpr double kFlat = 0.15;  // of the step from dentin to enamel
  const double flat = kFlat * (classes.enamel - classes.dentin);
  std::vector<double> sigmas;
  for (std::size_t p = 0; p < profiles.count(); ++p) {
    const double outside = profiles.mean(p, -3 * blur, -2 * blur),
                 below = profiles.mean(p, 1.5 * blur, 2.5 * blur),
                 deeper = profiles.mean(p, 3 * blur, 4 * blur);
    if (std::abs(deeper - below) > flat || below < classes.dentin - flat ||
        below > classes.enamel + flat || std::abs(outside - classes.surroundings) > 2 * flat)
      continue;
    const double plateau = 0.5 * (below + deeper);
    const auto low = profiles.first_above(p, outside + 0.25 * (plateau - outside)),
               high = profiles.first_above(p, outside + 0.75 * (plateau - outside));
    if (low && high && *high > *low) sigmas.push_back((*high - *low) / 1.349);
  }
  if (sigmas.size() < kFewest) return {};
  const auto middle = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 2);
  std::nth_element(sigmas.begin(), middle, sigmas.end());
  return *middle;
}

}  // namespace toothprep
