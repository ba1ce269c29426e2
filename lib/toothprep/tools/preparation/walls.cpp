#include "toothprep/tools/preparation/walls.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kLongestWall = 15;  // mm

// Horizontal unit vector of a wall's normal.
Vec3 direction_across(const Vec3& normal, const Vec3& d) {
  return (normal - normal.dot(d) * d).normalized();
}

double nearest_finish_height(const CutFacets& facets, const PreparationFrame& frame,
                             const Vec3& at) {
  double best = 1e30, height = 0;
  for (const FinishSegment& s : facets.finish_line()) {
    const double h = frame.height(s.middle);
    if (h > frame.height(at)) continue;
    const Vec3 offset = s.middle - at;
    const double distance = (offset - offset.dot(frame.d) * frame.d).squaredNorm();
    if (distance < best) {
      best = distance;
      height = h;
    }
  }
  return best < 1e30 ? height : std::nan("");
}

}  // namespace

Vec3 outward(Side side, const PreparationFrame& frame) {
  switch (side) {
    case Side::kMesial:
      return frame.u;
    case Side::kDistal:
      return -frame.u;
    case Side::kBuccal:
      return frame.v;
    default:
      return -frame.v;
  }
}

Side opposite(Side side) {
  constexpr std::array<Side, 4> kOther = {Side::kDistal, Side::kMesial, Side::kLingual,
                                          Side::kBuccal};
  return kOther[static_cast<int>(side)];
}

std::string side_name(Side side, const PreparationFrame& frame) {
  constexpr std::array<const char*, 4> kKnown = {"mesial", "distal", "buccal", "lingual"};
  constexpr std::array<const char*, 4> kPlain = {"u_plus", "u_minus", "v_plus", "v_minus"};
  return (frame.sides_known ? kKnown : kPlain)[static_cast<int>(side)];
}

std::vector<WallFacet> find_walls(const CutFacets& facets, const std::vector<Floor>& floors,
                                  const PreparationFrame& frame, const TriangleTree& prepared,
                                  PreparationType type, double voxel) {
  const double aside = std::max(2 * voxel, 0.15);  // off the wall, to look along it
  const double steep = std::sqrt(0.5);
  std::vector<WallFacet> walls;
  for (std::uint32_t i = 0; i < facets.size(); ++i) {
    const Facet& f = facets[i];
    const double up = f.normal.dot(frame.d);
    if (std::abs(up) > steep) continue;
    const Vec3 slope = (frame.d - up * f.normal).normalized();
    // A way that starts `aside` off a leaning wall starts higher or lower than the facet.
    const double off_the_wall = aside * up / slope.dot(frame.d);
    WallFacet w;
    w.facet = i;
    w.plain = !f.crease;
    const auto below = prepared.first_hit(f.centroid + aside * f.normal, -slope, 0, kLongestWall);
    double foot_height = 0;
    if (below && facets.facet_of(below->triangle) >= 0) {
      foot_height = frame.height(below->point);
      double nearest = 0.3;  // mm
      for (std::size_t n = 0; n < floors.size(); ++n) {
        const double off =
            std::abs(foot_height - floors[n].plane.height_at(frame.along_u(below->point),
                                                             frame.along_v(below->point)));
        if (off < nearest) {
          nearest = off;
          w.floor = static_cast<int>(n);
        }
      }
      w.foot = below->distance - off_the_wall;
    } else {
      foot_height = nearest_finish_height(facets, frame, f.centroid);
      if (std::isnan(foot_height)) continue;
      w.foot = (frame.height(f.centroid) - foot_height) / slope.dot(frame.d);
    }
    const auto above = prepared.first_hit(f.centroid - aside * f.normal, slope, 0, kLongestWall);
    if (!above) continue;
    w.rim = above->distance - off_the_wall;
    if (!(w.foot > 0 && w.rim > 0 && w.foot + w.rim > 3 * voxel)) continue;
    const Vec3 facing = direction_across(f.normal, frame.d);
    const Vec3 stands = type == PreparationType::kCrown ? facing : Vec3(-facing);
    const double u = stands.dot(frame.u), v = stands.dot(frame.v);
    w.side = std::abs(u) >= std::abs(v) ? (u > 0 ? Side::kMesial : Side::kDistal)
                                        : (v > 0 ? Side::kBuccal : Side::kLingual);
    walls.push_back(w);
  }
  return walls;
}

double Wall::distance_at(double height_of_point) const {
  const double lean = std::tan(units::from_degree(angle_deg));
  return distance + (cavity ? lean : -lean) * (height_of_point - level);
}

Wall wall_of(const std::vector<WallFacet>& walls, Side side, const CutFacets& facets,
             const PreparationFrame& frame, PreparationType type) {
  Wall wall;
  wall.side = side;
  wall.cavity = type != PreparationType::kCrown;
  const Vec3 out = outward(side, frame);
  double weight = 0, lean = 0;
  Weighted heights;
  for (const WallFacet& w : walls) {
    if (w.side != side) continue;
    const Facet& f = facets[w.facet];
    wall.area += f.area;
    const double up = f.normal.dot(frame.d);
    heights.add((w.foot + w.rim) * std::sqrt(1 - up * up), f.area);
    if (!w.in_middle_third() || !w.plain) continue;
    wall.middle.push_back(w);
    weight += f.area;
    lean += f.area * up;
    wall.distance += f.area * (f.centroid - frame.origin).dot(out);
    wall.level += f.area * frame.height(f.centroid);
  }
  if (wall.middle.size() < 10) return {side, {}, 0, 0, 0, 0, 0, wall.cavity};
  wall.angle_deg = units::to_degree(std::asin(std::clamp(lean / weight, -1.0, 1.0)));
  wall.distance /= weight;
  wall.level /= weight;
  wall.height = heights.quantile(0.5);
  return wall;
}

}  // namespace toothprep
