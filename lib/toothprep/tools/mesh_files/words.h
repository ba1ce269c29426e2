// The words of a text file and what they mean; for this module's own .cpp files.
#pragma once

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh_files/mesh_file.h"

namespace toothprep::mesh_files {

constexpr std::uint64_t kMostFaces = 20'000'000;
constexpr auto kNoPoint = static_cast<std::uint32_t>(-1);

inline std::string lower(std::string_view text) {
  std::string low(text);
  std::transform(low.begin(), low.end(), low.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return low;
}

inline void refuse_too_many(const std::string& path, std::uint64_t faces) {
  if (faces > kMostFaces)
    throw InputError(path, "", "has " + std::to_string(faces) + " faces, more than 20 million",
                     "thin it out first");
}

inline void end_face(const std::string& path, MeshFile& mesh) {
  mesh.ends.push_back(mesh.corners.size());
  refuse_too_many(path, mesh.ends.size());
}

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

inline std::uint32_t point_index(const Words& words, std::int64_t index) {
  if (index < 0 || index >= kNoPoint) words.fail("names a point that does not exist");
  return static_cast<std::uint32_t>(index);
}

}  // namespace toothprep::mesh_files
