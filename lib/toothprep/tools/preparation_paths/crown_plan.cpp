#include "toothprep/tools/preparation_paths/crown_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/preparation_paths/crown_map.h"
#include "toothprep/tools/preparation_paths/neck.h"

namespace toothprep {
namespace {

constexpr int kRays = 72;
constexpr double kLeastHeight = 1.5;  // mm, of the stump's middle over the margin's mean height
constexpr double kEnd = 0.5;          // mm, of a head's end
constexpr double kRound = 0.4;        // mm, between rounds of roughing

using Ring = std::array<double, kRays>;

int wrapped(int k) { return (k % kRays + kRays) % kRays; }
double& of(Ring& ring, int k) { return ring[static_cast<std::size_t>(wrapped(k))]; }
double of(const Ring& ring, int k) { return ring[static_cast<std::size_t>(wrapped(k))]; }

Ring smooth_ring(const Ring& ring, double sigma) {
  Ring result{};
  const int reach = static_cast<int>(std::ceil(2.5 * sigma));
  for (int k = 0; k < kRays; ++k) {
    double sum = 0, weights = 0;
    for (int i = -reach; i <= reach; ++i) {
      const double w = std::exp(-0.5 * i * i / (sigma * sigma));
      sum += w * of(ring, k + i);
      weights += w;
    }
    of(result, k) = sum / weights;
  }
  return result;
}

// A tear in the neck (caries, a lost piece of enamel) doesn't count.
Ring median_ring(const Ring& ring, int reach) {
  Ring result{};
  for (int k = 0; k < kRays; ++k) {
    std::vector<double> near;
    for (int i = -reach; i <= reach; ++i) near.push_back(of(ring, k + i));
    std::nth_element(near.begin(), near.begin() + reach, near.end());
    of(result, k) = near[static_cast<std::size_t>(reach)];
  }
  return result;
}

Vec2 ray(int k) {
  const double angle = 2 * units::kPi * k / kRays;
  return {std::cos(angle), std::sin(angle)};
}

// The flank of a head: radius that it would have at the tip, and its angle.
struct Flank {
  double radius = 0, angle = 0;  // mm, rad
};

double radius_at(const Bur& bur, double z) {
  double low = 0, high = bur.max_radius() + 0.1;
  for (int i = 0; i < 40; ++i) {
    const double r = 0.5 * (low + high);
    (bur.distance(r, z) < 0 ? low : high) = r;
  }
  return low;
}

Flank flank_of(const Bur& bur) {
  const double low = std::min(1.0, 0.4 * bur.head_length());
  const double high = std::min(5.0, 0.8 * bur.head_length());
  const double angle = std::atan((radius_at(bur, high) - radius_at(bur, low)) / (high - low));
  return {radius_at(bur, low) - low * std::tan(angle), angle};
}

struct Margin {
  Vec2 middle = Vec2::Zero();
  Ring height{}, neck{};           // mm, z
  std::vector<Vec2> foot, normal;  // of the wall; outward
  double bulge = 0;                // mm, most that lies outside of the walls
};

Vec2 middle_of(const ToothGrid& grid, double z) {
  Vec2 sum = Vec2::Zero();
  double count = 0;
  const int level = grid.cell({0, 0, z}).z();
  for (int x = 0; x < grid.size().x(); ++x)
    for (int y = 0; y < grid.size().y(); ++y)
      if (level >= 0 && level < grid.size().z() && ToothGrid::is_tooth(grid.at(x, y, level))) {
        sum += grid.place(x, y, level).head<2>();
        ++count;
      }
  if (count == 0) throw Error("the crown is too low for a preparation");
  return sum / count;
}

Margin margin_of(const ToothGrid& grid, const CrownShape& shape, double top) {
  Margin m;
  m.middle = middle_of(grid, top - 3.5);
  for (int k = 0; k < kRays; ++k) of(m.neck, k) = neck_height(grid, m.middle, ray(k), top - 3.5);
  m.neck = smooth_ring(median_ring(m.neck, 4), 2.5);
  Ring radius{};
  for (int k = 0; k < kRays; ++k) {
    of(m.height, k) = of(m.neck, k) + shape.above_neck;
    of(radius, k) = outline_radius(grid, m.middle, ray(k), of(m.height, k));
  }
  radius = smooth_ring(radius, 1.5);
  const double slope = std::tan(units::from_degree(shape.taper));
  for (int k = 0; k < kRays; ++k) {
    const Vec2 along = of(radius, k + 1) * ray(k + 1) - of(radius, k - 1) * ray(k - 1);
    const Vec2 out = Vec2(along.y(), -along.x()).normalized();
    m.normal.push_back(out);
    m.foot.push_back(m.middle + of(radius, k) * ray(k) - shape.margin_width * out);
    for (double h = 0; h < 5; h += 0.25) {
      const double r = outline_radius(grid, m.middle, ray(k), of(m.height, k) + h);
      m.bulge = std::max(m.bulge, r - (of(radius, k) - shape.margin_width - h * slope));
    }
  }
  return m;
}

// The lower outline of a head's end: z of the surface at a radius. What lies higher is flank.
std::vector<std::pair<double, double>> underside(const Bur& bur) {
  std::vector<std::pair<double, double>> points;
  for (double r = 0; r < bur.max_radius() - 0.02; r += 0.1) {
    double z = 0;
    while (z <= kEnd && bur.distance(r, z + 1e-4) > 0) z += 0.02;
    if (z > kEnd) break;
    points.emplace_back(r, z);
  }
  return points;
}

// Where the tip may go so that the head takes nothing below the heights.
class Lowering {
 public:
  Lowering(const CrownMap& map, std::vector<double> heights, const Bur& bur)
      : map_(map), heights_(std::move(heights)) {
    for (const auto& [r, z] : underside(bur))
      for (int k = 0; k < (r > 0 ? 16 : 1); ++k) {
        const double a = 2 * units::kPi * k / 16;
        offsets_.push_back({r * std::cos(a), r * std::sin(a), z});
      }
  }
  double tip(const Vec2& p) const {  // -infinity where the head meets nothing
    double z = -std::numeric_limits<double>::infinity();
    for (const Vec3& o : offsets_) z = std::max(z, map_.height(heights_, p + o.head<2>()) - o.z());
    return z;
  }

 private:
  const CrownMap& map_;
  std::vector<double> heights_;
  std::vector<Vec3> offsets_;
};

// Lines over the crown, `apart` mm, as far as the head meets it; `over`: so much above the target.
void sweep(Plan& plan, const CrownMap& map, const Lowering& lowering, bool along_x, double apart,
           double over, double safe, Pace pace, const std::string& note) {
  const Vec2 low(map.x0, map.y0), span(map.step * map.nx, map.step * map.ny);
  const int a = along_x ? 0 : 1, b = 1 - a;
  bool back = false, first = true;
  for (double v = apart / 2; v < span[b]; v += apart) {
    std::vector<Vec3> line;
    for (double u = 0; u < span[a]; u += 0.4) {
      Vec2 p;
      p[a] = low[a] + u;
      p[b] = low[b] + v;
      const double z = lowering.tip(p);
      if (std::isfinite(z)) line.emplace_back(p.x(), p.y(), z + over);
    }
    if (line.size() < 2) continue;
    if (back) std::reverse(line.begin(), line.end());
    Vec3 out = line.front() - (line[1] - line[0]).normalized() * 1.2;
    out.z() = line.front().z();
    if (first) {
      plan.go({out.x(), out.y(), safe}, Pace::kAir, note);
      first = false;
    }
    plan.go(out, Pace::kAir);
    for (const Vec3& p : line) plan.go(p, pace);
    back = !back;
  }
  const Vec3 last = plan.strokes.back().to;
  plan.go({last.x(), last.y(), safe}, Pace::kAir);
}

// Once around, clockwise seen from the occlusal: so the drag of the cut pushes the bur out.
void round_trip(Plan& plan, const Margin& m, const Flank& flank, double lean, double off, Pace pace,
                const std::string& note) {
  for (int i = 0; i <= kRays; ++i) {
    const int k = wrapped(-i);
    const Vec2& out = m.normal[static_cast<std::size_t>(k)];
    const Vec2 p = m.foot[static_cast<std::size_t>(k)] + (flank.radius + off) * out;
    const Vec3 axis(-std::sin(lean) * out.x(), -std::sin(lean) * out.y(), std::cos(lean));
    plan.go({p.x(), p.y(), of(m.height, k)}, axis, pace, i == 0 ? note : "");
  }
}

void axial(Plan& plan, const Margin& m, const Flank& flank, double lean, double safe) {
  const Vec2& out = m.normal[0];
  const Vec2 beside = m.foot[0] + (flank.radius + m.bulge + 1.5) * out;
  const Vec3 axis(-std::sin(lean) * out.x(), -std::sin(lean) * out.y(), std::cos(lean));
  plan.go({beside.x(), beside.y(), safe}, axis, Pace::kAir);
  plan.go({beside.x(), beside.y(), m.height[0]}, Pace::kAir);
  const int rounds = std::max(1, static_cast<int>(std::ceil((m.bulge - 0.15) / kRound)));
  for (int r = rounds - 1; r >= 0; --r)
    round_trip(plan, m, flank, lean, 0.15 + (m.bulge - 0.15) * r / rounds, Pace::kRoughing,
               r == rounds - 1 ? "Roughing the walls: round by round." : "");
  round_trip(plan, m, flank, lean, 0, Pace::kRoughing, "");
  for (int r = 0; r < 3; ++r)
    round_trip(plan, m, flank, lean, 0, Pace::kFinishing,
               r == 0 ? "Finishing the walls and the margin, three times around." : "");
  plan.go({beside.x(), beside.y(), plan.strokes.back().to.z()}, Pace::kRoughing);
  plan.go({beside.x(), beside.y(), safe}, Pace::kAir);
}

}  // namespace

Plan plan_crown(const ToothGrid& grid, const Bur& bur, const CrownShape& shape) {
  const CrownMap map = crown_map(grid);
  const double highest = *std::max_element(map.surface.begin(), map.surface.end());
  const Margin m = margin_of(grid, shape, highest);
  const Flank flank = flank_of(bur);
  if (2 * flank.radius < shape.margin_width)
    throw Error(
        fmt::format("the bur's end is {:.2f} mm wide, less than the margin of {:g} mm: take a "
                    "thicker one",
                    2 * flank.radius, shape.margin_width));
  const double margin = *std::max_element(m.height.begin(), m.height.end());
  double mean = 0;
  for (const double z : m.height) mean += z / kRays;
  std::vector<double> target = smoothed(map, map.surface, 0.3);
  double least = std::numeric_limits<double>::infinity();
  for (int y = 0; y < map.ny; ++y)
    for (int x = 0; x < map.nx; ++x) {
      double& h = target[map.at(x, y)];
      if (!std::isfinite(h)) continue;
      h -= shape.reduction;
      if ((map.place(x, y) - m.middle).norm() < 2) least = std::min(least, h - mean);
      h = std::max(h, margin + 0.5);
    }
  if (least < kLeastHeight)
    throw Error(
        fmt::format("the stump would stand only {:.2f} mm over its margin: the crown is too "
                    "low for a reduction of {:g} mm",
                    least, shape.reduction));
  const Lowering lowering(map, target, bur);
  const double safe = highest + 1.5;
  Plan plan;
  plan.roughing_lag = 1;  // much is taken, and two rounds follow
  plan.start = {m.middle.x(), m.middle.y(), highest + 3};
  const double apart = std::max(0.4, 1.2 * radius_at(bur, 0.3));
  sweep(plan, map, lowering, true, apart, 0.5 * shape.reduction, safe, Pace::kRoughing,
        "Occlusal reduction: roughing, half of it.");
  sweep(plan, map, lowering, false, apart, 0.1, safe, Pace::kRoughing,
        "Roughing, across, the rest.");
  sweep(plan, map, lowering, true, 0.7 * apart, 0, safe, Pace::kFinishing, "Finishing.");
  axial(plan, m, flank, units::from_degree(shape.taper) - flank.angle, safe);
  const Vec3 last = plan.strokes.back().to;
  plan.go({last.x(), last.y(), highest + 3}, Pace::kAir);
  plan.facts.push_back(
      fmt::format("occlusal  {:.2f} mm lower, along the tooth's own form", shape.reduction));
  plan.facts.push_back(fmt::format(
      "walls     {:g} degrees of taper each; {:.1f} to {:.1f} mm are taken off the bulge",
      shape.taper, shape.margin_width, m.bulge));
  plan.facts.push_back(fmt::format("margin    {:.2f} mm wide, {:.2f} mm above the neck all around",
                                   shape.margin_width, shape.above_neck));
  return plan;
}

}  // namespace toothprep
