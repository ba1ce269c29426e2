#include "toothprep/tools/preparation/corner_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kPerDegree = units::from_degree(1);
constexpr double kLeastSlope = -40 * kPerDegree, kMostSlope = 75 * kPerDegree;
constexpr std::size_t kFewestPoints = 8;

// What the fit looks for: slope (radians), height of side 2 at its end (mm), share of the arc.
using Unknowns = std::array<double, 3>;

// The corner that these make, as signed distances to both sides see it.
struct Corner {
  Corner(const Unknowns& x, double wall_angle, double end_x)
      : side2(std::sin(x[0]), std::cos(x[0])),
        side1(std::cos(wall_angle), std::sin(wall_angle)),
        offset2(side2.dot(Vec2(end_x, x[1]))),
        cosine(side1.dot(side2)) {
    // Where both sides meet, from there to the end, and the largest arc that fits.
    const double up = offset2 / (side2.y() - side2.x() * std::tan(wall_angle));
    length = (Vec2(end_x, x[1]) - Vec2(-up * std::tan(wall_angle), up)).norm();
    const double half = std::acos(std::clamp(cosine, -1.0, 1.0)) / 2;
    radius = x[2] * length / std::max(std::tan(half), 1e-6);
  }
  double distance(const Vec2& p) const {
    const double a = radius - side1.dot(p), b = radius + offset2 - side2.dot(p);
    if (a - b * cosine <= 0 || b - a * cosine <= 0 || (a <= 0 && b <= 0))
      return std::max(a, b) - radius;
    return std::sqrt((a * a + b * b - 2 * a * b * cosine) / (1 - cosine * cosine)) - radius;
  }

  Vec2 side2, side1;  // unit normals, into what they bound
  double offset2, cosine, length = 0, radius = 0;
};

double mean_square(const Unknowns& x, const std::vector<Vec2>& points, double wall_angle,
                   double end) {
  const Corner corner(x, wall_angle, end);
  double sum = 0;
  for (const Vec2& p : points) {
    const double off = corner.distance(p);
    sum += off * off;
  }
  return sum / static_cast<double>(points.size());
}

// Levenberg and Marquardt's way down from x over slope and height, the arc's share kept. Returns the
// mean square there.
double settle(Unknowns& x, const std::vector<Vec2>& points, double wall_angle, double end) {
  const Vec2 scale(5 * kPerDegree, end / 20);
  double least = mean_square(x, points, wall_angle, end), damping = 1e-3;
  for (int pass = 0; pass < 10 && damping < 1e3; ++pass) {
    const Corner corner(x, wall_angle, end);
    std::array<std::optional<Corner>, 2> moved;
    for (std::size_t k = 0; k < 2; ++k) {
      Unknowns y = x;
      y[k] += 1e-4 * scale[static_cast<int>(k)];
      moved[k].emplace(y, wall_angle, end);
    }
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Vec2 right = Vec2::Zero();
    for (const Vec2& p : points) {
      const double off = corner.distance(p);
      const Vec2 slope = Vec2(moved[0]->distance(p) - off, moved[1]->distance(p) - off) / 1e-4;
      normal += slope * slope.transpose();
      right -= off * slope;
    }
    for (bool down = false; !down && damping < 1e3; damping *= down ? 0.1 : 10) {
      const Vec2 step =
          (normal + damping * normal.trace() * Eigen::Matrix2d::Identity()).ldlt().solve(right);
      Unknowns y = x;
      y[0] = std::clamp(y[0] + step[0] * scale[0], kLeastSlope, kMostSlope);
      y[1] += step[1] * scale[1];
      const double square = mean_square(y, points, wall_angle, end);
      down = square < least;
      if (!down) continue;
      if (least - square < 1e-4 * least) pass = 10;  // there
      x = y;
      least = square;
    }
  }
  return least;
}

}  // namespace

CornerFit fit_corner(const std::vector<Vec2>& points, double wall_angle, double end) {
  CornerFit fit;
  fit.misfit = std::numeric_limits<double>::infinity();
  if (points.size() < kFewestPoints) return fit;
  Unknowns best = {};
  double least = std::numeric_limits<double>::infinity();
  const auto attempt = [&](Unknowns x) {
    const double square = settle(x, points, wall_angle, end);
    if (!(square < least)) return false;
    least = square;
    best = x;
    return true;
  };
  // Over the arc's share there may be more than one valley; for each, the slope has one.
  constexpr int kArcs = 8;
  for (int n = 0; n <= kArcs; ++n) {
    Unknowns start = {0, 0, static_cast<double>(n) / kArcs};
    double square = std::numeric_limits<double>::infinity();
    for (const double slope : {-15.0, 0.0, 15.0, 30.0, 45.0, 60.0}) {
      const Unknowns x = {slope * kPerDegree, 0, start[2]};
      const double here = mean_square(x, points, wall_angle, end);
      if (here < square) start = x;
      square = std::min(square, here);
    }
    attempt(start);
  }
  for (double step = 0.5 / kArcs; step > 1e-3; step /= 2) {
    const Unknowns centre = best;
    for (const double sign : {1.0, -1.0})
      if (attempt({centre[0], centre[1], std::clamp(centre[2] + sign * step, 0.0, 1.0)})) break;
  }
  const Corner corner(best, wall_angle, end);
  fit.slope = best[0];
  fit.radius = corner.radius;
  fit.arc = best[2];
  fit.angle = units::kPi - std::acos(std::clamp(corner.cosine, -1.0, 1.0));
  fit.misfit = std::sqrt(least);
  return fit;
}

}  // namespace toothprep
