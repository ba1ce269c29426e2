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

// The part of a tooth: its surface. Throws Error if nothing remains of it.
[[nodiscard]] RenderPart part_of(const LayeredTooth& tooth);

// Outward unit normal of the solid's level set at a place near its surface, by central differences
// over a voxel; zero where the level set says nothing.
[[nodiscard]] Vec3 level_normal(const LayeredTooth& tooth, const Vec3& x);

// The tissue at a place inside the tooth: that which reaches furthest beyond it.
[[nodiscard]] Tissue tissue_in(const LayeredTooth& tooth, const Vec3& x);

}  // namespace toothprep
