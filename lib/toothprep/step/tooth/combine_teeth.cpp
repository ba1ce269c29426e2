#include "toothprep/step/tooth/combine_teeth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

// By how many voxels a lattice is shifted against another.
Index3 shift_of(const Lattice& from, const Lattice& to) {
  const Vec3 shift = (from.origin - to.origin) / to.voxel;
  const Vec3 whole = shift.array().round();
  if (std::abs(from.voxel - to.voxel) > 1e-9 * to.voxel ||
      (shift - whole).cwiseAbs().maxCoeff() > 1e-6)
    throw Error("bodies must lie on one lattice: the same voxel size, and whole voxels apart");
  return whole.cast<int>();
}

using Tissues = std::array<LevelSet, 3>;  // what remains of them, while it is put together

// Lays one tooth over what is there so far.
void add_tooth(const LayeredTooth& from, std::uint8_t number, LayeredTooth& all, Tissues& tissues,
               LabelGrid& of) {
  const Index3 shift = shift_of(from.lattice, all.lattice);
  for (std::size_t b = 0; b < from.solid.table_size(); ++b) {
    if (from.solid.is_uniform(b) && from.solid.uniform_value(b) > 0) continue;
    const Index3 origin = from.solid.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const float solid = from.solid.brick(b)[v];
      const Index3 i = origin + Index3(v >> 6, (v >> 3) & 7, v & 7) + shift;
      const auto to = static_cast<std::size_t>(all.solid.brick_index(i.x(), i.y(), i.z()));
      const int at = brick_offset(i.x() & 7, i.y() & 7, i.z() & 7);
      for (std::size_t k = 0; k < tissues.size(); ++k)
        if (const float r = from.remains[k].brick(b)[v]; r < tissues[k].brick(to)[at])
          tissues[k].writable_brick(to)[at] = r;
      const bool has_label = from.tissue.brick(b)[v] != 0;
      if (!(solid < all.solid.brick(to)[at]) && !(has_label && of.brick(to)[at] == 0)) continue;
      if (solid < all.solid.brick(to)[at]) all.solid.writable_brick(to)[at] = solid;
      if (!has_label) continue;
      all.tissue.writable_brick(to)[at] = from.tissue.brick(b)[v];
      of.writable_brick(to)[at] = number;
    }
  }
}

void refuse_same_tooth(const std::vector<LayeredTooth>& teeth, const std::vector<Body>& list) {
  std::vector<Box> boxes;
  for (const LayeredTooth& tooth : teeth) {
    const Box box = bounds_of_solid(tooth);
    for (std::size_t b = 0; b < boxes.size(); ++b)
      if (box.min == boxes[b].min && box.max == boxes[b].max)
        throw Error("'" + list[boxes.size()].name + "' is the same tooth as '" + list[b].name +
                    "'");
    boxes.push_back(box);
  }
}

template <class T>
BrickGrid<T> without_even_bricks(const BrickGrid<T>& from, const std::vector<T>& constants) {
  BrickGrid<T> tidy(from.first_brick(), from.brick_counts(), from.background(), constants);
  for (std::size_t b = 0; b < from.table_size(); ++b)
    if (!from.is_uniform(b) || from.uniform_value(b) != from.background())
      tidy.set_brick(b, from.brick(b));
  return tidy;
}

}  // namespace

LayeredTooth combine_teeth(const std::vector<LayeredTooth>& teeth, const std::vector<Body>& list) {
  check_bodies(list);
  if (teeth.size() != list.size()) throw Error("a list of bodies needs a tooth for each");
  refuse_same_tooth(teeth, list);
  const Lattice& lattice = teeth[0].lattice;
  Index3 lower = Index3::Constant(1 << 30), upper = -lower;
  for (const LayeredTooth& tooth : teeth) {
    const Index3 first = tooth.solid.first_brick() * kBrickEdge + shift_of(tooth.lattice, lattice);
    lower = lower.cwiseMin(first);
    upper = upper.cwiseMax(first + tooth.solid.brick_counts() * kBrickEdge - Index3::Ones());
  }
  LayeredTooth all = make_empty_tooth(lattice, lower, upper);
  Tissues tissues = {all.solid, all.solid, all.solid};  // empty
  LabelGrid of = make_body_grid(all.tissue, list.size());
  for (std::size_t b = 0; b < teeth.size(); ++b) {
    add_tooth(teeth[b], static_cast<std::uint8_t>(b + 1), all, tissues, of);
    if (list[b].kind == BodyKind::kTooth) all.provenance = teeth[b].provenance;
  }
  const auto band = static_cast<float>(all.band());
  all.tissue = without_even_bricks<std::uint8_t>(all.tissue, {1, 2, 3, 4});
  all.solid = without_even_bricks<float>(all.solid, {-band});
  for (std::size_t k = 0; k < tissues.size(); ++k)
    for (std::size_t b = 0; b < tissues[k].table_size(); ++b)
      if (!tissues[k].is_uniform(b)) all.remains[k].set_brick(b, tissues[k].brick(b));
  set_bodies(all, list, std::move(of));
  return all;
}

}  // namespace toothprep
