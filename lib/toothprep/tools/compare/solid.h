// A tooth as the comparison sees it: a layered tooth or a closed mesh, with its surface.
//
// Lengths are mm in W. Everything that is compared is first brought onto one lattice, that of the
// original tooth, and takes the original's anatomy: tissues are those of the original, and what
// remains of each is max(tissue of the original, solid). So the volumes per tissue of a prepared
// tooth are known also when it is a bare mesh.
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {

struct Solid {           // a tooth or a mesh as something to compare
  std::string file;      // where it came from, for messages
  std::string sha256;    // of the tooth (tooth_sha256) or of the mesh file
  LayeredTooth tooth;    // its voxels
  TriangleMesh surface;  // mm, W
  bool layered = true;   // has tissues of its own; a mesh is `other` throughout
  std::vector<std::string>
      warnings;  // of reading a tooth file (read_tooth_with_warnings), of mending
  std::vector<OpenSide> open_sides;  // of a mesh that had to be closed there
  // Of a tooth file with a list of bodies. The tooth itself has all but the prepared one as `other`.
  std::optional<ToothBodies> bodies;

  // Told by on_lattice():
  double beyond_box_mm3 = 0;  // what lay beyond the box of the lattice and was cut off
  // Share of the voxels labelled in both whose labels differ from the original's; NaN where that
  // can't be asked (a mesh, another lattice).
  double other_anatomy = NAN;
};

// A tooth file (.vdb), or a mesh (.stl, .ply, .obj, .off, .gz of these; of `mm_per_unit`, else mm)
// that becomes voxels of `voxel` mm. The surface of a tooth is sharpest_surface(); that of a mesh is
// the mesh itself, its edges halved until none is longer than two voxels, so that figures per
// vertex are dense. A mesh is mended and closed as close_shell() does, with warnings. Throws
// InputError for what can't be read, another extension, a mesh that can't be closed without
// inventing a shape, or a tooth of which nothing is left.
[[nodiscard]] Solid read_solid(const std::string& path, double voxel,
                               std::optional<double> mm_per_unit = {});

// A tooth in memory, as if it had been read.
[[nodiscard]] Solid solid_of(std::string name, LayeredTooth tooth);

// `solid`, moved rigidly by `motion` (its frame to the original's), on the original's lattice and
// box, with the original's anatomy. Voxels are copied where the lattices coincide and nothing
// moves; else a tooth is resampled (trilinear, which rounds edges within a voxel) and a mesh is
// voxelized anew (exact distances). The surface is moved, not resampled. Beyond the open side of
// either nothing is known of one of them, and the original stands in for it: nothing was cut there.
// The surface is then that of the voxels.
Solid on_lattice(const Solid& solid, const Solid& original, const Pose& motion = {});

// Whether on_lattice() would copy.
[[nodiscard]] bool same_lattice(const Lattice& a, const Lattice& b);
[[nodiscard]] bool is_identity(const Pose& motion);

// The surface with its edges halved until none is longer than `longest` mm; the same points of
// space, still closed.
[[nodiscard]] TriangleMesh with_short_edges(TriangleMesh surface, double longest);

[[nodiscard]] TriangleMesh moved(TriangleMesh surface,
                                 const Pose& motion);  // every vertex by `motion`

}  // namespace toothprep
