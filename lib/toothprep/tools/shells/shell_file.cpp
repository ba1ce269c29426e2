// Reading of shells, against the bytes that are there: nothing is allocated because a header says
// so, every number has to be one, and every count has to be met. Not by CGAL's readers (5.5): they
// follow a null pointer where a PLY's coordinates are integers, allocate what a list's length
// claims, and drop the rest of a face's line at a word that is no number.
#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <optional>
#include <string_view>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMostTriangles = 20'000'000;
constexpr double kLongest = 200, kShortest = 0.5;  // of a box around teeth, mm
constexpr auto kNone = static_cast<std::uint32_t>(-1);

// Faces of any number of corners, as the file has them.
struct Soup {
  std::vector<Vec3> points;
  std::vector<std::uint32_t> corners;  // of one face after the other, counted from 0
  std::vector<std::size_t> ends;       // per face, where its corners end
};

std::string lower(std::string_view text) {
  std::string low(text);
  std::transform(low.begin(), low.end(), low.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return low;
}

void refuse_too_many(const std::string& path, std::uint64_t faces) {
  if (faces > kMostTriangles)
    throw InputError(path, "", "has " + std::to_string(faces) + " faces, more than 20 million",
                     "thin it out first");
}

void end_face(const std::string& path, Soup& soup) {
  soup.ends.push_back(soup.corners.size());
  refuse_too_many(path, soup.ends.size());
}

// ---- Text

// The words of a text, one after the other; `comment` starts what is skipped to the line's end.
class Words {
 public:
  Words(const std::string& path, std::string_view text, char comment = '\n')
      : path_(path), text_(text), comment_(comment) {}

  bool more_in_line() {
    while (at_ < text_.size() && text_[at_] != '\n' && is_blank(text_[at_])) ++at_;
    if (at_ < text_.size() && text_[at_] == comment_)
      while (at_ < text_.size() && text_[at_] != '\n') ++at_;
    return at_ < text_.size() && text_[at_] != '\n';
  }
  bool more() {
    while (!more_in_line()) {
      if (at_ >= text_.size()) return false;
      next_line();
    }
    return true;
  }
  // Behind the line's end.
  void next_line() {
    while (at_ < text_.size() && text_[at_] != '\n') ++at_;
    if (at_ < text_.size()) ++at_, ++line_;
  }
  std::string_view word_in_line() {
    if (!more_in_line()) lacks();
    const std::size_t from = at_;
    while (at_ < text_.size() && !is_blank(text_[at_])) ++at_;
    return text_.substr(from, at_ - from);
  }
  std::string_view word() {
    if (!more()) lacks();
    return word_in_line();
  }
  void expect(std::string_view wanted) {
    const std::string found = lower(word());
    if (found != wanted)
      fail("has '" + shown(found) + "' in place of '" + std::string(wanted) + "'");
  }
  double number(std::string_view word) const { return parsed<double>(word); }
  std::int64_t integer(std::string_view word) const { return parsed<std::int64_t>(word); }
  Vec3 point_in_line() {
    Vec3 p;
    for (int a = 0; a < 3; ++a) p[a] = number(word_in_line());
    return p;
  }

  std::size_t at() const { return at_; }
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(path_, "line " + std::to_string(line_), what);
  }

 private:
  static bool is_blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
  static std::string shown(std::string_view word) {
    std::string text(word.substr(0, 20));
    for (char& c : text)
      if (static_cast<unsigned char>(c) < 32 || static_cast<unsigned char>(c) > 126) c = '?';
    return text;
  }
  [[noreturn]] void lacks() const {
    if (at_ >= text_.size()) throw InputError(path_, "", "is truncated: it ends too early");
    fail("lacks a number");
  }
  template <class T>
  T parsed(std::string_view word) const {
    T value{};
    const char* first = word.data();
    const char* last = first + word.size();
    if (word.size() > 1 && *first == '+') ++first;
    const auto [end, error] = std::from_chars(first, last, value);
    if (error != std::errc() || end != last)
      fail("'" + shown(word) + "' is no " + (std::is_integral_v<T> ? "whole number" : "number"));
    return value;
  }

  const std::string& path_;
  std::string_view text_;
  char comment_;
  std::size_t at_ = 0, line_ = 1;
};

std::uint32_t point_index(const Words& words, std::int64_t index) {
  if (index < 0 || index >= kNone) words.fail("names a point that does not exist");
  return static_cast<std::uint32_t>(index);
}

Soup read_text_stl(const std::string& path, std::string_view text) {
  Soup soup;
  Words words(path, text);
  do {
    words.expect("solid");
    words.next_line();  // its name
    for (;;) {
      const std::string what = lower(words.word());
      if (what == "endsolid") break;
      if (what != "facet") words.fail("holds neither a facet nor the solid's end");
      words.expect("normal");
      for (int a = 0; a < 3; ++a) words.word();  // which follows from the corners
      words.expect("outer");
      words.expect("loop");
      for (int c = 0; c < 3; ++c) {
        words.expect("vertex");
        soup.corners.push_back(point_index(words, static_cast<std::int64_t>(soup.points.size())));
        soup.points.push_back(words.point_in_line());
      }
      words.expect("endloop");
      words.expect("endfacet");
      end_face(path, soup);
    }
    words.next_line();
  } while (words.more());
  return soup;
}

Soup read_obj(const std::string& path, std::string_view text) {
  // What does not bound a solid or only dresses it; anything else is damage.
  constexpr std::string_view kOther =
      " vt vn vp o g s l p usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
      "trace_obj ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con "
      "mg ";
  Soup soup;
  Words words(path, text, '#');
  for (; words.more(); words.next_line()) {
    const std::string_view what = words.word();
    if (what == "v") {
      soup.points.push_back(words.point_in_line());
    } else if (what == "f") {
      while (words.more_in_line()) {  // "5", "5/1", "5//2", "5/1/2"; -1 is the latest point
        const std::string_view word = words.word_in_line();
        const std::int64_t index = words.integer(word.substr(0, word.find('/')));
        if (index == 0) words.fail("names point 0; points are counted from 1");
        const auto latest = static_cast<std::int64_t>(soup.points.size());
        if (index < -latest) words.fail("names a point that does not exist");
        soup.corners.push_back(point_index(words, index > 0 ? index - 1 : latest + index));
      }
      end_face(path, soup);
    } else if (kOther.find(" " + std::string(what) + " ") == std::string_view::npos) {
      words.fail("is not of an OBJ file");
    }
  }
  return soup;
}

Soup read_off(const std::string& path, std::string_view text) {
  Soup soup;
  Words words(path, text, '#');
  std::string_view kind = words.word();
  for (const std::string_view prefix : {"ST", "C", "N"})  // texture, colours, normals: not read
    if (kind.starts_with(prefix)) kind.remove_prefix(prefix.size());
  if (kind != "OFF") words.fail("is not the first of an OFF file with points in space");
  std::array<std::int64_t, 2> count{};
  for (auto& n : count) {
    const std::string_view word = words.word();
    if (word == "BINARY") words.fail("announces a binary OFF file; save it as text");
    n = words.integer(word);
    if (n < 0) words.fail("states a negative count");
  }
  for (std::int64_t k = 0; k < count[0]; ++k) {
    words.next_line();
    words.more();
    soup.points.push_back(words.point_in_line());
  }
  for (std::int64_t k = 0; k < count[1]; ++k) {
    words.next_line();
    words.more();
    const std::int64_t corners = words.integer(words.word_in_line());
    for (std::int64_t c = 0; c < corners; ++c)
      soup.corners.push_back(point_index(words, words.integer(words.word_in_line())));
    end_face(path, soup);
  }
  return soup;
}

// ---- PLY

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
    if (!(value >= 0 && value < kNone && value == std::floor(value)))
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

Soup read_ply(const std::string& path, std::string_view text) {
  Words words(path, text);
  if (words.word() != "ply") throw InputError(path, "", "is not a PLY file");
  std::vector<PlyElement> elements;
  std::optional<PlyValues::Form> form;
  for (bool ended = false; !ended;) {
    words.next_line();
    if (!words.more()) throw InputError(path, "", "is truncated: the header has no end");
    const std::string_view what = words.word_in_line();
    if (what == "format") {
      const std::string_view name = words.word_in_line();
      if (name == "ascii") form = PlyValues::Form::kText;
      if (name == "binary_little_endian") form = PlyValues::Form::kLittle;
      if (name == "binary_big_endian") form = PlyValues::Form::kBig;
    } else if (what == "element") {
      PlyElement element{std::string(words.word_in_line()), 0, {}};
      const std::int64_t count = words.integer(words.word_in_line());
      if (count < 0) words.fail("states a negative count");
      element.count = static_cast<std::uint64_t>(count);
      elements.push_back(element);
    } else if (what == "property") {
      if (elements.empty()) words.fail("is a property of nothing");
      PlyProperty property;
      std::string_view type = words.word_in_line();
      property.is_list = type == "list";
      if (property.is_list) {
        property.count_type = ply_type(words, words.word_in_line());
        type = words.word_in_line();
      }
      property.type = ply_type(words, type);
      property.name = words.word_in_line();
      elements.back().properties.push_back(property);
    } else if (what == "end_header") {
      ended = true;
    } else if (what != "comment" && what != "obj_info") {
      words.fail("is not of a PLY header");
    }
  }
  if (!form) throw InputError(path, "format", "is neither text nor binary");
  words.next_line();

  Soup soup;
  PlyValues values(path, text.substr(words.at()), *form);
  for (const PlyElement& element : elements) {
    const std::size_t n = element.properties.size();
    const bool is_point = element.name == "vertex" || element.name == "vertices";
    const bool is_face = element.name == "face" || element.name == "faces";
    const std::array<std::size_t, 3> xyz = {find_property(element, "x", false),
                                            find_property(element, "y", false),
                                            find_property(element, "z", false)};
    std::size_t corners = find_property(element, "vertex_indices", true);
    if (corners == n) corners = find_property(element, "vertex_index", true);
    if (is_point && *std::max_element(xyz.begin(), xyz.end()) == n)
      throw InputError(path, element.name, "has no x, y and z");
    if (is_face && corners == n)
      throw InputError(path, element.name, "has no list of vertex_indices");
    for (std::uint64_t k = 0; k < element.count && n > 0; ++k) {
      Vec3 point = Vec3::Zero();
      const std::string place = is_face ? "face " + std::to_string(k + 1) : element.name;
      for (std::size_t p = 0; p < n; ++p) {
        const PlyProperty& property = element.properties[p];
        if (property.is_list) {
          const std::uint32_t length = values.next_count(property.count_type, place);
          for (std::uint32_t c = 0; c < length; ++c) {
            if (is_face && p == corners)
              soup.corners.push_back(values.next_count(property.type, place));
            else
              values.next(property.type);
          }
        } else {
          const double value = values.next(property.type);
          for (int a = 0; a < 3; ++a)
            if (xyz[a] == p) point[a] = value;
        }
      }
      if (is_point) soup.points.push_back(point);
      if (is_face) end_face(path, soup);
    }
  }
  return soup;
}

// ---- Binary STL

// A file that begins with "solid" is text, unless it is as long as a binary one would be: the
// count of a text would be letters, more than 100 million.
bool is_text_stl(const std::string& path, std::string_view bytes) {
  const bool says_text = lower(bytes.substr(0, 5)) == "solid";
  if (bytes.size() < 84) {
    if (says_text) return true;
    throw InputError(path, "", "is truncated: shorter than the header of a binary STL file");
  }
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  const std::uint64_t needed = 84 + std::uint64_t{50} * count;
  if (bytes.size() < needed && !says_text)
    throw InputError(path, "",
                     "is truncated or no STL file: " + std::to_string(count) +
                         " triangles would take " + std::to_string(needed) + " bytes, it has " +
                         std::to_string(bytes.size()));
  return bytes.size() < needed;
}

Soup read_binary_stl(const std::string& path, std::string_view bytes) {
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  refuse_too_many(path, count);
  Soup soup;
  soup.points.reserve(std::size_t{3} * count);
  for (std::uint32_t k = 0; k < count; ++k) {
    std::array<float, 9> x;
    std::memcpy(x.data(), bytes.data() + 84 + std::size_t{50} * k + 12, sizeof x);
    for (std::size_t c = 0; c < 9; c += 3) {
      soup.corners.push_back(static_cast<std::uint32_t>(soup.points.size()));
      soup.points.emplace_back(x[c], x[c + 1], x[c + 2]);
    }
    end_face(path, soup);
  }
  return soup;
}

Soup read_soup(const std::string& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) throw InputError(path, "", "is not a file");
  const std::string extension = lower(fs::path(path).extension().string());
  if (extension != ".stl" && extension != ".ply" && extension != ".obj" && extension != ".off")
    throw InputError(path, "", "is none of .stl, .ply, .obj, .off");
  const std::uintmax_t size = fs::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in) throw InputError(path, "", "can't be read");
  if (size == 0) throw InputError(path, "", "is empty");
  std::string bytes(size, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (static_cast<std::uintmax_t>(in.gcount()) != size) throw InputError(path, "", "can't be read");
  if (extension == ".ply") return read_ply(path, bytes);
  if (extension == ".obj") return read_obj(path, bytes);
  if (extension == ".off") return read_off(path, bytes);
  return is_text_stl(path, bytes) ? read_text_stl(path, bytes) : read_binary_stl(path, bytes);
}

void check_size(const std::string& path, const Shell& shell) {
  Vec3 low = shell.points[0], high = shell.points[0];
  for (const Vec3& p : shell.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double longest = (high - low).maxCoeff();
  std::array<char, 64> size{};
  std::snprintf(size.data(), size.size(), "its longest side would be %.4g mm", longest);
  if (longest > kLongest)
    throw InputError(path, "", size.data(), "coordinates must be mm; are these micrometres?");
  if (longest < kShortest)
    throw InputError(path, "", size.data(), "coordinates must be mm; are these metres?");
  if (std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff()) > 1e5)
    throw InputError(path, "", "lies more than 100 m from the frame's zero");
}

}  // namespace

Shell read_shell(const std::string& path) {
  const Soup soup = read_soup(path);
  if (soup.ends.empty()) throw InputError(path, "", "holds no faces");
  Shell shell;
  shell.file = path;

  // Equal points are one point, numbered in the order of their first appearance. -0 is 0.
  const std::size_t n = soup.points.size();
  std::vector<Vec3> points(n);
  for (std::size_t k = 0; k < n; ++k) {
    points[k] = soup.points[k] + Vec3::Zero();
    if (!points[k].allFinite())
      throw InputError(path, "point " + std::to_string(k + 1), "a coordinate is not finite");
  }
  if (n >= kNone) throw InputError(path, "", "has too many points");
  std::vector<std::uint32_t> order(n), same(n), number(n, kNone);
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Vec3 &p = points[a], &q = points[b];
    if (p.x() != q.x()) return p.x() < q.x();
    if (p.y() != q.y()) return p.y() < q.y();
    if (p.z() != q.z()) return p.z() < q.z();
    return a < b;
  });
  for (std::size_t k = 0; k < n; ++k)
    same[order[k]] =
        k > 0 && points[order[k]] == points[order[k - 1]] ? same[order[k - 1]] : order[k];

  std::vector<std::uint32_t> corner;
  for (std::size_t f = 0, c = 0; f < soup.ends.size(); ++f) {
    const std::string place = "face " + std::to_string(f + 1);
    if (soup.ends[f] < c + 3) throw InputError(path, place, "has fewer than three corners");
    corner.clear();
    for (; c < soup.ends[f]; ++c) {
      const std::uint32_t point = soup.corners[c];
      if (point >= n) throw InputError(path, place, "names a point that does not exist");
      std::uint32_t& known = number[same[point]];
      if (known == kNone) {
        known = static_cast<std::uint32_t>(shell.points.size());
        shell.points.push_back(points[same[point]]);
      }
      corner.push_back(known);
    }
    // A quad is cut along its shorter diagonal, a larger face into a fan.
    const auto at = [&](std::size_t k) { return shell.points[corner[k]]; };
    if (corner.size() == 4 && (at(1) - at(3)).squaredNorm() < (at(0) - at(2)).squaredNorm())
      std::rotate(corner.begin(), corner.begin() + 1, corner.end());
    for (std::size_t k = 1; k + 1 < corner.size(); ++k) {
      shell.triangles.push_back({corner[0], corner[k], corner[k + 1]});
      shell.face.push_back(static_cast<std::uint32_t>(f + 1));
    }
    refuse_too_many(path, shell.triangles.size());
  }
  check_size(path, shell);
  return shell;
}

}  // namespace toothprep
