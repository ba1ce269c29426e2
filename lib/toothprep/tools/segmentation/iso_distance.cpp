#include "toothprep/tools/segmentation/iso_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "toothprep/step/tooth/cell_cases.h"

namespace toothprep {
namespace {

using Vec3f = Eigen::Vector3f;

// The triangles of each of the 256 sign patterns, as triples of edges, which run from a lower
// corner along an axis (edge / 4): the loops of the shared cases, each a fan from its first edge.
struct FlatCases {
  std::array<int, 12> from{}, to{};  // corners of an edge
  std::array<std::uint8_t, 256> triangles{};
  std::array<std::array<std::uint8_t, 30>, 256> edges{};

  FlatCases() {
    const CellCases& shared = cell_cases();
    for (int e = 0; e < 12; ++e) {
      from[e] = shared.edges[e].base;
      to[e] = shared.edges[e].base | 1 << shared.edges[e].axis;
    }
    for (int inside = 0; inside < 256; ++inside) {
      const CellCase& cell = shared.cases[inside];
      for (int l = 0; l < cell.loops; ++l) {
        std::array<std::uint8_t, 7> loop = cell.loop[l].edge;
        const int length = cell.loop[l].size;
        // Which way a loop is walked decides the last bit of a distance. Here its second edge is
        // the one that shares with the first the face across the higher axis.
        const CellEdge &first = shared.edges[loop[0]], &second = shared.edges[loop[1]];
        const int across = first.axis == 2 ? 1 : 2;
        if (second.axis == across || ((first.base ^ second.base) >> across & 1))
          std::reverse(loop.begin() + 1, loop.begin() + length);
        for (int t = 1; t + 1 < length; ++t) {
          auto* triple = &edges[inside][3 * triangles[inside]++];
          triple[0] = loop[0];
          triple[1] = loop[t];
          triple[2] = loop[t + 1];
        }
      }
    }
  }
};

constexpr int kLanes = 8;

// Squared distances of points in a row along x to a triangle. Along the row all products are linear
// in x, and there is no branch, so that the compiler turns a call into a few vector instructions.
struct Triangle {
  Vec3f a, ab, ac, bc, normal;            // normal: unit, or zero for a sliver
  float d00, d01, d11, d22, area2;        // products of the edges; twice the area, squared
  float inverse00, inverse11, inverse22;  // of the squared lengths, 0 for a point
  Vec3f centre;                           // of a ball around the triangle
  float radius;

  Triangle(const Vec3f& a_, const Vec3f& b, const Vec3f& c)
      : a(a_), ab(b - a_), ac(c - a_), bc(c - b), normal(ab.cross(ac)) {
    d00 = ab.squaredNorm();
    d01 = ab.dot(ac);
    d11 = ac.squaredNorm();
    d22 = bc.squaredNorm();
    const auto inverse = [](float x) { return x > 1e-12f ? 1 / x : 0.0f; };
    inverse00 = inverse(d00);
    inverse11 = inverse(d11);
    inverse22 = inverse(d22);
    area2 = normal.squaredNorm();
    if (area2 > 1e-12f) {
      normal /= std::sqrt(area2);
    } else {
      area2 = -1;  // no point projects into it
      normal.setZero();
    }
    centre = a + (ab + ac) / 3;
    radius = std::sqrt(std::max(
        {(a_ - centre).squaredNorm(), (b - centre).squaredNorm(), (c - centre).squaredNorm()}));
  }

  // Of the points first + (n, 0, 0).
  void squared_distances(const Vec3f& first, std::array<float, kLanes>& result) const {
    const Vec3f p = first - a, q = p - ab;
    const float p_ab = p.dot(ab), p_ac = p.dot(ac), q_bc = q.dot(bc), height = p.dot(normal);
    const float p_side = p.tail<2>().squaredNorm(), q_side = q.tail<2>().squaredNorm();
    const auto to_segment = [](float squared, float along, float length2, float inverse) {
      const float t = std::min(std::max(along * inverse, 0.0f), 1.0f);
      return squared - t * (2 * along - t * length2);
    };
    for (int n = 0; n < kLanes; ++n) {
      const auto s = static_cast<float>(n);
      const float d20 = p_ab + s * ab.x(), d21 = p_ac + s * ac.x(), d22_ = q_bc + s * bc.x();
      const float h = height + s * normal.x();
      const float px = p.x() + s, qx = q.x() + s;
      const float pp = px * px + p_side, qq = qx * qx + q_side;
      const float edges = std::min(
          to_segment(pp, d20, d00, inverse00),
          std::min(to_segment(pp, d21, d11, inverse11), to_segment(qq, d22_, d22, inverse22)));
      const float v = d11 * d20 - d01 * d21, w = d00 * d21 - d01 * d20;
      // All three weights of the projection's barycentric coordinates positive: the face is
      // nearest.
      const float least = std::min(std::min(v, w), area2 - v - w);
      const float face = h * h;
      result[static_cast<std::size_t>(n)] = least >= 0 ? face : std::max(edges, 0.0f);
    }
  }
};

}  // namespace

std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band) {
  static const FlatCases cases;
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
    std::fill(best, best + static_cast<std::size_t>(z1 - z0) * plane, band * band);
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
            const int from = cases.from[e], to = cases.to[e];
            if ((inside >> from & 1) == (inside >> to & 1)) continue;
            const float fa = f[corner[from]], fb = f[corner[to]];
            point[e] = Vec3f(from & 1, from >> 1 & 1, from >> 2);
            point[e][e / 4] += fa / (fa - fb);
          }
          for (int t = 0; t < count; ++t) {
            const auto* triple = &cases.edges[inside][3 * t];
            const Triangle triangle(point[triple[0]], point[triple[1]], point[triple[2]]);
            // Nodes beyond the band from the ball around the triangle don't matter.
            const float ball = band + triangle.radius;
            const Vec3f& centre = triangle.centre;
            const auto first = [](float x, int offset, int least) {
              return std::max(least, offset + static_cast<int>(std::ceil(x)));
            };
            const auto last = [](float x, int offset, int most) {
              return std::min(most, offset + static_cast<int>(std::floor(x)));
            };
            const int ya = first(centre.y() - ball, j, 0), yb = last(centre.y() + ball, j, ny - 1);
            const int za = first(centre.z() - ball, k, z0), zb = last(centre.z() + ball, k, z1 - 1);
            for (int z = za; z <= zb; ++z)
              for (int y = ya; y <= yb; ++y) {
                const float dy = static_cast<float>(y - j) - centre.y();
                const float dz = static_cast<float>(z - k) - centre.z();
                const float half2 = ball * ball - dy * dy - dz * dz;
                if (half2 <= 0) continue;
                const float half = std::sqrt(half2);
                const int xb = last(centre.x() + half, i, nx - 1);
                float* line = best + static_cast<std::size_t>(z - z0) * plane +
                              static_cast<std::size_t>(y) * row;
                for (int x = first(centre.x() - half, i, 0); x <= xb; x += kLanes) {
                  std::array<float, kLanes> d2;
                  triangle.squared_distances(
                      Vec3f(static_cast<float>(x - i), static_cast<float>(y - j),
                            static_cast<float>(z - k)),
                      d2);
                  const int lanes = std::min(kLanes, xb - x + 1);
                  for (int n = 0; n < lanes; ++n)
                    line[x + n] = std::min(line[x + n], d2[static_cast<std::size_t>(n)]);
                }
              }
          }
        }
      }
    const float* f = field.data() + static_cast<std::size_t>(z0) * plane;
    for (std::size_t v = 0; v < static_cast<std::size_t>(z1 - z0) * plane; ++v) {
      // Never zero: the sign must tell inside from outside.
      const float d = std::max(std::sqrt(best[v]), 1e-6f);
      best[v] = f[v] > 0 ? -d : d;
    }
  });
  return distance;
}

}  // namespace toothprep
