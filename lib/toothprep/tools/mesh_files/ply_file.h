// PLY: points, faces and scalar properties of the points, in text or binary.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "toothprep/tools/mesh_files/mesh_file.h"

namespace toothprep::mesh_files {

// Of the file's bytes. Throws InputError for what is no PLY file, is truncated or contradicts itself.
MeshFile read_ply(const std::string& path, std::string_view bytes,
                  const std::vector<std::string>& wanted);

}  // namespace toothprep::mesh_files
