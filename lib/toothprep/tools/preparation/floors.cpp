#include "toothprep/tools/preparation/floors.h"

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

double FloorPlane::tilt_deg() const { return units::to_degree(std::atan(slope.norm())); }

Vec3 FloorPlane::normal(const PreparationFrame& frame) const {
  return (frame.d - slope.x() * frame.u - slope.y() * frame.v).normalized();
}

std::vector<Floor> find_floors(const CutFacets& facets, const PreparationFrame& frame,
                               double smallest) {
  std::vector<Floor> floors;
  const double level = std::sqrt(0.5);
  for (auto& piece :
       facets.pieces([&](std::size_t i) { return facets[i].normal.dot(frame.d) > level; })) {
    Floor floor;
    floor.area = facets.area(piece);
    if (floor.area < smallest) break;
    for (const std::uint32_t i : piece)
      if (!facets[i].crease && !facets[i].rim) floor.core.push_back(i);
    if (facets.area(floor.core) < floor.area / 3) floor.core = piece;  // rough all over
    floor.facets = std::move(piece);
    double weight = 0;
    Vec3 mean = Vec3::Zero();
    for (const std::uint32_t i : floor.core) {
      const Facet& f = facets[i];
      mean += f.area *
              Vec3(frame.along_u(f.centroid), frame.along_v(f.centroid), frame.height(f.centroid));
      weight += f.area;
    }
    mean /= weight;
    Eigen::Matrix2d a = Eigen::Matrix2d::Zero();
    Vec2 b = Vec2::Zero();
    const auto relative = [&](const Facet& f) -> Vec3 {
      return Vec3(frame.along_u(f.centroid), frame.along_v(f.centroid), frame.height(f.centroid)) -
             mean;
    };
    for (const std::uint32_t i : floor.core) {
      const Vec3 x = relative(facets[i]);
      a += facets[i].area * x.head<2>() * x.head<2>().transpose();
      b += facets[i].area * x.z() * x.head<2>();
    }
    floor.plane.centre = mean.head<2>();
    floor.plane.level = mean.z();
    floor.plane.slope = a.completeOrthogonalDecomposition().solve(b);
    const double cosine = 1 / std::sqrt(1 + floor.plane.slope.squaredNorm());
    double square = 0;
    for (const std::uint32_t i : floor.core) {
      const Vec3 x = relative(facets[i]);
      const double off = (x.z() - floor.plane.slope.dot(x.head<2>())) * cosine;
      square += facets[i].area * off * off;
    }
    floor.flatness = std::sqrt(square / weight);
    floors.push_back(std::move(floor));
  }
  return floors;
}

double Weighted::quantile(double q) const {
  return values_.empty() ? std::numeric_limits<double>::quiet_NaN() : weighted_quantile(values_, q);
}

double Weighted::mean() const {
  double sum = 0, total = 0;
  for (const auto& [value, weight] : values_) {
    sum += weight * value;
    total += weight;
  }
  return sum / total;
}

double Weighted::weight() const {
  double total = 0;
  for (const auto& value : values_) total += value.weight;
  return total;
}

Weighted depths_below(const std::vector<std::uint32_t>& of_floor, const CutFacets& facets,
                      const PreparationFrame& frame, const TriangleTree& original) {
  Weighted depths;
  for (const std::uint32_t i : of_floor)
    if (const auto hit = original.first_hit(facets[i].centroid, frame.d))
      depths.add(hit->distance, facets[i].area);
  return depths;
}

}  // namespace toothprep
