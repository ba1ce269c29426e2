// glTF 2.0, binary (Khronos Group, "glTF 2.0 Specification", 2021, section 4): a header of 12 bytes,
// a chunk of JSON, a chunk of numbers, all little endian and aligned to 4 bytes.
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "toothprep/tools/models/formats.h"
#include "toothprep/tools/models/tissue_triangles.h"
#include "toothprep/tools/render/colours.h"

namespace toothprep {
namespace {

using Json = nlohmann::json;  // keys in alphabetical order: the same bytes

static_assert(std::endian::native == std::endian::little, "glTF is little endian");

// Of the specification.
constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJson = 0x4E4F534A, kBinary = 0x004E4942;
constexpr int kFloat = 5126, kUnsignedInt = 5125, kVertices = 34962, kIndices = 34963;
constexpr int kTriangles = 4;

constexpr double kMetresPerMm = 0.001;
constexpr double kRoughness = 0.5;  // moist enamel is glossier, dry dentin duller

void put(std::string& out, const void* data, std::size_t size) {
  out.append(static_cast<const char*>(data), size);
}

void put(std::string& out, std::uint32_t value) { put(out, &value, sizeof value); }

std::string padded(std::string chunk, char with) {
  chunk.resize((chunk.size() + 3) / 4 * 4, with);
  return chunk;
}

Json material_of(Tissue tissue) {
  const Colour colour = tissue_colour(tissue);  // linear, as glTF's factors are
  Json factors = Json::array();
  for (int k = 0; k < 3; ++k) factors.push_back(std::round(1e4 * double{colour[k]}) / 1e4);
  factors.push_back(1.0);
  return {
      {"name", material_name(tissue)},
      {"pbrMetallicRoughness",
       {{"baseColorFactor", factors}, {"metallicFactor", 0.0}, {"roughnessFactor", kRoughness}}}};
}

// Adds `bytes` to the chunk of numbers, as a view of its own.
void add_view(Json& gltf, std::string& numbers, const void* data, std::size_t size, int target) {
  gltf["bufferViews"].push_back(
      {{"buffer", 0}, {"byteOffset", numbers.size()}, {"byteLength", size}, {"target", target}});
  put(numbers, data, size);
}

void add_vertices(Json& gltf, std::string& numbers, const TriangleMesh& mesh) {
  Eigen::Vector3f least = mesh.vertices[0], most = mesh.vertices[0];
  for (const auto& v : mesh.vertices) {
    least = least.cwiseMin(v);
    most = most.cwiseMax(v);
  }
  static_assert(sizeof(Eigen::Vector3f) == 12);
  add_view(gltf, numbers, mesh.vertices.data(), 12 * mesh.vertices.size(), kVertices);
  gltf["accessors"].push_back({{"bufferView", 0},
                               {"componentType", kFloat},
                               {"count", mesh.vertices.size()},
                               {"type", "VEC3"},
                               {"min", {least[0], least[1], least[2]}},
                               {"max", {most[0], most[1], most[2]}}});
}

// A node, its mesh and its material; returns the node's number.
std::size_t add_part(Json& gltf, std::string& numbers, const TissueTriangles& part) {
  const std::size_t accessor = gltf["accessors"].size();
  add_view(gltf, numbers, part.triangles.data(), 12 * part.triangles.size(), kIndices);
  gltf["accessors"].push_back({{"bufferView", accessor},
                               {"componentType", kUnsignedInt},
                               {"count", 3 * part.triangles.size()},
                               {"type", "SCALAR"}});
  gltf["materials"].push_back(material_of(part.tissue));
  const Json primitive = {{"attributes", {{"POSITION", 0}}},
                          {"indices", accessor},
                          {"material", gltf["materials"].size() - 1},
                          {"mode", kTriangles}};
  gltf["meshes"].push_back(
      {{"name", material_name(part.tissue)}, {"primitives", Json::array({primitive})}});
  gltf["nodes"].push_back(
      {{"name", material_name(part.tissue)}, {"mesh", gltf["meshes"].size() - 1}});
  return gltf["nodes"].size() - 1;
}

}  // namespace

std::string glb_of(const TriangleMesh& mesh) {
  constexpr double kHalf = 0.70710678118654752;  // sine and cosine of 45°
  Json gltf;
  gltf["asset"] = {{"version", "2.0"}, {"generator", "toothprep"}};
  gltf["scene"] = 0;
  gltf["scenes"].push_back({{"nodes", Json::array({0})}});
  // (x, y, z) mm of LPS becomes (x, z, -y) / 1000 m: a quarter turn about x.
  gltf["nodes"].push_back({{"name", "tooth"},
                           {"rotation", {-kHalf, 0.0, 0.0, kHalf}},
                           {"scale", {kMetresPerMm, kMetresPerMm, kMetresPerMm}}});
  std::string numbers;
  numbers.reserve(12 * (mesh.vertices.size() + mesh.triangles.size()));
  add_vertices(gltf, numbers, mesh);
  Json parts;
  for (const TissueTriangles& part : triangles_by_tissue(mesh))
    parts.push_back(add_part(gltf, numbers, part));
  gltf["nodes"][0]["children"] = parts;
  gltf["buffers"].push_back({{"byteLength", numbers.size()}});

  const std::string json = padded(gltf.dump(), ' ');
  numbers = padded(std::move(numbers), '\0');
  const std::size_t size = 12 + 8 + json.size() + 8 + numbers.size();
  if (size > std::numeric_limits<std::uint32_t>::max())
    throw ModelTooLarge("the model is larger than 4 GB, which .glb can't hold; write a .ply");
  std::string out;
  out.reserve(size);
  for (const std::uint32_t word : {kMagic, kVersion, static_cast<std::uint32_t>(size),
                                   static_cast<std::uint32_t>(json.size()), kJson})
    put(out, word);
  out += json;
  put(out, static_cast<std::uint32_t>(numbers.size()));
  put(out, kBinary);
  return out + numbers;
}

}  // namespace toothprep
