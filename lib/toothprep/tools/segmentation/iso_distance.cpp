#include "toothprep/tools/segmentation/iso_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>

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
  std::array<std::uint8_t, 256> crossed{};  // bits: corners at the ends of edges that are crossed
  std::array<bool, 256> same_opposite{};    // the opposite pattern has the same triangles

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
      for (int e = 0; e < 12; ++e)
        if ((inside >> from[e] & 1) != (inside >> to[e] & 1))
          crossed[inside] = static_cast<std::uint8_t>(crossed[inside] | 1 << from[e] | 1 << to[e]);
    }
    for (std::size_t inside = 0; inside < 256; ++inside)
      same_opposite[inside] = edges[inside] == edges[255 - inside];
  }
};

const FlatCases& flat_cases() {
  static const FlatCases cases;
  return cases;
}

constexpr int kLanes = 8;
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));
constexpr Lanes kUp = {0, 1, 2, 3, 4, 5, 6, 7};

Lanes load(const float* values) {
  Lanes lanes;
  std::memcpy(&lanes, values, sizeof lanes);
  return lanes;
}
Lanes lesser(const Lanes& a, const Lanes& b) { return b < a ? b : a; }
Lanes greater(const Lanes& a, const Lanes& b) { return a < b ? b : a; }

// Squared distances of points in a row along x to a triangle. Along the row all products are linear
// in x, and there is no branch, so that a call becomes a few vector instructions.
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
    const Lanes px = x - a.x(), py = (y + kUp) - a.y();
    const Lanes qx = px - ab.x(), qy = py - ab.y();
    rows.x = px;
    rows.q_x = qx;
    rows.p_side = py * py + pz * pz;
    rows.q_side = qy * qy + qz * qz;
    rows.p_ab = px * ab.x() + (py * ab.y() + pz * ab.z());
    rows.p_ac = px * ac.x() + (py * ac.y() + pz * ac.z());
    rows.q_bc = qx * bc.x() + (qy * bc.y() + qz * bc.z());
    rows.height = heights(y, z, x);
  }
  Lanes heights(float y, float z, const Lanes& x) const {
    return (x - a.x()) * normal.x() + (((y + kUp) - a.y()) * normal.y() + (z - a.z()) * normal.z());
  }

  // Of the points from where row r begins on.
  Lanes squared_distances(const Rows& rows, int r) const {
    constexpr Lanes zero{}, one = zero + 1;
    const auto to_segment = [](const Lanes& squared, const Lanes& along, float length2,
                               float inverse) {
      Lanes t = along * inverse;
      t = t < zero ? zero : t;
      t = t > one ? one : t;
      return squared - t * (2 * along - t * length2);
    };
    const Lanes d20 = rows.p_ab[r] + kUp * ab.x(), d21 = rows.p_ac[r] + kUp * ac.x(),
                d22_ = rows.q_bc[r] + kUp * bc.x();
    const Lanes h = rows.height[r] + kUp * normal.x();
    const Lanes px = rows.x[r] + kUp, qx = rows.q_x[r] + kUp;
    const Lanes pp = px * px + rows.p_side[r], qq = qx * qx + rows.q_side[r];
    const Lanes edges =
        lesser(to_segment(pp, d20, d00, inverse00),
               lesser(to_segment(pp, d21, d11, inverse11), to_segment(qq, d22_, d22, inverse22)));
    const Lanes v = d11 * d20 - d01 * d21, w = d00 * d21 - d01 * d20;
    // All three weights of the projection's barycentric coordinates positive: the face is
    // nearest.
    const Lanes least = lesser(lesser(v, w), area2 - v - w);
    return least >= zero ? h * h : greater(edges, zero);
  }
};

// A cell that a surface passes.
struct Cell {
  std::array<int, 3> at;
  std::uint8_t inside;         // sign pattern
  std::array<float, 8> value;  // of the field, at its corners
};

// Takes the cells with the same triangles out of both, which are in the order of places.
std::vector<Cell> take_shared(std::vector<Cell>& cells, std::vector<Cell>& others) {
  const FlatCases& cases = flat_cases();
  const auto same = [&](const Cell& a, const Cell& b) {
    if (a.inside != 255 - b.inside || !cases.same_opposite[a.inside]) return false;
    for (int c = 0; c < 8; ++c)
      if ((cases.crossed[a.inside] >> c & 1) != 0 && a.value[c] != -b.value[c]) return false;
    return true;
  };
  const auto before = [](const Cell& a, const Cell& b) {
    return std::lexicographical_compare(a.at.rbegin(), a.at.rend(), b.at.rbegin(), b.at.rend());
  };
  std::vector<Cell> shared;
  std::size_t kept = 0, kept_others = 0, other = 0;
  for (const Cell& cell : cells) {
    while (other < others.size() && before(others[other], cell))
      others[kept_others++] = others[other++];
    if (other < others.size() && others[other].at == cell.at && same(cell, others[other])) {
      shared.push_back(cell);
      ++other;
    } else {
      cells[kept++] = cell;
    }
  }
  while (other < others.size()) others[kept_others++] = others[other++];
  cells.resize(kept);
  others.resize(kept_others);
  return shared;
}

// The distances of the nodes in some planes: squares first, from the triangles of every cell within
// reach, then their roots with a sign. A minimum over the same triangles, whatever the slabs. Most
// triangles near a node are farther away than another one: to know so early, each node starts from a
// bound that one of the triangles beneath it gives.
class Slab {
 public:
  Slab(const Index3& size, const IsoField& of, float band, int first, int last)
      : nx_(size.x()),
        ny_(size.y()),
        nz_(size.z()),
        z0_(first),
        z1_(last),
        row_(static_cast<std::size_t>(nx_)),
        plane_(row_ * static_cast<std::size_t>(ny_)),
        band_(band),
        field_(*of.field),
        best_(of.distance),
        nodes_(static_cast<std::size_t>(last - first) * plane_),
        wanted_(of.wanted) {
    std::fill_n(least_.begin() + kLanes, kLanes, band_ * band_);
  }

  // Those within reach of the nodes.
  std::vector<Cell> cells() {
    std::vector<Cell> found;
    const int reach = static_cast<int>(std::ceil(band_));
    const int low = std::max(0, z0_ - reach - 1), high = std::min(nz_ - 1, z1_ + reach);
    positive_.resize(2 * plane_ + sizeof(std::uint64_t));
    for (std::vector<RowPart>& parts : changes_) parts.resize(static_cast<std::size_t>(ny_));
    if (low < high) find_signs(low);
    for (int k = low; k < high; ++k) {
      find_signs(k + 1);
      for (int j = 0; j + 1 < ny_; ++j) find_cells(j, k, found);
    }
    return found;
  }

  // From the band's end, or the least of these squares.
  void start(const std::vector<const float*>* squares) {
    std::fill(best_, best_ + nodes_, band_ * band_);
    if (!squares) return;
    for (const float* square : *squares)
      for (std::size_t v = 0, n = nodes_; v < n; ++v) best_[v] = std::min(best_[v], square[v]);
  }
  void lower_by(const std::vector<Cell>& cells) {
    for (const Cell& cell : cells) bound_nodes(cell);
    for (const Cell& cell : cells) visit(cell);
  }
  const float* squares() const { return best_; }

  void take_roots() {
    const std::size_t first = static_cast<std::size_t>(z0_) * plane_;
    for (std::size_t row = 0; row < nodes_; row += row_) {
      field_.signs(first + row, nx_, positive_.data());
      const std::uint8_t* positive = positive_.data();
      float* best = best_ + row;
      for (std::size_t i = 0, n = row_; i < n; ++i) {
        // Never zero: the sign must separate inside from outside.
        const float distance = std::max(std::sqrt(best[i]), 1e-6f);
        best[i] = positive[i] ? -distance : distance;
      }
    }
  }

 private:
  // Ones where the field is positive, and in which parts of rows that changes; of two planes at a time.
  std::uint8_t* signs_of(int k) { return positive_.data() + (k % 2 ? plane_ : 0); }
  void find_signs(int k) {
    for (int j = 0; j < ny_; ++j) {
      const std::size_t row = static_cast<std::size_t>(j) * row_;
      changes_[k % 2][static_cast<std::size_t>(j)] =
          field_.signs(static_cast<std::size_t>(k) * plane_ + row, nx_, signs_of(k) + row);
    }
  }

  // Those along x with a surface. Most lie eight beside each other without one.
  void find_cells(int j, int k, std::vector<Cell>& found) {
    const std::size_t row = static_cast<std::size_t>(j) * row_;
    const std::uint8_t *a = signs_of(k) + row, *b = a + row_, *c = signs_of(k + 1) + row,
                       *d = c + row_;
    int first = nx_, end = 0;
    for (const std::vector<RowPart>& plane : changes_)
      for (int y = j; y < j + 2; ++y) {
        first = std::min(first, plane[static_cast<std::size_t>(y)].first - 1);
        end = std::max(end, plane[static_cast<std::size_t>(y)].end);
      }
    first = std::max(first, 0);
    end = std::min(end, nx_ - 1);
    constexpr std::uint64_t kAllPositive = 0x0101010101010101;
    const auto word = [](const std::uint8_t* signs) {
      std::uint64_t eight;
      std::memcpy(&eight, signs, sizeof eight);
      return eight;
    };
    for (int i = first; i < end; i += 8) {
      std::uint64_t any = 0, all = kAllPositive;
      for (const std::uint8_t* signs : {a, b, c, d})
        for (const int beside : {0, 1}) {
          const std::uint64_t eight = word(signs + i + beside);
          any |= eight;
          all &= eight;
        }
      if (any == 0 || all == kAllPositive) continue;
      for (int n = i; n < std::min(i + 8, end); ++n) {
        const auto inside =
            static_cast<std::uint8_t>(a[n] | a[n + 1] << 1 | b[n] << 2 | b[n + 1] << 3 | c[n] << 4 |
                                      c[n + 1] << 5 | d[n] << 6 | d[n + 1] << 7);
        if (cases_.triangles[inside] > 0) found.push_back({{n, j, k}, inside, values_at(n, j, k)});
      }
    }
  }

  std::array<float, 8> values_at(int i, int j, int k) const {
    const std::size_t v = static_cast<std::size_t>(k) * plane_ +
                          static_cast<std::size_t>(j) * row_ + static_cast<std::size_t>(i);
    std::array<float, 8> values;
    for (std::size_t c = 0; c < 8; ++c)
      values[c] = field_[v + (c & 1) + (c >> 1 & 1) * row_ + (c >> 2) * plane_];
    return values;
  }
  // Where the surface crosses an edge.
  Vec3f crossing(const Cell& cell, int e) const {
    const int from = cases_.from[e];
    const float fa = cell.value[from], fb = cell.value[cases_.to[e]];
    Vec3f point(from & 1, from >> 1 & 1, from >> 2);
    point[e / 4] += fa / (fa - fb);
    return point;
  }

  // The nodes along the normal of the cell's first triangle are not farther away than its centre.
  void bound_nodes(const Cell& cell) {
    const auto* triple = cases_.edges[cell.inside].data();
    const Vec3f a = crossing(cell, triple[0]), b = crossing(cell, triple[1]),
                c = crossing(cell, triple[2]);
    const Vec3f normal = (b - a).cross(c - a), centre = a + ((b - a) + (c - a)) / 3;
    if (normal.squaredNorm() < kSliver) return;
    int main;
    normal.cwiseAbs().maxCoeff(&main);
    const Vec3f step = normal / normal[main];
    const std::array<int, 3> first{0, 0, z0_}, end{nx_, ny_, z1_};
    const float reach = band_ / step.norm();
    for (int m = static_cast<int>(std::ceil(centre[main] - reach)); m <= centre[main] + reach;
         ++m) {
      const Vec3f on = centre + (static_cast<float>(m) - centre[main]) * step;
      float squared = 0;
      std::array<int, 3> node;
      bool there = true;
      for (int x = 0; x < 3; ++x) {
        const auto nearest = static_cast<int>(std::floor(on[x] + 0.5f));
        const float away = static_cast<float>(nearest) - centre[x];
        squared += away * away;
        node[x] = cell.at[x] + nearest;
        there = there && node[x] >= first[x] && node[x] < end[x];
      }
      if (!there) continue;
      float& best =
          best_[static_cast<std::size_t>(node[2] - z0_) * plane_ +
                static_cast<std::size_t>(node[1]) * row_ + static_cast<std::size_t>(node[0])];
      best = std::min(best, squared * (1 + kSlack) + kSlack);
    }
  }

  void visit(const Cell& cell) {
    std::array<Vec3f, 12> point;
    for (int e = 0; e < 12; ++e)
      if ((cell.inside >> cases_.from[e] & 1) != (cell.inside >> cases_.to[e] & 1))
        point[e] = crossing(cell, e);
    for (int t = 0; t < cases_.triangles[cell.inside]; ++t) {
      const auto* triple = &cases_.edges[cell.inside][3 * t];
      lower(Index3(cell.at[0], cell.at[1], cell.at[2]),
            Triangle(point[triple[0]], point[triple[1]], point[triple[2]]));
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
    const Lanes dy = (from_y + kUp) - centre.y(), side2 = dy * dy + dz * dz;
    // Where the row enters the ball and leaves it.
    Lanes half2, x;
    std::array<int, kLanes> first, last;
    for (int n = 0; n < kLanes; ++n) {
      half2[n] = ball * ball - dy[n] * dy[n] - dz * dz;
      const float half = std::sqrt(std::max(half2[n], 0.0f));
      first[n] = std::max(0, i + static_cast<int>(std::ceil(centre.x() - half)));
      last[n] = std::min(nx_ - 1, i + static_cast<int>(std::floor(centre.x() + half)));
      x[n] = static_cast<float>(first[n] - i);
    }
    const std::size_t r = static_cast<std::size_t>(z - z0_) * static_cast<std::size_t>(ny_) +
                          static_cast<std::size_t>(y);
    // Where the lanes begin decides their last bit, so it doesn't depend on what is wanted.
    for (bool more = true; more;) {
      more = false;
      std::array<const float*, kLanes> best;  // of the rows' nodes
      unsigned looked_at = 0, unknown = 0;    // rows, as bits
      for (int n = 0; n < count; ++n) {
        const std::size_t row = r + static_cast<std::size_t>(n),
                          at = row * row_ + static_cast<std::size_t>(first[n]);
        bool counts = half2[n] > 0;
        counts &= first[n] <= last[n];
        if (wanted_) {
          counts &= first[n] < wanted_[row].end;
          counts &= first[n] + kLanes > wanted_[row].first;
        }
        const bool known = triangle.area2 >= kSliver && at + kLanes <= nodes_;
        best[n] = counts && known ? best_ + at : least_.data();
        looked_at |= static_cast<unsigned>(counts) << n;
        unknown |= static_cast<unsigned>(!known) << n;
      }
      if (looked_at != 0) {
        const Lanes height = triangle.heights(from_y, from_z, x);
        looked_at &=
            unknown | may_lie_above(best, looked_at, triangle, height, x - centre.x(), side2);
      }
      if (looked_at != 0) {
        Triangle::Rows rows;
        triangle.rows_from(from_y, from_z, x, rows);
        for (; looked_at != 0; looked_at &= looked_at - 1) {
          const int n = __builtin_ctz(looked_at);
          lower_nodes(triangle, rows, n,
                      (r + static_cast<std::size_t>(n)) * row_ + static_cast<std::size_t>(first[n]),
                      last[n] - first[n] + 1);
        }
      }
      for (int n = 0; n < count; ++n) {
        first[n] += kLanes;
        x[n] += static_cast<float>(kLanes);
        more = more || (half2[n] > 0 && first[n] <= last[n]);
      }
    }
  }

  // The rows, as bits, of which one of the nodes may be nearer to a triangle than to the triangles before: by the
  // height above its plane, and how far beside a ball around it the node is at that height. The first node of
  // row n is x[n] from the ball's centre, all are `side2[n]` beside it, squared. A root is not more than its
  // tangent at kTangent, since where a triangle beneath is known there is little left of it.
  static unsigned may_lie_above(const std::array<const float*, kLanes>& best, unsigned rows,
                                const Triangle& triangle, const Lanes& height, const Lanes& x,
                                const Lanes& side2) {
    constexpr float kTangent = 0.25f, kHeightSlack = 3 * kSlack;
    const float radius = triangle.radius + kMargin, slope = 1 + radius / kTangent;
    const Lanes rest = side2 - radius * (radius + kTangent);
    decltype(Lanes{} < Lanes{}) may{};
    for (; rows != 0; rows &= rows - 1) {
      const int n = __builtin_ctz(rows);
      const Lanes above = height[n] + kUp * triangle.normal.x(), dx = x[n] + kUp;
      const Lanes height2 = above * above, left = load(best[n]) + kHeightSlack - height2;
      may |= (left >= 0) & (dx * dx + rest[n] - height2 < left * slope) & (1 << n);
    }
    return bits_of(may);
  }
  // The bits of all lanes.
  static unsigned bits_of(const decltype(Lanes{} < Lanes{}) & lanes) {
    std::array<std::uint64_t, kLanes / 2> pairs;
    std::memcpy(pairs.data(), &lanes, sizeof lanes);
    const std::uint64_t both = pairs[0] | pairs[1] | pairs[2] | pairs[3];
    return static_cast<unsigned>(both | both >> 32);
  }

  // The `count` nodes from `at` on along row r, as many as there are lanes at most.
  void lower_nodes(const Triangle& triangle, const Triangle::Rows& rows, int r, std::size_t at,
                   int count) {
    Lanes d2 = triangle.squared_distances(rows, r);
    d2 = greater(d2, load(least_.data() + kLanes - std::min(kLanes, count)));
    float* node = best_ + at;
    if (at + kLanes <= nodes_) {
      d2 = lesser(load(node), d2);
      std::memcpy(node, &d2, sizeof d2);
    } else {
      for (int n = 0; n < std::min(kLanes, count); ++n) node[n] = std::min(node[n], d2[n]);
    }
  }

  // What a squared distance can be wrong by, single precision as it is, unless the triangle's area is
  // next to nothing; and more than that in terms of the distance.
  static constexpr float kSlack = 1e-3f, kSliver = 1e-3f, kMargin = 0.01f;

  const FlatCases& cases_ = flat_cases();
  int nx_, ny_, nz_, z0_, z1_;
  std::size_t row_, plane_;
  float band_;
  const SignedField& field_;
  float* best_;
  std::size_t nodes_;
  const RowPart* wanted_;
  std::array<float, 2 * kLanes> least_{};  // of squared distances: zeros, then what is too far away
  std::vector<std::uint8_t> positive_;
  std::array<std::vector<RowPart>, 2> changes_;
};

}  // namespace

std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band) {
  const SignedField changes(size, field);
  std::vector<float> distance(field.size());
  const std::size_t plane = static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y());
  constexpr int kPlanes = 16;
  tbb::parallel_for(0, (size.z() + kPlanes - 1) / kPlanes, [&](int slab) {
    const int first = slab * kPlanes;
    iso_distance_in(size,
                    {&changes, distance.data() + static_cast<std::size_t>(first) * plane, nullptr},
                    band, first, std::min(size.z(), first + kPlanes));
  });
  return distance;
}

void iso_distance_in(const Index3& size, const IsoField& of, float band, int first, int last,
                     const std::vector<IsoField>& opposite) {
  std::vector<Slab> slabs = {Slab(size, of, band, first, last)};
  for (const IsoField& other : opposite) slabs.emplace_back(size, other, band, first, last);
  // What the first shares with each of the others, and what each has for itself.
  std::array<std::vector<std::vector<Cell>>, 2> cells;
  for (auto& each : cells) each.resize(slabs.size());
  for (std::size_t s = 0; s < slabs.size(); ++s) {
    cells[1][s] = slabs[s].cells();
    if (s > 0) cells[0][s] = take_shared(cells[1][0], cells[1][s]);
  }
  with_wide_vectors([&] {
    std::vector<const float*> shared;
    for (std::size_t own = 0; own < 2; ++own)
      for (std::size_t s = 0; s < slabs.size(); ++s) {
        if (s == 0 ? own == 1 : own == 0) slabs[s].start(s == 0 ? &shared : nullptr);
        slabs[s].lower_by(cells[own][s]);
        if (s > 0 && own == 0) shared.push_back(slabs[s].squares());
      }
    for (Slab& slab : slabs) slab.take_roots();
  });
}

}  // namespace toothprep
