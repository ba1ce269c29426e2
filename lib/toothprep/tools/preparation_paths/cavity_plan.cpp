#include "toothprep/tools/preparation_paths/cavity_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/preparation_paths/box_plan.h"

namespace toothprep {
namespace {

constexpr double kOver = 1.0;   // mm, of a bur that passes over the tooth
constexpr double kEdge = 0.03;  // mm: ridges that passes may leave on a floor

Vec3 at(const Vec2& p, double z) { return {p.x(), p.y(), z}; }

// Heights over all that a bur of this radius covers along the line.
std::vector<double> heights_under(const CrownMap& map, const std::vector<double>& heights,
                                  const std::vector<Vec2>& line, double radius) {
  std::vector<double> found;
  for (int y = 0; y < map.ny; ++y)
    for (int x = 0; x < map.nx; ++x) {
      const double h = heights[map.at(x, y)];
      if (!std::isfinite(h)) continue;
      double least = std::numeric_limits<double>::infinity();
      for (const Vec2& p : line) least = std::min(least, (p - map.place(x, y)).squaredNorm());
      if (least <= radius * radius) found.push_back(h);
    }
  if (found.empty()) throw Error("the cavity lies beside the tooth");
  return found;
}

void check_width(const Bur& bur, double width, const char* option) {
  const double diameter = 2 * bur.max_radius();
  if (width < diameter - 1e-6)
    throw Error(
        fmt::format("{} {:g} is less than the bur's diameter of {:g} mm: take a thinner bur "
                    "or a wider cavity",
                    option, width, diameter));
}

// Lines side by side that fill a width, the outer ones along its borders.
std::vector<double> lanes(const Bur& bur, double width) {
  const double free = width - 2 * bur.max_radius();
  if (free < 0.04) return {0};
  const int gaps = std::max(1, static_cast<int>(std::ceil(free / (1.7 * flat_radius(bur, kEdge)))));
  std::vector<double> offsets;
  for (int i = 0; i <= gaps; ++i) offsets.push_back(free * (static_cast<double>(i) / gaps - 0.5));
  return offsets;
}

void follow(Plan& plan, const std::vector<Vec2>& line, double from_z, double to_z, Pace pace,
            const std::string& note = {}) {
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (i % 4 != 0 && i + 1 != line.size()) continue;  // points are 0.1 mm apart
    const double t = line.size() > 1 ? static_cast<double>(i) / (line.size() - 1.0) : 1;
    plan.go(at(line[i], from_z + t * (to_z - from_z)), pace, i == 0 ? note : "");
  }
}

std::vector<Vec2> reversed(std::vector<Vec2> line) {
  std::reverse(line.begin(), line.end());
  return line;
}

// A slot along a line, layer by layer: each is entered by going down along the first lane, so that
// the flat end never plunges.
struct Slot {
  std::vector<Vec2> line;
  double width = 0, top = 0, floor = 0;
};

void rough(Plan& plan, const Slot& slot, const Bur& bur, double thickest) {
  const std::vector<double> offsets = lanes(bur, slot.width);
  plan.go(at(shifted(slot.line, offsets[0]).front(), plan.start.z()), Pace::kAir);
  plan.go(at(shifted(slot.line, offsets[0]).front(), slot.top + 0.1), Pace::kAir,
          "Roughing: along the fissure, down layer by layer.");
  double z = slot.top;
  bool back = false;
  for (const double floor : layer_floors(slot.top, slot.floor, thickest)) {
    const auto lane = [&](double offset) {
      const std::vector<Vec2> line = shifted(slot.line, offset);
      return back ? reversed(line) : line;
    };
    follow(plan, lane(offsets[0]), z, floor, Pace::kRoughing);
    for (std::size_t k = 1; k < offsets.size(); ++k) {
      back = !back;
      follow(plan, lane(offsets[k]), floor, floor, Pace::kRoughing);
    }
    back = !back;
    follow(plan, lane(offsets[0]), floor, floor, Pace::kRoughing);
    back = !back;
    z = floor;
  }
}

// Twice around the outline on the floor, once each way, with waits at the ends, then over its middle.
void finish(Plan& plan, const Slot& slot, const Bur& bur) {
  const double half = 0.5 * slot.width - bur.max_radius();
  const double z = slot.floor;
  if (half < 0.02) {
    follow(plan, reversed(slot.line), z, z, Pace::kFinishing, "Finishing: floor and walls.");
    plan.hold(kCatchUp);
    follow(plan, slot.line, z, z, Pace::kFinishing);
    plan.hold(kCatchUp);
    return;
  }
  const std::vector<Vec2> left = shifted(slot.line, half), right = shifted(slot.line, -half);
  follow(plan, left, z, z, Pace::kFinishing, "Finishing: walls and floor, once around each way.");
  plan.hold(kCatchUp);
  follow(plan, reversed(right), z, z, Pace::kFinishing);
  plan.hold(kCatchUp);
  follow(plan, left, z, z, Pace::kFinishing);
  follow(plan, reversed(left), z, z, Pace::kFinishing);
  plan.hold(kCatchUp);
  follow(plan, right, z, z, Pace::kFinishing);
  plan.hold(kCatchUp);
  for (const double offset : lanes(bur, slot.width))
    if (std::abs(offset) < half - 0.01)
      follow(plan, reversed(shifted(slot.line, offset)), z, z, Pace::kFinishing);
}

struct Occlusal {
  CrownMap map;
  Fissure fissure;
  double floor = 0, highest = 0;  // mm; highest: of all of it, and of others
};

double floor_under(const CrownMap& map, const std::vector<Vec2>& line, const CavityShape& shape) {
  const double radius = 0.5 * shape.width;
  if (!shape.into_dentin)
    return median(heights_under(map, map.surface, line, radius)) - shape.depth;
  std::vector<double> border = heights_under(map, map.dentin, line, radius);
  const auto low = border.begin() + static_cast<std::ptrdiff_t>(border.size() / 20);
  std::nth_element(border.begin(), low, border.end());
  return *low - *shape.into_dentin;
}

Occlusal occlusal_part(const ToothGrid& grid, const CavityShape& shape,
                       const CavityGround& ground) {
  Occlusal o{crown_map(grid), {}};
  FissureSearch search;
  search.middle = ground.fossa;
  search.along = ground.along;
  search.from_outline = shape.ridge + 0.5 * shape.width;
  search.longest = shape.longest;
  o.fissure = find_fissure(grid, o.map, search);
  o.floor = floor_under(o.map, o.fissure.points, shape);
  o.highest = *std::max_element(o.map.surface.begin(), o.map.surface.end());
  for (const SurfacePlace& p : ground.others) o.highest = std::max(o.highest, p.at.z());
  return o;
}

Plan started(const Occlusal& o, const Vec2& over) {
  Plan plan;
  plan.start = at(over, o.highest + 3);
  return plan;
}

double top_along(const CrownMap& map, const std::vector<Vec2>& line, double radius) {
  const std::vector<double> heights = heights_under(map, map.surface, line, radius);
  return *std::max_element(heights.begin(), heights.end()) + 0.05;
}

void leave(Plan& plan, double z) {
  const Vec3 last = plan.strokes.back().to;
  plan.go({last.x(), last.y(), z}, Pace::kAir, "Out along the bur's axis.");
}

}  // namespace

Plan plan_class1(const ToothGrid& grid, const Bur& bur, const CavityShape& shape,
                 const CavityGround& ground) {
  check_width(bur, shape.width, "--width-mm");
  const Occlusal o = occlusal_part(grid, shape, ground);
  // Its round ends are as wide as the bur: the tip stays inside the cavity by the bur's radius.
  const Slot slot{o.fissure.points, shape.width,
                  top_along(o.map, o.fissure.points, 0.5 * shape.width), o.floor};
  Plan plan = started(o, slot.line.front());
  plan.facts.push_back(fmt::format(
      "outline   {:.2f} mm along the main fissure, {:.2f} mm wide; {:.1f} mm or more of the "
      "marginal ridges stay",
      length_of(slot.line) + 2 * bur.max_radius(), shape.width, shape.ridge));
  plan.facts.push_back(
      fmt::format("floor     flat, {:.2f} mm below the lowest place of the fissure",
                  o.fissure.fossa - o.floor));
  rough(plan, slot, bur, shape.layer);
  finish(plan, slot, bur);
  leave(plan, o.highest + 3);
  return plan;
}

Plan plan_class2(const ToothGrid& grid, const Bur& bur, const CavityShape& shape,
                 const CavityGround& ground) {
  check_width(bur, shape.width, "--width-mm");
  check_width(bur, shape.box_width, "--box-width-mm");
  CavityGround along = ground;
  along.along = Vec2::UnitX();
  Occlusal o = occlusal_part(grid, shape, along);
  const Proximal side = proximal_side(grid, o.fissure.points.back(), o.fissure.fossa);
  const ProximalBox box(grid, o.map, bur, shape, ground, side, o.floor);
  // The occlusal part goes on into the box.
  std::vector<Vec2>& line = o.fissure.points;
  while (line.size() > 2 && line.back().x() > box.wall_x(0) - 0.5) line.pop_back();
  const Vec2 from = line.back(), into(box.wall_x(0), box.middle());
  const int parts = std::max(1, static_cast<int>(std::ceil((into - from).norm() / 0.1)));
  for (int i = 1; i <= parts; ++i)
    line.push_back(from + (into - from) * static_cast<double>(i) / parts);
  const Slot slot{line, shape.width, top_along(o.map, line, 0.5 * shape.width), o.floor};
  Plan plan = started(o, line.front());
  plan.facts.push_back(
      fmt::format("occlusal  {:.2f} mm long, {:.2f} mm wide, floor {:.2f} mm below the "
                  "lowest place of the fissure",
                  length_of(line), shape.width, o.fissure.fossa - o.floor));
  plan.facts.push_back(fmt::format(
      "box       {:.2f} mm wide, axial wall {:.2f} mm deep, gingival floor {:.2f} mm below the "
      "pulpal one and {:.2f} mm above the neck",
      shape.box_width, shape.axial_depth, o.floor - box.floor(), box.floor() - side.neck));
  if (box.beside_others())
    plan.facts.push_back(fmt::format(
        "beside it {:.2f} mm stay between the bur and what must not be touched; {}", ground.clear,
        box.shell() > 0
            ? fmt::format("a shell of up to {:.2f} mm stays at the contact", box.shell())
            : std::string("the contact is open")));
  rough(plan, slot, bur, shape.layer);
  leave(plan, o.highest + kOver);
  box.rough(plan, shape.layer);
  box.finish(plan);
  const Vec3 out = plan.strokes.back().to;
  plan.go({out.x(), out.y(), o.highest + kOver}, Pace::kAir);
  plan.go(at(line.front(), o.highest + kOver), Pace::kAir);
  plan.go(at(line.front(), o.floor + 0.3), Pace::kAir);
  finish(plan, slot, bur);
  leave(plan, o.highest + 3);
  return plan;
}

}  // namespace toothprep
