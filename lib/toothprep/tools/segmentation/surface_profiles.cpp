#include "toothprep/tools/segmentation/surface_profiles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <utility>

#include "toothprep/tools/segmentation/wide_vectors.h"

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

void find_places(const WorkBox& box, const Field& grey, const SurfaceDepth& depth,
                 const BandField& level, double border, double blur, SurfaceProfiles& profiles) {
  struct Place {
    Index3 voxel;
    Vec3 inwards;
    double zero;
  };
  const auto ny = static_cast<std::size_t>(box.size.y());
  std::vector<std::vector<Place>> planes(static_cast<std::size_t>(box.size.z()));
  profiles.size = box.size;
  profiles.row_end.assign(planes.size() * ny, 0);
  tbb::parallel_for(0, box.size.z(), [&](int k) {
    std::vector<Place>& plane = planes[static_cast<std::size_t>(k)];
    std::size_t v = box.offset(0, 0, k);
    for (int j = 0; j < box.size.y(); ++j) {
      for (int i = 0; i < box.size.x(); ++i, ++v) {
        if (!(depth[v] >= 0 && depth[v] < 1)) continue;
        const Index3 index(i, j, k);
        const Vec3 inwards = inwards_at(box, level, index);
        if (inwards.isZero()) continue;
        const auto zero = crossing(box, grey, index.cast<double>(), inwards, border, 1 + blur);
        if (zero) plane.push_back({index, inwards, *zero});
      }
      profiles.row_end[static_cast<std::size_t>(k) * ny + static_cast<std::size_t>(j)] =
          static_cast<std::uint32_t>(plane.size());
    }
  });
  for (std::size_t k = 0; k < planes.size(); ++k) {
    for (std::size_t j = 0; j < ny; ++j)
      profiles.row_end[k * ny + j] += static_cast<std::uint32_t>(profiles.count());
    for (const Place& place : planes[k]) {
      profiles.voxel.push_back(place.voxel);
      profiles.inwards.push_back(place.inwards);
      profiles.zero.push_back(place.zero);
    }
  }
}

struct BallRow {  // of voxels around a centre, along x
  int y, z, half;
};

std::vector<BallRow> ball(double radius) {
  const int r = static_cast<int>(radius);
  std::vector<BallRow> rows;
  for (int z = -r; z <= r; ++z)
    for (int y = -r; y <= r; ++y) {
      int half = r;
      while (half >= 0 && half * half + y * y + z * z > radius * radius) --half;
      if (half >= 0) rows.push_back({y, z, half});
    }
  return rows;
}

// The places in the ball around a place whose normal is about the same. One place after another along
// a row, so that each of the ball's rows is walked once.
class SameNormal {
 public:
  SameNormal(const SurfaceProfiles& profiles, const std::vector<BallRow>& ball)
      : profiles_(profiles), ball_(ball), rows_(ball.size()) {}

  const std::vector<std::size_t>& around(std::size_t p) {
    const Index3 at = profiles_.voxel[p];
    if (at.y() != y_ || at.z() != z_) enter_row(at.y(), at.z());
    found_.clear();
    for (std::size_t n = 0; n < ball_.size(); ++n) {
      Walk& row = rows_[n];
      while (row.next < row.end && profiles_.voxel[row.next].x() < at.x() - ball_[n].half)
        ++row.next;
      for (std::size_t other = row.next;
           other < row.end && profiles_.voxel[other].x() <= at.x() + ball_[n].half; ++other)
        if (profiles_.inwards[p].dot(profiles_.inwards[other]) >= kSameNormal)
          found_.push_back(other);
    }
    return found_;
  }

 private:
  struct Walk {
    std::size_t next = 0, end = 0;
  };
  void enter_row(int y, int z) {
    y_ = y, z_ = z;
    for (std::size_t n = 0; n < ball_.size(); ++n) {
      const auto [first, end] = profiles_.row(y + ball_[n].y, z + ball_[n].z);
      rows_[n] = {first, end};
    }
  }

  const SurfaceProfiles& profiles_;
  const std::vector<BallRow>& ball_;
  std::vector<Walk> rows_;
  std::vector<std::size_t> found_;
  int y_ = -1, z_ = -1;
};

// The mean of some profiles. Some samples of all of them at a time, whose sums stay in registers.
void mean_of(const SurfaceProfiles& profiles, const std::vector<std::size_t>& some, float* mean) {
  constexpr int kAtOnce = 16;
  const auto count = static_cast<double>(some.size());
  int s = 0;
  for (; s + kAtOnce <= profiles.samples; s += kAtOnce) {
    std::array<double, kAtOnce> sum{};
    for (const std::size_t p : some) {
      const float* grey = profiles.of(p) + s;
      for (int n = 0; n < kAtOnce; ++n) sum[n] += grey[n];
    }
    for (int n = 0; n < kAtOnce; ++n) mean[s + n] = static_cast<float>(sum[n] / count);
  }
  for (; s < profiles.samples; ++s) {
    double sum = 0;
    for (const std::size_t p : some) sum += profiles.of(p)[s];
    mean[s] = static_cast<float>(sum / count);
  }
}

// Some planes' places at a time; their means take the profiles' place when no other plane needs these.
void average_along(double blur, SurfaceProfiles& profiles) {
  const std::vector<BallRow> near = ball(kAlong * blur);
  const auto samples = static_cast<std::size_t>(profiles.samples);
  const auto ny = static_cast<std::size_t>(profiles.size.y());
  const int reach = static_cast<int>(kAlong * blur);
  const auto places_before = [&](int plane) {
    return plane == 0 ? std::size_t{0}
                      : std::size_t{profiles.row_end[static_cast<std::size_t>(plane) * ny - 1]};
  };
  struct Means {
    int end;  // plane
    std::size_t first;
    std::vector<float> values;
  };
  std::deque<Means> waiting;
  const auto take_over = [&](int plane) {
    for (; !waiting.empty() && waiting.front().end + reach <= plane; waiting.pop_front())
      std::copy(
          waiting.front().values.begin(), waiting.front().values.end(),
          profiles.grey.begin() + static_cast<std::ptrdiff_t>(waiting.front().first * samples));
  };
  constexpr int kAtOnce = 16;
  for (int plane = 0; plane < profiles.size.z(); plane += kAtOnce) {
    const int end = std::min(profiles.size.z(), plane + kAtOnce);
    const std::size_t first = places_before(plane), last = places_before(end);
    Means means{end, first, std::vector<float>((last - first) * samples)};
    tbb::parallel_for(plane, end, [&](int k) {
      SameNormal same(profiles, near);
      with_wide_vectors([&] {
        for (std::size_t p = places_before(k); p < places_before(k + 1); ++p)
          mean_of(profiles, same.around(p), means.values.data() + (p - first) * samples);
      });
    });
    waiting.push_back(std::move(means));
    take_over(end);
  }
  take_over(profiles.size.z() + reach);
}

}  // namespace

BandField inward_level(const WorkBox& box, const SurfaceDepth& depth, double outside, double inside,
                       double blur) {
  const auto far = static_cast<float>(std::max(outside, inside) + 2 * blur);
  // With the neighbours that its gradient is from: none is deeper by more than one.
  BandField level(chunks_where(box.voxels(), [&](std::size_t v) {
    return depth[v] > -outside - 1 && depth[v] < inside + 1;
  }));
  const auto fill = [&](int k, float* plane) {
    const std::size_t first = box.offset(0, 0, k), area = box.offset(0, 0, 1);
    for (std::size_t v = 0; v < area; ++v) plane[v] = std::clamp(depth[first + v], -far, far);
  };
  smooth_where(box.size, std::max(1.0, 0.5 * blur), level, fill,
               [&](std::size_t v, float value) { level[v] = value; });
  return level;
}

Vec3 inwards_at(const WorkBox& box, const BandField& level, const Index3& index) {
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
                                 const Field& grey, const SurfaceDepth& depth,
                                 const BandField& level, double border, double blur) {
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
  average_along(blur, profiles);
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
