#include "toothprep/tools/decimation/surface_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toothprep/tools/mesh/nearest_in_triangle.h"

namespace toothprep {
namespace {

using Piece = std::vector<Vec3>;  // a convex polygon

constexpr int kMostPieces = 20'000;  // of one triangle

Corners corners_of(const TriangleMesh& mesh, std::uint32_t t) {
  const auto& v = mesh.triangles[t];
  return {mesh.vertices[v[0]].cast<double>(), mesh.vertices[v[1]].cast<double>(),
          mesh.vertices[v[2]].cast<double>()};
}

// The parts on both sides of the plane through `p` along `normal`, the first where it is negative.
std::pair<Piece, Piece> divide(const Piece& piece, const Vec3& p, const Vec3& normal) {
  std::pair<Piece, Piece> parts;
  for (std::size_t k = 0; k < piece.size(); ++k) {
    const Vec3 &a = piece[k], &b = piece[(k + 1) % piece.size()];
    const double at_a = normal.dot(a - p), at_b = normal.dot(b - p);
    if (at_a <= 0) parts.first.push_back(a);
    if (at_a >= 0) parts.second.push_back(a);
    if ((at_a < 0 && at_b > 0) || (at_a > 0 && at_b < 0)) {
      const Vec3 x = a + at_a / (at_a - at_b) * (b - a);
      parts.first.push_back(x);
      parts.second.push_back(x);
    }
  }
  return parts;
}

bool reaches_across(const Piece& piece, const Vec3& p, const Vec3& normal) {
  double least = 0, most = 0;
  for (const Vec3& x : piece) {
    least = std::min(least, normal.dot(x - p));
    most = std::max(most, normal.dot(x - p));
  }
  return least < 0 && most > 0;
}

double farthest(const Corners& triangle, const Piece& piece) {
  double most = 0;
  for (const Vec3& x : piece) most = std::max(most, distance_to_triangle(triangle, x));
  return most;
}

// The longest extent halved.
std::pair<Piece, Piece> halve(const Piece& piece) {
  Vec3 along = Vec3::Zero(), middle = Vec3::Zero();
  for (const Vec3& a : piece)
    for (const Vec3& b : piece)
      if ((b - a).squaredNorm() > along.squaredNorm()) {
        along = b - a;
        middle = (a + b) / 2;
      }
  return divide(piece, middle, along);
}

// One triangle against the other surface.
class Judge {
 public:
  Judge(const TriangleMesh& to, const TriangleTree& tree, double limit)
      : to_(to), tree_(tree), limit_(limit) {}

  bool within(const Corners& triangle) {
    for (const Vec3& x : triangle) greatest_ = std::max(greatest_, tree_.nearest(x).distance);
    if (greatest_ > limit_) return false;
    left_.assign(1, Piece(triangle.begin(), triangle.end()));
    for (int count = 0; !left_.empty(); ++count) {
      const Piece piece = std::move(left_.back());
      left_.pop_back();
      if (count == kMostPieces || !judge(piece)) return false;
    }
    return true;
  }
  double greatest() const { return greatest_; }

 private:
  bool judge(const Piece& piece) {
    Vec3 middle = Vec3::Zero();
    for (const Vec3& x : piece) middle += x / static_cast<double>(piece.size());
    double radius = 0;
    for (const Vec3& x : piece) radius = std::max(radius, (x - middle).norm());
    const SurfacePoint nearest = tree_.nearest(middle);
    greatest_ = std::max(greatest_, nearest.distance);
    if (nearest.distance > limit_) return false;
    if (nearest.distance + radius <= limit_) return true;
    const Corners other = corners_of(to_, nearest.triangle);
    if (farthest(other, piece) <= limit_) return true;
    if (radius < limit_ / 100) return false;
    const auto [inside, divided] = cut_off_beyond(other, piece);
    if (divided && farthest(other, inside) <= limit_) return true;
    auto parts = halve(inside);
    left_.push_back(std::move(parts.first));
    left_.push_back(std::move(parts.second));
    return true;
  }

  // What of the piece lies over the triangle; the rest is left to judge. Whether there is a rest.
  std::pair<Piece, bool> cut_off_beyond(const Corners& c, Piece piece) {
    bool divided = false;
    const Vec3 normal = (c[1] - c[0]).cross(c[2] - c[0]);
    if (normal.squaredNorm() == 0) return {std::move(piece), false};
    for (int k = 0; k < 3; ++k) {
      const Vec3 outward = (c[(k + 1) % 3] - c[k]).cross(normal).stableNormalized();
      const Vec3 p = c[k] + limit_ / 16 * outward;  // beyond the edge: no rests without width
      if (!reaches_across(piece, p, outward)) continue;
      auto parts = divide(piece, p, outward);
      piece = std::move(parts.first);
      left_.push_back(std::move(parts.second));
      divided = true;
    }
    return {std::move(piece), divided};
  }

  const TriangleMesh& to_;
  const TriangleTree& tree_;
  double limit_, greatest_ = 0;
  std::vector<Piece> left_;
};

}  // namespace

SurfaceDistance surface_distance(const TriangleMesh& from, const TriangleMesh& to,
                                 const TriangleTree& tree, double limit_mm) {
  std::vector<double> greatest(from.triangles.size());
  std::vector<char> within(from.triangles.size());
  tbb::parallel_for(
      tbb::blocked_range<std::uint32_t>(0, static_cast<std::uint32_t>(from.triangles.size()), 64),
      [&](const tbb::blocked_range<std::uint32_t>& part) {
        for (std::uint32_t t = part.begin(); t != part.end(); ++t) {
          Judge judge(to, tree, limit_mm);
          within[t] = judge.within(corners_of(from, t));
          greatest[t] = judge.greatest();
        }
      });
  SurfaceDistance result;
  for (std::uint32_t t = 0; t < greatest.size(); ++t) {
    result.greatest_mm = std::max(result.greatest_mm, greatest[t]);
    if (!within[t]) result.beyond.push_back(t);
  }
  return result;
}

}  // namespace toothprep
