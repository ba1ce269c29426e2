// Reading of shells: CGAL's polygon soups; binary STL by ourselves, since CGAL merges points on
// reading and a NaN would be lost in that.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/OBJ.h>
#include <CGAL/IO/OFF.h>
#include <CGAL/IO/PLY.h>
#include <CGAL/IO/STL.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <sstream>

#include "toothprep/core/errors.h"
#include "toothprep/mesh/shells.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;

constexpr std::uintmax_t kMostTriangles = 20'000'000;
constexpr double kLongest = 200, kShortest = 0.5;  // of a box around teeth, mm

struct Soup {
  std::vector<Point> points;
  std::vector<std::vector<std::size_t>> faces;
};

std::string lower_extension(const std::string& path) {
  std::string e = fs::path(path).extension().string();
  std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return std::tolower(c); });
  return e;
}

void refuse_too_many(const std::string& path, std::uintmax_t faces) {
  if (faces > kMostTriangles)
    throw InputError(path, "", "has " + std::to_string(faces) + " faces, more than 20 million",
                     "thin it out first");
}

// The counts a header promises, before memory is taken for them: a corner takes at least 6 bytes as
// text or binary ("0 0 0" and a line's end), a face at least 7.
void check_promise(const std::string& path, std::uintmax_t bytes, double points, double faces) {
  if (!(points > 0 && faces > 0)) throw InputError(path, "", "holds no faces");
  if (points * 6 + faces * 7 > static_cast<double>(bytes))
    throw InputError(path, "", "is truncated: it is too short for what its header promises");
  refuse_too_many(path, static_cast<std::uintmax_t>(faces));
}

void check_header(const std::string& path, const std::string& extension, std::uintmax_t bytes,
                  std::istream& in) {
  double points = 0, faces = 0;
  std::string line;
  if (extension == ".ply") {
    if (!std::getline(in, line) || line.compare(0, 3, "ply") != 0)
      throw InputError(path, "", "is not a PLY file");
    bool ended = false;
    while (!ended && std::getline(in, line)) {
      std::istringstream words(line);
      std::string word, name;
      words >> word >> name;
      if (word == "element" && name == "vertex") words >> points;
      if (word == "element" && name == "face") words >> faces;
      ended = word == "end_header";
    }
    if (!ended) throw InputError(path, "", "is truncated: the header has no end");
    check_promise(path, bytes, points, faces);
  } else if (extension == ".off") {
    while (std::getline(in, line)) {
      std::istringstream words(line.substr(0, line.find('#')));
      std::string word;
      if (!(words >> word)) continue;
      if (word.size() >= 3 && word.compare(word.size() - 3, 3, "OFF") == 0 && !(words >> word))
        continue;
      std::istringstream(word) >> points;
      words >> faces;
      if (words) check_promise(path, bytes, points, faces);
      return;  // an odd header is the reader's to judge
    }
  }
}

// Binary STL if its size is the one its count of triangles demands.
bool read_binary_stl(const std::string& path, std::uintmax_t bytes, std::istream& in, Soup& soup) {
  static_assert(std::endian::native == std::endian::little);
  std::array<char, 84> header{};
  in.read(header.data(), header.size());
  const bool says_text = in.gcount() >= 5 && std::memcmp(header.data(), "solid", 5) == 0;
  if (in.gcount() < 84) {
    if (says_text) return false;
    throw InputError(path, "", "is truncated: shorter than the header of a binary STL file");
  }
  std::uint32_t count = 0;
  std::memcpy(&count, header.data() + 80, sizeof count);
  const std::uintmax_t needed = 84 + std::uintmax_t{50} * count;
  if (bytes != needed && says_text) return false;
  if (bytes < needed)
    throw InputError(path, "",
                     "is truncated or no STL file: " + std::to_string(count) +
                         " triangles would take " + std::to_string(needed) + " bytes, it has " +
                         std::to_string(bytes));
  refuse_too_many(path, count);
  soup.points.reserve(std::size_t{3} * count);
  soup.faces.reserve(count);
  std::array<char, 50> record{};
  for (std::uint32_t k = 0; k < count; ++k) {
    if (!in.read(record.data(), record.size())) throw InputError(path, "", "can't be read");
    std::array<float, 9> x;
    std::memcpy(x.data(), record.data() + 12, sizeof x);
    for (std::size_t c = 0; c < 9; c += 3) soup.points.emplace_back(x[c], x[c + 1], x[c + 2]);
    soup.faces.push_back({std::size_t{3} * k, std::size_t{3} * k + 1, std::size_t{3} * k + 2});
  }
  return true;
}

// A text STL cut off anywhere has lost its end; CGAL would take some of these for an empty binary.
void check_text_stl(const std::string& path, std::uintmax_t bytes, std::istream& in) {
  constexpr std::uintmax_t kTail = 4096;  // room for a long name and empty lines
  in.clear();
  in.seekg(static_cast<std::streamoff>(bytes - std::min(bytes, kTail)));
  const std::string tail{std::istreambuf_iterator<char>(in), {}};
  if (tail.find("endsolid") == std::string::npos)
    throw InputError(path, "", "is truncated: the text has no endsolid");
}

Soup read_soup(const std::string& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) throw InputError(path, "", "is not a file");
  const std::uintmax_t bytes = fs::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in) throw InputError(path, "", "can't be read");
  if (bytes == 0) throw InputError(path, "", "is empty");
  const std::string extension = lower_extension(path);
  Soup soup;
  bool good = false;
  const auto silent = CGAL::parameters::verbose(false);  // the error is ours to tell
  try {
    const auto rewind = [&in] {
      in.clear();
      in.seekg(0);
    };
    if (extension == ".stl") {
      good = read_binary_stl(path, bytes, in, soup);
      if (!good) {
        check_text_stl(path, bytes, in);
        rewind();
        good = CGAL::IO::read_STL(in, soup.points, soup.faces, silent);
      }
    } else if (extension == ".ply" || extension == ".off") {
      check_header(path, extension, bytes, in);
      rewind();
      good = extension == ".ply" ? CGAL::IO::read_PLY(in, soup.points, soup.faces, silent)
                                 : CGAL::IO::read_OFF(in, soup.points, soup.faces, silent);
    } else if (extension == ".obj") {
      good = CGAL::IO::read_OBJ(in, soup.points, soup.faces, silent);
    } else {
      throw InputError(path, "", "is none of .stl, .ply, .obj, .off");
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception&) {
    good = false;
  }
  if (!good)
    throw InputError(path, "",
                     "can't be read as " + extension.substr(1) + "; it is truncated or damaged");
  if (soup.faces.empty()) throw InputError(path, "", "holds no faces");
  refuse_too_many(path, soup.faces.size());
  return soup;
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
  Shell shell;
  shell.file = path;

  // Equal points are one point, numbered in the order of their first appearance. -0 is 0.
  const std::size_t n = soup.points.size();
  std::vector<Vec3> points(n);
  for (std::size_t k = 0; k < n; ++k) {
    points[k] = Vec3(soup.points[k].x(), soup.points[k].y(), soup.points[k].z()) + Vec3::Zero();
    if (!points[k].allFinite())
      throw InputError(path, "point " + std::to_string(k + 1), "a coordinate is not finite");
  }
  constexpr auto kNone = static_cast<std::uint32_t>(-1);
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

  for (std::size_t f = 0; f < soup.faces.size(); ++f) {
    const auto& face = soup.faces[f];
    const std::string place = "face " + std::to_string(f + 1);
    if (face.size() < 3) throw InputError(path, place, "has fewer than three corners");
    std::vector<std::uint32_t> corner;
    for (const std::size_t c : face) {
      if (c >= n) throw InputError(path, place, "names a point that does not exist");
      std::uint32_t& known = number[same[c]];
      if (known == kNone) {
        known = static_cast<std::uint32_t>(shell.points.size());
        shell.points.push_back(points[same[c]]);
      }
      corner.push_back(known);
    }
    // A quad is cut along its shorter diagonal, a larger face into a fan.
    const auto at = [&](std::size_t c) { return shell.points[corner[c]]; };
    if (corner.size() == 4 && (at(1) - at(3)).squaredNorm() < (at(0) - at(2)).squaredNorm())
      std::rotate(corner.begin(), corner.begin() + 1, corner.end());
    for (std::size_t c = 1; c + 1 < corner.size(); ++c) {
      shell.triangles.push_back({corner[0], corner[c], corner[c + 1]});
      shell.face.push_back(static_cast<std::uint32_t>(f + 1));
    }
    refuse_too_many(path, shell.triangles.size());
  }
  check_size(path, shell);
  return shell;
}

}  // namespace toothprep
