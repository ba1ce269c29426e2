#include "toothprep/tools/segmentation/cavity.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kPulpShare = 0.004;  // of the tooth's voxels: less is no pulp chamber
double smallest_cavity(double blur) { return 8 * std::pow(blur, 3); }  // voxels

}  // namespace

Cavity find_cavity(const WorkBox& box, const Field& grey, const GreyClasses& classes, double blur,
                   double margin) {
  const std::size_t n = box.voxels();
  const double wall_grey = std::max(classes.threshold_dentin,
                                    classes.dentin - 0.4 * (classes.dentin - classes.below_dentin));
  Mask wall(n), dark(n);
  for (std::size_t v = 0; v < n; ++v) wall[v] = grey[v] >= wall_grey;
  keep_largest_component(box.size, wall);
  std::size_t wall_voxels = 0;
  for (std::size_t v = 0; v < n; ++v) {
    wall_voxels += wall[v];
    dark[v] = !wall[v];
  }
  const Field to_wall = distance_to(box.size, wall);
  Mask closed = wall;  // dark and not connected with the outside at all
  fill_enclosed(box.size, closed);
  for (std::size_t v = 0; v < n; ++v) closed[v] = closed[v] && dark[v];

  Cavity cavity;
  Components parts;
  std::vector<std::uint8_t> keep;
  bool any = false;
  for (const double radius : {0.35, 0.5, 0.75, 1.0}) {  // mm
    const double ball = std::max(2 * blur, radius / box.lattice.voxel);
    Mask open(n), outside(n), candidate(n);
    for (std::size_t v = 0; v < n; ++v) open[v] = to_wall[v] > ball;  // the ball's centre fits
    const Components balls = connected_components(box.size, open);
    for (std::size_t v = 0; v < n; ++v)
      outside[v] = balls.label[v] != 0 && balls.at_edge[balls.label[v] - 1];
    cavity.ball = ball;
    cavity.from_outside = distance_to(box.size, outside);
    // Beyond the box all is outside: there the centre is free at the ball's radius from the tooth.
    const double beyond = std::max(0.0, ball - margin);
    box.for_each([&](int i, int j, int k, std::size_t v) {
      const Index3 index(i, j, k);
      const int to_edge =
          std::min(index.minCoeff(), (box.size - Index3::Ones() - index).minCoeff());
      cavity.from_outside[v] =
          std::min(cavity.from_outside[v], static_cast<float>(to_edge + beyond));
    });
    for (std::size_t v = 0; v < n; ++v)
      candidate[v] = dark[v] && cavity.from_outside[v] > ball + 0.5;
    parts = connected_components(box.size, candidate);

    // Per part: does a ball fit, is it closed, what are its walls made of?
    keep.assign(parts.count(), 0);
    std::vector<std::size_t> dentin_walls(parts.count(), 0), walls(parts.count(), 0);
    const std::array<std::ptrdiff_t, 3> stride = {
        1, box.size.x(), static_cast<std::ptrdiff_t>(box.size.x()) * box.size.y()};
    std::size_t v = 0;
    for (int k = 0; k < box.size.z(); ++k)
      for (int j = 0; j < box.size.y(); ++j)
        for (int i = 0; i < box.size.x(); ++i, ++v) {
          if (parts.label[v] == 0) continue;
          const std::size_t part = parts.label[v] - 1;
          if (open[v] || closed[v]) keep[part] = 1;
          const Index3 index(i, j, k);
          for (int a = 0; a < 3; ++a)
            for (const int side : {-1, 1}) {
              if (index[a] + side < 0 || index[a] + side >= box.size[a]) continue;
              const auto o =
                  static_cast<std::size_t>(static_cast<std::ptrdiff_t>(v) + side * stride[a]);
              if (!wall[o]) continue;
              ++walls[part];
              dentin_walls[part] += grey[o] < classes.threshold_enamel;
            }
        }
    std::size_t kept_voxels = 0;
    for (std::size_t part = 0; part < parts.count(); ++part) {
      keep[part] = keep[part] && static_cast<double>(parts.voxels[part]) >= smallest_cavity(blur) &&
                   2 * dentin_walls[part] >= walls[part];
      if (keep[part]) kept_voxels += parts.voxels[part];
    }
    any = kept_voxels > 0;
    if (static_cast<double>(kept_voxels) > kPulpShare * static_cast<double>(wall_voxels)) break;
  }
  if (!any) return {};

  // Typical grey: where the walls' blur doesn't reach, if there is such a place.
  Field core;
  for (double deep = 3 * blur; core.size() < 30 && deep > 0.1; deep *= 0.7) {
    core.clear();
    for (std::size_t v = 0; v < n; ++v)
      if (parts.label[v] != 0 && keep[parts.label[v] - 1] && to_wall[v] >= deep)
        core.push_back(grey[v]);
  }
  std::nth_element(core.begin(), core.begin() + static_cast<std::ptrdiff_t>(core.size() / 2),
                   core.end());
  cavity.grey = core[core.size() / 2];

  // The border at half-way grey may lie beyond the parts (bright pulp) or within (dark pulp).
  cavity.border = 0.5 * (cavity.grey + classes.dentin);
  Mask kept(n);
  for (std::size_t v = 0; v < n; ++v) kept[v] = parts.label[v] != 0 && keep[parts.label[v] - 1];
  const Field to_kept = cavity.border > wall_grey ? distance_to(box.size, kept) : Field();
  cavity.mask.resize(n);
  for (std::size_t v = 0; v < n; ++v)
    cavity.mask[v] = grey[v] < cavity.border && cavity.from_outside[v] > cavity.ball + 0.5 &&
                     (kept[v] || (!to_kept.empty() && to_kept[v] <= blur));
  const Components pieces = connected_components(box.size, cavity.mask);
  any = false;
  for (std::size_t v = 0; v < n; ++v) {
    cavity.mask[v] =
        pieces.label[v] != 0 &&
        static_cast<double>(pieces.voxels[pieces.label[v] - 1]) >= smallest_cavity(blur);
    any = any || cavity.mask[v];
  }
  return any ? cavity : Cavity{};
}

}  // namespace toothprep
