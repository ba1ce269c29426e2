#include "toothprep/scan/iso_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace toothprep {
namespace {

using Vec3f = Eigen::Vector3f;

// A cell's corner c stands at (c & 1, c >> 1 & 1, c >> 2). Edges run along x, y, z from lower
// corners.
struct Edge {
  int from, to;
};
constexpr std::array<Edge, 12> kEdges = {{{0, 1},
                                          {2, 3},
                                          {4, 5},
                                          {6, 7},
                                          {0, 2},
                                          {1, 3},
                                          {4, 6},
                                          {5, 7},
                                          {0, 4},
                                          {1, 5},
                                          {2, 6},
                                          {3, 7}}};
constexpr std::array<std::array<int, 4>, 6> kFaces = {
    {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}};

int edge_between(int a, int b) {
  for (int e = 0; e < 12; ++e)
    if ((kEdges[e].from == a && kEdges[e].to == b) || (kEdges[e].from == b && kEdges[e].to == a))
      return e;
  return -1;
}

// The triangles of each of the 256 sign patterns, as triples of edges. They are derived rather than
// listed: on every face of the cell the surface is one segment, or two that cut off the inside
// corners one by one; the segments close to loops, and each loop is a fan.
struct CellCases {
  std::array<std::uint8_t, 256> triangles{};
  std::array<std::array<std::uint8_t, 30>, 256> edges{};

  CellCases() {
    for (int inside = 0; inside < 256; ++inside) {
      std::array<std::array<int, 2>, 12> next{};  // the two edges that follow an edge
      std::array<int, 12> degree{};
      const auto join = [&](int a, int b) {
        next[a][degree[a]++] = b;
        next[b][degree[b]++] = a;
      };
      const auto in = [inside](int corner) { return (inside >> corner & 1) != 0; };
      for (const auto& face : kFaces) {
        std::array<int, 4> crossing{};
        int crossings = 0;
        for (int s = 0; s < 4; ++s)
          if (in(face[s]) != in(face[(s + 1) % 4]))
            crossing[crossings++] = edge_between(face[s], face[(s + 1) % 4]);
        if (crossings == 2) join(crossing[0], crossing[1]);
        if (crossings == 4)
          for (int s = 0; s < 4; ++s)
            if (in(face[s]))
              join(edge_between(face[s], face[(s + 1) % 4]),
                   edge_between(face[s], face[(s + 3) % 4]));
      }
      std::array<bool, 12> done{};
      for (int start = 0; start < 12; ++start) {
        if (degree[start] != 2 || done[start]) continue;
        std::array<int, 12> loop{};
        int length = 0, previous = -1, e = start;
        do {
          loop[length++] = e;
          done[e] = true;
          const int step = next[e][0] != previous ? next[e][0] : next[e][1];
          previous = e;
          e = step;
        } while (e != start && length < 12);
        for (int t = 1; t + 1 < length; ++t) {
          auto* triple = &edges[inside][3 * triangles[inside]++];
          triple[0] = static_cast<std::uint8_t>(loop[0]);
          triple[1] = static_cast<std::uint8_t>(loop[t]);
          triple[2] = static_cast<std::uint8_t>(loop[t + 1]);
        }
      }
    }
  }
};

struct Triangle {
  Vec3f a, ab, ac, normal;  // normal: unit, or zero for a sliver
  float d00, d01, d11, area2;
  Vec3f centre;  // a ball around the triangle
  float radius;

  Triangle(const Vec3f& a_, const Vec3f& b, const Vec3f& c) : a(a_), ab(b - a_), ac(c - a_) {
    normal = ab.cross(ac);
    area2 = normal.squaredNorm();
    normal = area2 > 1e-12f ? Vec3f(normal / std::sqrt(area2)) : Vec3f::Zero();
    d00 = ab.squaredNorm();
    d01 = ab.dot(ac);
    d11 = ac.squaredNorm();
    centre = a + (ab + ac) / 3;
    radius = std::sqrt(std::max(
        {(a_ - centre).squaredNorm(), (b - centre).squaredNorm(), (c - centre).squaredNorm()}));
  }

  static float to_segment(const Vec3f& p, const Vec3f& d, float d2) {  // squared, segment 0 .. d
    const float t = d2 > 0 ? std::clamp(p.dot(d) / d2, 0.0f, 1.0f) : 0.0f;
    return (p - t * d).squaredNorm();
  }

  float squared_distance(const Vec3f& x) const {
    const Vec3f p = x - a;
    if (area2 > 1e-12f) {
      const float d20 = p.dot(ab), d21 = p.dot(ac);
      const float v = d11 * d20 - d01 * d21, w = d00 * d21 - d01 * d20;
      if (v >= 0 && w >= 0 && v + w <= area2) {
        const float h = p.dot(normal);
        return h * h;
      }
    }
    const Vec3f bc = ac - ab;
    return std::min(
        {to_segment(p, ab, d00), to_segment(p, ac, d11), to_segment(p - ab, bc, bc.squaredNorm())});
  }
};

}  // namespace

std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band) {
  static const CellCases cases;
  const int nx = size.x(), ny = size.y(), nz = size.z();
  const std::size_t row = static_cast<std::size_t>(nx), plane = row * static_cast<std::size_t>(ny);
  const std::array<std::size_t, 8> corner = {0,     1,         row,         row + 1,
                                             plane, plane + 1, plane + row, plane + row + 1};
  std::vector<float> distance(field.size());
  const int reach = static_cast<int>(std::ceil(band));
  constexpr int kSlab = 16;
  const int slabs = (nz + kSlab - 1) / kSlab;

  // Each slab of the result is one task that visits all cells within reach: a minimum over the same
  // triangles whatever the order of tasks.
  tbb::parallel_for(0, slabs, [&](int slab) {
    const int z0 = slab * kSlab, z1 = std::min(nz, z0 + kSlab);
    float* best = distance.data() + static_cast<std::size_t>(z0) * plane;
    std::fill(best, best + static_cast<std::size_t>(z1 - z0) * plane, band);
    for (int k = std::max(0, z0 - reach - 1); k < std::min(nz - 1, z1 + reach); ++k)
      for (int j = 0; j + 1 < ny; ++j) {
        const float* f =
            field.data() + static_cast<std::size_t>(k) * plane + static_cast<std::size_t>(j) * row;
        int left = 0;  // the pattern's bits of the corners at the cell's lower x
        for (int c = 0; c < 8; c += 2) left |= (f[corner[c]] > 0) << c;
        for (int i = 0; i + 1 < nx; ++i, ++f) {
          int right = 0;
          for (int c = 0; c < 8; c += 2) right |= (f[corner[c + 1]] > 0) << c;
          const int inside = left | right << 1;
          left = right;
          const int count = cases.triangles[inside];
          if (count == 0) continue;
          std::array<Vec3f, 12> point;
          for (int e = 0; e < 12; ++e) {
            const auto [from, to] = kEdges[e];
            if ((inside >> from & 1) == (inside >> to & 1)) continue;
            const float fa = f[corner[from]], fb = f[corner[to]];
            point[e] = Vec3f(from & 1, from >> 1 & 1, from >> 2);
            point[e][e / 4] += fa / (fa - fb);
          }
          for (int t = 0; t < count; ++t) {
            const auto* triple = &cases.edges[inside][3 * t];
            const Triangle triangle(point[triple[0]], point[triple[1]], point[triple[2]]);
            // Nodes beyond the band from the ball around the triangle don't matter, nor do those
            // for which its plane or this ball is farther than what they have already.
            const float ball = band + triangle.radius;
            const Vec3f& centre = triangle.centre;
            const auto first = [](float x, int offset, int least) {
              return std::max(least, offset + static_cast<int>(std::ceil(x)));
            };
            const auto last = [](float x, int offset, int most) {
              return std::min(most, offset + static_cast<int>(std::floor(x)));
            };
            for (int z = first(centre.z() - ball, k, z0); z <= last(centre.z() + ball, k, z1 - 1);
                 ++z)
              for (int y = first(centre.y() - ball, j, 0); y <= last(centre.y() + ball, j, ny - 1);
                   ++y) {
                const Vec3f from_centre =
                    Vec3f(0, static_cast<float>(y - j), static_cast<float>(z - k)) -
                    Vec3f(0, centre.y(), centre.z());
                const float beside = from_centre.squaredNorm();
                if (beside >= ball * ball) continue;
                const float half = std::sqrt(ball * ball - beside);
                const int xa = first(centre.x() - half, i, 0),
                          xb = last(centre.x() + half, i, nx - 1);
                float* line = best + static_cast<std::size_t>(z - z0) * plane +
                              static_cast<std::size_t>(y) * row;
                const Vec3f x(static_cast<float>(xa - i), static_cast<float>(y - j),
                              static_cast<float>(z - k));
                const float height = triangle.normal.dot(x - triangle.a);
                for (int n = xa; n <= xb; ++n) {
                  const float step = static_cast<float>(n - xa);
                  const float h = height + step * triangle.normal.x();
                  const float dx = x.x() + step - centre.x();
                  const float limit = line[n] + triangle.radius;
                  if (std::abs(h) < line[n] && dx * dx + beside < limit * limit)
                    line[n] = std::min(line[n],
                                       std::sqrt(triangle.squared_distance(x + Vec3f(step, 0, 0))));
                }
              }
          }
        }
      }
    const float* f = field.data() + static_cast<std::size_t>(z0) * plane;
    for (std::size_t v = 0; v < static_cast<std::size_t>(z1 - z0) * plane; ++v) {
      // Never zero: the sign must tell inside from outside.
      const float d = std::max(best[v], 1e-6f);
      best[v] = f[v] > 0 ? -d : d;
    }
  });
  return distance;
}

}  // namespace toothprep
