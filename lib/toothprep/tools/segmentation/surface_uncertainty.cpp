#include "toothprep/tools/segmentation/surface_uncertainty.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace toothprep {
namespace {

constexpr double k95 = 1.96;
constexpr double kOfOutside = 0.2, kOfInside = 0.3, kOfPulp = 0.4;  // of the scan's voxel
constexpr double kOfThin = 0.33;
constexpr double kLargest = 2;  // likewise

// Grey values per voxel, by central differences; a sum over both sides of a face.
double slope_at(const WorkBox& box, const TrimmedField& grey, const Index3& at) {
  Vec3 gradient;
  for (int a = 0; a < 3; ++a) {
    Index3 p = at, q = at;
    p[a] = std::max(p[a] - 1, 0);
    q[a] = std::min(q[a] + 1, box.size[a] - 1);
    gradient[a] = (grey[box.offset(q.x(), q.y(), q.z())] - grey[box.offset(p.x(), p.y(), p.z())]) /
                  (q[a] - p[a]);
  }
  return gradient.norm();
}

// How much the greys of a tissue vary beyond the noise, where the grey is level: a standard deviation.
double variation(const WorkBox& box, const TrimmedField& grey, const ToothFields& fields,
                 Tissue tissue, double noise, double level) {
  std::vector<float> greys;
  constexpr int kEvery = 3;  // voxels
  for (int k = 1; k + 1 < box.size.z(); k += kEvery)
    for (int j = 1; j + 1 < box.size.y(); j += kEvery)
      for (int i = 1; i + 1 < box.size.x(); i += kEvery) {
        const std::size_t v = box.offset(i, j, k);
        if (fields.label[v] != static_cast<std::uint8_t>(tissue)) continue;
        if (slope_at(box, grey, Index3(i, j, k)) < level + 2 * noise) greys.push_back(grey[v]);
      }
  if (greys.size() < 100) return 0;
  const auto median = [](std::vector<float>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  const float centre = median(greys);
  for (float& g : greys) g = std::abs(g - centre);
  const double all = 1.4826 * median(greys);
  return std::sqrt(std::max(0.0, all * all - noise * noise));
}

ScanSurface surface_between(std::uint8_t a, std::uint8_t b) {
  const auto is = [&](Tissue t) {
    return a == static_cast<std::uint8_t>(t) || b == static_cast<std::uint8_t>(t);
  };
  if (is(Tissue::kOther)) return ScanSurface::kOther;
  if (is(Tissue::kPulp)) return ScanSurface::kPulp;
  if (!is(Tissue::kAir)) return ScanSurface::kEnamelDentin;
  return is(Tissue::kEnamel) ? ScanSurface::kEnamelOutside : ScanSurface::kDentinOutside;
}

// The surface beside a voxel, if it has one; of several the outermost.
std::optional<ScanSurface> surface_at(const WorkBox& box, const ToothFields& fields,
                                      const Index3& at) {
  const std::uint8_t here = fields.label[box.offset(at.x(), at.y(), at.z())];
  std::optional<ScanSurface> found;
  for (int a = 0; a < 3; ++a)
    for (const int side : {-1, 1}) {
      const Index3 n = at + side * Index3::Unit(a);
      if (n[a] < 0 || n[a] >= box.size[a]) continue;
      const std::uint8_t there = fields.label[box.offset(n.x(), n.y(), n.z())];
      if (there == here) continue;
      const ScanSurface surface = surface_between(here, there);
      if (!found || surface < *found) found = surface;
    }
  return found;
}

// Those with a voxel that has another neighbour. One across the end of a row counts as well.
Mask chunks_of_surfaces(const WorkBox& box, const std::vector<std::uint8_t>& label) {
  const std::array<std::size_t, 3> strides = {1, box.offset(0, 1, 0), box.offset(0, 0, 1)};
  Mask chunks((label.size() + BandField::kChunk - 1) / BandField::kChunk);
  tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t c) {
    const std::size_t v = c * BandField::kChunk;
    for (const std::size_t stride : strides) {
      const std::size_t from = std::max(v, stride),
                        end = std::min(v + BandField::kChunk, label.size()),
                        end_below = std::min(end, label.size() - std::min(stride, label.size()));
      std::uint8_t change = 0;
      for (std::size_t u = from; u < end; ++u) change |= label[u] ^ label[u - stride];
      for (std::size_t u = v; u < end_below; ++u) change |= label[u] ^ label[u + stride];
      chunks[c] |= change != 0;
    }
  });
  return chunks;
}

void add_figures(SurfaceUncertainty& result) {
  for (std::size_t s = 0; s < result.figures.size(); ++s) {
    std::vector<double> widths;
    double squares = 0;
    for (const auto& place : result.places)
      if (static_cast<std::size_t>(place.surface) == s) {
        widths.push_back(place.half_width);
        squares += place.half_width * place.half_width;
      }
    if (widths.empty()) continue;
    const auto n = static_cast<double>(widths.size());
    const auto quantile = [&](double q) {
      const auto at = widths.begin() + static_cast<std::ptrdiff_t>(q * (n - 1));
      std::nth_element(widths.begin(), at, widths.end());
      return *at;
    };
    result.figures[s] = {std::sqrt(squares / n), quantile(0.5), quantile(0.95), widths.size()};
  }
}

}  // namespace

SurfaceUncertainty surface_uncertainty(const WorkBox& box, const TrimmedField& grey, double noise,
                                       const ToothFields& fields, const GreyClasses& classes,
                                       const ThinEnamel& thin, double blur) {
  const double level = 0.1 * (classes.enamel - classes.dentin) / blur;
  const double border =
      0.5 * std::hypot(variation(box, grey, fields, Tissue::kDentin, noise, level),
                       variation(box, grey, fields, Tissue::kEnamel, noise, level));
  const auto fitted = [&](std::size_t v) {
    return std::binary_search(thin.voxels.begin(), thin.voxels.end(), ThinEnamel::Voxel{v},
                              [](const auto& a, const auto& b) { return a.at < b.at; });
  };

  std::vector<std::vector<SurfaceUncertainty::Place>> planes(
      static_cast<std::size_t>(box.size.z()));
  const Mask chunks = chunks_of_surfaces(box, fields.label);
  const auto look_at = [&](const Index3& at, std::size_t v) {
    const auto surface = surface_at(box, fields, at);
    if (!surface) return;
    const double slope =
        std::max(slope_at(box, grey, at), 1e-6 * (classes.enamel - classes.dentin));
    const double voxels = *surface <= ScanSurface::kDentinOutside ? kOfOutside
                          : *surface == ScanSurface::kPulp        ? kOfPulp
                                                                  : kOfInside;
    double square = std::pow(k95 * noise / slope, 2) + std::pow(k95 * border / slope, 2) +
                    std::pow(voxels * blur, 2);
    if (*surface == ScanSurface::kEnamelDentin && fitted(v))
      square = std::pow(kOfInside * blur, 2) + std::pow(kOfThin * blur, 2);
    const double half = std::min(std::sqrt(square), kLargest * blur) * box.lattice.voxel;
    planes[static_cast<std::size_t>(at.z())].push_back(
        {box.lower + at, *surface, static_cast<float>(half)});
  };
  box.for_each_row([&](int j, int k, std::size_t first, std::size_t end) {
    for (std::size_t v = first; v < end;) {
      const std::size_t next = std::min(end, (v / BandField::kChunk + 1) * BandField::kChunk);
      for (; v < next && chunks[v / BandField::kChunk]; ++v)
        look_at(Index3(static_cast<int>(v - first), j, k), v);
      v = next;
    }
  });
  SurfaceUncertainty result;
  result.voxel_mm = box.lattice.voxel;
  for (const auto& plane : planes)
    result.places.insert(result.places.end(), plane.begin(), plane.end());
  add_figures(result);
  return result;
}

}  // namespace toothprep
