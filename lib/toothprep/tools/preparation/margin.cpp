#include "toothprep/tools/preparation/margin.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {

Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance) {
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
  return margin;
}

}  // namespace toothprep
