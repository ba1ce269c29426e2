#include "toothprep/tools/models/model_file.h"

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/file_extension.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/models/formats.h"

namespace toothprep {
namespace {

bool is_model_name(const std::string& path) {
  const std::string extension = file_extension(path);
  return extension == ".glb" || extension == ".3mf";
}

}  // namespace

void write_model(const TriangleMesh& mesh, const std::string& path) {
  if (!is_model_name(path))
    throw Error(path + ": a model is written as .glb or .3mf, not '" + file_extension(path) + "'");
  if (mesh.triangles.empty()) throw Error(path + ": nothing to write, the surface is empty");
  try {
    write_file(path, file_extension(path) == ".glb" ? glb_of(mesh) : three_mf_of(mesh));
  } catch (const ModelTooLarge& e) {
    throw Error(path + ": " + e.what());
  }
}

void write_surface(const TriangleMesh& mesh, const std::string& path) {
  is_model_name(path) ? write_model(mesh, path) : write_mesh(mesh, path);
}

}  // namespace toothprep
