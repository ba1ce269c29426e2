// The scene of the page as a part of another HTML file, complete in itself: two surfaces, packed,
// and the scripts that show them. Where there is no WebGL 2 it stays hidden.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/render/view.h"

namespace toothprep {

struct ReportScene {
  TriangleMesh before, after;    // mm, W
  std::vector<float> deviation;  // mm, of `after` per vertex, NaN where it isn't known; or empty
  ToothAxes axes;
};

struct ScenePart {
  std::string markup;  // well-formed XML
  std::string policy;  // of scripts: their hashes, for a Content-Security-Policy
};

// At most 4 MB, whatever the meshes: large ones are made coarser.
[[nodiscard]] ScenePart scene_part(const ReportScene& scene);

// Packed by zlib; page/data.js (View.unpackMesh) reads it:
//   float32  origin (3), step, mm
//   uint32   vertices, triangles
//   bytes    places as multiples of the step from the origin: all x, all y, all z, each the
//            difference from the one before; corners of triangles, the same; LEB128, zigzag
//   int16    vertex_code() (wire.h) per vertex
[[nodiscard]] std::string packed_mesh(const TriangleMesh& mesh,
                                      const std::vector<float>& deviation);

// Vertices of a cell of `cell` mm become one; what is left of triangles without an area is gone.
// `deviation` is of the first vertex of each cell.
void make_coarser(TriangleMesh& mesh, std::vector<float>& deviation, double cell);

}  // namespace toothprep
