#include "toothprep/tools/render/ply_values.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>
#include <unordered_map>

#include "toothprep/step/core/regular_file.h"

namespace toothprep {
namespace {

struct Type {
  const char* name;
  const char* other_name;
  std::size_t size;
  double (*value)(const char*);
};
template <class T>
double value_of(const char* at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  return static_cast<double>(value);
}
constexpr Type kTypes[] = {
    {"char", "int8", 1, value_of<std::int8_t>},    {"uchar", "uint8", 1, value_of<std::uint8_t>},
    {"short", "int16", 2, value_of<std::int16_t>}, {"ushort", "uint16", 2, value_of<std::uint16_t>},
    {"int", "int32", 4, value_of<std::int32_t>},   {"uint", "uint32", 4, value_of<std::uint32_t>},
    {"float", "float32", 4, value_of<float>},      {"double", "float64", 8, value_of<double>}};

struct Property {
  const Type* type;
  std::string name;
  std::size_t offset;  // bytes from the vertex's first
};

struct VertexLayout {
  bool text = false;
  std::size_t count = 0, size = 0;  // vertices; bytes each
  std::vector<Property> properties;

  int find(const std::string& name) const {
    for (std::size_t i = 0; i < properties.size(); ++i)
      if (properties[i].name == name) return static_cast<int>(i);
    return -1;
  }
};

// Reads up to end_header. Nothing unless vertices come first and hold single numbers only.
std::optional<VertexLayout> read_header(std::istream& file) {
  VertexLayout layout;
  std::string line;
  int elements = 0;
  bool ply = false;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    std::string word, type, name;
    words >> word;
    if (word == "ply") ply = true;
    if (!ply) return std::nullopt;
    if (word == "end_header") return elements > 0 ? std::optional(layout) : std::nullopt;
    if (word == "format") {
      words >> type;
      layout.text = type == "ascii";
      if (!layout.text && type != "binary_little_endian") return std::nullopt;
    } else if (word == "element" && ++elements == 1) {
      words >> name >> layout.count;
      if (name != "vertex") return std::nullopt;
    } else if (word == "property" && elements == 1) {
      words >> type >> name;
      const auto found = std::find_if(std::begin(kTypes), std::end(kTypes), [&](const Type& t) {
        return type == t.name || type == t.other_name;
      });
      if (found == std::end(kTypes)) return std::nullopt;
      layout.properties.push_back({found, name, layout.size});
      layout.size += found->size;
    }
  }
  return std::nullopt;
}

// All properties of the next vertex; false at the end of the file.
bool read_vertex(std::istream& file, const VertexLayout& layout, std::vector<char>& bytes,
                 std::vector<double>& values) {
  if (layout.text) {
    for (double& value : values)
      if (!(file >> value)) return false;
    return true;
  }
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()))) return false;
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = layout.properties[i].type->value(bytes.data() + layout.properties[i].offset);
  return true;
}

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

}  // namespace

std::optional<std::vector<float>> vertex_property(const std::string& path, const TriangleMesh& mesh,
                                                  const std::string& name) {
  regular_file_size(path);
  std::ifstream file(path, std::ios::binary);
  const auto layout = read_header(file);
  if (!layout) return std::nullopt;
  const int x = layout->find("x"), y = layout->find("y"), z = layout->find("z");
  const int wanted = layout->find(name);
  if (x < 0 || y < 0 || z < 0 || wanted < 0) return std::nullopt;
  std::unordered_map<Place, float, PlaceHash> at;
  at.reserve(mesh.vertices.size());
  std::vector<char> bytes(layout->size);
  std::vector<double> values(layout->properties.size());
  for (std::size_t i = 0; i < layout->count && read_vertex(file, *layout, bytes, values); ++i)
    at.emplace(place_of(static_cast<float>(values[x]), static_cast<float>(values[y]),
                        static_cast<float>(values[z])),
               static_cast<float>(values[wanted]));
  std::vector<float> result;
  result.reserve(mesh.vertices.size());
  for (const auto& v : mesh.vertices) {
    const auto found = at.find(place_of(v.x(), v.y(), v.z()));
    result.push_back(found != at.end() ? found->second : std::numeric_limits<float>::quiet_NaN());
  }
  return result;
}

}  // namespace toothprep
