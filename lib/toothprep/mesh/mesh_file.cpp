// Triangle meshes as PLY, STL and OBJ files.
#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "toothprep/core/errors.h"
#include "toothprep/mesh/surface.h"

namespace toothprep {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY and STL are written little endian");

// Colours for viewers that know nothing of tissues, by label.
constexpr std::array<std::array<std::uint8_t, 3>, kTissueCount + 1> kColours = {{
    {128, 128, 128},  // air: does not occur
    {240, 236, 224},  // enamel
    {222, 192, 128},  // dentin
    {200, 60, 56},    // pulp
    {140, 145, 150},  // other
}};

class Bytes {
 public:
  explicit Bytes(std::size_t expected) { bytes_.reserve(expected); }
  template <class T>
  void put(const T& value) {
    put(&value, sizeof value);
  }
  void put(const void* data, std::size_t size) {
    const auto* first = static_cast<const char*>(data);
    bytes_.insert(bytes_.end(), first, first + size);
  }
  void text(const std::string& s) { put(s.data(), s.size()); }
  template <class T>
  void number(T value) {  // the shortest text that reads back as the same value, in any locale
    std::array<char, 32> digits;
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    put(digits.data(), static_cast<std::size_t>(end - digits.data()));
  }
  const std::vector<char>& bytes() const { return bytes_; }

 private:
  std::vector<char> bytes_;
};

Bytes ply_of(const TriangleMesh& mesh) {
  Bytes out(512 + mesh.vertices.size() * 16 + mesh.triangles.size() * 13);
  out.text(
      "ply\nformat binary_little_endian 1.0\n"
      "comment toothprep surface; lengths in mm; tissue: 1 enamel, 2 dentin, 3 pulp, 4 other\n"
      "element vertex " +
      std::to_string(mesh.vertices.size()) +
      "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar tissue\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face " +
      std::to_string(mesh.triangles.size()) +
      "\nproperty list uchar int vertex_indices\nend_header\n");
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const std::uint8_t label = v < mesh.tissue.size() ? mesh.tissue[v] : 0;
    out.put(mesh.vertices[v].data(), 12);
    out.put(label);
    out.put(kColours[std::min<std::size_t>(label, kTissueCount)]);
  }
  for (const auto& t : mesh.triangles) {
    out.put(std::uint8_t{3});
    out.put(t);
  }
  return out;
}

Bytes stl_of(const TriangleMesh& mesh) {
  Bytes out(84 + mesh.triangles.size() * 50);
  std::array<char, 80> header{};
  constexpr char kTitle[] = "toothprep surface, mm";  // must not begin with "solid"
  std::memcpy(header.data(), kTitle, sizeof kTitle);
  out.put(header);
  out.put(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[0]].cast<double>(), b = mesh.vertices[t[1]].cast<double>(),
               c = mesh.vertices[t[2]].cast<double>();
    const Eigen::Vector3f normal = (b - a).cross(c - a).normalized().cast<float>();
    out.put(normal.data(), 12);
    for (const std::uint32_t v : t) out.put(mesh.vertices[v].data(), 12);
    out.put(std::uint16_t{0});
  }
  return out;
}

Bytes obj_of(const TriangleMesh& mesh) {
  Bytes out(64 + mesh.vertices.size() * 36 + mesh.triangles.size() * 24);
  out.text("# toothprep surface, mm\n");
  for (const auto& v : mesh.vertices) {
    out.text("v");
    for (int k = 0; k < 3; ++k) {
      out.text(" ");
      out.number(v[k]);
    }
    out.text("\n");
  }
  for (const auto& t : mesh.triangles) {
    out.text("f");
    for (const std::uint32_t v : t) {
      out.text(" ");
      out.number(v + 1);
    }
    out.text("\n");
  }
  return out;
}

// In lower case.
std::string extension_of(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

}  // namespace

void check_mesh_name(const std::string& path) {
  const std::string extension = extension_of(path);
  if (extension != ".ply" && extension != ".stl" && extension != ".obj")
    throw Error(path + ": a mesh is written as .ply, .stl or .obj, not '" + extension + "'");
}

void write_mesh(const TriangleMesh& mesh, const std::string& path) {
  check_mesh_name(path);
  const std::string extension = extension_of(path);
  if (mesh.triangles.empty()) throw Error(path + ": nothing to write, the surface is empty");
  const Bytes out = extension == ".ply"   ? ply_of(mesh)
                    : extension == ".stl" ? stl_of(mesh)
                                          : obj_of(mesh);
  std::ofstream file(path, std::ios::binary);
  file.write(out.bytes().data(), static_cast<std::streamsize>(out.bytes().size()));
  file.close();
  if (!file) throw Error(path + ": cannot be written; is the disk full?");
}

}  // namespace toothprep
