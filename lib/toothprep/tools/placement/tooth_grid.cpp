#include "toothprep/tools/placement/tooth_grid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/level_at.h"
#include "toothprep/step/tooth/tooth_bodies.h"

namespace toothprep {

ToothGrid::ToothGrid(const LayeredTooth& tooth, const Pose& frame, double step, double margin)
    : tooth_(tooth), frame_(frame), step_(step) {
  const Box box = bounds_of_solid(tooth);
  if (!((box.max - box.min).minCoeff() > 0)) throw Error("nothing remains of the tooth");
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 x = frame.to_local({corner & 1 ? box.max.x() : box.min.x(),
                                   corner & 2 ? box.max.y() : box.min.y(),
                                   corner & 4 ? box.max.z() : box.min.z()});
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  low_ = low - Vec3::Constant(margin);
  size_ = (((high - low).array() + 2 * margin) / step).ceil().matrix().cast<int>() + Index3::Ones();
  tissue_.assign(static_cast<std::size_t>(size_.x()) * size_.y() * size_.z(), 0);
  tbb::parallel_for(0, size_.x(), [&](int x) {
    for (int y = 0; y < size_.y(); ++y)
      for (int z = 0; z < size_.z(); ++z) {
        const Vec3 w = frame_.to_world(place(x, y, z));
        if (!(level_at(tooth_.solid, tooth_.lattice, w) < 0)) continue;
        Tissue tissue = Tissue::kOther;
        double deepest = 0;
        for (int k = 0; k < 3; ++k) {
          const double d = level_at(tooth_.remains[k], tooth_.lattice, w);
          if (d < deepest) {
            deepest = d;
            tissue = tissue_at(k);
          }
        }
        tissue_[index(x, y, z)] = static_cast<std::uint8_t>(tissue);
      }
  });
}

Tissue ToothGrid::at(const Vec3& x) const {
  const Index3 c = cell(x);
  return holds(c) ? at(c.x(), c.y(), c.z()) : Tissue::kAir;
}

double ToothGrid::distance(Surface surface, const Vec3& x) const {
  const Vec3 w = frame_.to_world(x);
  const auto of = [&](int k) { return level_at(tooth_.remains[k], tooth_.lattice, w); };
  double d = of(2);
  if (surface != Surface::kPulp) d = std::min(d, of(1));
  if (surface == Surface::kTooth || surface == Surface::kOther) d = std::min(d, of(0));
  return surface == Surface::kOther
             ? std::max<double>(level_at(tooth_.solid, tooth_.lattice, w), -d)
             : d;
}

namespace {

bool belongs(ToothGrid::Surface surface, Tissue t) {
  switch (surface) {
    case ToothGrid::Surface::kPulp:
      return t == Tissue::kPulp;
    case ToothGrid::Surface::kDentin:
      return t == Tissue::kPulp || t == Tissue::kDentin;
    case ToothGrid::Surface::kOther:
      return t == Tissue::kOther;
    default:
      return ToothGrid::is_tooth(t);
  }
}

}  // namespace

std::vector<SurfacePlace> ToothGrid::surface(Surface surface) const {
  std::vector<SurfacePlace> places;
  for (int x = 1; x + 1 < size_.x(); ++x)
    for (int y = 1; y + 1 < size_.y(); ++y)
      for (int z = 1; z + 1 < size_.z(); ++z) {
        if (!belongs(surface, at(x, y, z))) continue;
        if (belongs(surface, at(x - 1, y, z)) && belongs(surface, at(x + 1, y, z)) &&
            belongs(surface, at(x, y - 1, z)) && belongs(surface, at(x, y + 1, z)) &&
            belongs(surface, at(x, y, z - 1)) && belongs(surface, at(x, y, z + 1)))
          continue;
        const Vec3 p = place(x, y, z);
        places.push_back({p, std::clamp(distance(surface, p), -step_, 0.0)});
      }
  return places;
}

std::string body_at(const LayeredTooth& whole, const Vec3& world) {
  if (!whole.bodies) return {};
  const Index3 at = whole.lattice.to_index(world).array().round().matrix().cast<int>();
  const std::uint8_t body = whole.bodies->of.value(at.x(), at.y(), at.z());
  return body == 0 ? std::string() : whole.bodies->list[body - 1].name;
}

std::vector<SurfacePlace> surface_of_others(const ToothGrid& grid, const LayeredTooth& whole) {
  if (!whole.bodies) return {};
  std::vector<SurfacePlace> places = grid.surface(ToothGrid::Surface::kOther);
  const std::string& own = whole.bodies->list[whole.bodies->worked()].name;
  const auto is_own = [&](const SurfacePlace& p) {
    return body_at(whole, grid.frame().to_world(p.at)) == own;
  };
  places.erase(std::remove_if(places.begin(), places.end(), is_own), places.end());
  return places;
}

double ToothGrid::height(Surface surface, double x, double y) const {
  const Index3 c = cell({x, y, low_.z()});
  if (c.x() < 0 || c.y() < 0 || c.x() >= size_.x() || c.y() >= size_.y())
    return -std::numeric_limits<double>::infinity();
  for (int z = size_.z() - 1; z > 0; --z) {
    if (!belongs(surface, at(c.x(), c.y(), z))) continue;
    const double h = low_.z() + step_ * z;
    const double in = distance(surface, {x, y, h}), out = distance(surface, {x, y, h + step_});
    return in < 0 && out > in ? h + step_ * std::clamp(in / (in - out), 0.0, 1.0) : h;
  }
  return -std::numeric_limits<double>::infinity();
}

double head_distance(const Bur& bur, const Pose& pose, const std::vector<SurfacePlace>& places,
                     Vec3* where) {
  double least = std::numeric_limits<double>::infinity();
  const Vec3 axis = pose.orientation * Vec3::UnitZ();
  for (const SurfacePlace& p : places) {
    const Vec3 off = p.at - pose.position;
    const double z = off.dot(axis), r = std::sqrt(std::max(0.0, off.squaredNorm() - z * z));
    // A cylinder around the head is never further than the head.
    const double across = r - bur.max_radius(), along = std::max(-z, z - bur.head_length());
    if (std::max(across, along) + p.outside >= least) continue;
    const double d = bur.distance(r, z) + p.outside;
    if (d >= least) continue;
    least = d;
    if (where) *where = p.at;
  }
  return least;
}

Milling::Bite Milling::at(const Pose& pose) {
  Bite bite;
  const double cell = grid_.step() * grid_.step() * grid_.step();
  const Vec3 axis = pose.orientation * Vec3::UnitZ();
  const bool shank = bur_.shank_radius() > 0;
  const double top = shank ? bur_.shank_top() : bur_.head_length();
  const double reach = std::max(bur_.max_radius(), bur_.shank_radius());
  const Vec3 end = pose.position + top * axis;
  const Vec3 round = reach * (Vec3::Ones() - axis.cwiseAbs2()).cwiseMax(0).cwiseSqrt();
  const Index3 low = grid_.cell(pose.position.cwiseMin(end) - round).cwiseMax(0);
  const Index3 high =
      grid_.cell(pose.position.cwiseMax(end) + round).cwiseMin(grid_.size() - Index3::Ones());
  for (int x = low.x(); x <= high.x(); ++x)
    for (int y = low.y(); y <= high.y(); ++y)
      for (int z = low.z(); z <= high.z(); ++z) {
        if (!remains(x, y, z)) continue;
        const Vec3 off = grid_.place(x, y, z) - pose.position;
        const double h = off.dot(axis), r = std::sqrt(std::max(0.0, off.squaredNorm() - h * h));
        if (r > reach) continue;
        if (bur_.distance(r, h) < 0) {
          gone_[grid_.index(x, y, z)] = true;
          bite.removed[tissue_index(grid_.at(x, y, z))] += cell;
        } else if (shank && h > bur_.head_length() && h < top &&
                   r < bur_.shank_radius() - 0.5 * grid_.step()) {
          bite.shank += cell;
        }
      }
  return bite;
}

Milling::Bite Milling::along(const Pose& from, const Pose& to) {
  const double way = (to.position - from.position).norm() +
                     bur_.head_length() * from.orientation.angularDistance(to.orientation);
  const int parts = std::max(1, static_cast<int>(std::ceil(2 * way / grid_.step())));
  Bite sum;
  for (int i = 1; i <= parts; ++i) {
    const double t = static_cast<double>(i) / parts;
    const Bite bite = at({from.position + t * (to.position - from.position),
                          from.orientation.slerp(t, to.orientation)});
    for (int k = 0; k < kTissueCount; ++k) sum.removed[k] += bite.removed[k];
    sum.shank = std::max(sum.shank, bite.shank);
  }
  return sum;
}

}  // namespace toothprep
