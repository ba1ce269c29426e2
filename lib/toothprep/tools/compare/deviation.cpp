#include "toothprep/tools/compare/deviation.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

// Signed distances of a surface's vertices to the surface of another solid; NaN outside the region.
std::vector<float> distances(const TriangleMesh& from, const LayeredTooth& original,
                             const LayeredTooth& other, const TriangleTree& to, double tolerance) {
  const std::vector<float> depth = depth_inside(from, original),
                           other_depth = depth_inside(from, other);
  std::vector<float> result(from.vertices.size(), NAN);
  tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t v) {
    const bool cut = static_cast<double>(depth[v]) > tolerance;
    // Most vertices lie on the surface of both; the level set gives the distance without a search.
    if (!cut && static_cast<double>(other_depth[v]) > -0.5 * tolerance) return;
    const double d = to.signed_distance(from.vertices[v].cast<double>());
    if (cut || d > tolerance) result[v] = static_cast<float>(d);
  });
  return result;
}

struct Farthest {
  double distance = 0;
  Vec3 at = Vec3::Zero();
};

Farthest farthest(const TriangleMesh& surface, const std::vector<float>& d) {
  Farthest result;
  for (std::size_t v = 0; v < d.size(); ++v)
    if (std::abs(static_cast<double>(d[v])) > result.distance)
      result = {std::abs(static_cast<double>(d[v])), surface.vertices[v].cast<double>()};
  return result;
}

std::vector<DeviationBin> histogram_of(const std::vector<float>& d, const std::vector<double>& area,
                                       double widest, const DeviationOptions& options) {
  const double end = std::min(options.most_mm, std::max(widest, options.bin_mm));
  const int half = std::max(1, static_cast<int>(std::ceil(end / options.bin_mm - 1e-9)));
  std::vector<DeviationBin> bins(static_cast<std::size_t>(2 * half));
  for (int b = 0; b < 2 * half; ++b) {
    bins[static_cast<std::size_t>(b)].from_mm = (b - half) * options.bin_mm;
    bins[static_cast<std::size_t>(b)].to_mm = (b + 1 - half) * options.bin_mm;
  }
  for (std::size_t v = 0; v < d.size(); ++v) {
    if (std::isnan(d[v])) continue;
    const double at = std::floor(static_cast<double>(d[v]) / options.bin_mm) + half;
    bins[static_cast<std::size_t>(std::clamp(at, 0.0, 2.0 * half - 1))].area_mm2 += area[v];
  }
  return bins;
}

double quantile_of_size(const std::vector<float>& d, const std::vector<double>& area,
                        double share) {
  std::vector<WeightedValue> sizes;
  for (std::size_t v = 0; v < d.size(); ++v)
    if (!std::isnan(d[v])) sizes.push_back({std::abs(static_cast<double>(d[v])), area[v]});
  return weighted_quantile(std::move(sizes), share);
}

}  // namespace

Deviation measure_deviation(const Solid& original, const Solid& prepared, const Solid& target,
                            const DeviationOptions& options) {
  const double tolerance = options.cut_tolerance_mm > 0 ? options.cut_tolerance_mm
                                                        : cut_tolerance(original.tooth.lattice);
  const TriangleTree to_target(target.surface), to_prepared(prepared.surface);
  Deviation result;
  result.per_vertex =
      distances(prepared.surface, original.tooth, target.tooth, to_target, tolerance);
  const std::vector<float> back =
      distances(target.surface, original.tooth, prepared.tooth, to_prepared, tolerance);

  const std::vector<double> area = vertex_areas(prepared.surface);
  double sum = 0, squares = 0, within_0_1 = 0, within_0_2 = 0;
  for (std::size_t v = 0; v < area.size(); ++v) {
    if (std::isnan(result.per_vertex[v])) continue;
    const double d = result.per_vertex[v];
    result.area_mm2 += area[v];
    sum += area[v] * d;
    squares += area[v] * d * d;
    if (std::abs(d) <= 0.1) within_0_1 += area[v];
    if (std::abs(d) <= 0.2) within_0_2 += area[v];
    result.least_mm = std::min(result.least_mm, d);
    result.most_mm = std::max(result.most_mm, d);
  }
  if (!(result.area_mm2 > 0))
    throw InputError(prepared.file, "", "no point of its surface was cut deeper than half a voxel",
                     "there is nothing to compare with the target");
  result.mean_mm = sum / result.area_mm2;
  result.rms_mm = std::sqrt(squares / result.area_mm2);
  result.share_within_0_1 = within_0_1 / result.area_mm2;
  result.share_within_0_2 = within_0_2 / result.area_mm2;
  result.p95_mm = quantile_of_size(result.per_vertex, area, 0.95);
  const Farthest there = farthest(prepared.surface, result.per_vertex),
                 here = farthest(target.surface, back);
  result.to_target_mm = there.distance;
  result.to_prepared_mm = here.distance;
  result.hausdorff_mm = std::max(there.distance, here.distance);
  result.worst = there.distance >= here.distance ? there.at : here.at;
  result.histogram =
      histogram_of(result.per_vertex, area, std::max(result.most_mm, -result.least_mm), options);
  return result;
}

}  // namespace toothprep
