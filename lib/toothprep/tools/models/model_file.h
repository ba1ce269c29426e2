// The surface of a tooth as a model for other programs, in the tissues' colours: glTF 2.0 (.glb) for
// Blender, Unity, game engines and web pages, 3MF (.3mf) for printers and CAD.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// By extension; a triangle without a tissue of its own belongs to that of most of its vertices, of
// three to the first.
// All tissues share one list of vertices, the mesh's.
//   .glb  glTF 2.0, binary. The mesh's coordinates (mm, W) as they stand; the node above them scales
//         to glTF's metres and turns W (LPS) so that superior is +y and anterior +z, as glTF wants
//         it. One mesh and one PBR material for each tissue that occurs, named for it. No normals:
//         viewers shade it flat.
//   .3mf  3MF core specification 1.3: one object, unit millimetre, coordinates in W, a base material
//         for each tissue that occurs.
// Same mesh, same bytes. Throws Error for another extension, an empty mesh, one that the format
// can't hold (.glb: 4 GB), or a file that can't be written. Writes `path` itself.
void write_model(const TriangleMesh& mesh, const std::string& path);

// The formats of write_surface(), by their extensions.
inline const std::vector<std::string> kSurfaceExtensions = {".ply", ".stl", ".obj",
                                                            ".vtk", ".glb", ".3mf"};

// As write_model(), or write_mesh() for a format of that, and throws as these do.
void write_surface(const TriangleMesh& mesh, const std::string& path);

}  // namespace toothprep
