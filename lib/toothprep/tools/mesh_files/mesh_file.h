// Triangle and polygon meshes in files, as they stand there: no point is merged and no face is cut.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

struct MeshFile {                      // as the file has it, unchecked
  std::string format;                  // "stl, binary", "ply, ascii", "obj", ...
  std::vector<Vec3> points;            // STL repeats them: three per triangle
  std::vector<std::uint32_t> corners;  // points of one face after the other, counted from 0
  std::vector<std::size_t> ends;       // per face, where its corners end
  // Scalar properties of a PLY's points that were asked for and are there; one value per point.
  std::map<std::string, std::vector<float>> values;
  std::map<std::string, std::vector<float>> face_values;  // the same of its faces
};

// Whether the name is that of a mesh: .stl, .ply, .obj, .off, each also gzipped (.stl.gz).
[[nodiscard]] bool is_mesh_file(const std::string& path);

// By extension: .stl (text or binary), .ply, .obj, .off, each also gzipped; `wanted` names properties of a PLY's points and faces
// (`tissue`, `quality`). Throws InputError for what is no regular file, is unreadable, truncated,
// empty or of another kind, has more than 20 million faces, or would take more memory than there is.
// Whether a face's corners exist and coordinates are finite is left to the caller.
MeshFile read_mesh_file(const std::string& path, const std::vector<std::string>& wanted = {});

}  // namespace toothprep
