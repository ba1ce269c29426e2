#include "toothprep/tools/preparation/margin.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
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

constexpr int kSteps = 72;
constexpr double kSameWall = 0.9;  // cosine between normals of one wall, 26°

// Middle thirds of walls in plan.
struct PlanPoint {
  Vec2 at;
  std::uint32_t facet;
};

constexpr double kWallReach = 0.25;  // mm along the finish line, to either side

// The wall beside a point of the finish line, and the margin from there: the plane fitted to the
// facets of middle thirds that stand beside it and face as the nearest does. Walls that face within
// 15° of across the way from the middle are sides of what wasn't cut.
MarginStation station_at(const Vec3& x, const Vec2& flat, const Vec2& centre,
                         const std::vector<PlanPoint>& middle, const CutFacets& facets,
                         const PreparationFrame& frame, double tolerance) {
  const Vec2 way = (flat - centre).normalized();
  const Vec3 out = way.x() * frame.u + way.y() * frame.v;
  double least = std::numeric_limits<double>::infinity();
  const Facet* nearest = nullptr;
  for (const PlanPoint& p : middle) {
    const double distance = (p.at - flat).squaredNorm();
    if (distance < least && facets[p.facet].normal.dot(out) > 0.26) {
      least = distance;
      nearest = &facets[p.facet];
    }
  }
  if (nearest == nullptr) return {x, out, out, 0};
  const Vec3 along = frame.d.cross(nearest->normal).normalized(), across = along.cross(frame.d);
  // How far out the wall is, by height and by place along it; where facets are too few for that, by
  // the nearest's own slope.
  constexpr double kFew = 1e-5;  // mm⁴
  Vec3 sides = Vec3(nearest->normal.dot(frame.d), nearest->normal.dot(along), 0) /
               -nearest->normal.dot(across);
  Eigen::Matrix3d normal = Eigen::Vector3d(kFew, kFew, 0).asDiagonal();
  Vec3 right = kFew * sides;
  for (const PlanPoint& p : middle) {
    const Facet& f = facets[p.facet];
    if (f.normal.dot(nearest->normal) < kSameWall) continue;
    const Vec3 r = f.centroid - x;
    const Vec3 terms(r.dot(frame.d), r.dot(along), 1);
    if (std::abs(terms[1]) > kWallReach && &f != nearest) continue;
    normal += f.area * terms * terms.transpose();
    right += f.area * r.dot(across) * terms;
  }
  sides = normal.ldlt().solve(right);
  MarginStation station;
  station.wall_normal = (across - sides[0] * frame.d - sides[1] * along).normalized();
  station.across = (across - sides[1] * along).normalized();
  station.width = tolerance - sides[2] * across.dot(station.across);
  station.at = x + tolerance * station.across;
  return station;
}

// The middle thirds of walls, and not of steep strips that are low beside them: what labels make of the
// edge of a bevel.
std::vector<WallFacet> of_high_walls(const CutFacets& facets, const std::vector<WallFacet>& walls) {
  Weighted height;
  for (const WallFacet& w : walls) height.add(w.foot + w.rim, facets[w.facet].area);
  std::vector<WallFacet> high;
  if (height.empty()) return high;
  const double least = height.quantile(0.5) / 3;
  for (const WallFacet& w : walls)
    if (w.in_middle_third() && w.plain && w.foot + w.rim > least) high.push_back(w);
  return high;
}

// Angles about the middle of the walls that a margin covers, as [from, to] with from in [0, 2 pi).
struct Covered {
  double from, to, radius;  // radians; mm
};

std::vector<MarginGap> gaps_between(std::vector<Covered> covered, double least) {
  constexpr double kTurn = 2 * units::kPi;
  if (covered.empty()) return {{units::kPi, kTurn, NAN}};
  std::sort(covered.begin(), covered.end(),
            [](const Covered& a, const Covered& b) { return a.from < b.from; });
  const Covered again = {covered[0].from + kTurn, covered[0].to + kTurn, covered[0].radius};
  std::vector<MarginGap> gaps;
  // What runs on beyond the full turn covers the beginning, too.
  Covered last = covered[0];
  for (const Covered& c : covered)
    if (c.to - kTurn > last.to) last = {c.from - kTurn, c.to - kTurn, c.radius};
  covered.push_back(again);
  for (const Covered& c : covered) {
    const double angle = c.from - last.to;
    const double length = angle * (c.radius + last.radius) / 2;
    if (length > least) gaps.push_back({last.to + angle / 2, angle, length});
    if (c.to > last.to) last = c;
  }
  return gaps;
}

}  // namespace

Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance, double voxel,
                      const std::vector<FinishSegment>& finish_line) {
  const auto flat = [&](const Vec3& x) { return Vec2(frame.along_u(x), frame.along_v(x)); };
  std::vector<PlanPoint> middle;
  Vec2 centre = Vec2::Zero();
  double lowest = 1e30, weight = 0;
  for (const WallFacet& w : of_high_walls(facets, walls)) {
    const Facet& f = facets[w.facet];
    middle.push_back({flat(f.centroid), w.facet});
    centre += f.area * middle.back().at;
    weight += f.area;
    lowest = std::min(lowest, frame.height(f.centroid));
  }
  Margin margin;
  if (middle.empty()) return margin;
  centre /= weight;

  constexpr double kTurn = 2 * units::kPi, kStep = kTurn / kSteps;
  const auto angle_of = [&](const Vec3& x) {
    const Vec2 r = flat(x) - centre;
    const double angle = std::atan2(r.y(), r.x());
    return angle < 0 ? angle + kTurn : angle;
  };
  std::array<Weighted, kSteps> around;
  std::array<std::optional<MarginStation>, kSteps> stations;
  std::array<double, kSteps> off_middle;  // of the station, radians
  off_middle.fill(kTurn);
  std::vector<Covered> covered;
  for (const FinishSegment& s : facets.finish_line()) {
    const double height = frame.height(s.middle);
    if (height > lowest || !(s.length > 0)) continue;  // a patch above that wasn't cut
    const MarginStation station =
        station_at(s.middle, flat(s.middle), centre, middle, facets, frame, tolerance);
    margin.width.add(station.width, s.length);
    const double angle = angle_of(s.middle);
    const int step = static_cast<int>(angle / kStep) % kSteps;
    around[step].add(station.width, s.length);
    const double off = std::abs(angle - (step + 0.5) * kStep);
    if (off < off_middle[step]) {
      off_middle[step] = off;
      stations[step] = station;
    }
    if (!(station.width > kNoMargin)) continue;
    double a = angle_of(s.from), b = angle_of(s.to);
    if (a > b) std::swap(a, b);
    if (b - a > units::kPi) std::swap(a += kTurn, b);  // it runs over the angle 0
    covered.push_back({a, b, (flat(s.middle) - centre).norm()});
  }
  for (const auto& station : stations)
    if (station) margin.stations.push_back(*station);
  margin.gaps = gaps_between(std::move(covered), std::max(kLeastGap, 2 * voxel));
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
