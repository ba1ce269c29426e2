#include "toothprep/tools/compare/solid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <mutex>
#include <unordered_map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/tooth/level_at.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/file_extension.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/mesh_files/mesh_file.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

constexpr double kLongestEdgeVoxels = 2;
constexpr double kBaseVoxels = 6;  // beyond a rim: more than the band of three on either side

TriangleMesh mesh_of(const Shell& shell) {
  TriangleMesh mesh;
  mesh.vertices.reserve(shell.points.size());
  for (const Vec3& p : shell.points) mesh.vertices.push_back(p.cast<float>());
  mesh.triangles = shell.triangles;
  mesh.tissue.assign(mesh.vertices.size(), static_cast<std::uint8_t>(Tissue::kOther));
  return mesh;
}

LayeredTooth voxels_of(Shell shell, double voxel) {
  const std::string file = shell.file;
  ShellOptions options;
  options.voxel = voxel;
  try {
    return voxelize_shells({{Tissue::kOther, std::move(shell)}}, options);
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {
    throw InputError(file, "", e.what());
  }
}

Solid read_mesh_solid(const std::string& path, double voxel, std::optional<double> mm_per_unit) {
  ShellReading how;
  how.mm_per_unit = mm_per_unit;
  how.base_mm = std::max(1.0, kBaseVoxels * voxel);
  SoundShell sound = read_sound_shell(path, how);
  Solid solid;
  solid.file = path;
  solid.sha256 = sha256_of_file(path);
  solid.layered = false;
  for (const std::string& note : sound.notes) solid.warnings.push_back(path + ": " + note);
  solid.open_sides = std::move(sound.open_sides);
  solid.surface = with_short_edges(mesh_of(sound.shell), kLongestEdgeVoxels * voxel);
  solid.tooth = voxels_of(std::move(sound.shell), voxel);
  solid.tooth.provenance["source"] = path;
  return solid;
}

// A closed surface as voxels on the lattice: moved so that voxelize_shells(), whose voxel faces lie
// at multiples of the voxel size, numbers them as the lattice does.
LevelSet voxelized_on(const TriangleMesh& surface, const std::string& file,
                      const Lattice& lattice) {
  Shell shell;
  shell.file = file;
  const Vec3 shift = Vec3::Constant(0.5 * lattice.voxel) - lattice.origin;
  shell.points.reserve(surface.vertices.size());
  for (const auto& v : surface.vertices) shell.points.push_back(v.cast<double>() + shift);
  shell.triangles = surface.triangles;
  shell.face.resize(surface.triangles.size());
  return voxels_of(std::move(shell), lattice.voxel).solid;
}

// Fills the bricks of `onto`'s box from `fill`, which gives 512 values or says that a brick is
// uniform.
template <class Grid, class Fill>
LevelSet filled(const Grid& box, float band, Fill fill) {
  LevelSet result(box.first_brick(), box.brick_counts(), band, {-band});
  std::mutex insert;
  tbb::parallel_for(std::size_t{0}, result.table_size(), [&](std::size_t b) {
    std::array<float, kBrickVoxels> values;
    fill(result.brick_origin(b), values.data());
    const std::lock_guard lock(insert);
    result.set_brick(b, values.data());
  });
  return result;
}

// The same voxels, numbered anew: voxel i of the result is voxel i + offset of the source.
LevelSet copied(const LevelSet& source, const Index3& offset, const LevelSet& box, float band) {
  const bool aligned = (offset.array() - 8 * (offset.array() / 8)).abs().sum() == 0;
  return filled(box, band, [&](const Index3& first, float* values) {
    const Index3 from = first + offset;
    if (aligned) {
      const std::int64_t b = source.brick_index(from.x(), from.y(), from.z());
      const float outside = source.background();
      for (int v = 0; v < kBrickVoxels; ++v) values[v] = b < 0 ? outside : source.brick(b)[v];
      return;
    }
    for (int v = 0; v < kBrickVoxels; ++v)
      values[v] = source.value(from.x() + (v >> 6), from.y() + ((v >> 3) & 7), from.z() + (v & 7));
  });
}

// Trilinear. Beyond the source's band a value only gives the side, so it becomes the result's band.
LevelSet resampled(const LayeredTooth& source, const Pose& motion, const LevelSet& box,
                   const Lattice& lattice, float band) {
  const LevelSet& phi = source.solid;
  const float known = phi.background() * (1 - 1e-5F);
  const double reach = 0.5 * std::sqrt(3.0) * (kBrickEdge - 1) * lattice.voxel;
  const auto uniform_side = [&](const Vec3& centre) {  // -1 inside, 1 outside, 0 mixed
    const Vec3 at = source.lattice.to_index(motion.to_local(centre));
    const double r = reach / source.lattice.voxel + 1;
    if (!(at.cwiseAbs().maxCoeff() < 1e8)) return 1;
    const Index3 low = (at.array() - r).floor().cast<int>(),
                 high = (at.array() + r).ceil().cast<int>();
    int side = 0;
    for (int x = low.x() >> 3; x <= high.x() >> 3; ++x)
      for (int y = low.y() >> 3; y <= high.y() >> 3; ++y)
        for (int z = low.z() >> 3; z <= high.z() >> 3; ++z) {
          const std::int64_t b = phi.brick_index(8 * x, 8 * y, 8 * z);
          if (b >= 0 && !phi.is_uniform(static_cast<std::size_t>(b))) return 0;
          const float value =
              b < 0 ? phi.background() : phi.uniform_value(static_cast<std::size_t>(b));
          const int here = value < 0 ? -1 : 1;
          if (side == -here) return 0;
          side = here;
        }
    return side;
  };
  return filled(box, band, [&](const Index3& first, float* values) {
    const Vec3 centre = lattice.to_world(first) + Vec3::Constant(3.5 * lattice.voxel);
    if (const int side = uniform_side(centre)) {
      std::fill(values, values + kBrickVoxels, static_cast<float>(side) * band);
      return;
    }
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x = lattice.to_world(first + Index3(v >> 6, (v >> 3) & 7, v & 7));
      const auto value = static_cast<float>(level_at(phi, source.lattice, motion.to_local(x)));
      values[v] = value >= known ? band : value <= -known ? -band : std::clamp(value, -band, band);
    }
  });
}

Index3 index_offset(const Lattice& from, const Lattice& to) {  // voxel i of `from` is i + offset
  return to.to_index(from.origin).array().round().cast<int>();
}

std::vector<OpenSide> moved(std::vector<OpenSide> sides, const Pose& motion) {
  for (OpenSide& side : sides) {
    side.centre = motion.to_world(side.centre);
    side.outward = motion.orientation * side.outward;
    for (Vec3& p : side.rim) p = motion.to_world(p);
  }
  return sides;
}

// Beyond all of them; never if there is none.
bool beyond(const std::vector<OpenSide>& sides, const Vec3& x) {
  return !sides.empty() && std::all_of(sides.begin(), sides.end(),
                                       [&](const OpenSide& side) { return side.beyond(x); });
}

double share_of_other_anatomy(const LabelGrid& original, const LabelGrid& own,
                              const Index3& offset) {
  std::size_t both = 0, differ = 0;
  for (std::size_t b = 0; b < original.table_size(); ++b) {
    if (original.is_uniform(b) && original.uniform_value(b) == 0) continue;
    const Index3 first = original.brick_origin(b) + offset;
    const std::uint8_t* labels = original.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      if (labels[v] == 0) continue;
      const std::uint8_t label =
          own.value(first.x() + (v >> 6), first.y() + ((v >> 3) & 7), first.z() + (v & 7));
      if (label == 0) continue;
      ++both;
      differ += label != labels[v];
    }
  }
  return both == 0 ? 1.0 : static_cast<double>(differ) / static_cast<double>(both);
}

// The tissue of the nearest labelled voxel within two voxels, per vertex.
std::vector<std::uint8_t> tissue_of_vertices(const TriangleMesh& surface,
                                             const LayeredTooth& anatomy) {
  std::vector<Index3> offsets;
  for (int x = -2; x <= 2; ++x)
    for (int y = -2; y <= 2; ++y)
      for (int z = -2; z <= 2; ++z) offsets.emplace_back(x, y, z);
  std::stable_sort(offsets.begin(), offsets.end(), [](const Index3& a, const Index3& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  std::vector<std::uint8_t> tissue(surface.vertices.size(),
                                   static_cast<std::uint8_t>(Tissue::kOther));
  tbb::parallel_for(std::size_t{0}, tissue.size(), [&](std::size_t v) {
    const Vec3 at = anatomy.lattice.to_index(surface.vertices[v].cast<double>());
    if (!(at.cwiseAbs().maxCoeff() < 1e8)) return;
    const Index3 i = at.array().round().cast<int>();
    for (const Index3& o : offsets)
      if (const std::uint8_t label =
              anatomy.tissue.value(i.x() + o.x(), i.y() + o.y(), i.z() + o.z())) {
        tissue[v] = label;
        return;
      }
  });
  return tissue;
}

}  // namespace

TriangleMesh with_short_edges(TriangleMesh surface, double longest) {
  const double square = longest * longest;
  // Every pass halves all long edges; both triangles of an edge see the same new vertex.
  for (int pass = 0; pass < 16; ++pass) {
    std::unordered_map<std::uint64_t, std::uint32_t> middle;
    const auto middle_of = [&](std::uint32_t a, std::uint32_t b) -> std::uint32_t {
      const Eigen::Vector3f &p = surface.vertices[std::min(a, b)],
                            &q = surface.vertices[std::max(a, b)];
      constexpr std::uint32_t kNone = ~std::uint32_t{0};
      if (static_cast<double>((p - q).squaredNorm()) <= square) return kNone;
      const Eigen::Vector3f half = 0.5F * (p + q);
      if (half == p || half == q) return kNone;
      const std::uint64_t key = static_cast<std::uint64_t>(std::min(a, b)) << 32 | std::max(a, b);
      const auto [at, is_new] =
          middle.try_emplace(key, static_cast<std::uint32_t>(surface.vertices.size()));
      if (is_new) {
        surface.vertices.push_back(half);
        if (!surface.tissue.empty()) surface.tissue.push_back(surface.tissue[std::min(a, b)]);
      }
      return at->second;
    };
    const auto none = [](std::uint32_t v) { return v == ~std::uint32_t{0}; };
    std::vector<std::array<std::uint32_t, 3>> next;
    next.reserve(surface.triangles.size());
    const auto old = std::move(surface.triangles);
    for (const auto& t : old) {
      std::array<std::uint32_t, 3> m;
      for (std::size_t k = 0; k < 3; ++k) m[k] = middle_of(t[k], t[(k + 1) % 3]);
      const auto halved = std::count_if(m.begin(), m.end(), [&](auto v) { return !none(v); });
      if (halved == 0) {
        next.push_back(t);
      } else if (halved == 3) {
        next.push_back({t[0], m[0], m[2]});
        next.push_back({m[0], t[1], m[1]});
        next.push_back({m[2], m[1], t[2]});
        next.push_back({m[0], m[1], m[2]});
      } else if (halved == 1) {
        std::size_t k = 0;
        while (none(m[k])) ++k;
        next.push_back({t[k], m[k], t[(k + 2) % 3]});
        next.push_back({m[k], t[(k + 1) % 3], t[(k + 2) % 3]});
      } else {
        std::size_t k = 0;  // the edge from corner k stays whole
        while (!none(m[k])) ++k;
        const std::size_t k1 = (k + 1) % 3, k2 = (k + 2) % 3;
        next.push_back({m[k1], t[k2], m[k2]});
        next.push_back({t[k], t[k1], m[k1]});
        next.push_back({t[k], m[k1], m[k2]});
      }
    }
    surface.triangles = std::move(next);
    if (middle.empty()) break;
  }
  return surface;
}

TriangleMesh moved(TriangleMesh surface, const Pose& motion) {
  if (is_identity(motion)) return surface;
  for (auto& v : surface.vertices) v = motion.to_world(v.cast<double>()).cast<float>();
  return surface;
}

bool is_identity(const Pose& motion) {
  return motion.position.isZero(0) && motion.orientation.vec().isZero(0);
}

bool same_lattice(const Lattice& a, const Lattice& b) {
  constexpr double kSlack = 1e-4;  // voxels
  if (std::abs(a.voxel - b.voxel) > 1e-6 * b.voxel) return false;
  const Vec3 offset = b.to_index(a.origin);
  if (!(offset.cwiseAbs().maxCoeff() < 1e8)) return false;
  return (offset.array() - offset.array().round()).abs().maxCoeff() < kSlack;
}

Solid solid_of(std::string name, LayeredTooth tooth) {
  Solid solid;
  solid.file = std::move(name);
  solid.sha256 = tooth_sha256(tooth);
  solid.surface = sharpest_surface(tooth);
  if (solid.surface.triangles.empty())
    throw InputError(solid.file, "grid 'solid'", "nothing is left of the tooth");
  solid.tooth = std::move(tooth);
  return solid;
}

Solid read_solid(const std::string& path, double voxel, std::optional<double> mm_per_unit) {
  const std::string extension = file_extension(path);
  if (extension == ".vdb") {
    ToothReading reading = read_tooth_with_warnings(path);
    std::optional<ToothBodies> bodies = reading.tooth.bodies;
    const std::string sha256 = bodies ? tooth_sha256(reading.tooth) : std::string();
    Solid solid = solid_of(path, with_others_as_other(std::move(reading.tooth)));
    if (bodies) solid.sha256 = sha256;
    solid.bodies = std::move(bodies);
    solid.warnings = std::move(reading.warnings);
    return solid;
  }
  if (is_mesh_file(path)) {
    if (!(voxel > 0 && voxel <= 10))
      throw Error("the voxel size for a mesh must lie in (0, 10] mm");
    return read_mesh_solid(path, voxel, mm_per_unit);
  }
  throw InputError(path, "",
                   "a tooth is read from .vdb, .stl, .ply, .obj or .off, not '" + extension + "'");
}

Solid on_lattice(const Solid& solid, const Solid& original, const Pose& motion) {
  const LayeredTooth& onto = original.tooth;
  const auto band = static_cast<float>(onto.band());
  Solid result;
  result.file = solid.file;
  result.sha256 = solid.sha256;
  result.layered = original.layered;
  result.surface = moved(solid.surface, motion);
  LevelSet phi;
  double whole = 0;  // volume before the box cuts it, mm³
  const bool copies = is_identity(motion) && same_lattice(solid.tooth.lattice, onto.lattice);
  const Index3 offset =
      copies ? index_offset(onto.lattice, solid.tooth.lattice) : Index3(Index3::Zero());
  if (copies) {
    phi = copied(solid.tooth.solid, offset, onto.solid, band);
    whole = volume_mm3(solid.tooth.solid, solid.tooth.lattice.voxel);
    if (solid.layered && original.layered)
      result.other_anatomy = share_of_other_anatomy(onto.tissue, solid.tooth.tissue, offset);
  } else if (solid.layered) {
    phi = resampled(solid.tooth, motion, onto.solid, onto.lattice, band);
    whole = volume_mm3(solid.tooth.solid, solid.tooth.lattice.voxel);
  } else {
    const LevelSet voxels = voxelized_on(result.surface, solid.file, onto.lattice);
    phi = copied(voxels, Index3::Zero(), onto.solid, band);
    whole = volume_mm3(voxels, onto.lattice.voxel);
  }
  const std::vector<OpenSide> open_sides = moved(solid.open_sides, motion);
  if (!open_sides.empty() || !original.open_sides.empty()) {
    phi = filled(onto.solid, band, [&](const Index3& first, float* values) {
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 i = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
        const Vec3 x = onto.lattice.to_world(i);
        const bool known = !beyond(open_sides, x) && !beyond(original.open_sides, x);
        values[v] = (known ? phi : onto.solid).value(i.x(), i.y(), i.z());
      }
    });
    whole = 0;  // a base may well reach beyond the box
  }
  // Resampling alone changes a volume by some 0.02 %; only more than 0.1 % was beyond the box.
  const double missing = whole - volume_mm3(phi, onto.lattice.voxel);
  result.beyond_box_mm3 = missing > 1e-3 * whole ? missing : 0;
  result.tooth = onto;
  result.tooth.provenance = solid.tooth.provenance;
  apply_remaining_solid(result.tooth, std::move(phi));
  if (copies && solid.tooth.parts && open_sides.empty() && original.open_sides.empty()) {
    result.tooth.parts = ToothParts{copied(solid.tooth.parts->intact, offset, onto.solid, band),
                                    copied(solid.tooth.parts->cut, offset, onto.solid, band)};
  }
  if (!open_sides.empty() || !original.open_sides.empty())
    result.surface = sharpest_surface(result.tooth);
  else if (!solid.layered)
    result.surface.tissue = tissue_of_vertices(result.surface, onto);
  return result;
}

}  // namespace toothprep
