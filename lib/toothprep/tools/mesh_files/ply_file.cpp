#include "toothprep/tools/mesh_files/ply_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "toothprep/tools/mesh_files/words.h"

namespace toothprep::mesh_files {
namespace {

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat;
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

// Values of the body, one after the other, in text or binary.
class PlyValues {
 public:
  enum class Form { kText, kLittle, kBig };

  PlyValues(const std::string& path, std::string_view body, Form form)
      : path_(path), body_(body), form_(form), words_(path, body) {}

  double next(PlyType type) {
    if (form_ == Form::kText) return words_.number(words_.word());
    switch (type) {
      case PlyType::kInt8:
        return static_cast<double>(taken<std::int8_t>());
      case PlyType::kUint8:
        return static_cast<double>(taken<std::uint8_t>());
      case PlyType::kInt16:
        return static_cast<double>(taken<std::int16_t>());
      case PlyType::kUint16:
        return static_cast<double>(taken<std::uint16_t>());
      case PlyType::kInt32:
        return static_cast<double>(taken<std::int32_t>());
      case PlyType::kUint32:
        return static_cast<double>(taken<std::uint32_t>());
      case PlyType::kFloat:
        return static_cast<double>(taken<float>());
      case PlyType::kDouble:
        break;
    }
    return taken<double>();
  }
  // A list's length or a point's number.
  std::uint32_t next_count(PlyType type, const std::string& place) {
    const double value = next(type);
    if (!(value >= 0 && value < kNoPoint && value == std::floor(value)))
      throw InputError(path_, place, "has a length or the number of a point that can't be one");
    return static_cast<std::uint32_t>(value);
  }

 private:
  template <class T>
  T taken() {
    static_assert(std::endian::native == std::endian::little);
    std::array<char, sizeof(T)> bytes;
    if (body_.size() - at_ < bytes.size())
      throw InputError(path_, "", "is truncated: it ends too early");
    std::memcpy(bytes.data(), body_.data() + at_, bytes.size());
    at_ += bytes.size();
    if (form_ == Form::kBig) std::reverse(bytes.begin(), bytes.end());
    return std::bit_cast<T>(bytes);
  }

  const std::string& path_;
  std::string_view body_;
  Form form_;
  Words words_;
  std::size_t at_ = 0;
};

PlyType ply_type(const Words& words, std::string_view name) {
  constexpr std::array<std::array<std::string_view, 2>, 8> kNames = {{{"char", "int8"},
                                                                      {"uchar", "uint8"},
                                                                      {"short", "int16"},
                                                                      {"ushort", "uint16"},
                                                                      {"int", "int32"},
                                                                      {"uint", "uint32"},
                                                                      {"float", "float32"},
                                                                      {"double", "float64"}}};
  for (std::size_t k = 0; k < kNames.size(); ++k)
    if (name == kNames[k][0] || name == kNames[k][1]) return static_cast<PlyType>(k);
  words.fail("states a type that PLY doesn't have");
}

// The place of a property in its element; the number of properties if it isn't there.
std::size_t find_property(const PlyElement& element, std::string_view name, bool is_list) {
  const auto found =
      std::find_if(element.properties.begin(), element.properties.end(),
                   [&](const PlyProperty& p) { return p.name == name && p.is_list == is_list; });
  return static_cast<std::size_t>(found - element.properties.begin());
}

struct PlyHeader {
  std::string format;  // as it is called there
  PlyValues::Form form = PlyValues::Form::kText;
  std::vector<PlyElement> elements;
  std::size_t end = 0;  // bytes
};

PlyElement element_in_line(Words& words) {
  PlyElement element{std::string(words.word_in_line()), 0, {}};
  const std::int64_t count = words.integer(words.word_in_line());
  if (count < 0) words.fail("states a negative count");
  element.count = static_cast<std::uint64_t>(count);
  return element;
}

PlyProperty property_in_line(Words& words) {
  PlyProperty property;
  std::string_view type = words.word_in_line();
  property.is_list = type == "list";
  if (property.is_list) {
    property.count_type = ply_type(words, words.word_in_line());
    type = words.word_in_line();
  }
  property.type = ply_type(words, type);
  property.name = words.word_in_line();
  return property;
}

PlyHeader ply_header(const std::string& path, std::string_view text) {
  Words words(path, text);
  if (words.word() != "ply") throw InputError(path, "", "is not a PLY file");
  PlyHeader header;
  for (bool ended = false; !ended;) {
    words.next_line();
    if (!words.more()) throw InputError(path, "", "is truncated: the header has no end");
    const std::string_view what = words.word_in_line();
    if (what == "format") {
      header.format = words.word_in_line();
    } else if (what == "element") {
      header.elements.push_back(element_in_line(words));
    } else if (what == "property") {
      if (header.elements.empty()) words.fail("is a property of nothing");
      header.elements.back().properties.push_back(property_in_line(words));
    } else if (what == "end_header") {
      ended = true;
    } else if (what != "comment" && what != "obj_info") {
      words.fail("is not of a PLY header");
    }
  }
  if (header.format == "binary_little_endian")
    header.form = PlyValues::Form::kLittle;
  else if (header.format == "binary_big_endian")
    header.form = PlyValues::Form::kBig;
  else if (header.format != "ascii")
    throw InputError(path, "format", "is neither text nor binary");
  words.next_line();
  header.end = words.at();
  return header;
}

// What of an element's properties is of use, by its place among them.
struct Uses {
  bool is_point = false, is_face = false;
  std::array<std::size_t, 3> xyz{};
  std::size_t corners = 0;
  std::vector<std::pair<std::size_t, std::vector<float>*>> values;
};

Uses uses_of(const std::string& path, const PlyElement& element,
             const std::vector<std::string>& wanted, MeshFile& mesh) {
  const std::size_t n = element.properties.size();
  Uses uses;
  uses.is_point = element.name == "vertex" || element.name == "vertices";
  uses.is_face = element.name == "face" || element.name == "faces";
  uses.xyz = {find_property(element, "x", false), find_property(element, "y", false),
              find_property(element, "z", false)};
  uses.corners = find_property(element, "vertex_indices", true);
  if (uses.corners == n) uses.corners = find_property(element, "vertex_index", true);
  if (uses.is_point && *std::max_element(uses.xyz.begin(), uses.xyz.end()) == n)
    throw InputError(path, element.name, "has no x, y and z");
  if (uses.is_face && uses.corners == n)
    throw InputError(path, element.name, "has no list of vertex_indices");
  for (const std::string& name : wanted)
    if (const std::size_t at = find_property(element, name, false);
        at < n && (uses.is_point || uses.is_face))
      uses.values.emplace_back(at, &(uses.is_point ? mesh.values : mesh.face_values)[name]);
  return uses;
}

void read_item(const PlyElement& element, const Uses& uses, const std::string& place,
               PlyValues& values, MeshFile& mesh) {
  Vec3 point = Vec3::Zero();
  for (std::size_t p = 0; p < element.properties.size(); ++p) {
    const PlyProperty& property = element.properties[p];
    if (property.is_list) {
      const std::uint32_t length = values.next_count(property.count_type, place);
      for (std::uint32_t c = 0; c < length; ++c) {
        if (uses.is_face && p == uses.corners)
          mesh.corners.push_back(values.next_count(property.type, place));
        else
          values.next(property.type);
      }
      continue;
    }
    const double value = values.next(property.type);
    for (int a = 0; a < 3; ++a)
      if (uses.xyz[static_cast<std::size_t>(a)] == p) point[a] = value;
    for (const auto& [at, column] : uses.values)
      if (at == p) column->push_back(static_cast<float>(value));
  }
  if (uses.is_point) mesh.points.push_back(point);
}

}  // namespace

MeshFile read_ply(const std::string& path, std::string_view bytes,
                  const std::vector<std::string>& wanted) {
  const PlyHeader header = ply_header(path, bytes);
  MeshFile mesh;
  mesh.format = "ply, " + header.format;
  PlyValues values(path, bytes.substr(header.end), header.form);
  for (const PlyElement& element : header.elements) {
    if (element.properties.empty()) continue;
    const Uses uses = uses_of(path, element, wanted, mesh);
    for (std::uint64_t k = 0; k < element.count; ++k) {
      const std::string place = uses.is_face ? "face " + std::to_string(k + 1) : element.name;
      read_item(element, uses, place, values, mesh);
      if (uses.is_face) end_face(path, mesh);
    }
  }
  return mesh;
}

}  // namespace toothprep::mesh_files
