#include "toothprep/tools/segmentation/cavity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace toothprep {
namespace {

constexpr double kPulpShare = 0.004;  // of the tooth's voxels: less is no pulp chamber
double smallest_cavity(double blur) { return 8 * std::pow(blur, 3); }  // voxels

// What surrounds a cavity, and what could be one.
struct Walls {
  double grey = 0;  // at least that bright
  Mask wall;        // the largest piece of it
  Mask closed;      // dark and not connected with the outside at all
  Field distance;   // to the wall, voxels
  std::size_t voxels = 0;
};

Walls walls_of(const WorkBox& box, const Field& grey, const GreyClasses& classes) {
  const std::size_t n = box.voxels();
  Walls walls;
  walls.grey = std::max(classes.threshold_dentin,
                        classes.dentin - 0.4 * (classes.dentin - classes.below_dentin));
  walls.wall.resize(n);
  for (std::size_t v = 0; v < n; ++v) walls.wall[v] = grey[v] >= walls.grey;
  keep_largest_component(box.size, walls.wall);
  for (std::size_t v = 0; v < n; ++v) walls.voxels += walls.wall[v];
  walls.distance = distance_to(box.size, walls.wall);
  walls.closed = walls.wall;
  fill_enclosed(box.size, walls.closed);
  for (std::size_t v = 0; v < n; ++v) walls.closed[v] = walls.closed[v] && !walls.wall[v];
  return walls;
}

// Where a ball of this radius (voxels) fits, and how far (voxels) every voxel is from where it comes
// in from the outside. Beyond the box all is outside: there the centre is free at the ball's radius
// from the tooth, which is `margin` voxels away.
struct BallPlaces {
  Mask open;
  Field from_outside;
};

BallPlaces places_of_ball(const WorkBox& box, const Walls& walls, double ball, double margin) {
  const std::size_t n = box.voxels();
  BallPlaces places{Mask(n), {}};
  Mask outside(n);
  for (std::size_t v = 0; v < n; ++v) places.open[v] = walls.distance[v] > ball;
  const Components balls = connected_components(box.size, places.open);
  for (std::size_t v = 0; v < n; ++v)
    outside[v] = balls.label[v] != 0 && balls.at_edge[balls.label[v] - 1];
  places.from_outside = distance_to(box.size, outside);
  const double beyond = std::max(0.0, ball - margin);
  box.for_each([&](int i, int j, int k, std::size_t v) {
    const Index3 index(i, j, k);
    const int to_edge = std::min(index.minCoeff(), (box.size - Index3::Ones() - index).minCoeff());
    places.from_outside[v] = std::min(places.from_outside[v], static_cast<float>(to_edge + beyond));
  });
  return places;
}

// Dark parts that the ball can't reach from outside.
struct Parts {
  Components parts;
  std::vector<std::uint8_t> keep;  // per part: it is a cavity
  std::size_t kept_voxels = 0;

  bool kept(std::size_t v) const { return parts.label[v] != 0 && keep[parts.label[v] - 1]; }
};

// A part is a cavity if a ball fits or it is closed, it is no speck, and dentin makes up its walls.
Parts cavities_among(const WorkBox& box, const Field& grey, const GreyClasses& classes,
                     const Walls& walls, const BallPlaces& places, double ball, double blur) {
  const std::size_t n = box.voxels();
  Mask candidate(n);
  for (std::size_t v = 0; v < n; ++v)
    candidate[v] = !walls.wall[v] && places.from_outside[v] > ball + 0.5;
  Parts found;
  found.parts = connected_components(box.size, candidate);
  found.keep.assign(found.parts.count(), 0);
  std::vector<std::size_t> dentin_walls(found.parts.count(), 0), all_walls(found.parts.count(), 0);
  const std::array<std::ptrdiff_t, 3> stride = {
      1, box.size.x(), static_cast<std::ptrdiff_t>(box.size.x()) * box.size.y()};
  std::size_t v = 0;
  for (int k = 0; k < box.size.z(); ++k)
    for (int j = 0; j < box.size.y(); ++j)
      for (int i = 0; i < box.size.x(); ++i, ++v) {
        if (found.parts.label[v] == 0) continue;
        const std::size_t part = found.parts.label[v] - 1;
        if (places.open[v] || walls.closed[v]) found.keep[part] = 1;
        const Index3 index(i, j, k);
        for (int a = 0; a < 3; ++a)
          for (const int side : {-1, 1}) {
            if (index[a] + side < 0 || index[a] + side >= box.size[a]) continue;
            const auto o =
                static_cast<std::size_t>(static_cast<std::ptrdiff_t>(v) + side * stride[a]);
            if (!walls.wall[o]) continue;
            ++all_walls[part];
            dentin_walls[part] += grey[o] < classes.threshold_enamel;
          }
      }
  for (std::size_t part = 0; part < found.parts.count(); ++part) {
    found.keep[part] = found.keep[part] &&
                       static_cast<double>(found.parts.voxels[part]) >= smallest_cavity(blur) &&
                       2 * dentin_walls[part] >= all_walls[part];
    if (found.keep[part]) found.kept_voxels += found.parts.voxels[part];
  }
  return found;
}

// The median grey where the walls' blur doesn't reach, if there is such a place.
double typical_grey(const Field& grey, const Parts& found, const Walls& walls, double blur) {
  Field core;
  for (double deep = 3 * blur; core.size() < 30 && deep > 0.1; deep *= 0.7) {
    core.clear();
    for (std::size_t v = 0; v < grey.size(); ++v)
      if (found.kept(v) && walls.distance[v] >= deep) core.push_back(grey[v]);
  }
  std::nth_element(core.begin(), core.begin() + static_cast<std::ptrdiff_t>(core.size() / 2),
                   core.end());
  return core[core.size() / 2];
}

// The cavity's mask, at its half-way border, which may lie beyond the parts (bright pulp) or within
// (dark pulp). False if nothing is left.
bool fill_mask(const WorkBox& box, const Field& grey, const Parts& found, const Walls& walls,
               double blur, Cavity& cavity) {
  const std::size_t n = box.voxels();
  Mask kept(n);
  for (std::size_t v = 0; v < n; ++v) kept[v] = found.kept(v);
  const Field to_kept = cavity.border > walls.grey ? distance_to(box.size, kept) : Field();
  cavity.mask.resize(n);
  for (std::size_t v = 0; v < n; ++v)
    cavity.mask[v] = grey[v] < cavity.border && cavity.from_outside[v] > cavity.ball + 0.5 &&
                     (kept[v] || (!to_kept.empty() && to_kept[v] <= blur));
  const Components pieces = connected_components(box.size, cavity.mask);
  bool any = false;
  for (std::size_t v = 0; v < n; ++v) {
    cavity.mask[v] =
        pieces.label[v] != 0 &&
        static_cast<double>(pieces.voxels[pieces.label[v] - 1]) >= smallest_cavity(blur);
    any = any || cavity.mask[v];
  }
  return any;
}

}  // namespace

Cavity find_cavity(const WorkBox& box, const Field& grey, const GreyClasses& classes, double blur,
                   double margin) {
  const Walls walls = walls_of(box, grey, classes);
  Cavity cavity;
  Parts found;
  for (const double radius : {0.35, 0.5, 0.75, 1.0}) {  // mm
    cavity.ball = std::max(2 * blur, radius / box.lattice.voxel);
    BallPlaces places = places_of_ball(box, walls, cavity.ball, margin);
    found = cavities_among(box, grey, classes, walls, places, cavity.ball, blur);
    cavity.from_outside = std::move(places.from_outside);
    if (static_cast<double>(found.kept_voxels) > kPulpShare * static_cast<double>(walls.voxels))
      break;
  }
  if (found.kept_voxels == 0) return {};
  cavity.grey = typical_grey(grey, found, walls, blur);
  cavity.border = 0.5 * (cavity.grey + classes.dentin);
  return fill_mask(box, grey, found, walls, blur, cavity) ? cavity : Cavity{};
}

}  // namespace toothprep
