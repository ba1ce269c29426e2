#include "toothprep/tools/models/model_file.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/models/formats.h"

namespace toothprep {
namespace {

std::string extension_of(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

}  // namespace

bool is_model_name(const std::string& path) {
  const std::string extension = extension_of(path);
  return extension == ".glb" || extension == ".3mf";
}

void write_model(const TriangleMesh& mesh, const std::string& path) {
  if (!is_model_name(path))
    throw Error(path + ": a model is written as .glb or .3mf, not '" + extension_of(path) + "'");
  if (mesh.triangles.empty()) throw Error(path + ": nothing to write, the surface is empty");
  try {
    write_file(path, extension_of(path) == ".glb" ? glb_of(mesh) : three_mf_of(mesh));
  } catch (const ModelTooLarge& e) {
    throw Error(path + ": " + e.what());
  }
}

}  // namespace toothprep
