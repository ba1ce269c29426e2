// What `toothprep info` says of a triangle mesh, read in one pass without keeping it.
#pragma once

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/geometry.h"

namespace toothprep::app {

struct MeshSummary {
  std::string format;
  std::uint64_t vertices = 0;  // STL repeats them: three per triangle
  std::uint64_t triangles = 0;
  Vec3 min = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 max = -min;

  void add(const Vec3& x) {
    min = min.cwiseMin(x);
    max = max.cwiseMax(x);
  }
};

class MeshReader {
 public:
  explicit MeshReader(const std::string& path) : path_(path), in_(path, std::ios::binary) {
    std::error_code error;
    bytes_ = std::filesystem::file_size(path, error);
    if (!in_ || error) throw InputError(path, "", "cannot be read", "check that the file exists");
  }

  MeshSummary read(const std::string& extension) {
    MeshSummary mesh;
    if (extension == ".ply") mesh = read_ply();
    if (extension == ".obj") mesh = read_obj();
    if (extension == ".stl") mesh = read_stl();
    if (mesh.vertices == 0) refuse("holds no vertices");
    if (!mesh.min.allFinite() || !mesh.max.allFinite()) refuse("holds a vertex that is not finite");
    return mesh;
  }

 private:
  [[noreturn]] void refuse(const std::string& condition) const {
    throw InputError(path_, "", condition, "is the mesh complete?");
  }
  bool next_line(std::string& line) {
    if (!std::getline(in_, line)) return false;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return true;
  }
  Vec3 three(std::istringstream& words) const {
    Vec3 x;
    for (int i = 0; i < 3; ++i) {
      std::string word;
      words >> word;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), x[i]);
      if (error != std::errc() || end != word.data() + word.size())
        refuse("'" + word.substr(0, 20) + "' is no coordinate");
    }
    if (!x.allFinite()) refuse("holds a vertex that is not finite");
    return x;
  }

  // Binary STL is told from text by its length, since both may begin with "solid".
  MeshSummary read_stl() {
    MeshSummary mesh;
    std::uint32_t count = 0;
    char header[84] = {};
    if (bytes_ >= sizeof header) {
      in_.read(header, sizeof header);
      std::memcpy(&count, header + 80, sizeof count);
    }
    if (bytes_ >= sizeof header && bytes_ == 84 + 50 * std::uint64_t{count}) {
      mesh.format = "stl, binary";
      mesh.triangles = count;
      float facet[13];
      for (std::uint64_t i = 0; i < mesh.triangles && in_.read(reinterpret_cast<char*>(facet), 50);
           ++i)
        for (int v = 1; v <= 3; ++v) {
          const Vec3 x(facet[3 * v], facet[3 * v + 1], facet[3 * v + 2]);
          if (!x.allFinite()) refuse("holds a vertex that is not finite");
          mesh.add(x);
        }
      mesh.vertices = 3 * mesh.triangles;
      return mesh;
    }
    if (std::strncmp(header, "solid", 5) != 0)
      refuse("is neither a text STL nor a binary one of the length that its count gives");
    mesh.format = "stl, text";
    in_.clear();
    in_.seekg(0);
    for (std::string line, word; next_line(line);) {
      std::istringstream words(line);
      words >> word;
      if (word == "vertex") {
        mesh.add(three(words));
        ++mesh.vertices;
      }
    }
    if (mesh.vertices % 3 != 0) refuse("ends inside a triangle");
    mesh.triangles = mesh.vertices / 3;
    return mesh;
  }

  MeshSummary read_obj() {
    MeshSummary mesh;
    mesh.format = "obj";
    for (std::string line, word; next_line(line);) {
      std::istringstream words(line);
      word.clear();
      words >> word;
      if (word == "v") {
        mesh.add(three(words));
        ++mesh.vertices;
      } else if (word == "f") {
        std::uint64_t corners = 0;
        while (words >> word) ++corners;
        if (corners < 3) refuse("holds a face of fewer than three corners");
        mesh.triangles += corners - 2;
      }
    }
    return mesh;
  }

  struct Property {
    std::string name;
    std::size_t size = 0;  // bytes
    bool real = false;
  };

  MeshSummary read_ply() {
    MeshSummary mesh;
    std::string line, format, element;
    std::vector<Property> properties;
    bool vertices_first = false;
    next_line(line);
    if (line != "ply") refuse("is not a PLY file");
    do {
      if (!next_line(line) || in_.tellg() > 65536) refuse("has no end of its PLY header");
      std::istringstream words(line);
      std::string word;
      words >> word;
      if (word == "format") {
        words >> format;
      } else if (word == "element") {
        std::uint64_t count = 0;
        words >> element >> count;
        if (words.fail() || count > bytes_) refuse("claims more elements than the file has bytes");
        if (element == "vertex") {
          mesh.vertices = count;
          vertices_first = properties.empty();
        } else if (element == "face") {
          mesh.triangles = count;
        } else if (mesh.vertices == 0) {
          refuse("does not begin with its vertices");
        }
      } else if (word == "property" && element == "vertex") {
        properties.push_back(property(words));
      }
    } while (line != "end_header");
    mesh.format = "ply, " + format;
    const std::size_t at[3] = {find(properties, "x"), find(properties, "y"), find(properties, "z")};
    if (!vertices_first) refuse("does not begin with its vertices");
    if (format == "ascii")
      read_ascii_vertices(mesh, at);
    else if (format == "binary_little_endian" || format == "binary_big_endian")
      read_binary_vertices(mesh, properties, at, format == "binary_big_endian");
    else
      refuse("is of an unknown PLY format");
    return mesh;
  }
  Property property(std::istringstream& words) const {
    std::string type, name;
    words >> type >> name;
    if (type == "list") refuse("has lists among its vertices' properties");
    if (type == "double" || type == "float64") return {name, 8, true};
    if (type == "float" || type == "float32") return {name, 4, true};
    if (type.find("int") != std::string::npos && type.find("16") == std::string::npos &&
        type.find('8') == std::string::npos)
      return {name, 4, false};
    if (type.find("short") != std::string::npos || type.find("16") != std::string::npos)
      return {name, 2, false};
    return {name, 1, false};
  }
  std::size_t find(const std::vector<Property>& properties, const std::string& name) const {
    for (std::size_t i = 0; i < properties.size(); ++i)
      if (properties[i].name == name && properties[i].real) return i;
    refuse("has no vertex property '" + name + "' of floating-point numbers");
  }
  void read_ascii_vertices(MeshSummary& mesh, const std::size_t (&at)[3]) {
    std::string line;
    for (std::uint64_t i = 0; i < mesh.vertices; ++i) {
      if (!next_line(line)) refuse("ends before its last vertex");
      std::istringstream words(line);
      std::vector<std::string> fields;
      for (std::string word; words >> word;) fields.push_back(word);
      std::string coordinates;
      for (const std::size_t a : at) {
        if (a >= fields.size()) refuse("ends inside a vertex");
        coordinates += fields[a] + " ";
      }
      std::istringstream xyz(coordinates);
      mesh.add(three(xyz));
    }
  }
  void read_binary_vertices(MeshSummary& mesh, const std::vector<Property>& properties,
                            const std::size_t (&at)[3], bool big_endian) {
    std::size_t stride = 0;
    std::vector<std::size_t> offset;
    for (const Property& p : properties) {
      offset.push_back(stride);
      stride += p.size;
    }
    if (static_cast<std::uint64_t>(in_.tellg()) + mesh.vertices * stride > bytes_)
      refuse("ends before its last vertex");
    std::vector<char> row(stride);
    for (std::uint64_t i = 0; i < mesh.vertices && in_.read(row.data(), row.size()); ++i) {
      Vec3 x;
      for (int c = 0; c < 3; ++c) {
        char number[8] = {};
        const std::size_t size = properties[at[c]].size;
        for (std::size_t b = 0; b < size; ++b)
          number[big_endian ? size - 1 - b : b] = row[offset[at[c]] + b];
        float single;
        std::memcpy(&single, number, sizeof single);
        std::memcpy(&x[c], number, sizeof(double));
        if (size == 4) x[c] = single;
      }
      if (!x.allFinite()) refuse("holds a vertex that is not finite");
      mesh.add(x);
    }
  }

  std::string path_;
  std::ifstream in_;
  std::uint64_t bytes_ = 0;
};

}  // namespace toothprep::app
