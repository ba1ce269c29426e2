#include "toothprep/tools/preparation/undercut.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kDeepest = 3;         // mm: undercuts deeper than this count as this deep
constexpr double kStep = 0.02;         // mm, of the search along the side
constexpr double kOffSurface = 1e-3;   // mm
constexpr double kRaised = 0.02;       // mm: over ripples of a floor, which would bar every way
constexpr int kWays = 12;              // all around
const double kSteep = std::sqrt(0.5);  // of a wall's normal, the part across the path

// How far from x along `side` (unit, across the path) the way out is free; `stop` if not nearer.
double free_after(const TriangleTree& tree, const Vec3& x, const Vec3& side, const Vec3& path,
                  double stop) {
  for (double blocked = 0; blocked < stop;) {
    const double t = std::min(blocked + kStep, stop);
    if (tree.hits(x + t * side, path)) {
      blocked = t;
      continue;
    }
    double free = t;
    while (free - blocked > 1e-3) {
      const double middle = (free + blocked) / 2;
      (tree.hits(x + middle * side, path) ? blocked : free) = middle;
    }
    return free;
  }
  return stop;
}

}  // namespace

Vec3 best_path_of_draw(const CutFacets& facets, const Vec3& axis) {
  const double slack = std::sin(units::from_degree(1));
  const Vec3 a = axis.unitOrthogonal(), b = axis.cross(a);
  double total = 0;
  for (const Facet& f : facets.all()) total += f.area;
  const auto path_at = [&](double x, double y) -> Vec3 {
    return (axis + x * a + y * b).normalized();
  };
  const auto cost = [&](double x, double y) {
    const Vec3 p = path_at(x, y);
    double sum = 0;
    for (const Facet& f : facets.all()) {
      const double missing = slack - f.normal.dot(p);
      if (missing > 0 && !f.crease) sum += f.area * missing * missing;
    }
    return sum / total + 1e-5 * (x * x + y * y);
  };
  const double limit = std::tan(units::kPi / 6);
  double x = 0, y = 0, best = cost(0, 0);
  for (double step = 0.1; step > 1e-4;) {  // a pattern search: two unknowns, a convex cost
    bool moved = false;
    for (const auto& [dx, dy] : {std::pair{1., 0.}, {-1., 0.}, {0., 1.}, {0., -1.}}) {
      const double tx = x + step * dx, ty = y + step * dy;
      if (tx * tx + ty * ty > limit * limit) continue;
      if (const double c = cost(tx, ty); c < best) {
        best = c;
        x = tx;
        y = ty;
        moved = true;
        break;
      }
    }
    if (!moved) step /= 2;
  }
  return path_at(x, y);
}

Undercut find_undercuts(const CutFacets& facets, const TriangleTree& prepared, const Vec3& path,
                        double threshold, const std::vector<double>& ways_down) {
  std::vector<double> depth(facets.size(), 0);
  tbb::parallel_for(std::size_t{0}, facets.size(), [&](std::size_t i) {
    const Facet& f = facets[i];
    if (f.crease) return;
    const Vec3 x = f.centroid + kOffSurface * f.normal;
    if (!prepared.hits(x, path)) return;
    const Vec3 flat = f.normal - f.normal.dot(path) * path;
    const Vec3 side = flat.norm() > 1e-6 ? Vec3(flat.normalized()) : Vec3(path.unitOrthogonal());
    const Vec3 other = path.cross(side);
    const Vec3 raised = x + kRaised * path;
    // The way out is mostly the way the wall faces; under a ceiling and in corners it may be any.
    const double straight = free_after(prepared, raised, side, path, kDeepest);
    // What ways within 30° and 60° lead across the wall; on a wall that isn't curved, all the same.
    double least = straight, nearly = straight, across = straight;
    for (int k = 1; k < kWays; ++k) {
      const double turn = k * 2 * units::kPi / kWays, cosine = std::cos(turn);
      const double share = cosine > 0.4 ? cosine : 1;
      const Vec3 way = cosine * side + std::sin(turn) * other;
      const double stop = std::max(least, (cosine > 0.8 ? nearly : across) / share);
      const double free = free_after(prepared, raised, way, path, stop);
      if (free >= stop) continue;
      least = std::min(least, free);
      across = std::min(across, free * share);
      if (cosine > 0.8) nearly = std::min(nearly, free * share);
    }
    // Beside another wall that is undercut, too, only what leads across its own counts.
    if (flat.norm() > kSteep) least = least < straight ? across : nearly;
    depth[i] = least;
  });
  Undercut result;
  for (std::uint32_t i = 0; i < facets.size(); ++i) {
    if (!(depth[i] > threshold)) continue;
    result.facets.push_back(i);
    result.area += facets[i].area;
    const double overhang = -facets[i].normal.dot(path);
    if (-overhang > kSteep)
      continue;  // a floor: no deeper than the walls on it, but for its corners
    const double at_the_floor =
        depth[i] + (std::isnan(ways_down[i]) ? 0 : ways_down[i] * std::max(0.0, overhang));
    if (at_the_floor > result.deepest) {
      result.deepest = at_the_floor;
      result.place = facets[i].centroid;
    }
  }
  return result;
}

}  // namespace toothprep
