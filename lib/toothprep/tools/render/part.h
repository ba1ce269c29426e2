// What is drawn: a surface, and what is known at each place of it.
#pragma once

#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

enum class ColourBy { kTissue, kDeviation, kPlain };  // what a part's colour shows

struct RenderPart {   // one surface of a scene
  TriangleMesh mesh;  // mm, W
  // Of the same surface, if there is one: gives smoother normals, sharper borders of tissues, and
  // tissues on a cut face. Must outlive the part.
  const LayeredTooth* tooth = nullptr;
  // Signed, per vertex, mm (positive: the surface stands out); NaN where unknown; may be empty.
  std::vector<float> deviation;
  ColourBy colour = ColourBy::kTissue;  // default: tissues
  // How often normals are averaged with their neighbours' before shading (mesh_normals.h): meshes
  // from voxels or scanners need it; it bends the normals of an exact mesh by a tenth of a facet.
  int smoothing = 3;
  // Drawn as a tinted glass around the others: the tooth as it was. Not in the data channels.
  bool ghost = false;
};

// The part of a tooth: its surface_by_tissue(). Throws Error if nothing remains of it.
[[nodiscard]] RenderPart part_of(const LayeredTooth& tooth);

// A smooth part of a tooth's surface: of one that was cut here (ToothParts) its own or the cut's.
enum class Side { kSolid, kIntact, kCut };

// On which side the surface of the tooth near a place is.
[[nodiscard]] Side side_at(const LayeredTooth& tooth, const Vec3& x);

// Outward unit normal of a side's level set at a place near it, by central differences over a
// voxel; zero where the level set says nothing.
[[nodiscard]] Vec3 level_normal(const LayeredTooth& tooth, const Vec3& x, Side side = Side::kSolid);

// Whether a place is inside of what remains. A margin is as sharp as sharpest_surface() has it.
[[nodiscard]] bool inside(const LayeredTooth& tooth, const Vec3& x);

// The tissue at a place inside of what remains or on its surface.
[[nodiscard]] Tissue tissue_in(const LayeredTooth& tooth, const Vec3& x);

}  // namespace toothprep
