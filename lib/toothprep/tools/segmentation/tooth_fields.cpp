#include "toothprep/tools/segmentation/tooth_fields.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <mutex>

#include "toothprep/tools/segmentation/iso_distance.h"
#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {

float signed_as(bool positive, float value) {
  constexpr float kTiny = 0.01f;
  return positive ? std::max(value, kTiny) : std::min(value, -kTiny);
}

namespace {

// How a value at a place comes from those of the fields' voxels along an axis, from `first` on: the one there, or four
// by Keys' cubic convolution (a = -1/2). Linear ones would make what is round thinner.
struct Weights {
  int first = 0;
  std::array<float, 4> of{};
};

// For a number of the tooth's voxels, as many as there are in whole bricks.
std::vector<Weights> weights_along(int axis, const WorkBox& fields, const Lattice& tooth, int from,
                                   int count, int taps) {
  std::vector<Weights> weights;
  for (int i = from; i < from + count; ++i) {
    const double at =
        fields.lattice.to_index(tooth.to_world(Index3::Constant(i)))[axis] - fields.lower[axis];
    // Beyond the fields' box it is air, as at its border.
    if (taps == 1) {
      const double nearest = std::clamp(std::round(at), 0.0, fields.size[axis] - 1.0);
      weights.push_back({static_cast<int>(nearest), {1}});
    } else {
      const double within = std::clamp(at, 1.0, fields.size[axis] - 2.5);
      const int base = static_cast<int>(within);
      const auto f = static_cast<float>(within - base);
      weights.push_back({base - 1,
                         {((-0.5f * f + 1) * f - 0.5f) * f, (1.5f * f - 2.5f) * f * f + 1,
                          ((-1.5f * f + 2) * f + 0.5f) * f, (0.5f * f - 0.5f) * f * f}});
    }
  }
  return weights;
}

// Of a brick's voxels along an axis.
using EdgeWeights = std::array<Weights, kBrickEdge>;

// Values of a brick's voxels from those of the fields' voxels, of which `values` is the first that counts. False, and
// only the first one set, where all are the same: as they are far from this surface.
template <int kTaps>
bool interpolate(const float* values, std::size_t row, std::size_t plane,
                 const std::array<EdgeWeights, 3>& weights, float* brick) {
  constexpr int kMost = kBrickEdge + kTaps - 1;  // of the fields' voxels, which are not smaller
  std::array<std::array<std::array<float, kBrickEdge>, kMost>, kMost> of_x;  // by plane, row
  std::array<std::array<std::array<float, kBrickEdge>, kBrickEdge>, kMost> of_xy;
  const auto first = [&](int axis, int n) {
    return weights[axis][n].first - weights[axis].front().first;
  };
  const auto size = [&](int axis) { return first(axis, kBrickEdge - 1) + kTaps; };
  const auto line = [&](int j, int k) {
    return values + static_cast<std::size_t>(k) * plane + static_cast<std::size_t>(j) * row;
  };
  const auto is_same = [&](int j, int k) {
    const float* of = line(j, k);
    bool same = true;
    for (int i = 0; i < size(0); ++i) same &= of[i] == values[0];
    return same;
  };
  bool same = true;
  for (int k = 0; k < size(2) && same; ++k)
    for (int j = 0; j < size(1) && same; ++j) same = is_same(j, k);
  brick[0] = values[0];
  if (same) return false;
  const auto sum = [](const Weights& by, const auto& value) {
    float all = by.of[0] * value(0);
    for (int t = 1; t < kTaps; ++t) all += by.of[static_cast<std::size_t>(t)] * value(t);
    return all;
  };
  for (int k = 0; k < size(2); ++k)
    for (int j = 0; j < size(1); ++j)
      for (int x = 0; x < kBrickEdge; ++x)
        of_x[k][j][x] = sum(weights[0][x], [&](int t) { return line(j, k)[first(0, x) + t]; });
  for (int k = 0; k < size(2); ++k)
    for (int y = 0; y < kBrickEdge; ++y)
      for (int x = 0; x < kBrickEdge; ++x)
        of_xy[k][y][x] = sum(weights[1][y], [&](int t) { return of_x[k][first(1, y) + t][x]; });
  for (int z = 0; z < kBrickEdge; ++z)
    for (int y = 0; y < kBrickEdge; ++y)
      for (int x = 0; x < kBrickEdge; ++x)
        brick[x << 6 | y << 3 | z] =
            sum(weights[2][z], [&](int t) { return of_xy[first(2, z) + t][y][x]; });
  return true;
}

constexpr std::size_t kBricksTogether = 16;  // put in place at once, since threads wait for that

struct Brick {
  std::array<std::uint8_t, kBrickVoxels> label;
  std::array<std::array<float, kBrickVoxels>, 4> phi;  // mm; the solid's, then the tissues'
};

// Bricks of a tooth, from distances in some planes of the fields.
class BrickLayers {
 public:
  // `band`: of the tooth, in the fields' voxels. `taps`: how many of these, along an axis, make a voxel of the tooth.
  BrickLayers(const WorkBox& box, const ToothFields& fields, float band, int taps, int first,
              int last)
      : box_(box),
        fields_(fields),
        band_(band),
        taps_(taps),
        first_(first),
        size_(box.size.x(), box.size.y(), last - first),
        area_(static_cast<std::size_t>(box.size.x()) * static_cast<std::size_t>(box.size.y())) {
    // From a place within the band to the voxels that it is interpolated from; those farther off, at the corners,
    // count by less than a hundredth.
    reach_ = band + (taps > 1 ? 1.8f : 0);
    for (std::size_t n = 0; n < 4; ++n)
      if (n == 0 || !fields.tissue[n - 1].empty())
        distance_[n].resize(static_cast<std::size_t>(size_.z()) * area_);
    iso_distance_in(box.size, {&fields.solid, distance_[0].data(), nullptr}, reach_, first, last);
    near_solid_ = whole_rows();
    shorten(near_solid_, [&](std::size_t o) { return distance_[0][o] < reach_; });
    find_distances();
  }

  // The brick with its voxels at these places; false if all of it is air.
  bool fill(const std::array<EdgeWeights, 3>& weights, double voxel, Brick& brick) const {
    if (is_air(weights)) return false;
    const std::size_t lowest =
        offset(weights[0].front().first, weights[1].front().first, weights[2].front().first);
    std::array<bool, 4> varies{};
    for (std::size_t n = 0; n < 4; ++n) {
      brick.phi[n][0] = reach_;
      if (!distance_[n].empty())
        varies[n] =
            (taps_ == 1 ? interpolate<1> : interpolate<4>)(distance_[n].data() + lowest,
                                                           static_cast<std::size_t>(size_.x()),
                                                           area_, weights, brick.phi[n].data());
    }
    const bool uniform = varies == std::array<bool, 4>{};
    for (std::size_t n = 0; n < 4 && !uniform; ++n)
      if (!varies[n]) brick.phi[n].fill(brick.phi[n][0]);
    with_wide_vectors([&] { finish(uniform ? 1 : kBrickVoxels, weights, voxel, brick); });
    if (!uniform) return true;
    brick.label.fill(brick.label[0]);
    for (auto& phi : brick.phi) phi.fill(phi[0]);
    return true;
  }

 private:
  static constexpr float kTiny = 1e-6f;
  static constexpr auto kAir = static_cast<std::int32_t>(Tissue::kAir),
                        kOther = static_cast<std::int32_t>(Tissue::kOther);

  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k - first_) * static_cast<std::size_t>(size_.y()) +
            static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size_.x()) +
           static_cast<std::size_t>(i);
  }

  bool is_air(const std::array<EdgeWeights, 3>& weights) const {
    const auto end = [&](int axis) { return weights[axis].back().first + taps_; };
    const int low = weights[0].front().first, high = end(0);
    for (int k = weights[2].front().first; k < end(2); ++k)
      for (int j = weights[1].front().first; j < end(1); ++j) {
        const RowPart& part = near_solid_[offset(0, j, k) / static_cast<std::size_t>(size_.x())];
        if (part.first < high && low < part.end && part.first < part.end) return false;
      }
    return true;
  }

  // Labels and level sets of the first voxels of a brick, from its distances.
  void finish(int count, const std::array<EdgeWeights, 3>& weights, double voxel,
              Brick& brick) const {
    const auto band = static_cast<float>(kBandVoxels * voxel), far = (1 - 1e-6f) * band_;
    const auto mm = static_cast<float>(box_.lattice.voxel);
    // What is far away is at the band's very end: single precision's 3 * 0.12 is not 0.36.
    const auto to_mm = [band, far, mm](float voxels) {
      const float in_band = std::min(std::max(voxels * mm, -band), band);
      return std::abs(voxels) < far ? in_band : std::copysign(band, voxels);
    };
    const Tissues tissues = find_tissues(count, weights, brick);
    float* const solid = brick.phi[0].data();
    for (int n = 1; n < 4; ++n) {
      float* const phi = brick.phi[static_cast<std::size_t>(n)].data();
      for (int v = 0; v < count; ++v) {
        // Its level set says the same as its label.
        const float own = phi[v], within = std::min(own, -kTiny), outside = std::max(own, kTiny),
                    as_label = tissues[v] == n ? within : outside;
        phi[v] = to_mm(std::max(tissues[v] == kAir ? own : as_label, solid[v]));
      }
    }
    for (int v = 0; v < count; ++v) solid[v] = to_mm(solid[v]);
    for (int v = 0; v < count; ++v) brick.label[v] = static_cast<std::uint8_t>(tissues[v]);
  }

  // The tissue of each voxel that lies in the solid: that which it lies deepest in.
  using Tissues = std::array<std::int32_t, kBrickVoxels>;  // as wide as distances
  Tissues find_tissues(int count, const std::array<EdgeWeights, 3>& weights,
                       const Brick& brick) const {
    const float* const solid = brick.phi[0].data();
    Tissues tissues;
    std::array<float, kBrickVoxels> least;
    tissues.fill(kOther);
    least.fill(std::numeric_limits<float>::infinity());
    for (int n = 1; n < 4; ++n) {
      if (distance_[static_cast<std::size_t>(n)].empty()) continue;
      const float* const phi = brick.phi[static_cast<std::size_t>(n)].data();
      for (int v = 0; v < count; ++v) {
        const float own = phi[v], before = least[v];
        tissues[v] = own < before ? n : tissues[v];
        least[v] = own < before ? own : before;
      }
    }
    std::int32_t outside_all = 0;  // of the tissues, in the solid
    for (int v = 0; v < count; ++v) {
      const std::int32_t inside = solid[v] < 0 ? 1 : 0, none = least[v] >= 0 ? 1 : 0;
      tissues[v] = inside != 0 ? tissues[v] : kAir;
      outside_all |= inside & none;
    }
    for (int v = 0; v < count && outside_all > 0; ++v)
      if (solid[v] < 0 && least[v] >= 0 &&
          beside_other(
              {weights[0][v >> 6].first, weights[1][v >> 3 & 7].first, weights[2][v & 7].first}))
        tissues[v] = kOther;
    return tissues;
  }
  // Whether a voxel that comes from those of the fields from `first` on lies beside one.
  bool beside_other(const Index3& first) const {
    for (int n = 0; n < (taps_ == 1 ? 1 : 8); ++n) {
      const Index3 at =
          first + Index3::Constant((taps_ - 1) / 2) + Index3(n & 1, n >> 1 & 1, n >> 2);
      if (fields_.label[box_.offset(at.x(), at.y(), at.z())] ==
          static_cast<std::uint8_t>(Tissue::kOther))
        return true;
    }
    return false;
  }

  std::vector<RowPart> whole_rows() const {
    return std::vector<RowPart>(distance_[0].size() / static_cast<std::size_t>(size_.x()),
                                {0, size_.x()});
  }
  // Of each part what lies between the first and the last node that is wanted.
  template <class Wanted>
  void shorten(std::vector<RowPart>& parts, const Wanted& wanted) const {
    for (std::size_t r = 0; r < parts.size(); ++r) {
      const std::size_t row = r * static_cast<std::size_t>(size_.x());
      const auto is_wanted = [&](int i) { return wanted(row + static_cast<std::size_t>(i)); };
      RowPart& part = parts[r];
      while (part.first < part.end && !is_wanted(part.first)) ++part.first;
      while (part.first < part.end && !is_wanted(part.end - 1)) --part.end;
    }
  }

  // The dentin's surface is for the most part enamel's and the pulp's from the other side. A tissue's
  // distance doesn't matter where the solid's is the larger for sure: beyond the solid's band, and, of a place
  // that isn't between others, outside the solid where the tissue's field is inside.
  void find_distances() {
    const std::size_t before = static_cast<std::size_t>(first_) * area_;
    std::vector<IsoField> tissues;  // dentin first
    std::array<std::vector<RowPart>, 3> wanted;
    for (const std::size_t t : {std::size_t{1}, std::size_t{0}, std::size_t{2}}) {
      const SignedField& own = fields_.tissue[t];
      if (own.empty()) continue;
      const SignedField& first = tissues.empty() ? own : *tissues.front().field;
      wanted[t] = near_solid_;
      if (taps_ == 1)
        shorten(wanted[t], [&](std::size_t o) {
          return distance_[0][o] < 0 ||
                 (distance_[0][o] < reach_ && (own[before + o] < 0 || first[before + o] < 0));
        });
      tissues.push_back({&own, distance_[t + 1].data(), wanted[t].data()});
    }
    if (tissues.empty()) return;
    const IsoField of = tissues.front();
    tissues.erase(tissues.begin());
    iso_distance_in(box_.size, of, reach_, first_, first_ + size_.z(), tissues);
  }

  const WorkBox& box_;
  const ToothFields& fields_;
  float band_, reach_ = 0;  // voxels
  int taps_;
  int first_;
  Index3 size_;
  std::size_t area_;
  std::vector<RowPart> near_solid_;
  std::array<Field, 4> distance_;  // voxels; the solid's, then the tissues'
};

}  // namespace

LayeredTooth tooth_of(const WorkBox& box, const ToothFields& fields, const WorkBox& voxels) {
  LayeredTooth tooth =
      make_empty_tooth(voxels.lattice, voxels.lower, voxels.lower + voxels.size - Index3::Ones());
  const Index3 counts = tooth.solid.brick_counts();
  const int taps = voxels.lattice.voxel < box.lattice.voxel ? 4 : 1;
  std::array<std::vector<Weights>, 3> along;
  for (int a = 0; a < 3; ++a)
    along[a] = weights_along(a, box, tooth.lattice, tooth.solid.first_brick()[a] * kBrickEdge,
                             counts[a] * kBrickEdge, taps);
  const double ratio = voxels.lattice.voxel / box.lattice.voxel;
  const int at_once = std::max(2, static_cast<int>(std::lround(3 / ratio)));  // layers of bricks
  std::mutex insert;
  tbb::parallel_for(0, (counts.z() + at_once - 1) / at_once, [&](int part) {
    const int z = part * at_once, z_end = std::min(counts.z(), z + at_once);
    const auto of = [&](int axis, int n) { return along[axis][static_cast<std::size_t>(n)]; };
    const BrickLayers layers(box, fields, static_cast<float>(kBandVoxels * ratio), taps,
                             of(2, z * kBrickEdge).first,
                             of(2, z_end * kBrickEdge - 1).first + taps);
    std::vector<Brick> bricks(kBricksTogether);
    std::vector<std::size_t> places;
    const auto put = [&] {
      // Which pool slot a brick gets depends on the order of threads; its values and place do not.
      const std::lock_guard lock(insert);
      for (std::size_t n = 0; n < places.size(); ++n) {
        tooth.tissue.set_brick(places[n], bricks[n].label.data());
        tooth.solid.set_brick(places[n], bricks[n].phi[0].data());
        for (std::size_t k = 0; k < 3; ++k)
          tooth.remains[k].set_brick(places[n], bricks[n].phi[k + 1].data());
      }
      places.clear();
    };
    for (int b = 0; b < counts.x() * counts.y() * (z_end - z); ++b) {
      const Index3 at(b % counts.x(), b / counts.x() % counts.y(), z + b / counts.x() / counts.y());
      std::array<EdgeWeights, 3> weights;
      for (int a = 0; a < 3; ++a)
        for (int n = 0; n < kBrickEdge; ++n) weights[a][n] = of(a, at[a] * kBrickEdge + n);
      if (!layers.fill(weights, tooth.lattice.voxel, bricks[places.size()])) continue;  // as it is
      places.push_back((static_cast<std::size_t>(at.x()) * counts.y() + at.y()) * counts.z() +
                       at.z());
      if (places.size() == bricks.size()) put();
    }
    put();
  });
  return tooth;
}

}  // namespace toothprep
