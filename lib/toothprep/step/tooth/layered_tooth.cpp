#include "toothprep/step/tooth/layered_tooth.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"

namespace toothprep {
namespace {

Index3 floor_div8(const Index3& i) { return Index3(i.x() >> 3, i.y() >> 3, i.z() >> 3); }

LevelSet empty_level_set(const Index3& first, const Index3& counts, double band) {
  const auto b = static_cast<float>(band);
  return LevelSet(first, counts, b, {-b});
}

double inside_fraction(float phi, double voxel) {
  return std::clamp(0.5 - static_cast<double>(phi) / voxel, 0.0, 1.0);
}

}  // namespace

LayeredTooth make_empty_tooth(const Lattice& lattice, const Index3& lower, const Index3& upper) {
  if (!(lattice.voxel > 0 && lattice.voxel <= 10) || !lattice.origin.allFinite())
    throw Error("voxel size must lie in (0, 10] mm, got " + std::to_string(lattice.voxel));
  const Index3 first = floor_div8(lower) - Index3::Ones();
  const Index3 counts = floor_div8(upper) + Index3::Constant(2) - first;
  if ((upper - lower).minCoeff() < 0) throw Error("a tooth needs a box with at least one voxel");
  if (counts.cast<double>().prod() * kBrickVoxels > 8.6e9)
    throw Error("the box holds more than 2^33 voxels; use a larger voxel size or a smaller region");
  LayeredTooth tooth;
  tooth.lattice = lattice;
  tooth.tissue = LabelGrid(first, counts, 0, {1, 2, 3, 4});
  tooth.solid = empty_level_set(first, counts, tooth.band());
  for (auto& grid : tooth.remains)
    grid = PackedLevelSet(first, counts, static_cast<float>(tooth.band()));
  return tooth;
}

LayeredTooth build_tooth_by_brick(
    const Lattice& lattice, const Index3& lower, const Index3& upper,
    const std::function<void(const Index3& first, ToothSample* samples)>& sample_brick) {
  LayeredTooth tooth = make_empty_tooth(lattice, lower, upper);
  const auto band = static_cast<float>(tooth.band());
  std::mutex insert;
  tbb::parallel_for(std::size_t{0}, tooth.tissue.table_size(), [&](std::size_t b) {
    std::array<ToothSample, kBrickVoxels> samples;
    sample_brick(tooth.tissue.brick_origin(b), samples.data());
    std::array<std::uint8_t, kBrickVoxels> labels;
    std::array<std::array<float, kBrickVoxels>, 4> phi;
    const auto clamped = [band](float v) { return std::clamp(v, -band, band); };
    for (int v = 0; v < kBrickVoxels; ++v) {
      labels[v] = static_cast<std::uint8_t>(samples[v].label);
      phi[0][v] = clamped(samples[v].solid);
      for (int k = 0; k < 3; ++k)
        phi[k + 1][v] = clamped(std::max(samples[v].tissue[k], samples[v].solid));
    }
    // Which pool slot a brick gets depends on the order of threads; its values and place do not.
    const std::lock_guard lock(insert);
    tooth.tissue.set_brick(b, labels.data());
    tooth.solid.set_brick(b, phi[0].data());
    for (int k = 0; k < 3; ++k) tooth.remains[k].set_brick(b, phi[k + 1].data());
  });
  return tooth;
}

LayeredTooth build_tooth(const Lattice& lattice, const Index3& lower, const Index3& upper,
                         const std::function<ToothSample(const Vec3&)>& sample, bool lipschitz) {
  const double half_diagonal = lattice.voxel * (kBrickEdge - 1) / 2.0 * std::sqrt(3.0);
  const double far = half_diagonal + kBandVoxels * lattice.voxel;
  return build_tooth_by_brick(
      lattice, lower, upper, [&](const Index3& first, ToothSample* samples) {
        if (lipschitz) {
          const Vec3 centre =
              lattice.to_world(first) + Vec3::Constant(lattice.voxel * (kBrickEdge - 1) / 2.0);
          const ToothSample s = sample(centre);
          const bool uniform =
              std::abs(s.solid) > far &&
              (s.solid > 0 || std::all_of(s.tissue.begin(), s.tissue.end(),
                                          [far](float d) { return std::abs(d) > far; }));
          if (uniform) {
            std::fill(samples, samples + kBrickVoxels, s);
            return;
          }
        }
        for (int x = 0; x < kBrickEdge; ++x)
          for (int y = 0; y < kBrickEdge; ++y)
            for (int z = 0; z < kBrickEdge; ++z)
              samples[brick_offset(x, y, z)] = sample(lattice.to_world(first + Index3(x, y, z)));
      });
}

void set_remains(LayeredTooth& tooth, std::size_t tissue, std::size_t brick, const float* values) {
  constexpr auto kDentin = static_cast<std::size_t>(tissue_index(Tissue::kDentin));
  PackedLevelSet& remains = tooth.remains[tissue];
  if (remains.share_brick(brick, values, tooth.solid)) return;
  if (tissue != kDentin && remains.share_negative(brick, values, tooth.remains[kDentin])) return;
  remains.set_brick(brick, values);
}

namespace {

template <class Grid>
double volume_of(const Grid& level_set, double voxel) {
  std::array<float, kBrickVoxels> unpacked;
  double fractions = 0;
  for (std::size_t b = 0; b < level_set.table_size(); ++b) {
    if (level_set.is_uniform(b)) {
      fractions += kBrickVoxels * inside_fraction(level_set.uniform_value(b), voxel);
      continue;
    }
    const float* phi = brick_values(level_set, b, unpacked);
    double sum = 0;
    for (int v = 0; v < kBrickVoxels; ++v) sum += inside_fraction(phi[v], voxel);
    fractions += sum;
  }
  return fractions * voxel * voxel * voxel;
}

// `other` has no level set: in its own voxels and those beside them it is what the solid has left.
double volume_of_other(const LayeredTooth& tooth) {
  constexpr auto kOther = static_cast<std::uint8_t>(Tissue::kOther);
  const double voxel = tooth.lattice.voxel;
  const auto is_other = [&](const Index3& i) {
    return tooth.tissue.value(i.x(), i.y(), i.z()) == kOther;
  };
  const auto near_other = [&](const Index3& i) {
    return is_other(i) || is_other(i + Index3(1, 0, 0)) || is_other(i - Index3(1, 0, 0)) ||
           is_other(i + Index3(0, 1, 0)) || is_other(i - Index3(0, 1, 0)) ||
           is_other(i + Index3(0, 0, 1)) || is_other(i - Index3(0, 0, 1));
  };
  double fractions = 0;
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    const float* solid = tooth.solid.brick(b);
    double sum = 0;
    for (int v = 0; v < kBrickVoxels; ++v) {
      double rest = inside_fraction(solid[v], voxel);
      for (const PackedLevelSet& tissue : tooth.remains)
        rest -= inside_fraction(tissue.brick(b)[v], voxel);
      if (rest > 1e-6 &&
          near_other(tooth.solid.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7)))
        sum += rest;
    }
    fractions += sum;
  }
  return fractions * voxel * voxel * voxel;
}

}  // namespace

double volume_mm3(const LevelSet& level_set, double voxel) { return volume_of(level_set, voxel); }

double volume_mm3(const PackedLevelSet& level_set, double voxel) {
  return volume_of(level_set, voxel);
}

PerTissue<double> remaining_volumes_mm3(const LayeredTooth& tooth) {
  PerTissue<double> volumes{};
  tbb::parallel_for(std::size_t{0}, tooth.remains.size(), [&](std::size_t k) {
    volumes[k] = volume_mm3(tooth.remains[k], tooth.lattice.voxel);
  });
  constexpr auto kOther = static_cast<std::uint8_t>(Tissue::kOther);
  bool has_other = false;
  for (std::size_t b = 0; b < tooth.tissue.table_size() && !has_other; ++b) {
    const std::uint8_t* labels = tooth.tissue.brick(b);
    const std::uint8_t* end = labels + (tooth.tissue.is_uniform(b) ? 1 : kBrickVoxels);
    has_other = std::find(labels, end, kOther) != end;
  }
  if (has_other) volumes[tissue_index(Tissue::kOther)] = volume_of_other(tooth);
  return volumes;
}

Box bounds_of_solid(const LayeredTooth& tooth) {
  // A voxel at signed distance phi < 0 has solid all round it up to |phi|: exact for a face along
  // the axes.
  Box box{Vec3::Constant(std::numeric_limits<double>::max()),
          Vec3::Constant(std::numeric_limits<double>::lowest())};
  const auto include = [&](const Index3& voxel, const Eigen::Vector3f& phi) {
    const Vec3 centre = tooth.lattice.to_world(voxel), reach = -phi.cast<double>();
    for (int axis = 0; axis < 3; ++axis) {
      if (phi[axis] >= 0) continue;
      box.min[axis] = std::min(box.min[axis], centre[axis] - reach[axis]);
      box.max[axis] = std::max(box.max[axis], centre[axis] + reach[axis]);
    }
  };
  const Vec3 band = Vec3::Constant(tooth.band());
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    if (tooth.solid.is_uniform(b) && tooth.solid.uniform_value(b) >= 0) continue;
    const Index3 first = tooth.solid.brick_origin(b);
    const Index3 last = first + Index3::Constant(kBrickEdge - 1);
    if (((tooth.lattice.to_world(first) - band).array() > box.min.array()).all() &&
        ((tooth.lattice.to_world(last) + band).array() < box.max.array()).all())
      continue;  // well within what was found so far
    if (tooth.solid.is_uniform(b)) {
      const Eigen::Vector3f phi = Eigen::Vector3f::Constant(tooth.solid.uniform_value(b));
      include(first, phi);
      include(last, phi);
      continue;
    }
    // Of each layer across an axis, the deepest voxel reaches farthest along it.
    const Eigen::Map<const Eigen::Matrix<float, kBrickEdge, kBrickEdge * kBrickEdge>> by_z(
        tooth.solid.brick(b));
    const Eigen::Matrix<float, 1, kBrickEdge* kBrickEdge> columns = by_z.colwise().minCoeff();
    const Eigen::Map<const Eigen::Matrix<float, kBrickEdge, kBrickEdge>> by_y(columns.data());
    const Eigen::Matrix<float, kBrickEdge, 1> z = by_z.rowwise().minCoeff(),
                                              y = by_y.rowwise().minCoeff(),
                                              x = by_y.colwise().minCoeff();
    for (int i = 0; i < kBrickEdge; ++i) include(first + Index3::Constant(i), {x[i], y[i], z[i]});
  }
  return box.min.x() <= box.max.x() ? box : Box{};
}

std::size_t memory_bytes(const LayeredTooth& tooth) {
  std::size_t bytes = 0;
  std::set<const void*> counted;  // what grids share, once
  const auto add = [&](const auto& grid) {
    bytes += grid.memory_bytes();
    if (counted.insert(grid.shared().bricks.get()).second) bytes += grid.shared().memory_bytes();
  };
  add(tooth.tissue);
  add(tooth.solid);
  for (const auto& grid : tooth.remains) add(grid);
  if (tooth.parts) {
    add(tooth.parts->intact), add(tooth.parts->cut);
    for (std::size_t k = 0; tooth.parts->tissues && k < tooth.remains.size(); ++k)
      bytes += (*tooth.parts->tissues)[k].memory_bytes_beside(tooth.remains[k]);
    if (tooth.parts->way) add(tooth.parts->way->deepest);
  }
  if (tooth.bodies) add(tooth.bodies->of);
  return bytes;
}

namespace {

template <class Grid>
void hash_grid(Sha256& hash, const Grid& grid) {
  using T = decltype(grid.background());
  std::array<T, kBrickVoxels> unpacked;
  for (std::size_t b = 0; b < grid.table_size(); ++b) {
    if (grid.is_uniform(b) && grid.uniform_value(b) == grid.background()) continue;
    const T* values = brick_values(grid, b, unpacked);
    const bool uniform = grid.is_uniform(b) || std::all_of(values, values + kBrickVoxels,
                                                           [&](T v) { return v == values[0]; });
    if (uniform && values[0] == grid.background()) continue;
    const Index3 first = grid.brick_origin(b);
    hash.update(first.data(), sizeof(int) * 3);
    hash.update(values, sizeof(T) * (uniform ? 1 : kBrickVoxels));
  }
}

}  // namespace

std::string tooth_sha256(const LayeredTooth& tooth) {
  Sha256 hash;
  hash.update(tooth.lattice.origin.data(), sizeof(double) * 3);
  hash.update(&tooth.lattice.voxel, sizeof(double));
  hash_grid(hash, tooth.tissue);
  hash_grid(hash, tooth.solid);
  for (const auto& grid : tooth.remains) hash_grid(hash, grid);
  return hash.hex();
}

void apply_remaining_solid(LayeredTooth& tooth, LevelSet solid) {
  const auto band = static_cast<float>(tooth.band());
  for (auto& grid : tooth.remains) {
    for (std::size_t b = 0; b < solid.table_size(); ++b) {
      if (grid.is_uniform(b) && grid.uniform_value(b) >= band) continue;
      if (solid.is_uniform(b) && solid.uniform_value(b) <= -band) continue;
      const float* s = solid.brick(b);
      std::array<float, kBrickVoxels> old, next;
      grid.brick(b).unpack(old.data());
      for (int v = 0; v < kBrickVoxels; ++v) next[v] = std::max(old[v], s[v]);
      // Most bricks stay as they are, and shared.
      if (std::memcmp(next.data(), old.data(), sizeof next) != 0) grid.set_brick(b, next.data());
    }
  }
  tooth.solid = std::move(solid);
  tooth.parts.reset();
}

LevelSet carved_solid(const LevelSet& solid, const LevelSet& cut) {
  LevelSet remaining = solid;
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    if (cut.is_uniform(b) && cut.uniform_value(b) < 0) continue;
    const float *before = solid.brick(b), *carved = cut.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) values[v] = std::max(before[v], carved[v]);
    if (std::memcmp(values.data(), before, sizeof values) != 0)
      remaining.set_brick(b, values.data());
  }
  return remaining;
}

void apply_cut(LayeredTooth& tooth, const LevelSet& cut) {
  const LevelSet& solid = tooth.solid;
  ToothParts parts =
      tooth.parts
          ? std::move(*tooth.parts)
          : ToothParts{solid,
                       empty_level_set(solid.first_brick(), solid.brick_counts(), tooth.band()),
                       tooth.remains};
  parts.way.reset();
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    if (cut.is_uniform(b) && cut.uniform_value(b) < 0) continue;
    const float *before = parts.cut.brick(b), *carved = cut.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) values[v] = std::min(before[v], -carved[v]);
    parts.cut.set_brick(b, values.data());
  }
  apply_remaining_solid(tooth, carved_solid(solid, cut));
  tooth.parts = std::move(parts);
}

}  // namespace toothprep
