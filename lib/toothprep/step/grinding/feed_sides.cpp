#include "toothprep/step/grinding/feed_sides.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kCellsPerBall = 2;    // edge of a cell of the table: half of the ball's radius
constexpr double kPointsPerBall = 16;  // points along the outline
// Where the ball is nearer to the axis than this part of its distance from it, its azimuth says
// nothing. Up to there the unit vector from the axis turns by less than 1.16 ball / r: it is at most
// twice the sine of half the angle whose sine is 1 / 1.16.
constexpr float kTurn = 1.16f;

std::vector<ProfilePoint> points_along(const std::vector<ProfilePiece>& outline, double spacing) {
  std::vector<ProfilePoint> points;
  for (const ProfilePiece& piece : outline) {
    const int parts = std::max(1, static_cast<int>(std::ceil(length_of(piece) / spacing)));
    for (int i = 0; i <= parts; ++i)
      points.push_back(point_on(piece, static_cast<double>(i) / parts));
  }
  return points;
}

double distance_of(const ProfilePoint& p, double r, double z) {
  return std::hypot(p.r - r, p.z - z);
}

}  // namespace

FeedSides::FeedSides(const Bur& bur, double ball, double reach)
    : ball_(static_cast<float>(ball)), reach_(static_cast<float>(reach)) {
  if (!is_convex(bur.profile())) return;
  const double edge = ball / kCellsPerBall, spacing = ball / kPointsPerBall;
  per_cell_ = static_cast<float>(1 / edge);
  across_ = static_cast<int>(std::ceil((bur.max_radius() + reach) / edge));
  along_ = static_cast<int>(std::ceil((bur.head_length() + 2 * reach) / edge));
  const std::vector<ProfilePoint> outline = points_along(bur.profile(), spacing);
  cells_.reserve(static_cast<std::size_t>(across_) * static_cast<std::size_t>(along_));
  for (int i = 0; i < across_; ++i)
    for (int j = 0; j < along_; ++j)
      cells_.push_back(
          normals_about(bur, outline, spacing, (i + 0.5) * edge, (j + 0.5) * edge - reach));
}

// For a ball whose middle is anywhere in the cell about (r, z).
FeedSides::Normals FeedSides::normals_about(const Bur& bur,
                                            const std::vector<ProfilePoint>& outline,
                                            double spacing, double r, double z) const {
  const double in_cell = std::sqrt(0.5) / static_cast<double>(per_cell_);
  const double radius = static_cast<double>(ball_) + in_cell, d = bur.distance(r, z);
  double from_r = r, from_z = z, within = std::abs(d) + 2 * radius;
  if (d >= radius) {
    const auto nearest = std::min_element(outline.begin(), outline.end(),
                                          [&](const ProfilePoint& a, const ProfilePoint& b) {
                                            return distance_of(a, r, z) < distance_of(b, r, z);
                                          });
    from_r = nearest->r, from_z = nearest->z;
    // Of a convex outline the nearest of its points may be this far from the place that is nearest.
    within = radius + std::sqrt(d * spacing) + spacing;
  }
  Normals n{0, 1, 0, -1};
  for (const ProfilePoint& p : outline) {
    if (distance_of(p, from_r, from_z) > within + spacing) continue;
    const auto n_r = static_cast<float>(p.along_z), n_z = static_cast<float>(-p.along_r);
    if (n_z <= n.low_z) n.low_r = n_r, n.low_z = n_z;
    if (n_z >= n.high_z) n.high_r = n_r, n.high_z = n_z;
  }
  return n;
}

FeedSides::Side FeedSides::of(float x, float y, float r, float z, const Motion& m) const noexcept {
  const float up = (z + reach_) * per_cell_, out = r * per_cell_;
  if (!(kTurn * ball_ < r) || !(up >= 0) || !(up < static_cast<float>(along_)) ||
      !(out < static_cast<float>(across_)))
    return Side::kEither;
  const Normals& n = cells_[static_cast<std::size_t>(out) * static_cast<std::size_t>(along_) +
                            static_cast<std::size_t>(up)];
  const float middle = (x * m.x + y * m.y) / r, turned = kTurn * ball_ / r * m.across;
  const float least = middle - turned, most = middle + turned;
  // Between the two normals n·t is a piece of a sine wave: where it is positive at both ends it is
  // nowhere below the lesser of them.
  if (std::min(n.low_r * least + n.low_z * m.z, n.high_r * least + n.high_z * m.z) > m.uncertain)
    return Side::kAhead;
  if (std::max(n.low_r * most + n.low_z * m.z, n.high_r * most + n.high_z * m.z) < -m.uncertain)
    return Side::kBehind;
  return Side::kEither;
}

}  // namespace toothprep
