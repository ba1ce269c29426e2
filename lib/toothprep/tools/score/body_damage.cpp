#include "toothprep/tools/score/body_damage.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/compare/volumes.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

struct Damage {
  double volume = 0, depth = 0;  // mm³, mm
  bool present = false;          // there is such a body
};

double fraction(float phi, double voxel) {
  return std::clamp(0.5 - static_cast<double>(phi) / voxel, 0.0, 1.0);
}

void add_volumes(const Solid& original, const Solid& prepared, double tolerance,
                 std::vector<Damage>& damage) {
  const LabelGrid& of = original.bodies->of;
  const double voxel = original.tooth.lattice.voxel;
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    const float *before = original.tooth.solid.brick(b), *after = prepared.tooth.solid.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const std::uint8_t body = of.brick(b)[v];
      const double gone = fraction(before[v], voxel) - fraction(after[v], voxel);
      if (body > 0 && gone > tolerance / voxel) damage[body - 1u].volume += gone;
    }
  }
  for (Damage& d : damage) d.volume *= voxel * voxel * voxel;
}

void add_depths(const Solid& original, const Solid& prepared, double tolerance,
                std::vector<Damage>& damage) {
  const ToothBodies& bodies = *original.bodies;
  const Lattice& lattice = original.tooth.lattice;
  const std::vector<float> depth = depth_inside(prepared.surface, original.tooth);
  const double known = 0.9 * original.tooth.band();  // deeper, the level set is clamped
  std::optional<TriangleTree> tree;
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (!(depth[i] > tolerance)) continue;
    const Vec3 x = prepared.surface.vertices[i].cast<double>();
    const Index3 at = lattice.to_index(x).array().round().matrix().cast<int>();
    const std::uint8_t body = bodies.of.value(at.x(), at.y(), at.z());
    if (body == 0 || body == bodies.worked() + 1) continue;
    Damage& d = damage[body - 1u];
    if (depth[i] >= known && !tree) tree.emplace(original.surface);
    d.depth = std::max(d.depth, depth[i] < known ? double{depth[i]} : tree->nearest(x).distance);
  }
}

void put(Quantities& quantities, Quantity quantity) {
  const auto same = std::find_if(quantities.begin(), quantities.end(),
                                 [&](const Quantity& q) { return q.key == quantity.key; });
  if (same != quantities.end())
    *same = std::move(quantity);
  else
    quantities.push_back(std::move(quantity));
}

}  // namespace

void add_body_damage(const Solid& original, const Solid& prepared, double voxel, double tolerance,
                     Quantities& quantities) {
  if (!original.bodies) return;
  const std::vector<Body>& list = original.bodies->list;
  std::vector<Damage> damage(list.size());
  add_volumes(original, prepared, tolerance, damage);
  // A surface's own vertices lie on it to a tenth of a voxel.
  add_depths(original, prepared, std::max(tolerance, original.tooth.lattice.voxel / 10), damage);
  const auto put_damage = [&](const Damage& d, const std::string& volume,
                              const std::string& depth) {
    put(quantities, {volume, d.volume, volume_uncertainty_mm3(d.volume, voxel), "mm^3"});
    put(quantities, {depth, d.depth, voxel / 2, "mm"});
  };
  Damage neighbours, gum;
  for (std::size_t b = 0; b < list.size(); ++b) {
    if (list[b].kind == BodyKind::kTooth) continue;
    put_damage(damage[b], "body_removed_mm3." + list[b].name, "body_depth_mm." + list[b].name);
    Damage& all = list[b].kind == BodyKind::kGum ? gum : neighbours;
    all.volume += damage[b].volume;
    all.depth = std::max(all.depth, damage[b].depth);
    all.present = true;
  }
  for (Quantity& q : quantities)
    if (q.key == "removed_mm3.total") q.value -= neighbours.volume + gum.volume;
  if (neighbours.present) put_damage(neighbours, "neighbour_damage_mm3", "neighbour_depth_mm");
  if (gum.present) put_damage(gum, "gum_damage_mm3", "gum_depth_mm");
}

}  // namespace toothprep
