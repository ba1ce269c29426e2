#include "toothprep/tools/mesh/crossing_triangles.h"

#include <algorithm>
#include <cmath>

#include "toothprep/tools/mesh/nearest_in_triangle.h"

namespace toothprep {
namespace {

// Six times the volume of a tetrahedron of vertices. They are of single precision, so its sign is
// right but for volumes that are next to nothing.
double volume(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return (b - a).cross(c - a).dot(d - a);
}

constexpr double kFlat = 1e-6;  // mm: vertices as near to a plane as their rounding lie in it

// In the plane of a triangle with this normal: whether a segment passes through its inside.
bool segment_crosses_in_plane(const Vec3& p, const Vec3& q, const std::array<Vec3, 3>& t,
                              const Vec3& normal) {
  // Not if all of the triangle is beside the segment, or all of the segment beside one of its edges.
  const auto side = [&](const Vec3& a, const Vec3& b, const Vec3& c) {
    return (b - a).cross(c - a).dot(normal) / (b - a).norm();
  };
  std::array<double, 3> corner;
  for (int k = 0; k < 3; ++k) corner[k] = side(p, q, t[k]);
  if (*std::min_element(corner.begin(), corner.end()) > -kFlat ||
      *std::max_element(corner.begin(), corner.end()) < kFlat)
    return false;
  for (int k = 0; k < 3; ++k)
    if (std::max(side(t[k], t[(k + 1) % 3], p), side(t[k], t[(k + 1) % 3], q)) < kFlat)
      return false;
  return true;
}

// `normal`: of the triangle, twice its area long, and `flat` so much of it as its thickness is;
// `above`, `below`: volume() of the triangle and p or q.
bool segment_crosses(const Vec3& p, double above, const Vec3& q, double below,
                     const std::array<Vec3, 3>& t, const Vec3& normal, double flat) {
  if (std::abs(above) < flat && std::abs(below) < flat)
    return flat > 0 && segment_crosses_in_plane(p, q, t, normal.normalized());
  if (above * below > 0 || (above == 0 && below == 0)) return false;
  const std::array<double, 3> side = {volume(p, q, t[0], t[1]), volume(p, q, t[1], t[2]),
                                      volume(p, q, t[2], t[0])};
  return *std::min_element(side.begin(), side.end()) >= 0 ||
         *std::max_element(side.begin(), side.end()) <= 0;
}

}  // namespace

bool cross(const TriangleMesh& mesh, std::size_t a, std::size_t b) {
  const std::array<std::size_t, 2> triangle = {a, b};
  std::array<std::array<Vec3, 3>, 2> at;
  for (int side = 0; side < 2; ++side)
    for (int k = 0; k < 3; ++k)
      at[side][k] = mesh.vertices[mesh.triangles[triangle[side]][k]].cast<double>();
  for (int side = 0; side < 2; ++side) {
    const auto &own = mesh.triangles[triangle[side]], &other = mesh.triangles[triangle[1 - side]];
    const auto is_shared = [&](int k) {
      return std::find(other.begin(), other.end(), own[k]) != other.end();
    };
    const int shared = is_shared(0) + is_shared(1) + is_shared(2);
    if (shared > 1) continue;
    const std::array<Vec3, 3>&p = at[side], &t = at[1 - side];
    const Vec3 normal = (t[1] - t[0]).cross(t[2] - t[0]);
    const double flat = kFlat * normal.norm();
    std::array<double, 3> above;  // volume() of the other triangle and a vertex
    for (int k = 0; k < 3; ++k) above[k] = normal.dot(p[k] - t[0]);
    for (int k = 0; k < 3; ++k) {
      const int next = (k + 1) % 3;
      if (is_shared(k)) continue;
      if (!is_shared(next) &&
          segment_crosses(p[k], above[k], p[next], above[next], t, normal, flat))
        return true;
      if (std::abs(above[k]) <= flat && distance_to_triangle(t, p[k]) < kFlat) return true;
    }
  }
  return false;
}

}  // namespace toothprep
