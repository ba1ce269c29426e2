#include "toothprep/tools/segmentation/surface_profiles.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <limits>
#include <numeric>
#include <utility>

#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

constexpr double kBefore = 3, kBehind = 5;  // of the profiles, in `blur`
constexpr double kAlong = 1.5;              // radius of the average, in `blur`
constexpr double kSameNormal = 0.9;         // cosine, of places that are averaged

using Four = double __attribute__((vector_size(4 * sizeof(double))));

// Keys' cubic convolution (a = -1/2); the scan's edge values are continued outside.
class Cubic {
 public:
  explicit Cubic(const ImageVolume<float>& scan)
      : scan_(scan),
        stride_{1, static_cast<std::size_t>(scan.size.x()),
                static_cast<std::size_t>(scan.size.x()) * static_cast<std::size_t>(scan.size.y())} {
  }

  // At four places, a lane each.
  std::array<float, 4> operator()(const std::array<Vec3, 4>& index) const {
    std::array<std::array<Four, 4>, 3> weight;
    std::array<Index3, 4> first;
    bool within = true;
    for (int a = 0; a < 3; ++a) {
      Four f;
      for (int n = 0; n < 4; ++n) {
        const double x = std::clamp(index[n][a], 0.0, scan_.size[a] - 1.0);
        const int base = static_cast<int>(x);
        f[n] = x - base;
        first[n][a] = base - 1;
        within = within && base > 0 && base + 2 < scan_.size[a];
      }
      weight[a] = {((-0.5 * f + 1) * f - 0.5) * f, (1.5 * f - 2.5) * f * f + 1,
                   ((-1.5 * f + 2) * f + 0.5) * f, (0.5 * f - 0.5) * f * f};
    }
    std::array<const float*, 4> values;
    if (within) {
      for (int n = 0; n < 4; ++n)
        values[n] = scan_.data.data() + offset(first[n].x(), first[n].y(), first[n].z());
      return sum_of(weight, values, stride_[1], stride_[2]);
    }
    std::array<std::array<float, 64>, 4> continued;
    for (int n = 0; n < 4; ++n) {
      for (int v = 0; v < 64; ++v) {
        const Index3 at =
            (first[n] + Index3(v & 3, v >> 2 & 3, v >> 4)).cwiseMin(scan_.size - Index3::Ones());
        continued[n][v] =
            scan_.data[offset(std::max(0, at.x()), std::max(0, at.y()), std::max(0, at.z()))];
      }
      values[n] = continued[n].data();
    }
    return sum_of(weight, values, 4, 16);
  }

 private:
  std::size_t offset(int x, int y, int z) const {
    return static_cast<std::size_t>(z) * stride_[2] + static_cast<std::size_t>(y) * stride_[1] +
           static_cast<std::size_t>(x);
  }
  // Of each lane's 4 x 4 x 4 values.
  static std::array<float, 4> sum_of(const std::array<std::array<Four, 4>, 3>& weight,
                                     const std::array<const float*, 4>& values, std::size_t row,
                                     std::size_t plane) {
    using Floats = float __attribute__((vector_size(4 * sizeof(float))));
    Four sum{};
    for (std::size_t k = 0; k < 4; ++k)
      for (std::size_t j = 0; j < 4; ++j) {
        const std::size_t o = k * plane + j * row;
        const auto of_x = [&](std::size_t i) {
          const Floats here = {values[0][o + i], values[1][o + i], values[2][o + i],
                               values[3][o + i]};
          return weight[0][i] * __builtin_convertvector(here, Four);
        };
        const Four line = ((of_x(0) + of_x(1)) + of_x(2)) + of_x(3);
        sum += weight[2][k] * weight[1][j] * line;
      }
    return {static_cast<float>(sum[0]), static_cast<float>(sum[1]), static_cast<float>(sum[2]),
            static_cast<float>(sum[3])};
  }

  const ImageVolume<float>& scan_;
  std::array<std::size_t, 3> stride_;
};

// Where the grey first exceeds `border` on the way inwards, from the voxel's centre.
std::optional<double> crossing(const WorkBox& box, const TrimmedField& grey, const Vec3& at,
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

void find_places(const WorkBox& box, const TrimmedField& grey, const SurfaceDepth& depth,
                 const BandField& level, double border, double blur, SurfaceProfiles& profiles) {
  struct Place {
    Index3 voxel;
    Vec3 inwards;
    double zero;
  };
  const auto ny = static_cast<std::size_t>(box.size.y()),
             nz = static_cast<std::size_t>(box.size.z());
  const auto on_surface = [&](std::size_t v) { return depth[v] >= 0 && depth[v] < 1; };
  std::vector<std::size_t> most(nz);  // of each plane's places
  tbb::parallel_for(std::size_t{0}, nz, [&](std::size_t k) {
    level.for_each(box.offset(0, 0, static_cast<int>(k)), box.offset(0, 0, static_cast<int>(k) + 1),
                   [&](std::size_t v) { most[k] += on_surface(v); });
  });
  const std::size_t count = std::accumulate(most.begin(), most.end(), std::size_t{0});
  profiles.voxel.reserve(count);
  profiles.inwards.reserve(count);
  profiles.zero.reserve(count);
  profiles.size = box.size;
  profiles.row_end.assign(nz * ny, 0);
  // Some planes at a time, so that no place is long there twice.
  constexpr std::size_t kAtOnce = 16;
  std::array<std::vector<Place>, kAtOnce> planes;
  for (std::size_t first = 0; first < nz; first += kAtOnce) {
    const std::size_t end = std::min(nz, first + kAtOnce);
    tbb::parallel_for(first, end, [&](std::size_t k) {
      std::vector<Place>& plane = planes[k - first];
      plane.clear();
      for (std::size_t j = 0; j < ny; ++j) {
        const std::size_t row = (k * ny + j) * static_cast<std::size_t>(box.size.x());
        level.for_each(row, row + static_cast<std::size_t>(box.size.x()), [&](std::size_t v) {
          if (!on_surface(v)) return;
          const Index3 index(static_cast<int>(v - row), static_cast<int>(j), static_cast<int>(k));
          const Vec3 inwards = inwards_at(box, level, index);
          if (inwards.isZero()) return;
          const auto zero = crossing(box, grey, index.cast<double>(), inwards, border, 1 + blur);
          if (zero) plane.push_back({index, inwards, *zero});
        });
        profiles.row_end[k * ny + j] = static_cast<std::uint32_t>(plane.size());
      }
    });
    for (std::size_t k = first; k < end; ++k) {
      for (std::size_t j = 0; j < ny; ++j)
        profiles.row_end[k * ny + j] += static_cast<std::uint32_t>(profiles.count());
      for (const Place& place : planes[k - first]) {
        profiles.voxel.push_back(place.voxel);
        profiles.inwards.push_back(place.inwards);
        profiles.zero.push_back(place.zero);
      }
    }
  }
}

// Means of profiles over the places in the ball around each whose normal is about the same, for all in a
// block of voxels: who is beside whom is asked of those around the block, four at a time, and a mean comes
// from the one before by what is different. In double precision sums of greys are exact, for all that
// matters in single precision.
class AlongSurface {
 public:
  static constexpr int kBlock = 4;  // voxels along an edge

  AlongSurface(const SurfaceProfiles& profiles, double radius)
      : profiles_(profiles),
        radius_(radius),
        reach_(static_cast<int>(radius)),
        sum_(static_cast<std::size_t>(profiles.samples)) {}

  // Of the places in kBlock x kBlock rows from y and z on, in the planes before `z_end`; those of place p
  // go to means + (p - first) * samples.
  void means_of(int y, int z, int z_end, std::size_t first, float* means) {
    own_.clear();
    around_.clear();
    z_end = std::min(z_end, z + kBlock);
    for (int k = z - reach_; k < z_end + reach_; ++k)
      for (int j = y - reach_; j < y + kBlock + reach_; ++j) {
        const auto [next, end] = profiles_.row(j, k);
        if (next == end) continue;
        around_.push_back({next, end});
        if (k >= z && k < z_end && j >= y && j < y + kBlock) own_.push_back({next, end});
      }
    const auto x_of = [&](std::size_t p) { return profiles_.voxel[p].x(); };
    for (;;) {
      int x = std::numeric_limits<int>::max();
      for (const Row& row : own_)
        if (row.next < row.end) x = std::min(x, x_of(row.next));
      if (x == std::numeric_limits<int>::max()) return;
      gather(x - reach_, x + kBlock + reach_);
      for (Row& row : own_)
        for (; row.next < row.end && x_of(row.next) < x + kBlock; ++row.next)
          mean_of(row.next,
                  means + (row.next - first) * static_cast<std::size_t>(profiles_.samples));
    }
  }

 private:
  struct Row {
    std::size_t next, end;
  };
  struct Word {  // 64 places, as bits
    std::array<std::array<double, 64>, 3> at, inwards;
    std::array<std::size_t, 64> place;
    std::uint64_t summed;
  };

  // The places around from x = low to high - 1.
  void gather(int low, int high) {
    words_.clear();
    std::size_t count = 0;
    for (Row& row : around_) {
      while (row.next < row.end && profiles_.voxel[row.next].x() < low) ++row.next;
      for (std::size_t p = row.next; p < row.end && profiles_.voxel[p].x() < high; ++p, ++count) {
        const std::size_t n = count % 64;
        if (n == 0) {
          words_.emplace_back();
          words_.back().at[0].fill(std::numeric_limits<double>::infinity());  // nowhere
        }
        Word& word = words_.back();
        for (int a = 0; a < 3; ++a) {
          word.at[a][n] = profiles_.voxel[p][a];
          word.inwards[a][n] = profiles_.inwards[p][a];
        }
        word.place[n] = p;
      }
    }
    std::fill(sum_.begin(), sum_.end(), 0.0);
  }

  std::uint64_t beside(const Word& word, const Vec3& at, const Vec3& inwards) const {
    using Bits = decltype(Four{} < Four{});
    Bits bits{}, bit = {1, 2, 4, 8};
    const auto four = [](const double* values) {
      Four lanes;
      std::memcpy(&lanes, values, sizeof lanes);
      return lanes;
    };
    for (std::size_t n = 0; n < 64; n += 4, bit <<= 4) {
      const Four x = four(&word.at[0][n]) - at.x(), y = four(&word.at[1][n]) - at.y(),
                 z = four(&word.at[2][n]) - at.z();
      const Four cosine = four(&word.inwards[0][n]) * inwards.x() +
                          four(&word.inwards[1][n]) * inwards.y() +
                          four(&word.inwards[2][n]) * inwards.z();
      bits |= (x * x + y * y + z * z <= radius_ * radius_) & (cosine >= kSameNormal) & bit;
    }
    return static_cast<std::uint64_t>(bits[0] | bits[1] | bits[2] | bits[3]);
  }

  void mean_of(std::size_t p, float* mean) {
    const Vec3 at = profiles_.voxel[p].cast<double>(), inwards = profiles_.inwards[p];
    beside_.clear();
    int count = 0, changes = 0;
    for (const Word& word : words_) {
      beside_.push_back(beside(word, at, inwards));
      count += __builtin_popcountll(beside_.back());
      changes += __builtin_popcountll(beside_.back() ^ word.summed);
    }
    const bool anew = changes > count;
    if (anew) std::fill(sum_.begin(), sum_.end(), 0.0);
    const auto samples = static_cast<std::size_t>(profiles_.samples);
    double* sum = sum_.data();
    for (std::size_t w = 0; w < words_.size(); ++w) {
      Word& word = words_[w];
      for (std::uint64_t change = beside_[w] ^ (anew ? 0 : word.summed); change != 0;
           change &= change - 1) {
        const int n = __builtin_ctzll(change);
        const double sign = beside_[w] >> n & 1 ? 1 : -1;
        const float* grey = profiles_.of(word.place[static_cast<std::size_t>(n)]);
        for (std::size_t s = 0; s < samples; ++s) sum[s] += sign * grey[s];
      }
      word.summed = beside_[w];
    }
    for (std::size_t s = 0; s < samples; ++s) mean[s] = static_cast<float>(sum[s] / count);
  }

  const SurfaceProfiles& profiles_;
  double radius_;
  int reach_;
  std::vector<Row> own_, around_;
  std::vector<Word> words_;
  std::vector<std::uint64_t> beside_;  // of each word, who is beside the place
  std::vector<double> sum_;            // of those that the words call summed
};

// Some planes' places at a time; their means take the profiles' place when no other plane needs these.
void average_along(double blur, SurfaceProfiles& profiles) {
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
    constexpr int kBlock = AlongSurface::kBlock;
    tbb::parallel_for(0, (end - plane + kBlock - 1) / kBlock, [&](int layer) {
      AlongSurface along(profiles, kAlong * blur);
      with_wide_vectors([&] {
        for (int y = 0; y < profiles.size.y(); y += kBlock)
          along.means_of(y, plane + layer * kBlock, end, first, means.values.data());
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
  BandField level(depth.chunks_where([&](float d) { return d > -outside - 1 && d < inside + 1; }));
  const auto fill = [&](int k, float* plane) {
    const std::size_t first = box.offset(0, 0, k), area = box.offset(0, 0, 1);
    for (std::size_t v = 0; v < area; ++v) plane[v] = std::clamp(depth[first + v], -far, far);
  };
  smooth_where(box.size, std::max(1.0, 0.5 * blur), level, fill,
               [&](std::size_t v, float value) { level[v] = value; });
  return level;
}

Vec3 inwards_at(const WorkBox& box, const BandField& level, const Index3& index) {
  const std::size_t v = box.offset(index.x(), index.y(), index.z());
  const std::array<std::size_t, 3> stride = {1, box.offset(0, 1, 0), box.offset(0, 0, 1)};
  Vec3 inwards;
  for (int a = 0; a < 3; ++a)
    inwards[a] = level[index[a] + 1 < box.size[a] ? v + stride[a] : v] -
                 level[index[a] > 0 ? v - stride[a] : v];
  if (inwards.squaredNorm() > 0) inwards.normalize();
  return inwards;
}

double SurfaceProfiles::mean(std::size_t p, double from, double to) const {
  double sum = 0;
  int count = 0, s = std::max(0, before + static_cast<int>(from / step) - 2);
  while (s < samples && x(s) < from - 1e-9) ++s;
  for (; s < samples && x(s) <= to + 1e-9; ++s, ++count) sum += of(p)[s];
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
                                 const TrimmedField& grey, const SurfaceDepth& depth,
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
  const Cubic cubic(scan);
  const double voxel = box.lattice.voxel;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, profiles.count()), [&](const auto& range) {
    with_wide_vectors([&] {
      std::array<Vec3, 4> at;
      for (std::size_t p = range.begin(); p < range.end(); ++p) {
        float* g = profiles.grey.data() + p * static_cast<std::size_t>(profiles.samples);
        for (int s = 0; s < profiles.samples; s += 4) {
          const int count = std::min(4, profiles.samples - s);
          for (int n = 0; n < 4; ++n) {
            const double x = profiles.x(s + std::min(n, count - 1));
            at[n] = first + to_scan *
                                (profiles.voxel[p].cast<double>() +
                                 (profiles.zero[p] + x) * profiles.inwards[p]) *
                                voxel;
          }
          std::copy_n(cubic(at).data(), count, g + s);
        }
      }
    });
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
