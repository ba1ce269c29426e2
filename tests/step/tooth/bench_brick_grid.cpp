// Bricks against OpenVDB for what the 1 kHz step does with a level set: trilinear look-ups along
// the bur's surface while it advances, and writing what it removed. Figures and decision:
// lib/toothprep/step/tooth/README.md.
//
// The set-up is a slot in a block, a cylinder (1.2 x 3 mm) at its end, 1250 points on its surface,
// advancing by 0.0005 mm per step (0.5 mm/s at 1 kHz). One iteration is one step.
#include <benchmark/benchmark.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "toothprep/step/core/units.h"
#include "toothprep/step/tooth/brick_grid.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {
namespace {

constexpr double kRadius = 0.6, kLength = 3.0, kAdvance = 0.0005;
constexpr int kSteps = 2000;  // then the path starts again: 1 mm

struct Scene {
  double voxel;
  LayeredTooth tooth;
  openvdb::FloatGrid::Ptr grid;
  std::vector<Vec3> surface;  // index coordinates at the start of the path

  explicit Scene(double d) : voxel(d) {
    Lattice lattice;
    lattice.voxel = voxel;
    lattice.origin = Vec3::Constant(voxel / 2);
    const int n = static_cast<int>(2 / voxel);
    tooth = build_tooth(
        lattice, Index3(-n, -2 * n, -n), Index3(n, 0, n),
        [](const Vec3& x) {
          const Vec3 q = (x + Vec3(0, 2, 0)).cwiseAbs() - Vec3(2, 2, 2);
          const double block = q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
          const double along = std::max(x.y() + 1.0, 0.0) - x.y() - 1.0;  // below the slot's end
          const double slot =
              std::max(std::hypot(x.x(), along) - kRadius, std::abs(x.z()) - kLength / 2);
          ToothSample s;
          s.solid = static_cast<float>(std::max(block, -slot));
          if (s.solid < 0) s.label = Tissue::kDentin;
          return s;
        },
        false);
    openvdb::initialize();
    grid = openvdb::FloatGrid::create(tooth.solid.background());
    for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
      const Index3 o = tooth.solid.brick_origin(b);
      const openvdb::Coord origin(o.x(), o.y(), o.z());
      if (tooth.solid.is_uniform(b)) {
        if (tooth.solid.uniform_value(b) < 0)
          grid->tree().addTile(1, origin, tooth.solid.uniform_value(b), false);
        continue;
      }
      auto* leaf = grid->tree().touchLeaf(origin);
      std::copy(tooth.solid.brick(b), tooth.solid.brick(b) + kBrickVoxels, leaf->buffer().data());
    }
    const int around = 50, up = 25;
    for (int l = 0; l < up; ++l)
      for (int a = 0; a < around; ++a) {
        const double phi = 2 * units::kPi * (a + 0.5) / around;
        surface.push_back(
            lattice.to_index(Vec3(kRadius * std::cos(phi), -1 + kRadius * std::sin(phi),
                                  kLength * ((l + 0.5) / up - 0.5))));
      }
  }
};

const Scene& scene(double voxel) {
  static std::vector<std::unique_ptr<Scene>> scenes;
  for (const auto& s : scenes)
    if (s->voxel == voxel) return *s;
  return *scenes.emplace_back(std::make_unique<Scene>(voxel));
}
double voxel_of(const benchmark::State& state) {
  return static_cast<double>(state.range(0)) * 1e-3;
}
double advance(int& step, const Scene& s) {  // in voxels
  if (++step == kSteps) step = 0;
  return step * kAdvance / s.voxel;
}

// Trilinear, the eight corners from one brick where they lie in one.
float trilinear(const LevelSet& grid, double x, double y, double z) {
  const double fx = std::floor(x), fy = std::floor(y), fz = std::floor(z);
  const int i = static_cast<int>(fx), j = static_cast<int>(fy), k = static_cast<int>(fz);
  std::array<float, 8> c;
  if ((i & 7) != 7 && (j & 7) != 7 && (k & 7) != 7) {
    const std::int64_t b = grid.brick_index(i, j, k);
    if (b < 0) return grid.background();
    const float* p = grid.brick(static_cast<std::size_t>(b)) + brick_offset(i & 7, j & 7, k & 7);
    c = {p[0], p[1], p[8], p[9], p[64], p[65], p[72], p[73]};
  } else {
    for (int n = 0; n < 8; ++n) c[n] = grid.value(i + (n >> 2), j + (n >> 1 & 1), k + (n & 1));
  }
  const auto tx = static_cast<float>(x - fx), ty = static_cast<float>(y - fy),
             tz = static_cast<float>(z - fz);
  const float c00 = c[0] + tz * (c[1] - c[0]), c01 = c[2] + tz * (c[3] - c[2]);
  const float c10 = c[4] + tz * (c[5] - c[4]), c11 = c[6] + tz * (c[7] - c[6]);
  const float c0 = c00 + ty * (c01 - c00), c1 = c10 + ty * (c11 - c10);
  return c0 + tx * (c1 - c0);
}

void look_up_bricks(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  int step = 0;
  for (auto _ : state) {
    const double moved = advance(step, s);
    float inside = 0;
    for (const Vec3& x : s.surface) inside += trilinear(s.tooth.solid, x.x(), x.y() - moved, x.z());
    benchmark::DoNotOptimize(inside);
  }
  state.counters["bricks_MB"] = static_cast<double>(s.tooth.solid.memory_bytes()) / 1e6;
}

void look_up_openvdb(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  const openvdb::FloatGrid::ConstAccessor accessor = s.grid->getConstAccessor();
  int step = 0;
  for (auto _ : state) {
    const double moved = advance(step, s);
    float inside = 0;
    for (const Vec3& x : s.surface)
      inside +=
          openvdb::tools::BoxSampler::sample(accessor, openvdb::Vec3d(x.x(), x.y() - moved, x.z()));
    benchmark::DoNotOptimize(inside);
  }
  state.counters["tree_MB"] = static_cast<double>(s.grid->memUsage()) / 1e6;
}

// The bricks that a removal at the bur's place touches: those of the cylinder's box, as in the
// step.
std::vector<Index3> touched(const Scene& s) {
  const Index3 low =
      s.tooth.lattice.to_index(Vec3(-kRadius, -1 - kRadius, -kLength / 2)).cast<int>();
  const Index3 high = s.tooth.lattice.to_index(Vec3(kRadius, -1, kLength / 2)).cast<int>();
  std::vector<Index3> origins;
  for (int x = low.x() >> 3; x <= high.x() >> 3; ++x)
    for (int y = low.y() >> 3; y <= high.y() >> 3; ++y)
      for (int z = low.z() >> 3; z <= high.z() >> 3; ++z) origins.emplace_back(x * 8, y * 8, z * 8);
  return origins;
}

void carve(float* values, float d) {
  for (int v = 0; v < kBrickVoxels; ++v) values[v] = std::max(values[v], d);
}

// max() over every voxel of those bricks, which all have storage already. Per brick: divide by
// `bricks`.
void write_bricks(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  LevelSet grid = s.tooth.solid;
  const std::vector<Index3> origins = touched(s);
  for (const Index3& o : origins)
    grid.writable_brick(static_cast<std::size_t>(grid.brick_index(o.x(), o.y(), o.z())));
  for (auto _ : state) {
    for (const Index3& o : origins)
      carve(grid.writable_brick(static_cast<std::size_t>(grid.brick_index(o.x(), o.y(), o.z()))),
            -1);
    benchmark::ClobberMemory();
  }
  state.counters["bricks"] = static_cast<double>(origins.size());
}

void write_openvdb(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  const auto grid = s.grid->deepCopy();
  openvdb::FloatGrid::Accessor accessor = grid->getAccessor();
  const std::vector<Index3> origins = touched(s);
  for (auto _ : state) {
    for (const Index3& o : origins)
      carve(accessor.touchLeaf(openvdb::Coord(o.x(), o.y(), o.z()))->buffer().data(), -1);
    benchmark::ClobberMemory();
  }
  state.counters["bricks"] = static_cast<double>(origins.size());
}

// The first write into uniform tissue: the brick takes its storage (reserved) or the leaf is
// allocated. Every brick of the inside once per iteration; the counter is the time of one.
const auto kPerBrick = benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert;

void first_write_bricks(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  std::vector<std::size_t> inside;
  for (std::size_t b = 0; b < s.tooth.solid.table_size(); ++b)
    if (s.tooth.solid.is_uniform(b) && s.tooth.solid.uniform_value(b) < 0) inside.push_back(b);
  for (auto _ : state) {
    state.PauseTiming();
    auto grid = std::make_unique<LevelSet>(s.tooth.solid);
    grid->reserve(inside.size());
    state.ResumeTiming();
    for (const std::size_t b : inside) carve(grid->writable_brick(b, false), -0.01F);
    benchmark::ClobberMemory();
    state.PauseTiming();
    grid.reset();
    state.ResumeTiming();
  }
  state.counters["per_brick"] = benchmark::Counter(static_cast<double>(inside.size()), kPerBrick);
}

void first_write_openvdb(benchmark::State& state) {
  const Scene& s = scene(voxel_of(state));
  std::vector<openvdb::Coord> inside;
  for (std::size_t b = 0; b < s.tooth.solid.table_size(); ++b)
    if (s.tooth.solid.is_uniform(b) && s.tooth.solid.uniform_value(b) < 0) {
      const Index3 o = s.tooth.solid.brick_origin(b);
      inside.emplace_back(o.x(), o.y(), o.z());
    }
  for (auto _ : state) {
    state.PauseTiming();
    auto grid = s.grid->deepCopy();
    openvdb::FloatGrid::Accessor accessor = grid->getAccessor();
    state.ResumeTiming();
    for (const openvdb::Coord& o : inside) carve(accessor.touchLeaf(o)->buffer().data(), -0.01F);
    benchmark::ClobberMemory();
    state.PauseTiming();
    accessor.clear();
    grid.reset();
    state.ResumeTiming();
  }
  state.counters["per_brick"] = benchmark::Counter(static_cast<double>(inside.size()), kPerBrick);
}

// Voxel size in micrometres.
void voxels(benchmark::internal::Benchmark* b) {
  b->Arg(100)->Arg(50)->Arg(25)->Unit(benchmark::kMicrosecond);
}
BENCHMARK(look_up_bricks)->Apply(voxels);
BENCHMARK(look_up_openvdb)->Apply(voxels);
BENCHMARK(write_bricks)->Apply(voxels);
BENCHMARK(write_openvdb)->Apply(voxels);
BENCHMARK(first_write_bricks)->Apply(voxels)->Iterations(5);
BENCHMARK(first_write_openvdb)->Apply(voxels)->Iterations(5);

}  // namespace
}  // namespace toothprep
