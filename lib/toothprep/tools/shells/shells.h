// Closed triangle shells (one per tissue, drawn or segmented elsewhere) to a layered tooth.
//
// Lengths are mm, the frame is W (the scan's, LPS); the tooth stands where the shells do, on the
// lattice whose voxel faces lie at multiples of the voxel size.
//
// What is where. A point belongs to the innermost shell that contains it, in the order pulp,
// dentin, enamel, other. So an enamel shell may be a cap on the dentin or the hull of the whole
// crown, and a dentin shell may have a cavity for the pulp or not: the tooth is the same. The solid
// is the union of the shells.
//
// Shells that touch. Two shells drawn side by side never share their border to the last bit. Where
// the gap between two of them is thinner than half a voxel (g = D/2) they count as touching: their
// border is moved to the middle of the gap, and the solid has no surface there. With s_i the signed
// distance to shell i, a gap is where 0 < s_i + s_j < g and their gradients oppose each other
// (their product < -1/2); there s_i and s_j become ±(s_i - s_j)/2. The solid's depth is the
// distance to the exposed surface only: shells are cut into pieces of at most D, and a piece is
// covered if another shell contains a point g/4, g/2 or g outward of its middle. An air gap wider
// than g stays.
//
// Accuracy: distances to the shells are exact (double) within the band of three voxels, signs are
// by counting crossings along z (without gaps at edges: neighbours share the arithmetic). The
// solid's depth near the line where three surfaces meet, and below a shell thinner than g, can be
// off by up to half a voxel.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/tissue.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct Shell {                                          // a surface as read, with merged points
  std::string file;                                     // where it came from, for messages
  std::vector<Vec3> points;                             // mm; no two are equal
  std::vector<std::array<std::uint32_t, 3>> triangles;  // counter-clockwise seen from outside
  std::vector<std::uint32_t> face;  // per triangle, the file's face, counted from 1
};

// By extension: .stl (text or binary), .ply, .obj, .off, each also gzipped (.stl.gz). Faces of more
// than three corners are cut into triangles; equal points are merged. Coordinates are mm unless
// `mm_per_unit` says otherwise. Throws InputError if it is unreadable, truncated or empty, has a
// coordinate that is not finite, more than 20 million triangles, or a size that can't be a tooth's
// or a jaw's (box longer than 200 mm or shorter than 0.5 mm; not asked with `any_size`).
[[nodiscard]] Shell read_shell(const std::string& path, std::optional<double> mm_per_unit = {},
                               bool any_size = false);

// The units that a mesh may be in: mm, m, um, cm, in.
struct MeshUnit {
  const char *name, *word;  // "um", "micrometres"
  double mm;                // one of it
};
// All of them, mm first.
[[nodiscard]] const std::vector<MeshUnit>& mesh_units();

// The unit in which a box of this longest side is that of teeth; null if it is mm or none fits.
[[nodiscard]] const MeshUnit* likely_mesh_unit(double longest);

// What keeps a shell from bounding a solid, one clause each with its place in mm: faces without
// area or given twice, holes, edges of more than two faces, flipped faces, faces that intersect,
// components turned inside out. Later checks need the earlier ones to pass. Empty: the shell is
// fit.
[[nodiscard]] std::vector<std::string> shell_faults(const Shell& shell);

struct TissueShell {                // which tissue a shell bounds
  Tissue tissue = Tissue::kEnamel;  // not air
  Shell shell;                      // without faults
};

struct ShellOptions {  // of the tooth that is made
  double voxel = 0.1;  // D, mm
  // Called with what is being done and how much of the whole is done (0..1), now and then.
  std::function<void(const std::string& stage, double done)> progress;
  // Told in advance what memory and time the work will take, if that is much.
  std::function<void(const std::string&)> announce;
};

// The tooth of shells without faults (not checked again), each of another tissue; see above.
// `notes` gets what a user ought to look at. Throws Error if there is no shell, a tissue is given
// twice, or the tooth would take more than 2^29 voxels or more memory than there is.
[[nodiscard]] LayeredTooth voxelize_shells(const std::vector<TissueShell>& shells,
                                           const ShellOptions& options,
                                           std::vector<std::string>* notes = nullptr);

}  // namespace toothprep
