#include "toothprep/tools/segmentation/label_surface.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"

namespace toothprep {
namespace {

// Chosen on exact cavities, straight and turned (README.md): edges stay sharp, steps vanish.
constexpr std::array<float, 2> kSlopeChange = {0.5f, 0.2f};  // delta, one round each
constexpr int kSteps = 100;                                  // of each round, at fineness 1
// Least |f|. A plane comes as near to a centre as it likes; but a voxel without a neighbour on the
// other side lies 1/sqrt(3) or more from any plane that separates, which sets the scale of f.
constexpr float kMarginAtSteps = 0.03f, kMarginBehind = 0.5f;
constexpr int kSearch = 2;  // voxels, for the distance to the other side
constexpr double kBytesPerBandVoxel = 90, kBytesPerVoxel = 7;

struct Offset {
  std::ptrdiff_t step;
  float distance;
};

// Of the voxels around one, the nearest first.
std::vector<Offset> offsets_around(const Index3& size, const Vec3& relative_spacing) {
  std::vector<Offset> offsets;
  for (int k = -kSearch; k <= kSearch; ++k)
    for (int j = -kSearch; j <= kSearch; ++j)
      for (int i = -kSearch; i <= kSearch; ++i)
        offsets.push_back(
            {(static_cast<std::ptrdiff_t>(k) * size.y() + j) * size.x() + i,
             static_cast<float>(Vec3(i, j, k).cwiseProduct(relative_spacing).norm())});
  std::stable_sort(offsets.begin(), offsets.end(),
                   [](const Offset& a, const Offset& b) { return a.distance < b.distance; });
  return offsets;
}

void need_memory(double bytes) {
  if (bytes > static_cast<double>(available_memory()))
    throw Error("smoothing the labels takes " + size_text(bytes) + " of memory, " +
                size_text(static_cast<double>(available_memory())) +
                " are available; cut out a part by --roi, or keep their steps by "
                "--no-smooth-labels");
}

template <class Work>
void for_each_place(std::size_t count, const Work& work) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) work(i);
  });
}

}  // namespace

// The unknowns, packed. The last element of what neighbours are read from belongs to nobody: it is
// the neighbour of those that have none, and is 0.
struct LabelSurface::Band {
  using Neighbours = std::array<std::uint32_t, 2>;  // along an axis
  std::size_t count = 0;
  std::array<std::vector<Neighbours>, 3> beside;
  std::array<std::vector<float>, 3> weight, bend;
  std::vector<float> low, high;      // bounds of f
  std::vector<float> f, ahead;       // ahead: f with its momentum
  std::array<float, 3> stiffness{};  // (least spacing / spacing)⁴

  float second_difference(const std::vector<float>& g, int a, std::size_t i) const {
    const auto& [p, q] = beside[a][i];
    return g[p] + g[q] - 2 * g[i];
  }
};

LabelSurface::LabelSurface(const Index3& size, Sides sides, const Vec3& spacing, int reach,
                           double fineness)
    : size_(size),
      sides_(std::move(sides)),
      spacing_(spacing),
      reach_(reach),
      steps_(std::max(10, static_cast<int>(std::lround(kSteps * std::min(1.0, fineness))))),
      far_(static_cast<float>(reach + 1)) {
  need_memory(kBytesPerVoxel * static_cast<double>(sides_.size()));
  find_band();
  need_memory(kBytesPerBandVoxel * static_cast<double>(voxel_.size()));
  Band band;
  start(band);
  relax(band);
  band.f.pop_back();
  value_ = std::move(band.f);
}

void LabelSurface::find_band() {
  const auto row = static_cast<std::ptrdiff_t>(size_.x()), plane = row * size_.y();
  const std::array<std::ptrdiff_t, 3> stride = {1, row, plane};
  const auto inner_planes = [&](const auto& work) {  // work(v) for all voxels inside the border
    const int border = kSearch;
    tbb::parallel_for(border, size_.z() - border, [&](int k) {
      for (std::ptrdiff_t v = k * plane + border * row; v < (k + 1) * plane - border * row; ++v)
        work(v);
    });
  };
  std::vector<std::uint8_t> near(sides_.size(), 0), grown(sides_.size(), 0);
  inner_planes([&](std::ptrdiff_t v) {
    for (const std::ptrdiff_t d : stride)
      near[v] |= ((sides_[v] ^ sides_[v - d]) | (sides_[v] ^ sides_[v + d])) & kInside;
  });
  for (int n = 0; n < reach_; ++n)
    for (const std::ptrdiff_t d : stride) {
      inner_planes([&](std::ptrdiff_t v) { grown[v] = near[v] | near[v - d] | near[v + d]; });
      near.swap(grown);
    }
  place_.assign(sides_.size(), -1);
  for (std::size_t v = 0; v < near.size(); ++v)
    if (near[v]) {
      place_[v] = static_cast<std::int32_t>(voxel_.size());
      voxel_.push_back(v);
    }
}

// Neighbours, bounds, and the distance to the nearest voxel of the other side to begin with.
void LabelSurface::start(Band& band) const {
  const auto row = static_cast<std::ptrdiff_t>(size_.x()), plane = row * size_.y();
  const std::array<std::ptrdiff_t, 3> stride = {1, row, plane};
  const Vec3 relative = spacing_ / spacing_.minCoeff();
  const std::vector<Offset> offsets = offsets_around(size_, relative);
  const std::size_t n = band.count = voxel_.size();
  for (int a = 0; a < 3; ++a) {
    band.stiffness[a] = static_cast<float>(std::pow(relative[a], -4));
    band.beside[a].resize(n);
    band.weight[a].resize(n);
    band.bend[a].assign(n + 1, 0);
  }
  band.low.resize(n);
  band.high.resize(n);
  band.f.assign(n + 1, 0);
  const auto none = static_cast<std::uint32_t>(n);
  for_each_place(n, [&](std::size_t i) {
    const auto v = static_cast<std::ptrdiff_t>(voxel_[i]);
    const auto other = [&](std::ptrdiff_t u) { return ((sides_[u] ^ sides_[v]) & kInside) != 0; };
    bool at_step = false;
    for (int a = 0; a < 3; ++a) {
      const std::ptrdiff_t d = stride[a];
      const auto place = [&](std::ptrdiff_t u) {
        return place_[u] < 0 ? none : static_cast<std::uint32_t>(place_[u]);
      };
      band.beside[a][i] = {place(v - d), place(v + d)};
      at_step = at_step || other(v - d) || other(v + d);
      // One or two voxels thin.
      const bool below = other(v - d) || other(v - 2 * d), above = other(v + d) || other(v + 2 * d);
      const bool thin = below && above && (other(v - d) || other(v + d));
      const bool inner = place(v - d) != none && place(v + d) != none;
      band.weight[a][i] = inner && !thin ? 1.0f : 0.0f;
    }
    float distance = far_;
    for (const Offset& o : offsets)
      if (other(v + o.step)) {
        distance = std::min(distance, o.distance - 0.5f);
        break;
      }
    const bool inside = sides_[v] & kInside, free = sides_[v] & kFree;
    const float margin = at_step ? kMarginAtSteps : kMarginBehind;
    band.f[i] = inside ? distance : -distance;
    band.low[i] = inside && !free ? margin : -far_;
    band.high[i] = inside || free ? far_ : -margin;
  });
}

void LabelSurface::relax(Band& band) const {
  const std::array<float, 3>& k = band.stiffness;
  const float step = 1 / (16 * (k[0] + k[1] + k[2]));  // the largest eigenvalue's inverse
  std::array<std::vector<float>, 3> slope_change;
  for (const float delta : kSlopeChange) {
    for (int a = 0; a < 3; ++a) {
      for_each_place(band.count, [&](std::size_t i) {
        band.bend[a][i] = band.weight[a][i] > 0 ? band.second_difference(band.f, a, i) : 0;
      });
      for_each_place(band.count, [&](std::size_t i) {
        if (!(band.weight[a][i] > 0)) return;
        const auto& [p, q] = band.beside[a][i];
        const float change = (band.bend[a][p] + band.bend[a][i] + band.bend[a][q]) / delta;
        const float w = 1 / (1 + change * change);
        band.weight[a][i] = k[a] * w * w;
      });
    }
    band.ahead = band.f;
    float t = 1;
    for (int n = 0; n < steps_; ++n) {
      for_each_place(band.count, [&](std::size_t i) {
        for (int a = 0; a < 3; ++a)
          band.bend[a][i] = band.weight[a][i] * band.second_difference(band.ahead, a, i);
      });
      const float next_t = (1 + std::sqrt(1 + 4 * t * t)) / 2, momentum = (t - 1) / next_t;
      t = next_t;
      for_each_place(band.count, [&](std::size_t i) {
        float gradient = 0;
        for (int a = 0; a < 3; ++a) gradient += band.second_difference(band.bend[a], a, i);
        const float next = std::clamp(band.ahead[i] - step * gradient, band.low[i], band.high[i]);
        band.ahead[i] = next + momentum * (next - band.f[i]);
        band.f[i] = next;
      });
    }
  }
}

float LabelSurface::at(const Vec3& index) const {
  const Index3 base = index.array().floor().cast<int>();
  const Vec3 f = index - base.cast<double>();
  const auto row = static_cast<std::size_t>(size_.x()),
             plane = row * static_cast<std::size_t>(size_.y());
  const std::size_t v = static_cast<std::size_t>(base.z()) * plane +
                        static_cast<std::size_t>(base.y()) * row +
                        static_cast<std::size_t>(base.x());
  const auto along_x = [&](std::size_t u) { return value(u) + f.x() * (value(u + 1) - value(u)); };
  const double a = along_x(v), b = along_x(v + row), c = along_x(v + plane),
               d = along_x(v + plane + row);
  const double ab = a + f.y() * (b - a), cd = c + f.y() * (d - c);
  return static_cast<float>(ab + f.z() * (cd - ab));
}

}  // namespace toothprep
