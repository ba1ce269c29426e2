#include "toothprep/tools/preparation_paths/box_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/preparation_paths/neck.h"

namespace toothprep {
namespace {

// Outermost x of the tooth at (y, z); -infinity where there is none.
double outermost(const ToothGrid& grid, double y, double z) {
  const Index3 c = grid.cell({grid.low().x(), y, z});
  if (!grid.holds({0, c.y(), c.z()})) return -std::numeric_limits<double>::infinity();
  for (int x = grid.size().x() - 1; x >= 0; --x)
    if (ToothGrid::is_tooth(grid.at(x, c.y(), c.z())))
      return grid.place(x, 0, 0).x() + 0.5 * grid.step();
  return -std::numeric_limits<double>::infinity();
}

// x = a + b y + c y², y from the box's middle: the proximal surface at a height.
Vec3 fitted_wall(const ToothGrid& grid, double middle, double half, double z) {
  Mat3 normal = Mat3::Zero();
  Vec3 right = Vec3::Zero();
  for (double y = -half; y <= half; y += grid.step()) {
    const double x = outermost(grid, middle + y, z);
    if (!std::isfinite(x)) continue;
    const Vec3 row(1, y, y * y);
    normal += row * row.transpose();
    right += x * row;
  }
  return normal.ldlt().solve(right);
}

double box_floor(const CavityShape& shape, const Proximal& side, double pulpal) {
  const double lowest = side.neck + 0.8;  // sound enamel below the floor
  const double floor = shape.gingival_below
                           ? pulpal - *shape.gingival_below
                           : std::max(lowest, std::min(side.contact - 1.0, pulpal - 0.8));
  if (floor < side.neck + 0.2)
    throw Error(
        fmt::format("the gingival floor would lie {:.2f} mm above the neck or below it: take "
                    "less than {:.2f} mm of --gingival-below-mm",
                    floor - side.neck, pulpal - side.neck - 0.2));
  if (floor > pulpal - 0.4)
    throw Error(fmt::format(
        "there is no space for a box: the pulpal floor lies {:.2f} mm over the neck on that side",
        pulpal - side.neck));
  return floor;
}

}  // namespace

Proximal proximal_side(const ToothGrid& grid, const Vec2& middle, double top) {
  Proximal side;
  side.neck = neck_height(grid, middle, Vec2::UnitX(), top);
  side.outermost = -std::numeric_limits<double>::infinity();
  for (double z = side.neck + 0.5; z < top; z += grid.step())
    for (double y = middle.y() - 4; y < middle.y() + 4; y += grid.step()) {
      const double x = outermost(grid, y, z);
      if (x <= side.outermost) continue;
      side.outermost = x;
      side.contact = z;
    }
  double sum = 0, count = 0;
  for (double y = middle.y() - 4; y < middle.y() + 4; y += grid.step())
    if (outermost(grid, y, side.contact) > side.outermost - 0.25) {
      sum += y;
      ++count;
    }
  side.middle = sum / count;
  return side;
}

ProximalBox::ProximalBox(const ToothGrid& grid, const CrownMap& map, const Bur& bur,
                         const CavityShape& shape, const CavityGround& ground, const Proximal& side,
                         double pulpal)
    : bur_(bur), middle_(side.middle), half_(0.5 * shape.box_width - bur.max_radius()) {
  floor_ = box_floor(shape, side, pulpal);
  const double half = 0.5 * shape.box_width;
  wall_ = fitted_wall(grid, middle_, half, 0.5 * (floor_ + pulpal));
  wall_[0] += bur.max_radius() - shape.axial_depth;
  outside_ = side.outermost + bur.max_radius() + 0.3;
  top_ = -std::numeric_limits<double>::infinity();
  for (double y = -half; y <= half; y += grid.step())
    for (double x = wall_x(y) - bur.max_radius(); x < outside_; x += grid.step())
      top_ = std::max(top_, map.height({x, middle_ + y}));
  top_ += 0.05;
  find_others(grid, ground);
}

// Those that the head could come too near to, and what remains of the side beside them.
void ProximalBox::find_others(const ToothGrid& grid, const CavityGround& ground) {
  clear_ = ground.clear;
  const double around = bur_.max_radius() + clear_;
  for (const SurfacePlace& p : ground.others)
    if (p.at.x() > wall_x(0) - 1 && p.at.x() < outside_ + around &&
        std::abs(p.at.y() - middle_) < half_ + around && p.at.z() > floor_ - clear_ &&
        p.at.z() < top_ + bur_.head_length() + clear_)
      near_.push_back(p);
  for (double y = -half_; !near_.empty() && y <= half_; y += grid.step()) {
    const Pose outer{tip(y, outside_, floor_), Quat::Identity()};
    if (const double off = outer.position.x() - wall_x(y); off < 0.05)
      throw Error(
          fmt::format("beside what else is there the bur could come no further than {:.2f} mm out "
                      "of the axial wall: take less of --gingival-below-mm or --clear-mm, or a "
                      "thinner bur",
                      std::max(off, 0.0)));
    for (double z = floor_; z < std::min(top_, floor_ + bur_.head_length()); z += grid.step()) {
      const double surface = outermost(grid, middle_ + y, z);
      double x = outer.position.x();
      while (x < surface && bur_.distance(x - outer.position.x(), z - floor_) < 0) x += 0.01;
      if (std::isfinite(surface)) shell_ = std::max(shell_, surface - x);
    }
  }
}

double ProximalBox::wall_x(double y) const { return wall_[0] + wall_[1] * y + wall_[2] * y * y; }

// As far as the head is clear all the way from the floor up and out of the box. Steps back by what is
// missing never pass the first place that is clear: the distance grows by at most the step.
double ProximalBox::outside(double y) const {
  double x = outside_;
  for (double z = floor_; !near_.empty() && (z == floor_ || z < top_);
       z += 0.5 * bur_.head_length())
    while (x > wall_x(y)) {
      const Pose pose{{x, middle_ + y, z}, Quat::Identity()};
      const double missing = clear_ - head_distance(bur_, pose, near_);
      if (missing < 0.002) break;
      x -= missing;
    }
  return x;
}

Vec3 ProximalBox::tip(double y, double off, double z) const {
  const double x = wall_x(y) + off;
  return {near_.empty() ? x : std::min(x, outside(y)), middle_ + y, z};
}

void ProximalBox::across(Plan& plan, double from, double to, double off, double from_z, double to_z,
                         Pace pace) const {
  const int parts = std::max(1, static_cast<int>(std::ceil(std::abs(to - from) / 0.4)));
  for (int i = 0; i <= parts; ++i)
    plan.go(tip(from + (to - from) * i / parts, off, from_z + (to_z - from_z) * i / parts), pace);
}

// Along the outermost row from where the bur is: a straight way would pass through what bulges
// between. Slowly: the force across the feed must not push the bur over.
void ProximalBox::outwards_to(Plan& plan, double y, double z) const {
  const Vec3 from = plan.strokes.back().to;
  across(plan, from.y() - middle_, y, outside_ - wall_x(0), from.z(), z, Pace::kFinishing);
}

// From outside inwards, so that the flat end never plunges; beside others down along the outermost
// row, and back.
void ProximalBox::layer(Plan& plan, double z, const std::string& note) const {
  const double beside = outside_ - wall_x(0);
  const int rows = std::max(1, static_cast<int>(std::ceil(beside / (1.5 * bur_.max_radius()))));
  double from = -half_;
  if (beside_others()) {
    if (plan.strokes.back().to.y() > middle_) from = half_;
    outwards_to(plan, -from, z);
    outwards_to(plan, from, z);
  } else {
    plan.go({outside_, middle_ - half_, z}, Pace::kRoughing, note);
  }
  for (int row = rows - 1; row >= 0; --row, from = -from)
    across(plan, from, -from, 0.1 + beside * row / rows, z, z, Pace::kRoughing);
  if (beside_others())
    plan.go(tip(from, beside, z), Pace::kFinishing);
  else
    plan.go({outside_, middle_ + from, z}, Pace::kRoughing);
}

void ProximalBox::rough(Plan& plan, double thickest) const {
  const double over = plan.strokes.back().to.z();
  plan.go({tip(-half_, outside_ - wall_x(-half_), top_).x(), middle_ - half_, over}, Pace::kAir);
  std::string note = "Roughing the box: from outside inwards, layer by layer.";
  if (beside_others()) {
    plan.go(tip(-half_, outside_ - wall_x(-half_), top_), Pace::kRoughing, note);
    note.clear();
  }
  for (const double z : layer_floors(top_, floor_, thickest)) {
    layer(plan, z, note);
    note.clear();
  }
}

// Where the ridge is higher than the head is long, first above the floor, so that the neck is free.
void ProximalBox::finish(Plan& plan) const {
  std::vector<double> levels = {floor_, floor_};
  if (const double over = top_ - floor_ - bur_.head_length() + 0.3; over > 0)
    levels.insert(levels.begin(), floor_ + over);
  const auto outer = [&](double y, double z) { return tip(y, outside_ - wall_x(y), z); };
  double way = 1;
  std::string note = "Finishing the box: along one wall, the axial wall, the other; and back.";
  for (const double z : levels) {
    if (beside_others()) outwards_to(plan, -way * half_, plan.strokes.back().to.z());
    plan.go(outer(-way * half_, z), Pace::kRoughing, note);
    note.clear();
    plan.go(tip(-way * half_, 0, z), Pace::kFinishing);
    plan.hold(kCatchUp);
    across(plan, -way * half_, way * half_, 0, z, z, Pace::kFinishing);
    plan.hold(kCatchUp);
    plan.go(outer(way * half_, z), Pace::kFinishing);
    way = -way;
  }
}

}  // namespace toothprep
