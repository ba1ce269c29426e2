// Meshes in gzip files.
#pragma once

#include <string>

#include "toothprep/tools/io/input_file.h"

namespace toothprep::mesh_files {

// What the file inflates to. Throws InputError for what is no gzip file, is damaged or truncated, or
// takes more memory than there is.
std::string inflated(const InputFile& file);

}  // namespace toothprep::mesh_files
