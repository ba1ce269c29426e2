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

const FlatCases& flat_cases() {
  static const FlatCases cases;
  return cases;
}

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

// The distances of the nodes in some planes: squares first, from the triangles of every cell within
// reach, then their roots with a sign. A minimum over the same triangles, whatever the slabs.
class Slab {
 public:
  Slab(const Index3& size, const float* field, float band, int first, int last, float* distance,
       const RowPart* wanted)
      : nx_(size.x()),
        ny_(size.y()),
        nz_(size.z()),
        z0_(first),
        z1_(last),
        row_(static_cast<std::size_t>(nx_)),
        plane_(row_ * static_cast<std::size_t>(ny_)),
        corner_{0, 1, row_, row_ + 1, plane_, plane_ + 1, plane_ + row_, plane_ + row_ + 1},
        band_(band),
        field_(field),
        best_(distance),
        wanted_(wanted) {}

  void fill() {
    std::fill(best_, best_ + static_cast<std::size_t>(z1_ - z0_) * plane_, band_ * band_);
    const int reach = static_cast<int>(std::ceil(band_));
    for (int k = std::max(0, z0_ - reach - 1); k < std::min(nz_ - 1, z1_ + reach); ++k)
      for (int j = 0; j + 1 < ny_; ++j) visit_row(j, k);
    const float* f = field_ + static_cast<std::size_t>(z0_) * plane_;
    for (std::size_t v = 0; v < static_cast<std::size_t>(z1_ - z0_) * plane_; ++v) {
      // Never zero: the sign must separate inside from outside.
      const float d = std::max(std::sqrt(best_[v]), 1e-6f);
      best_[v] = f[v] > 0 ? -d : d;
    }
  }

 private:
  // The cells along x.
  void visit_row(int j, int k) {
    const float* f =
        field_ + static_cast<std::size_t>(k) * plane_ + static_cast<std::size_t>(j) * row_;
    int left = 0;  // the pattern's bits of the corners at the cell's lower x
    for (int c = 0; c < 8; c += 2) left |= (f[corner_[c]] > 0) << c;
    for (int i = 0; i + 1 < nx_; ++i, ++f) {
      int right = 0;
      for (int c = 0; c < 8; c += 2) right |= (f[corner_[c + 1]] > 0) << c;
      const int inside = left | right << 1;
      left = right;
      if (cases_.triangles[inside] > 0) visit_cell(Index3(i, j, k), f, inside);
    }
  }

  void visit_cell(const Index3& cell, const float* f, int inside) {
    std::array<Vec3f, 12> point;
    for (int e = 0; e < 12; ++e) {
      const int from = cases_.from[e], to = cases_.to[e];
      if ((inside >> from & 1) == (inside >> to & 1)) continue;
      const float fa = f[corner_[from]], fb = f[corner_[to]];
      point[e] = Vec3f(from & 1, from >> 1 & 1, from >> 2);
      point[e][e / 4] += fa / (fa - fb);
    }
    for (int t = 0; t < cases_.triangles[inside]; ++t) {
      const auto* triple = &cases_.edges[inside][3 * t];
      lower(cell, Triangle(point[triple[0]], point[triple[1]], point[triple[2]]));
    }
  }

  // Of the nodes within the band of the ball around the triangle; others don't matter.
  void lower(const Index3& cell, const Triangle& triangle) {
    const int i = cell.x(), j = cell.y(), k = cell.z();
    const float ball = band_ + triangle.radius;
    const Vec3f& centre = triangle.centre;
    const auto first = [](float x, int offset, int least) {
      return std::max(least, offset + static_cast<int>(std::ceil(x)));
    };
    const auto last = [](float x, int offset, int most) {
      return std::min(most, offset + static_cast<int>(std::floor(x)));
    };
    const int ya = first(centre.y() - ball, j, 0), yb = last(centre.y() + ball, j, ny_ - 1);
    const int za = first(centre.z() - ball, k, z0_), zb = last(centre.z() + ball, k, z1_ - 1);
    for (int z = za; z <= zb; ++z)
      for (int y = ya; y <= yb; ++y) {
        const float dy = static_cast<float>(y - j) - centre.y();
        const float dz = static_cast<float>(z - k) - centre.z();
        const float half2 = ball * ball - dy * dy - dz * dz;
        if (half2 <= 0) continue;
        const std::size_t r = static_cast<std::size_t>(z - z0_) * static_cast<std::size_t>(ny_) +
                              static_cast<std::size_t>(y);
        const RowPart part = wanted_ ? wanted_[r] : RowPart{0, nx_};
        const float half = std::sqrt(half2);
        const int xb = last(centre.x() + half, i, nx_ - 1);
        float* line = best_ + r * row_;
        // Where the lanes begin decides their last bit, so it doesn't depend on what is wanted.
        for (int x = first(centre.x() - half, i, 0); x <= xb && x < part.end; x += kLanes) {
          if (x + kLanes <= part.first) continue;
          std::array<float, kLanes> d2;
          triangle.squared_distances(Vec3f(static_cast<float>(x - i), static_cast<float>(y - j),
                                           static_cast<float>(z - k)),
                                     d2);
          const int lanes = std::min(kLanes, xb - x + 1);
          for (int n = 0; n < lanes; ++n)
            line[x + n] = std::min(line[x + n], d2[static_cast<std::size_t>(n)]);
        }
      }
  }

  const FlatCases& cases_ = flat_cases();
  int nx_, ny_, nz_, z0_, z1_;
  std::size_t row_, plane_;
  std::array<std::size_t, 8> corner_;
  float band_;
  const float* field_;
  float* best_;
  const RowPart* wanted_;
};

}  // namespace

std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band) {
  std::vector<float> distance(field.size());
  const std::size_t plane = static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y());
  constexpr int kPlanes = 16;
  tbb::parallel_for(0, (size.z() + kPlanes - 1) / kPlanes, [&](int slab) {
    const int first = slab * kPlanes;
    iso_distance_in(size, field.data(), band, first, std::min(size.z(), first + kPlanes),
                    distance.data() + static_cast<std::size_t>(first) * plane);
  });
  return distance;
}

void iso_distance_in(const Index3& size, const float* field, float band, int first, int last,
                     float* distance, const RowPart* wanted) {
  Slab(size, field, band, first, last, distance, wanted).fill();
}

}  // namespace toothprep
