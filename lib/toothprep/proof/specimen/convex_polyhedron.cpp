#include "toothprep/proof/specimen/convex_polyhedron.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace toothprep {
namespace {

constexpr double kOnPlane = 1e-10;  // mm

double side(const HalfSpace& plane, const Vec3& x) { return plane.normal.dot(x) - plane.offset; }

double distance_to_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 ab = b - a;
  const double t = std::clamp((x - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
  return (x - a - t * ab).norm();
}

double distance_to_face(const Vec3& x, const PolyhedronFace& face) {
  const std::size_t n = face.corners.size();
  bool above = true;
  for (std::size_t i = 0; i < n && above; ++i) {
    const Vec3 edge = face.corners[(i + 1) % n] - face.corners[i];
    above = face.plane.normal.cross(edge).dot(x - face.corners[i]) >= 0;
  }
  if (above) return std::abs(side(face.plane, x));
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < n; ++i)
    least = std::min(least, distance_to_segment(x, face.corners[i], face.corners[(i + 1) % n]));
  return least;
}

// Least distance of two segments (Ericson, Real-Time Collision Detection, 5.1.9).
double distance_of_segments(const Vec3& p1, const Vec3& q1, const Vec3& p2, const Vec3& q2) {
  const Vec3 d1 = q1 - p1, d2 = q2 - p2, r = p1 - p2;
  const double a = d1.squaredNorm(), e = d2.squaredNorm(), f = d2.dot(r), c = d1.dot(r),
               b = d1.dot(d2), denominator = a * e - b * b;
  double s = denominator > 1e-14 * a * e ? std::clamp((b * f - c * e) / denominator, 0.0, 1.0) : 0;
  double t = (b * s + f) / e;
  if (t < 0 || t > 1) {
    t = std::clamp(t, 0.0, 1.0);
    s = std::clamp((b * t - c) / a, 0.0, 1.0);
  }
  return (p1 + s * d1 - p2 - t * d2).norm();
}

struct Edge {
  Vec3 from, to;
  Vec3 normal_a, normal_b;  // of the two faces; the edge runs counter-clockwise round face a
};

// Each edge once.
std::vector<Edge> edges_of(const ConvexPolyhedron& body) {
  std::vector<Edge> edges;
  for (std::size_t f = 0; f < body.faces.size(); ++f)
    for (std::size_t i = 0; i < body.faces[f].corners.size(); ++i) {
      const auto& corners = body.faces[f].corners;
      const Vec3 &a = corners[i], &b = corners[(i + 1) % corners.size()];
      for (std::size_t g = f + 1; g < body.faces.size(); ++g)
        for (std::size_t j = 0; j < body.faces[g].corners.size(); ++j) {
          const auto& other = body.faces[g].corners;
          if ((other[j] - b).norm() < 1e-8 && (other[(j + 1) % other.size()] - a).norm() < 1e-8)
            edges.push_back({a, b, body.faces[f].plane.normal, body.faces[g].plane.normal});
        }
    }
  return edges;
}

// Solid angle that three unit vectors span (van Oosterom and Strackee, IEEE Trans Biomed Eng
// 1983;30:125-126).
double solid_angle(const Vec3& a, const Vec3& b, const Vec3& c) {
  return std::abs(2 * std::atan2(a.dot(b.cross(c)), 1 + a.dot(b) + b.dot(c) + c.dot(a)));
}

}  // namespace

HalfSpace half_space(const Vec3& normal, const Vec3& point) {
  const Vec3 unit = normal.normalized();
  return {unit, unit.dot(point)};
}

double ConvexPolyhedron::distance(const Vec3& x) const {
  double nearest_plane = -std::numeric_limits<double>::infinity();
  for (const PolyhedronFace& face : faces)
    nearest_plane = std::max(nearest_plane, side(face.plane, x));
  if (nearest_plane <= 0) return nearest_plane;
  double least = std::numeric_limits<double>::infinity();
  for (const PolyhedronFace& face : faces)
    // The nearest point of a convex body lies on a face that looks towards x.
    if (side(face.plane, x) > 0) least = std::min(least, distance_to_face(x, face));
  return least;
}

ConvexPolyhedron box_polyhedron(const Vec3& low, const Vec3& high) {
  ConvexPolyhedron box;
  for (int axis = 0; axis < 3; ++axis)
    for (const int sign : {-1, 1}) {
      PolyhedronFace face;
      face.plane.normal = sign * Vec3::Unit(axis);
      face.plane.offset = sign > 0 ? high[axis] : -low[axis];
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (const auto& [at_u, at_v] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
        Vec3 corner;
        corner[axis] = sign > 0 ? high[axis] : low[axis];
        corner[u] = at_u ? high[u] : low[u];
        corner[v] = at_v ? high[v] : low[v];
        face.corners.push_back(corner);
      }
      if (sign < 0) std::reverse(face.corners.begin(), face.corners.end());
      box.faces.push_back(std::move(face));
    }
  return box;
}

ConvexPolyhedron clipped(const ConvexPolyhedron& body, const HalfSpace& plane) {
  bool any_in = false, any_out = false;
  for (const PolyhedronFace& face : body.faces)
    for (const Vec3& corner : face.corners) {
      any_in |= side(plane, corner) < -kOnPlane;
      any_out |= side(plane, corner) > kOnPlane;
    }
  if (!any_out) return body;
  if (!any_in) return {};

  ConvexPolyhedron result;
  std::vector<Vec3> cut;
  const auto add_cut = [&](const Vec3& x) {
    if (std::none_of(cut.begin(), cut.end(), [&](const Vec3& y) { return (x - y).norm() < 1e-9; }))
      cut.push_back(x);
  };
  for (const PolyhedronFace& face : body.faces) {
    PolyhedronFace kept{face.plane, {}};
    for (std::size_t i = 0; i < face.corners.size(); ++i) {
      const Vec3 &a = face.corners[i], &b = face.corners[(i + 1) % face.corners.size()];
      const double sa = side(plane, a), sb = side(plane, b);
      if (sa <= kOnPlane) kept.corners.push_back(a);
      if (std::abs(sa) <= kOnPlane) add_cut(a);
      if ((sa < -kOnPlane && sb > kOnPlane) || (sa > kOnPlane && sb < -kOnPlane)) {
        // From the same end whichever face it is met from.
        const Vec3 x =
            sa < sb ? Vec3(a + sa / (sa - sb) * (b - a)) : Vec3(b + sb / (sb - sa) * (a - b));
        kept.corners.push_back(x);
        add_cut(x);
      }
    }
    if (kept.corners.size() >= 3) result.faces.push_back(std::move(kept));
  }
  Vec3 centre = Vec3::Zero();
  for (const Vec3& x : cut) centre += x / static_cast<double>(cut.size());
  const Vec3 u = plane.normal.unitOrthogonal(), v = plane.normal.cross(u);
  std::sort(cut.begin(), cut.end(), [&](const Vec3& a, const Vec3& b) {
    return std::atan2(v.dot(a - centre), u.dot(a - centre)) <
           std::atan2(v.dot(b - centre), u.dot(b - centre));
  });
  if (cut.size() >= 3) result.faces.push_back({plane, std::move(cut)});
  return result;
}

ConvexPolyhedron intersection(ConvexPolyhedron a, const ConvexPolyhedron& b) {
  if (b.empty()) return {};
  for (const PolyhedronFace& face : b.faces) a = clipped(a, face.plane);
  return a;
}

ConvexPolyhedron planes_moved(const ConvexPolyhedron& body, double distance) {
  if (body.empty() || distance == 0) return body;
  Vec3 low = body.faces[0].corners[0], high = low;
  for (const PolyhedronFace& face : body.faces)
    for (const Vec3& x : face.corners) {
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
  // Corners may move much further than the planes, where these meet at a sharp angle.
  const Vec3 room = Vec3::Constant(10 * ((high - low).maxCoeff() + std::abs(distance)));
  ConvexPolyhedron result = box_polyhedron(low - room, high + room);
  for (PolyhedronFace face : body.faces) {
    face.plane.offset += distance;
    result = clipped(result, face.plane);
  }
  return result;
}

Vec3 area_vector(const std::vector<Vec3>& polygon) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
    sum += (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]) / 2;
  return sum;
}

double area_mm2(const std::vector<Vec3>& polygon) { return area_vector(polygon).norm(); }

double volume_mm3(const ConvexPolyhedron& body) {
  if (body.empty()) return 0;
  // Cones from a corner of the body, so that nothing large cancels.
  const Vec3 apex = body.faces[0].corners[0];
  double volume = 0;
  for (const PolyhedronFace& face : body.faces)
    volume -= area_mm2(face.corners) * side(face.plane, apex) / 3;
  return volume;
}

double distance_between(const ConvexPolyhedron& a, const ConvexPolyhedron& b) {
  if (volume_mm3(intersection(a, b)) > 0) return 0;
  double least = std::numeric_limits<double>::infinity();
  for (const PolyhedronFace& face : a.faces)
    for (const Vec3& x : face.corners) least = std::min(least, b.distance(x));
  for (const PolyhedronFace& face : b.faces)
    for (const Vec3& x : face.corners) least = std::min(least, a.distance(x));
  for (const PolyhedronFace& f : a.faces)
    for (std::size_t i = 0; i < f.corners.size(); ++i)
      for (const PolyhedronFace& g : b.faces)
        for (std::size_t j = 0; j < g.corners.size(); ++j)
          least = std::min(
              least, distance_of_segments(f.corners[i], f.corners[(i + 1) % f.corners.size()],
                                          g.corners[j], g.corners[(j + 1) % g.corners.size()]));
  return std::max(least, 0.0);
}

double shell_volume_mm3(const ConvexPolyhedron& body, double reach, const Vec3& axis, double low,
                        double high, bool& exact) {
  const HalfSpace above{axis, high}, below{-axis, -low};
  double volume = 0;
  for (const PolyhedronFace& face : body.faces) {
    ConvexPolyhedron prism;
    const Vec3 lift = reach * face.plane.normal;
    PolyhedronFace bottom{{-face.plane.normal, -face.plane.offset},
                          {face.corners.rbegin(), face.corners.rend()}},
        top{{face.plane.normal, face.plane.offset + reach}, {}};
    for (std::size_t i = 0; i < face.corners.size(); ++i) {
      const Vec3 &a = face.corners[i], &b = face.corners[(i + 1) % face.corners.size()];
      top.corners.push_back(a + lift);
      prism.faces.push_back({half_space((b - a).cross(lift), a), {a, b, b + lift, a + lift}});
    }
    prism.faces.push_back(std::move(bottom));
    prism.faces.push_back(std::move(top));
    volume += volume_mm3(clipped(clipped(prism, above), below));
  }
  for (const Edge& edge : edges_of(body)) {
    const double angle =
        std::atan2(edge.normal_a.cross(edge.normal_b).norm(), edge.normal_a.dot(edge.normal_b));
    const Vec3 along = edge.to - edge.from;
    // Heights that the sector's directions reach: along the arc from one normal to the other.
    const Vec3 across =
        (edge.normal_b - edge.normal_a.dot(edge.normal_b) * edge.normal_a).normalized();
    double lowest = 0, highest = 0;
    for (int i = 0; i <= 64; ++i) {
      const double phi = angle * i / 64;
      const double h = reach * axis.dot(std::cos(phi) * edge.normal_a + std::sin(phi) * across);
      lowest = std::min(lowest, h);
      highest = std::max(highest, h);
    }
    const double from = axis.dot(edge.from), to = axis.dot(edge.to);
    const double bottom = std::min(from, to), top = std::max(from, to);
    // The volume of the sector below a level: where the level crosses the edge itself the edge's
    // length below it, moved linearly by the height of the sector's points.
    const auto below_level = [&](double level) {
      const double sector = angle * reach * reach / 2;
      if (level >= top + highest - kOnPlane) return sector * along.norm();
      if (level <= bottom + lowest + kOnPlane) return 0.0;
      if (level > bottom + highest && level < top + lowest) {
        const double per_height = along.norm() / (top - bottom);
        const double mean_height =  // ∫ axis·m(phi) dphi over the arc
            axis.dot(std::sin(angle) * edge.normal_a + (1 - std::cos(angle)) * across);
        return per_height * (sector * (level - bottom) - reach * reach * reach / 3 * mean_height);
      }
      exact = false;
      return level > (bottom + top) / 2 ? sector * along.norm() : 0.0;
    };
    volume += below_level(high) - below_level(low);
  }
  // At each corner the cone of its faces' normals, as triangles about the first.
  std::vector<Vec3> corners;
  for (const PolyhedronFace& face : body.faces)
    for (const Vec3& x : face.corners)
      if (std::none_of(corners.begin(), corners.end(),
                       [&](const Vec3& y) { return (x - y).norm() < 1e-8; }))
        corners.push_back(x);
  for (const Vec3& corner : corners) {
    std::vector<Vec3> normals;
    Vec3 mean = Vec3::Zero();
    for (const PolyhedronFace& face : body.faces)
      if (std::any_of(face.corners.begin(), face.corners.end(),
                      [&](const Vec3& x) { return (x - corner).norm() < 1e-8; })) {
        normals.push_back(face.plane.normal);
        mean += face.plane.normal;
      }
    const Vec3 u = mean.unitOrthogonal(), v = mean.normalized().cross(u);
    std::sort(normals.begin(), normals.end(), [&](const Vec3& a, const Vec3& b) {
      return std::atan2(v.dot(a), u.dot(a)) < std::atan2(v.dot(b), u.dot(b));
    });
    double angle = 0;
    for (std::size_t i = 1; i + 1 < normals.size(); ++i)
      angle += solid_angle(normals[0], normals[i], normals[i + 1]);
    const double height = axis.dot(corner);
    for (const double level : {low, high})
      if (std::abs(level - height) < reach - kOnPlane) exact = false;
    if (height > low && height < high) volume += angle * reach * reach * reach / 3;
  }
  return volume;
}

}  // namespace toothprep
