// The layered tooth: what every tool reads, carves or writes.
//
// Labels say which tissue is where (the anatomy; grinding never changes them). Level sets say what
// remains: signed distances in mm, negative inside, clamped to a narrow band of three voxels.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/tissue.h"
#include "toothprep/step/tooth/brick_grid.h"
#include "toothprep/step/tooth/cut_way.h"
#include "toothprep/step/tooth/packed_level_set.h"
#include "toothprep/step/tooth/tooth_bodies.h"

namespace toothprep {

constexpr double kBandVoxels = 3.0;  // half width of the narrow band, as OpenVDB's default

// Where voxels lie: the centre of voxel i is origin + voxel * i (W frame, mm; axes are the
// world's).
struct Lattice {
  Vec3 origin = Vec3::Zero();  // mm, W: centre of voxel (0, 0, 0)
  double voxel = 0.1;          // D, mm

  Vec3 to_world(const Index3& i) const { return origin + voxel * i.cast<double>(); }  // mm, W
  Vec3 to_index(const Vec3& x) const { return (x - origin) / voxel; }  // of a point of W, mm
};

using LabelGrid = BrickGrid<std::uint8_t>;  // of Tissue values
using LevelSet = BrickGrid<float>;          // signed distance, mm, negative inside, within the band

// A prepared tooth's two surfaces, each smooth where the other ends: solid = max(intact, -cut). Their
// intersection is the margin, which the solid alone knows to a voxel only.
struct ToothParts {
  LevelSet intact;  // the solid before anything was cut, mm
  LevelSet cut;     // what burs passed through, mm, negative inside (Workpiece::cut() has the
                    // opposite sign)
  // Enamel, dentin and pulp of the intact tooth, mm: LayeredTooth::remains before anything was cut. Absent from older
  // files.
  std::optional<std::array<PackedLevelSet, 3>> tissues = std::nullopt;
  std::optional<CutWay> way =
      std::nullopt;  // of the burs that cut it, unless something else cut since
};

struct LayeredTooth {  // the anatomy, and what remains of it
  Lattice lattice;     // of all its grids
  LabelGrid tissue;    // Tissue values; background air
  LevelSet solid;      // what remains of labels 1-4
  // What remains of each tissue that has a grid of its own in the file (enamel, dentin, pulp);
  // `other` is what is left of solid.
  std::array<PackedLevelSet, 3> remains;
  // Of a tooth that was cut here; absent from one that is intact or whose history isn't known.
  std::optional<ToothParts> parts;
  // Whose each voxel is, where there are neighbours or gum beside the tooth that is prepared.
  std::optional<ToothBodies> bodies;
  // Free-form metadata: source, source_sha256, threshold_*_..., kept through files.
  std::map<std::string, std::string> provenance;

  double band() const { return kBandVoxels * lattice.voxel; }  // half width, mm
};

// An empty tooth whose grids cover the voxels lower..upper (inclusive) and a margin of one brick.
// Throws Error if voxel is not in (0, 10] mm or the box holds more than 2^33 voxels.
[[nodiscard]] LayeredTooth make_empty_tooth(const Lattice& lattice, const Index3& lower,
                                            const Index3& upper);

// Signed distances (mm, negative inside) of one point: the solid as a whole and each tissue with a
// grid (enamel, dentin, pulp), as the intact anatomy. Values beyond the band need only have the
// right sign.
struct ToothSample {
  float solid = 0;                // mm
  std::array<float, 3> tissue{};  // mm
  Tissue label = Tissue::kAir;    // of the voxel
};

// The tooth of a field given at every point. `sample` must be a pure function (it is called from
// several threads). With `lipschitz` the distances are taken as at most 1-Lipschitz and bricks far
// from every surface are filled from one sample at their centre.
[[nodiscard]] LayeredTooth build_tooth(const Lattice& lattice, const Index3& lower,
                                       const Index3& upper,
                                       const std::function<ToothSample(const Vec3&)>& sample,
                                       bool lipschitz);

// The same from a function that fills one brick's 512 samples (offset as in brick_offset) for the
// voxels first .. first + 7.
[[nodiscard]] LayeredTooth build_tooth_by_brick(
    const Lattice& lattice, const Index3& lower, const Index3& upper,
    const std::function<void(const Index3& first, ToothSample* samples)>& sample_brick);

// Stores 512 values of what remains of a tissue (0 enamel, 1 dentin, 2 pulp). What is a frozen solid's
// is shared with it, the negative of dentin with dentin, whose bricks are to be stored first.
void set_remains(LayeredTooth& tooth, std::size_t tissue, std::size_t brick, const float* values);

// Volume inside a level set, mm³: sum over voxels of D³·(1/2 - phi/D) clamped to [0, 1], which is
// exact for a plane along the axes and of second order elsewhere.
[[nodiscard]] double volume_mm3(const LevelSet& level_set, double voxel);
[[nodiscard]] double volume_mm3(const PackedLevelSet& level_set, double voxel);  // the same
// What remains per tissue, mm³; `other` is the rest of the solid.
[[nodiscard]] PerTissue<double> remaining_volumes_mm3(const LayeredTooth& tooth);

// World box around what remains of the solid (min, max), mm; a zero box at the origin if nothing
// does.
struct Box {
  Vec3 min = Vec3::Zero(), max = Vec3::Zero();  // mm, W
};
[[nodiscard]] Box bounds_of_solid(const LayeredTooth& tooth);  // the box just described

[[nodiscard]] std::size_t memory_bytes(const LayeredTooth& tooth);  // of all grids

// SHA-256 over lattice, labels and level sets (not over the file that holds them), independent of
// the box and of which bricks are stored. Parts and bodies aren't in it.
[[nodiscard]] std::string tooth_sha256(const LayeredTooth& tooth);

// The same anatomy with `solid` carved: each tissue's level set becomes max(tissue, solid).
// `solid` must lie on the same lattice. How it came about isn't known, so the tooth has no parts.
void apply_remaining_solid(LayeredTooth& tooth, LevelSet solid);

// What a cut leaves of a solid: max(solid, cut). `cut` (mm) is negative where nothing was cut, as
// Workpiece::cut() is, and covers the same bricks.
[[nodiscard]] LevelSet carved_solid(const LevelSet& solid, const LevelSet& cut);

// Carves the tooth by such a cut and keeps both surfaces in its parts; of a tooth that was cut
// before, the union of the cuts. The bur's way isn't known then.
void apply_cut(LayeredTooth& tooth, const LevelSet& cut);

}  // namespace toothprep
