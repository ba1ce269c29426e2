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

  float operator()(const Vec3& index) const {
    std::array<std::array<double, 4>, 3> weight;
    std::array<int, 3> first;
    bool within = true;
    for (int a = 0; a < 3; ++a) {
      const double x = std::clamp(index[a], 0.0, scan_.size[a] - 1.0);
      const int base = static_cast<int>(x);
      const double f = x - base;
      weight[a] = {((-0.5 * f + 1) * f - 0.5) * f, (1.5 * f - 2.5) * f * f + 1,
                   ((-1.5 * f + 2) * f + 0.5) * f, (0.5 * f - 0.5) * f * f};
      first[a] = base - 1;
      within = within && base > 0 && base + 2 < scan_.size[a];
    }
    const Four of_x = {weight[0][0], weight[0][1], weight[0][2], weight[0][3]},
               of_y = {weight[1][0], weight[1][1], weight[1][2], weight[1][3]};
    double sum = 0;
    for (int k = 0; k < 4; ++k) {
      std::array<Four, 4> row;  // along x
      for (int j = 0; j < 4; ++j)
        row[j] = within ? four_of(first[0], first[1] + j, first[2] + k)
                        : continued(first[0], first[1] + j, first[2] + k);
      const Four lines = {sum_of(of_x * row[0]), sum_of(of_x * row[1]), sum_of(of_x * row[2]),
                          sum_of(of_x * row[3])};
      const Four part = weight[2][k] * of_y * lines;
      for (int j = 0; j < 4; ++j) sum += part[j];
    }
    return static_cast<float>(sum);
  }

 private:
  static double sum_of(const Four& a) { return ((a[0] + a[1]) + a[2]) + a[3]; }
  // Four voxels along x.
  Four four_of(int x, int y, int z) const {
    using Floats = float __attribute__((vector_size(4 * sizeof(float))));
    Floats values;
    std::memcpy(&values,
                scan_.data.data() + static_cast<std::size_t>(z) * stride_[2] +
                    static_cast<std::size_t>(y) * stride_[1] + static_cast<std::size_t>(x),
                sizeof values);
    return __builtin_convertvector(values, Four);
  }
  Four continued(int x, int y, int z) const {
    const auto within = [&](int i, int a) {
      return static_cast<std::size_t>(std::clamp(i, 0, scan_.size[a] - 1));
    };
    const float* row = scan_.data.data() + within(z, 2) * stride_[2] + within(y, 1) * stride_[1];
    return Four{row[within(x, 0)], row[within(x + 1, 0)], row[within(x + 2, 0)],
                row[within(x + 3, 0)]};
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
      for (std::size_t p = range.begin(); p < range.end(); ++p) {
        float* g = profiles.grey.data() + p * static_cast<std::size_t>(profiles.samples);
        for (int s = 0; s < profiles.samples; ++s) {
          const Vec3 at = profiles.voxel[p].cast<double>() +
                          (profiles.zero[p] + profiles.x(s)) * profiles.inwards[p];
          g[s] = cubic(first + to_scan * at * voxel);
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
