#include "toothprep/tools/render/ply_values.h"

#include <array>
#include <bit>
#include <limits>
#include <unordered_map>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh_files/mesh_file.h"

namespace toothprep {
namespace {

using Place = std::array<std::uint32_t, 3>;  // the bits of three coordinates
struct PlaceHash {
  std::size_t operator()(const Place& p) const {
    return (p[0] * 0x9E3779B97F4A7C15u ^ p[1]) * 0xC2B2AE3D27D4EB4Fu ^ p[2];
  }
};

Place place_of(float x, float y, float z) {  // + 0 turns -0 into 0
  return {std::bit_cast<std::uint32_t>(x + 0.f), std::bit_cast<std::uint32_t>(y + 0.f),
          std::bit_cast<std::uint32_t>(z + 0.f)};
}

std::optional<MeshFile> file_with(const std::string& path, const std::string& name) {
  try {
    return read_mesh_file(path, {name});
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace

std::optional<std::vector<float>> vertex_property(const std::string& path, const TriangleMesh& mesh,
                                                  const std::string& name) {
  const std::optional<MeshFile> file = file_with(path, name);
  if (!file) return std::nullopt;
  const auto wanted = file->values.find(name);
  if (wanted == file->values.end()) return std::nullopt;
  std::unordered_map<Place, float, PlaceHash> at;
  at.reserve(mesh.vertices.size());
  for (std::size_t i = 0; i < file->points.size(); ++i) {
    const Eigen::Vector3f p = file->points[i].cast<float>();
    at.emplace(place_of(p.x(), p.y(), p.z()), wanted->second[i]);
  }
  std::vector<float> result;
  result.reserve(mesh.vertices.size());
  for (const auto& v : mesh.vertices) {
    const auto found = at.find(place_of(v.x(), v.y(), v.z()));
    result.push_back(found != at.end() ? found->second : std::numeric_limits<float>::quiet_NaN());
  }
  return result;
}

std::optional<std::vector<float>> triangle_property(const std::string& path,
                                                    const std::vector<std::uint32_t>& face_of,
                                                    const std::string& name) {
  const std::optional<MeshFile> file = file_with(path, name);
  if (!file) return std::nullopt;
  const auto wanted = file->face_values.find(name);
  if (wanted == file->face_values.end()) return std::nullopt;
  std::vector<float> result;
  result.reserve(face_of.size());
  for (const std::uint32_t face : face_of) result.push_back(wanted->second.at(face - 1));
  return result;
}

}  // namespace toothprep
