#include "toothprep/tools/preparation/texture.h"

#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kRadius = 0.4;  // mm
constexpr std::size_t kPlaces = 600;

double roughness_at(const CutFacets& facets, std::uint32_t centre) {
  const Facet& c = facets[centre];
  const double near_normal = std::cos(units::kPi / 6);
  std::vector<std::uint32_t> patch = {centre};
  std::vector<std::uint8_t> seen(facets.size(), 0);
  seen[centre] = 1;
  for (std::size_t n = 0; n < patch.size(); ++n)
    for (const std::uint32_t j : facets.around(patch[n])) {
      if (seen[j]) continue;
      seen[j] = 1;
      if ((facets[j].centroid - c.centroid).norm() > kRadius) continue;
      if (facets[j].normal.dot(c.normal) < near_normal) return NAN;  // a line angle is near
      if (facets[j].rim) return NAN;
      patch.push_back(j);
    }
  if (patch.size() < 24) return NAN;
  const Vec3 x = c.normal.unitOrthogonal(), y = c.normal.cross(x);
  Eigen::MatrixXd a(patch.size(), 6);
  Eigen::VectorXd b(patch.size()), w(patch.size());
  for (std::size_t n = 0; n < patch.size(); ++n) {
    const Facet& f = facets[patch[n]];
    const Vec3 r = (f.centroid - c.centroid) / kRadius;
    const double s = r.dot(x), t = r.dot(y), root = std::sqrt(f.area);
    const auto row = static_cast<Eigen::Index>(n);
    a.row(row) << 1, s, t, s * s, s * t, t * t;
    a.row(row) *= root;
    b(row) = root * r.dot(c.normal);
    w(row) = f.area;
  }
  const Eigen::VectorXd off = a * a.colPivHouseholderQr().solve(b) - b;
  return off.squaredNorm() / w.sum() * kRadius * kRadius;
}

}  // namespace

double surface_roughness(const CutFacets& facets) {
  const std::size_t stride = facets.size() / kPlaces + 1;
  std::vector<double> square((facets.size() + stride - 1) / stride);
  tbb::parallel_for(std::size_t{0}, square.size(), [&](std::size_t k) {
    square[k] = roughness_at(facets, static_cast<std::uint32_t>(k * stride));
  });
  double sum = 0;
  int count = 0;
  for (const double s : square)
    if (!std::isnan(s)) {
      sum += s;
      ++count;
    }
  return count > 0 ? std::sqrt(sum / count) : NAN;
}

LineAngles line_angle_radius(const CutFacets& facets, const std::vector<WallFacet>& walls,
                             const std::vector<Floor>& floors, const PreparationFrame& frame,
                             const TriangleTree& prepared) {
  Weighted radii, angles;
  for (const WallFacet& w : walls) {
    if (w.floor < 0 || !w.in_middle_third()) continue;
    const Facet& f = facets[w.facet];
    const FloorPlane& plane = floors[w.floor].plane;
    const Vec3 normal = plane.normal(frame);
    const Vec3 on_plane = frame.origin + plane.centre.x() * frame.u + plane.centre.y() * frame.v +
                          plane.level * frame.d;
    const Vec3 slope = (frame.d - frame.d.dot(f.normal) * f.normal).normalized();
    const double way = (f.centroid - on_plane).dot(normal) / slope.dot(normal);
    const double gap = prepared.nearest(f.centroid - way * slope).distance;
    const double angle = units::kPi - std::acos(std::clamp(f.normal.dot(normal), -1.0, 1.0));
    const double share = 1 / std::sin(angle / 2) - 1;
    if (!(share > 0.05)) continue;
    radii.add(gap / share, f.area);
    angles.add(units::to_degree(angle), f.area);
  }
  return {radii.quantile(0.5), angles.quantile(0.5)};
}

}  // namespace toothprep
