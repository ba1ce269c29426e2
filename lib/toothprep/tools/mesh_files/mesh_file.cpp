// Reading against the bytes that are there: nothing is allocated because a header says so, every
// number has to be one, and every count has to be met. Not by CGAL's readers (5.5): they follow a
// null pointer where a PLY's coordinates are integers, allocate what a list's length claims, and
// drop the rest of a face's line at a word that is no number.
#include "toothprep/tools/mesh_files/mesh_file.h"

#include <array>
#include <cstring>
#include <filesystem>

#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/mesh_files/gzip.h"
#include "toothprep/tools/mesh_files/ply_file.h"
#include "toothprep/tools/mesh_files/words.h"

namespace toothprep {
namespace mesh_files {
namespace {

MeshFile read_text_stl(const std::string& path, std::string_view text) {
  MeshFile mesh;
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
        mesh.corners.push_back(point_index(words, static_cast<std::int64_t>(mesh.points.size())));
        mesh.points.push_back(words.point_in_line());
      }
      words.expect("endloop");
      words.expect("endfacet");
      end_face(path, mesh);
    }
    words.next_line();
  } while (words.more());
  return mesh;
}

MeshFile read_obj(const std::string& path, std::string_view text) {
  // What does not bound a solid or only dresses it; anything else is damage.
  constexpr std::string_view kOther =
      " vt vn vp o g s l p usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
      "trace_obj ctech stech cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con "
      "mg ";
  MeshFile mesh;
  Words words(path, text, '#');
  for (; words.more(); words.next_line()) {
    const std::string_view what = words.word();
    if (what == "v") {
      mesh.points.push_back(words.point_in_line());
    } else if (what == "f") {
      while (words.more_in_line()) {  // "5", "5/1", "5//2", "5/1/2"; -1 is the latest point
        const std::string_view word = words.word_in_line();
        const std::int64_t index = words.integer(word.substr(0, word.find('/')));
        if (index == 0) words.fail("names point 0; points are counted from 1");
        const auto latest = static_cast<std::int64_t>(mesh.points.size());
        if (index < -latest) words.fail("names a point that does not exist");
        mesh.corners.push_back(point_index(words, index > 0 ? index - 1 : latest + index));
      }
      end_face(path, mesh);
    } else if (kOther.find(" " + std::string(what) + " ") == std::string_view::npos) {
      words.fail("is not of an OBJ file");
    }
  }
  return mesh;
}

MeshFile read_off(const std::string& path, std::string_view text) {
  MeshFile mesh;
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
    mesh.points.push_back(words.point_in_line());
  }
  for (std::int64_t k = 0; k < count[1]; ++k) {
    words.next_line();
    words.more();
    const std::int64_t corners = words.integer(words.word_in_line());
    for (std::int64_t c = 0; c < corners; ++c)
      mesh.corners.push_back(point_index(words, words.integer(words.word_in_line())));
    end_face(path, mesh);
  }
  return mesh;
}

// ---- Binary STL

constexpr std::size_t kStlHeader = 84;

std::uint64_t stl_count(std::string_view head) {
  std::uint32_t count = 0;
  std::memcpy(&count, head.data() + 80, sizeof count);
  return count;
}

std::uint64_t stl_size(std::string_view head) { return kStlHeader + 50 * stl_count(head); }

// A file that begins with "solid" is text, unless it is as long as a binary one would be: the
// count of a text would be letters, more than 100 million. `head`: the file's first bytes.
bool is_text_stl(const std::string& path, std::uint64_t size, std::string_view head) {
  const bool says_text = lower(head.substr(0, 5)) == "solid";
  if (head.size() < kStlHeader) {
    if (says_text) return true;
    throw InputError(path, "", "is truncated: shorter than the header of a binary STL file");
  }
  const std::uint64_t needed = stl_size(head);
  if (size < needed && !says_text)
    throw InputError(path, "",
                     "is truncated or no STL file: " + std::to_string(stl_count(head)) +
                         " triangles would take " + std::to_string(needed) + " bytes, it has " +
                         std::to_string(size));
  return size < needed;
}

MeshFile read_binary_stl(const std::string& path, std::string_view bytes) {
  const std::uint64_t count = stl_count(bytes);
  refuse_too_many(path, count);
  MeshFile mesh;
  mesh.points.reserve(3 * count);
  for (std::uint64_t k = 0; k < count; ++k) {
    std::array<float, 9> x;
    std::memcpy(x.data(), bytes.data() + kStlHeader + 50 * k + 12, sizeof x);
    for (std::size_t c = 0; c < 9; c += 3) {
      mesh.corners.push_back(static_cast<std::uint32_t>(mesh.points.size()));
      mesh.points.emplace_back(x[c], x[c + 1], x[c + 2]);
    }
    end_face(path, mesh);
  }
  return mesh;
}

// ---- Any

enum class Kind { kTextStl, kBinaryStl, kPly, kObj, kOff };

struct Contents {
  Kind kind;
  std::uint64_t size;  // bytes of the file that count
};

// ".stl" of "x.stl" and "X.STL.gz".
std::string extension_of(const std::string& path) {
  std::filesystem::path name(path);
  if (lower(name.extension().string()) == ".gz") name = name.stem();
  return lower(name.extension().string());
}

bool is_gzipped(const std::string& path) {
  return lower(std::filesystem::path(path).extension().string()) == ".gz";
}

// By extension, size and the first bytes, before the whole is read.
Contents contents_of(const std::string& path, std::uint64_t size, std::string_view head) {
  const std::string extension = extension_of(path);
  if (size == 0) throw InputError(path, "", "is empty");
  if (extension == ".ply") {
    if (!head.starts_with("ply")) throw InputError(path, "", "is not a PLY file");
    return {Kind::kPly, size};
  }
  if (extension == ".stl" && !is_text_stl(path, size, head))
    return {Kind::kBinaryStl, stl_size(head)};
  if (head.find('\0') != std::string::npos)
    throw InputError(path, "", "is no text, as " + extension + " is");
  return {extension == ".stl"   ? Kind::kTextStl
          : extension == ".obj" ? Kind::kObj
                                : Kind::kOff,
          size};
}

struct Opened {
  Kind kind;
  std::string bytes;
};

Opened opened(const std::string& path) {
  constexpr std::size_t kHead = 4096;
  const InputFile file(path);
  if (!is_mesh_file(path)) throw InputError(path, "", "is none of .stl, .ply, .obj, .off");
  if (file.size() == 0) throw InputError(path, "", "is empty");
  if (is_gzipped(path)) {
    std::string bytes = inflated(file);
    const Contents what = contents_of(path, bytes.size(), std::string_view(bytes).substr(0, kHead));
    bytes.resize(what.size);
    return {what.kind, std::move(bytes)};
  }
  std::string head(kHead, '\0');
  head.resize(file.read(0, head.size(), head.data()));
  const Contents what = contents_of(path, file.size(), head);
  constexpr double kBytesPerByte = 3;  // the file's, and what is made of them
  require_memory(path, "size", kBytesPerByte * static_cast<double>(what.size),
                 "thin the mesh out first");
  std::string bytes(what.size, '\0');
  if (file.read(0, bytes.size(), bytes.data()) != bytes.size())
    throw InputError(path, "", "can't be read");
  return {what.kind, std::move(bytes)};
}

MeshFile read_as(Kind kind, const std::string& path, std::string_view bytes,
                 const std::vector<std::string>& wanted) {
  switch (kind) {
    case Kind::kTextStl:
      return read_text_stl(path, bytes);
    case Kind::kBinaryStl:
      return read_binary_stl(path, bytes);
    case Kind::kPly:
      return read_ply(path, bytes, wanted);
    case Kind::kObj:
      return read_obj(path, bytes);
    case Kind::kOff:
      break;
  }
  return read_off(path, bytes);
}

}  // namespace
}  // namespace mesh_files

bool is_mesh_file(const std::string& path) {
  const std::string extension = mesh_files::extension_of(path);
  return extension == ".stl" || extension == ".ply" || extension == ".obj" || extension == ".off";
}

MeshFile read_mesh_file(const std::string& path, const std::vector<std::string>& wanted) {
  using mesh_files::Kind;
  const auto [kind, bytes] = mesh_files::opened(path);
  MeshFile mesh = mesh_files::read_as(kind, path, bytes, wanted);
  if (mesh.format.empty())
    mesh.format = kind == Kind::kTextStl     ? "stl, text"
                  : kind == Kind::kBinaryStl ? "stl, binary"
                  : kind == Kind::kObj       ? "obj"
                                             : "off";
  if (mesh_files::is_gzipped(path)) mesh.format += ", gzip";
  return mesh;
}

}  // namespace toothprep
