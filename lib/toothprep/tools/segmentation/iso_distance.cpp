#include "toothprep/tools/segmentation/iso_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/tools/segmentation/wide_vectors.h"

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
using Lanes = std::array<float, kLanes>;

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

  // What of the products stays the same along a row, for rows beside each other: a lane each.
  struct Rows {
    Lanes x, q_x, p_side, q_side, p_ab, p_ac, q_bc, height;
  };
  // Of the points first + (0, n, 0), each moved along x by what `x` says.
  void rows_from(float y, float z, const Lanes& x, Rows& rows) const {
    const float pz = z - a.z(), qz = pz - ab.z();
    for (int n = 0; n < kLanes; ++n) {
      const float px = x[n] - a.x(), py = (y + static_cast<float>(n)) - a.y();
      const float qx = px - ab.x(), qy = py - ab.y();
      rows.x[n] = px;
      rows.q_x[n] = qx;
      rows.p_side[n] = py * py + pz * pz;
      rows.q_side[n] = qy * qy + qz * qz;
      rows.p_ab[n] = px * ab.x() + (py * ab.y() + pz * ab.z());
      rows.p_ac[n] = px * ac.x() + (py * ac.y() + pz * ac.z());
      rows.q_bc[n] = qx * bc.x() + (qy * bc.y() + qz * bc.z());
      rows.height[n] = px * normal.x() + (py * normal.y() + pz * normal.z());
    }
  }

  // Of the points from where row r begins on.
  void squared_distances(const Rows& rows, int r, Lanes& result) const {
    const float x = rows.x[r], q_x = rows.q_x[r], p_side = rows.p_side[r], q_side = rows.q_side[r],
                p_ab = rows.p_ab[r], p_ac = rows.p_ac[r], q_bc = rows.q_bc[r],
                height = rows.height[r];
    const auto to_segment = [](float squared, float along, float length2, float inverse) {
      const float t = std::min(std::max(along * inverse, 0.0f), 1.0f);
      return squared - t * (2 * along - t * length2);
    };
    for (int n = 0; n < kLanes; ++n) {
      const auto s = static_cast<float>(n);
      const float d20 = p_ab + s * ab.x(), d21 = p_ac + s * ac.x(), d22_ = q_bc + s * bc.x();
      const float h = height + s * normal.x();
      const float px = x + s, qx = q_x + s;
      const float pp = px * px + p_side, qq = qx * qx + q_side;
      const float edges = std::min(
          to_segment(pp, d20, d00, inverse00),
          std::min(to_segment(pp, d21, d11, inverse11), to_segment(qq, d22_, d22, inverse22)));
      const float v = d11 * d20 - d01 * d21, w = d00 * d21 - d01 * d20;
      // All three weights of the projection's barycentric coordinates positive: the face is
      // nearest.
      const float least = std::min(std::min(v, w), area2 - v - w);
      const float face = h * h;
      result[n] = least >= 0 ? face : std::max(edges, 0.0f);
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
        nodes_(static_cast<std::size_t>(last - first) * plane_),
        wanted_(wanted) {}

  void fill() {
    std::fill(best_, best_ + nodes_, band_ * band_);
    const int reach = static_cast<int>(std::ceil(band_));
    const int low = std::max(0, z0_ - reach - 1), high = std::min(nz_ - 1, z1_ + reach);
    positive_.resize(2 * plane_);
    cases_in_row_.resize(row_);
    if (low < high) find_signs(low);
    for (int k = low; k < high; ++k) {
      find_signs(k + 1);
      for (int j = 0; j + 1 < ny_; ++j) visit_row(j, k);
    }
    const float* f = field_ + static_cast<std::size_t>(z0_) * plane_;
    for (std::size_t v = 0; v < nodes_; ++v) {
      // Never zero: the sign must separate inside from outside.
      const float d = std::max(std::sqrt(best_[v]), 1e-6f);
      best_[v] = f[v] > 0 ? -d : d;
    }
  }

 private:
  // Ones where the field is positive; of two planes at a time.
  std::uint8_t* signs_of(int k) { return positive_.data() + (k % 2 ? plane_ : 0); }
  void find_signs(int k) {
    const float* f = field_ + static_cast<std::size_t>(k) * plane_;
    std::uint8_t* positive = signs_of(k);
    for (std::size_t v = 0; v < plane_; ++v) positive[v] = f[v] > 0;
  }

  // The cells along x: first their sign patterns, all at once.
  void visit_row(int j, int k) {
    const std::size_t row = static_cast<std::size_t>(j) * row_;
    const std::uint8_t *a = signs_of(k) + row, *b = a + row_, *c = signs_of(k + 1) + row,
                       *d = c + row_;
    std::uint8_t* inside = cases_in_row_.data();
    for (std::size_t i = 0; i + 1 < row_; ++i)
      inside[i] = static_cast<std::uint8_t>(a[i] | a[i + 1] << 1 | b[i] << 2 | b[i + 1] << 3 |
                                            c[i] << 4 | c[i + 1] << 5 | d[i] << 6 | d[i + 1] << 7);
    const float* f = field_ + static_cast<std::size_t>(k) * plane_ + row;
    for (int i = 0; i + 1 < nx_; ++i)
      if (cases_.triangles[inside[i]] > 0) visit_cell(Index3(i, j, k), f + i, inside[i]);
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
    const int j = cell.y(), k = cell.z();
    const float ball = band_ + triangle.radius;
    const Vec3f& centre = triangle.centre;
    const int ya = std::max(0, j + static_cast<int>(std::ceil(centre.y() - ball))),
              yb = std::min(ny_ - 1, j + static_cast<int>(std::floor(centre.y() + ball)));
    const int za = std::max(z0_, k + static_cast<int>(std::ceil(centre.z() - ball))),
              zb = std::min(z1_ - 1, k + static_cast<int>(std::floor(centre.z() + ball)));
    for (int z = za; z <= zb; ++z)
      for (int y = ya; y <= yb; y += kLanes)
        lower_rows(cell, triangle, ball, y, std::min(kLanes, yb - y + 1), z);
  }

  // In `count` rows beside each other.
  void lower_rows(const Index3& cell, const Triangle& triangle, float ball, int y, int count,
                  int z) {
    const int i = cell.x();
    const Vec3f& centre = triangle.centre;
    const auto from_y = static_cast<float>(y - cell.y()), from_z = static_cast<float>(z - cell.z());
    const float dz = from_z - centre.z();
    // Where the row enters the ball and leaves it.
    Lanes half2, x;
    std::array<int, kLanes> first, last;
    for (int n = 0; n < kLanes; ++n) {
      const float dy = (from_y + static_cast<float>(n)) - centre.y();
      half2[n] = ball * ball - dy * dy - dz * dz;
      const float half = std::sqrt(std::max(half2[n], 0.0f));
      first[n] = std::max(0, i + static_cast<int>(std::ceil(centre.x() - half)));
      last[n] = std::min(nx_ - 1, i + static_cast<int>(std::floor(centre.x() + half)));
      x[n] = static_cast<float>(first[n] - i);
    }
    Triangle::Rows rows;
    const std::size_t r = static_cast<std::size_t>(z - z0_) * static_cast<std::size_t>(ny_) +
                          static_cast<std::size_t>(y);
    // Where the lanes begin decides their last bit, so it doesn't depend on what is wanted.
    for (bool more = true; more;) {
      triangle.rows_from(from_y, from_z, x, rows);
      more = false;
      for (int n = 0; n < count; ++n) {
        if (!(half2[n] > 0) || first[n] > last[n]) continue;
        const std::size_t row = r + static_cast<std::size_t>(n);
        if (!wanted_ || (first[n] < wanted_[row].end && first[n] + kLanes > wanted_[row].first))
          lower_nodes(triangle, rows, n, row * row_ + static_cast<std::size_t>(first[n]),
                      last[n] - first[n] + 1);
        first[n] += kLanes;
        x[n] += kLanes;
        more = more || first[n] <= last[n];
      }
    }
  }

  // The `count` nodes from `at` on along row r, as many as there are lanes at most.
  void lower_nodes(const Triangle& triangle, const Triangle::Rows& rows, int r, std::size_t at,
                   int count) {
    Lanes d2;
    triangle.squared_distances(rows, r, d2);
    for (int n = 0; n < kLanes; ++n) d2[n] = n < count ? d2[n] : band_ * band_;
    float* node = best_ + at;
    if (at + kLanes <= nodes_) {
      for (int n = 0; n < kLanes; ++n) node[n] = std::min(node[n], d2[n]);
    } else {
      for (int n = 0; n < std::min(kLanes, count); ++n) node[n] = std::min(node[n], d2[n]);
    }
  }

  const FlatCases& cases_ = flat_cases();
  int nx_, ny_, nz_, z0_, z1_;
  std::size_t row_, plane_;
  std::array<std::size_t, 8> corner_;
  float band_;
  const float* field_;
  float* best_;
  std::size_t nodes_;
  const RowPart* wanted_;
  std::vector<std::uint8_t> positive_, cases_in_row_;
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
  Slab slab(size, field, band, first, last, distance, wanted);
  with_wide_vectors([&] { slab.fill(); });
}

}  // namespace toothprep
