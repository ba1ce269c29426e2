// Triangle meshes as PLY, STL, OBJ and VTK files.
#include <algorithm>
#include <bit>
#include <cstring>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/io/file_extension.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {
namespace {

static_assert(std::endian::native == std::endian::little,
              "PLY and STL are written little endian, VTK by swapping bytes");

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
  template <class T>
  void put_big_endian(T value) {
    std::array<char, sizeof value> bytes;
    std::memcpy(bytes.data(), &value, sizeof value);
    std::reverse(bytes.begin(), bytes.end());
    put(bytes);
  }
  void text(const std::string& s) { put(s.data(), s.size()); }
  template <class T>
  void number(T value) {  // the shortest text that reads back as the same value, in any locale
    text(shortest_text(value));
  }
  const std::vector<char>& bytes() const { return bytes_; }

 private:
  std::vector<char> bytes_;
};

std::uint8_t label_of(const TriangleMesh& mesh, std::size_t v) {
  return v < mesh.tissue.size() ? mesh.tissue[v] : std::uint8_t{0};
}

Bytes ply_of(const TriangleMesh& mesh, const VertexAttributes& attributes) {
  const std::size_t per_vertex = 16 + 4 * attributes.scalars.size();
  Bytes out(1024 + mesh.vertices.size() * per_vertex + mesh.triangles.size() * 14);
  out.text(
      "ply\nformat binary_little_endian 1.0\n"
      "comment toothprep surface; lengths in mm; tissue: 1 enamel, 2 dentin, 3 pulp, 4 other\n"
      "element vertex " +
      std::to_string(mesh.vertices.size()) +
      "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar tissue\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n");
  for (const auto& scalar : attributes.scalars) out.text("property float " + scalar.name + "\n");
  const bool by_tissue = !mesh.triangle_tissue.empty();
  out.text("element face " + std::to_string(mesh.triangles.size()) +
           "\nproperty list uchar int vertex_indices\n" +
           (by_tissue ? "property uchar tissue\n" : "") + "end_header\n");
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const std::uint8_t label = label_of(mesh, v);
    out.put(mesh.vertices[v].data(), 12);
    out.put(label);
    out.put(attributes.colours.empty() ? kColours[std::min<std::size_t>(label, kTissueCount)]
                                       : attributes.colours[v]);
    for (const auto& scalar : attributes.scalars) out.put(scalar.values[v]);
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    out.put(std::uint8_t{3});
    out.put(mesh.triangles[t]);
    if (by_tissue) out.put(mesh.triangle_tissue[t]);
  }
  return out;
}

// Legacy VTK, whose binary numbers are big endian.
Bytes vtk_of(const TriangleMesh& mesh, const VertexAttributes& attributes) {
  const std::string points = std::to_string(mesh.vertices.size()),
                    faces = std::to_string(mesh.triangles.size());
  Bytes out(1024 + mesh.vertices.size() * (13 + 4 * attributes.scalars.size()) +
            mesh.triangles.size() * 17);
  out.text("# vtk DataFile Version 3.0\ntoothprep surface, mm\nBINARY\nDATASET POLYDATA\nPOINTS " +
           points + " float\n");
  for (const auto& v : mesh.vertices)
    for (int k = 0; k < 3; ++k) out.put_big_endian(v[k]);
  out.text("\nPOLYGONS " + faces + " " + std::to_string(4 * mesh.triangles.size()) + "\n");
  for (const auto& t : mesh.triangles) {
    out.put_big_endian(std::int32_t{3});
    for (const std::uint32_t v : t) out.put_big_endian(static_cast<std::int32_t>(v));
  }
  out.text("\nPOINT_DATA " + points + "\n");
  for (const auto& scalar : attributes.scalars) {  // the first is what ParaView colours by
    out.text("SCALARS " + scalar.name + " float 1\nLOOKUP_TABLE default\n");
    for (const float value : scalar.values) out.put_big_endian(value);
    out.text("\n");
  }
  out.text("SCALARS tissue unsigned_char 1\nLOOKUP_TABLE default\n");
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) out.put(label_of(mesh, v));
  out.text("\n");
  if (mesh.triangle_tissue.empty()) return out;
  out.text("CELL_DATA " + faces + "\nSCALARS tissue unsigned_char 1\nLOOKUP_TABLE default\n");
  out.put(mesh.triangle_tissue.data(), mesh.triangle_tissue.size());
  out.text("\n");
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
  const auto face = [&](const std::array<std::uint32_t, 3>& t) {
    out.text("f");
    for (const std::uint32_t v : t) {
      out.text(" ");
      out.number(v + 1);
    }
    out.text("\n");
  };
  if (mesh.triangle_tissue.empty()) {
    for (const auto& t : mesh.triangles) face(t);
    return out;
  }
  for (int label = 1; label <= kTissueCount; ++label) {  // a group for each tissue that occurs
    bool first = true;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      if (mesh.triangle_tissue[t] != label) continue;
      if (first) out.text("g " + std::string(kTissueNames[label - 1]) + "\n");
      first = false;
      face(mesh.triangles[t]);
    }
  }
  return out;
}

}  // namespace

void check_mesh_name(const std::string& path) {
  const std::string extension = file_extension(path);
  if (extension != ".ply" && extension != ".stl" && extension != ".obj" && extension != ".vtk")
    throw Error(path + ": a mesh is written as .ply, .stl, .obj or .vtk, not '" + extension + "'");
}

void write_mesh(const TriangleMesh& mesh, const std::string& path,
                const VertexAttributes& attributes) {
  check_mesh_name(path);
  const std::string extension = file_extension(path);
  if (mesh.triangles.empty()) throw Error(path + ": nothing to write, the surface is empty");
  for (const auto& scalar : attributes.scalars)
    if (scalar.values.size() != mesh.vertices.size())
      throw Error(path + ": '" + scalar.name + "' does not have one value per vertex");
  if (!mesh.triangle_tissue.empty() && mesh.triangle_tissue.size() != mesh.triangles.size())
    throw Error(path + ": the tissues are not one per triangle");
  if (!attributes.colours.empty() && attributes.colours.size() != mesh.vertices.size())
    throw Error(path + ": the colours are not one per vertex");
  const Bytes out = extension == ".ply"   ? ply_of(mesh, attributes)
                    : extension == ".vtk" ? vtk_of(mesh, attributes)
                    : extension == ".stl" ? stl_of(mesh)
                                          : obj_of(mesh);
  write_file(path, {out.bytes().data(), out.bytes().size()});
}

}  // namespace toothprep
