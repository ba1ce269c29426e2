#include "toothprep/tools/segmentation/metal_surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/tools/segmentation/blurred_step.h"
#include "toothprep/tools/segmentation/near_distance.h"

namespace toothprep {
namespace {

constexpr double kLowLevel = 0.2, kHighLevel = 0.6;  // of the way from T to the clip, or to M

struct MetalEdge {
  double outer = 0;          // T
  double low = 0, high = 0;  // x where the grey passes the two levels
};

std::optional<MetalEdge> edge_of(const SurfaceProfiles& profiles, std::size_t p, double top,
                                 double blur) {
  MetalEdge edge;
  edge.outer = profiles.mean(p, -3 * blur, -2 * blur);
  if (!(edge.outer < top)) return {};
  const auto low = profiles.first_above(p, edge.outer + kLowLevel * (top - edge.outer)),
             high = profiles.first_above(p, edge.outer + kHighLevel * (top - edge.outer));
  if (!low || !high || !(*high > *low)) return {};
  edge.low = *low, edge.high = *high;
  return edge;
}

// The metal's grey, from the top of what is seen: at most ten times as far from dentin.
double grey_beyond(const std::vector<std::optional<MetalEdge>>& edges, double top, double dentin,
                   double sigma) {
  std::vector<const MetalEdge*> some;
  const std::size_t every = 1 + edges.size() / 400;
  for (std::size_t p = 0; p < edges.size(); p += every)
    if (edges[p]) some.push_back(&*edges[p]);
  double best = top, least = std::numeric_limits<double>::infinity();
  for (double factor = 1; factor <= 10; factor *= 1.05) {
    const double metal = dentin + factor * (top - dentin);
    double sum = 0;
    for (const MetalEdge* e : some) {
      const double share = (top - e->outer) / (metal - e->outer);
      const double width =
          sigma * (place_on_step(kHighLevel * share) - place_on_step(kLowLevel * share));
      sum += std::abs(e->high - e->low - width);
    }
    if (sum < least) least = sum, best = metal;
  }
  return best;
}

// Of the places around the foot of a voxel on the surface.
bool metal_around(const SurfaceProfiles& profiles,
                  const std::vector<std::optional<MetalEdge>>& edges,
                  const std::vector<double>& surface, const Vec3& at, const Vec3& foot,
                  const Vec3& inwards, MetalSurface::Voxel& voxel) {
  double inside = 0, outer = 0;
  int count = 0;
  profiles.for_each_around(foot.array().round().cast<int>(), [&](std::size_t p) {
    if (!edges[p]) return;
    // With both normals a sphere's curvature falls out: its points have no distance from each other.
    const Vec3 normal = 0.5 * (profiles.inwards[p] + inwards);
    inside += (at - profiles.voxel[p].cast<double>()).dot(normal) - profiles.zero[p] - surface[p];
    outer += edges[p]->outer;
    ++count;
  });
  if (count == 0) return false;
  voxel.inside = static_cast<float>(inside / count);
  voxel.outer = static_cast<float>(outer / count);
  return true;
}

}  // namespace

MetalSurface find_metal_surface(const WorkBox& box, const ImageVolume<float>& scan,
                                const TrimmedField& grey, const Mask& domain,
                                const GreyClasses& classes, std::optional<double> clip,
                                double sigma, double blur) {
  MetalSurface result;
  if (!classes.threshold_metal) return result;
  const std::size_t n = box.voxels();
  Field bright;
  for (std::size_t v = 0; v < n; ++v)
    if (domain[v] && grey[v] > *classes.threshold_metal) bright.push_back(grey[v]);
  if (bright.empty()) return result;
  const auto typical =
      bright.begin() + static_cast<std::ptrdiff_t>(0.75 * static_cast<double>(bright.size()));
  std::nth_element(bright.begin(), typical, bright.end());
  const double top = *typical, border = 0.5 * (classes.enamel + top);
  result.metal.resize(n);
  bool all = true, any = false;
  for (std::size_t v = 0; v < n; ++v) {
    result.metal[v] = domain[v] && grey[v] > border;
    all = all && result.metal[v], any = any || result.metal[v];
  }
  if (all || !any) return MetalSurface();

  const double reach = 3 * blur;
  const SurfaceDepth depth(box.size, result.metal,
                           static_cast<int>(std::ceil(reach + 2 * blur + 0.5)));
  const BandField level = inward_level(box, depth, reach, reach, blur);
  const SurfaceProfiles profiles = surface_profiles(box, scan, grey, depth, level, border, blur);
  std::vector<std::optional<MetalEdge>> edges(profiles.count());
  for (std::size_t p = 0; p < edges.size(); ++p) edges[p] = edge_of(profiles, p, top, blur);
  const bool clipped = clip && *clip - top < 0.05 * (top - classes.enamel);
  result.grey = clipped ? grey_beyond(edges, top, classes.dentin, sigma) : top;
  std::vector<double> surface(edges.size());
  for (std::size_t p = 0; p < edges.size(); ++p) {
    if (!edges[p]) continue;
    const double share = (top - edges[p]->outer) / (result.grey - edges[p]->outer);
    surface[p] = 0.5 * (edges[p]->low - sigma * place_on_step(kLowLevel * share) + edges[p]->high -
                        sigma * place_on_step(kHighLevel * share));
  }
  std::vector<std::vector<MetalSurface::Voxel>> planes(static_cast<std::size_t>(box.size.z()));
  for_each_of(box, level, [&](int i, int j, int k, std::size_t v) {
    if (std::abs(depth[v]) >= reach) return;
    const Index3 index(i, j, k);
    const Vec3 at = index.cast<double>();
    MetalSurface::Voxel voxel;
    voxel.at = v;
    const Vec3 inwards = inwards_at(box, level, index);
    if (metal_around(profiles, edges, surface, at, at - (depth[v] - 0.5) * inwards, inwards, voxel))
      planes[static_cast<std::size_t>(k)].push_back(voxel);
  });
  std::size_t count = 0;
  for (const auto& plane : planes) count += plane.size();
  result.voxels.reserve(count);
  for (auto& plane : planes) {
    result.voxels.insert(result.voxels.end(), plane.begin(), plane.end());
    std::vector<MetalSurface::Voxel>().swap(plane);
  }
  return result;
}

}  // namespace toothprep
