#include "toothprep/tools/preparation/margin.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "toothprep/step/core/units.h"

namespace toothprep {

namespace {

struct LinePoint {
  Vec3 at = Vec3::Zero();  // along u, v and the axis
  double length = 0;
};

// Squared distance of a point of a line from the quadratic curve through what is near it, across
// the line; nothing where the line ends.
std::optional<double> squared_roughness_at(const std::vector<LinePoint>& line, const LinePoint& p,
                                           const Vec2& centre) {
  const Vec2 out = (p.at.head<2>() - centre).normalized();
  const Vec2 along(-out.y(), out.x());
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Matrix<double, 3, 2> right = Eigen::Matrix<double, 3, 2>::Zero();
  double first = 0, last = 0;
  for (const LinePoint& q : line) {
    const Vec3 r = q.at - p.at;
    if (r.squaredNorm() > kFinishLineReach * kFinishLineReach) continue;
    const double s = r.head<2>().dot(along) / kFinishLineReach;
    first = std::min(first, s);
    last = std::max(last, s);
    const Vec3 power(1, s, s * s);
    normal += q.length * power * power.transpose();
    right += q.length * power * Eigen::RowVector2d(r.z(), r.head<2>().dot(out));
  }
  if (first > -0.5 || last < 0.5) return std::nullopt;
  return (normal.ldlt().solve(right)).row(0).squaredNorm();
}

double roughness_of(const std::vector<LinePoint>& line, const Vec2& centre) {
  double sum = 0, length = 0;
  for (const LinePoint& p : line)
    if (const auto squared = squared_roughness_at(line, p, centre)) {
      sum += p.length * *squared;
      length += p.length;
    }
  return length > 0 ? std::sqrt(sum / length) : NAN;
}

}  // namespace

Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance,
                      const std::vector<FinishSegment>& finish_line) {
  struct Point {
    Vec2 at;
    std::uint32_t facet;
  };
  const auto flat = [&](const Vec3& x) { return Vec2(frame.along_u(x), frame.along_v(x)); };
  std::vector<Point> middle;
  Vec2 centre = Vec2::Zero();
  double lowest = 1e30, weight = 0;
  for (const WallFacet& w : walls) {
    if (!w.in_middle_third() || !w.plain) continue;
    const Facet& f = facets[w.facet];
    middle.push_back({flat(f.centroid), w.facet});
    centre += f.area * middle.back().at;
    weight += f.area;
    lowest = std::min(lowest, frame.height(f.centroid));
  }
  Margin margin;
  if (middle.empty()) return margin;
  centre /= weight;

  constexpr std::size_t kNearest = 12;
  constexpr int kSteps = 72;
  std::array<Weighted, kSteps> around;
  for (const FinishSegment& s : facets.finish_line()) {
    const double height = frame.height(s.middle);
    if (height > lowest || !(s.length > 0)) continue;  // a patch above that wasn't cut
    const Vec2 at = flat(s.middle);
    const std::size_t count = std::min(kNearest, middle.size());
    std::vector<std::pair<double, std::uint32_t>> near;
    near.reserve(middle.size());
    for (const Point& p : middle) near.push_back({(p.at - at).squaredNorm(), p.facet});
    std::nth_element(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count - 1),
                     near.end());
    std::sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count));
    Vec3 normal = Vec3::Zero(), on = Vec3::Zero();
    double area = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const Facet& f = facets[near[k].second];
      normal += f.area * f.normal;
      on += f.area * f.centroid;
      area += f.area;
    }
    normal.normalize();
    on /= area;
    const Vec3 across = (normal - normal.dot(frame.d) * frame.d).normalized();
    const double width = (s.middle - on).dot(normal) / normal.dot(across) + tolerance;
    margin.width.add(width, s.length);
    const double angle = std::atan2(at.y() - centre.y(), at.x() - centre.x());
    const int step = static_cast<int>((angle / (2 * units::kPi) + 1) * kSteps) % kSteps;
    around[step].add(width, s.length);
  }
  int good = 0;
  for (Weighted& w : around) good += !w.empty() && w.quantile(0.5) > kNoMargin;
  margin.continuity = static_cast<double>(good) / kSteps;
  std::vector<LinePoint> line;
  for (const FinishSegment& s : finish_line)
    if (const double height = frame.height(s.middle); height <= lowest && s.length > 0) {
      const Vec2 at = flat(s.middle);
      line.push_back({Vec3(at.x(), at.y(), height), s.length});
    }
  margin.roughness = roughness_of(line, centre);
  return margin;
}

}  // namespace toothprep
