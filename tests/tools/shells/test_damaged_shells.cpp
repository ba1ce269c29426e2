// Damaged mesh files: each is refused by one line that names it, or what is left of it is a shell.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

// A box of 4 mm with its corners numbered x fastest, in every form of every format.
using Row = std::vector<int>;
const std::vector<Row> kQuads = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                 {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
float corner(int point, int axis) { return (point >> axis & 1) != 0 ? 4 : 0; }

std::vector<Row> triangles() {
  std::vector<Row> all;
  for (const Row& q : kQuads) {
    all.push_back({q[0], q[1], q[2]});
    all.push_back({q[0], q[2], q[3]});
  }
  return all;
}

std::string xyz(int point) {
  std::ostringstream text;
  text << corner(point, 0) << " " << corner(point, 1) << " " << corner(point, 2);
  return text.str();
}

std::string text_stl() {
  std::string text = "solid box\n";
  for (const Row& t : triangles()) {
    text += "facet normal 0 0 0\n outer loop\n";
    for (const int p : t) text += "  vertex " + xyz(p) + "\n";
    text += " endloop\nendfacet\n";
  }
  return text + "endsolid box\n";
}

template <class T>
void put(std::string& bytes, T value, bool big = false) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  if (big) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.data(), raw.size());
}

std::string binary_stl() {
  std::string bytes(80, ' ');
  put(bytes, static_cast<std::uint32_t>(triangles().size()));
  for (const Row& t : triangles()) {
    bytes.append(12, '\0');
    for (const int p : t)
      for (int a = 0; a < 3; ++a) put(bytes, corner(p, a));
    bytes.append(2, '\0');
  }
  return bytes;
}

std::string ply_header(const std::string& format, const std::string& scalar,
                       const std::string& list) {
  return "ply\nformat " + format + " 1.0\ncomment box\nelement vertex 8\nproperty " + scalar +
         " x\nproperty " + scalar + " y\nproperty " + scalar +
         " z\nproperty uchar tissue\nelement face 6\nproperty list " + list +
         " vertex_indices\nend_header\n";
}

std::string text_ply(const std::string& scalar = "float") {
  std::string text = ply_header("ascii", scalar, "uchar int");
  for (int p = 0; p < 8; ++p) text += xyz(p) + " 1\n";
  for (const Row& q : kQuads) {
    text += "4";
    for (const int p : q) text += " " + std::to_string(p);
    text += "\n";
  }
  return text;
}

std::string binary_ply(bool big) {
  std::string bytes =
      ply_header(big ? "binary_big_endian" : "binary_little_endian", "float", "uint int");
  for (int p = 0; p < 8; ++p) {
    for (int a = 0; a < 3; ++a) put(bytes, corner(p, a), big);
    bytes += '\1';
  }
  for (const Row& q : kQuads) {
    put(bytes, std::uint32_t{4}, big);
    for (const int p : q) put(bytes, static_cast<std::int32_t>(p), big);
  }
  return bytes;
}

std::string obj() {
  std::string text = "# box\no box\n";
  for (int p = 0; p < 8; ++p) text += "v " + xyz(p) + "\n";
  text += "vn 0 0 1\n";
  for (std::size_t f = 0; f < kQuads.size(); ++f) {
    text += "f";
    for (const int p : kQuads[f])
      text += " " + (f < 3 ? std::to_string(p + 1) + "//1" : std::to_string(p - 8));
    text += "\n";
  }
  return text;
}

std::string off(const std::string& kind = "OFF", const std::string& dress = "") {
  std::string text = kind + " # box\n8 6 12\n";
  for (int p = 0; p < 8; ++p) text += xyz(p) + dress + "\n";
  text += "\n# faces\n";
  for (const Row& q : kQuads) {
    text += "4";
    for (const int p : q) text += " " + std::to_string(p);
    text += dress + "\n";
  }
  return text;
}

struct Sample {
  std::string name, bytes;
  bool has_end;  // of which nothing can be cut off unnoticed, but for the last line's end
};

std::vector<Sample> samples() {
  return {{"binary.stl", binary_stl(), true},
          {"text.stl", text_stl(), true},
          {"text.ply", text_ply(), true},
          {"ints.ply", text_ply("int"), true},
          {"little.ply", binary_ply(false), true},
          {"big.ply", binary_ply(true), true},
          {"box.obj", obj(), false},
          {"box.off", off(), true},
          {"colours.off", off("COFF", " 255 128 0"), false}};
}

class DamagedShells : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("toothprep_damaged_shells_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string written(const std::string& name, const std::string& bytes) const {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  // The error's text, which must be one line that names the file; empty if it was read. What was
  // read must be a shell that can be judged.
  static std::string refusal(const std::string& path) {
    try {
      const Shell shell = read_shell(path);
      EXPECT_FALSE(shell.triangles.empty()) << path;
      EXPECT_EQ(shell.face.size(), shell.triangles.size());
      for (const Vec3& p : shell.points) EXPECT_TRUE(p.allFinite());
      for (const auto& t : shell.triangles)
        for (const auto v : t) EXPECT_LT(v, shell.points.size());
      static_cast<void>(shell_faults(shell));
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), StartsWith(path + ": "));
      for (const char* c = e.what(); *c != '\0'; ++c)
        EXPECT_TRUE(*c >= 32 && *c < 127) << "in " << e.what();
      return e.what();
    }
    return {};
  }
  std::string refused(const std::string& name, const std::string& bytes) const {
    return refusal(written(name, bytes));
  }
  fs::path folder_;
};

TEST_F(DamagedShells, EverySampleIsTheBoxIfItIsNotDamaged) {
  for (const Sample& sample : samples()) {
    const Shell shell = read_shell(written(sample.name, sample.bytes));
    EXPECT_EQ(shell.points.size(), 8U) << sample.name;
    EXPECT_EQ(shell.triangles.size(), 12U) << sample.name;
    EXPECT_THAT(shell_faults(shell), IsEmpty()) << sample.name;
  }
  // Line ends of other systems; a binary file that calls itself solid.
  std::string dos;
  for (const char c : text_ply()) dos += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(refused("dos.ply", dos), "");
  std::string solid = binary_stl();
  solid.replace(0, 5, "solid");
  EXPECT_EQ(refused("solid.stl", solid), "");
  EXPECT_EQ(refused("more.stl", solid + "behind the end"), "");
}

TEST_F(DamagedShells, WhatIsCutOffIsMissed) {
  for (const Sample& sample : samples())
    for (std::size_t length = 0; length < sample.bytes.size(); ++length) {
      const std::string path = written("cut-" + sample.name, sample.bytes.substr(0, length));
      const std::string why = refusal(path);
      // "endsolid" is the end, whatever is left of its line; so is a last number's last digit.
      const std::size_t end =
          sample.name == "text.stl" ? sample.bytes.find("endsolid") + 8 : sample.bytes.size() - 1;
      if (!sample.has_end || length >= end) continue;
      EXPECT_NE(why, "") << sample.name << " cut to " << length << " of " << sample.bytes.size();
    }
}

TEST_F(DamagedShells, FlippedBytesNeverDoMore) {
  std::mt19937 random(11);
  int read = 0, all = 0;
  for (const Sample& sample : samples())
    for (int round = 0; round < 400; ++round) {
      std::string bytes = sample.bytes;
      for (int n = 0; n <= round % 3; ++n)
        bytes[random() % bytes.size()] = static_cast<char>(random());
      read += refused("flipped-" + sample.name, bytes).empty() ? 1 : 0;
      ++all;
    }
  // Neither all refused nor all read, or this test looked at nothing.
  EXPECT_GT(read, all / 20);
  EXPECT_LT(read, all * 19 / 20);
}

// `text` with the first `from` replaced.
std::string with(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST_F(DamagedShells, AbsurdNumbersAreNamed) {
  for (const char* count : {"-1", "nan", "1e9", "99999999999999999999", "9", "8.5", "0x8", ""}) {
    SCOPED_TRACE(count);
    EXPECT_NE(refused("points.ply", with(text_ply(), "vertex 8", std::string("vertex ") + count)),
              "");
    EXPECT_NE(refused("faces.ply", with(text_ply(), "face 6", std::string("face ") + count)), "");
    EXPECT_NE(refused("points.off", with(off(), "8 6 12", std::string(count) + " 6 12")), "");
    EXPECT_NE(refused("faces.off", with(off(), "8 6 12", "8 " + std::string(count) + " 12")), "");
  }
  for (const char* value : {"nan", "inf", "-inf", "1e999", "1,5", "4x", "--4", "1e300"}) {
    SCOPED_TRACE(value);
    for (const Sample& sample : samples())
      if (sample.bytes.find("4 4 4") != std::string::npos) {
        EXPECT_NE(refused("value-" + sample.name,
                          with(sample.bytes, "4 4 4", std::string(value) + " 4 4")),
                  "");
      }
  }
  for (const char* face : {"f 0 1 2", "f 1 2 9", "f -9 -1 -2", "f 1 2 x", "f 1 2", "f", "f 1 2 3.5",
                           "f 1 2 99999999999999999999", "f 1 2 4294967298", "f 1 2 /3"})
    EXPECT_NE(refused("face.obj", obj() + face + "\n"), "") << face;
  EXPECT_THAT(refused("line.obj", with(obj(), "vn 0 0 1", "xn 0 0 1")), HasSubstr("line 11"));
  EXPECT_THAT(refused("word.stl", with(text_stl(), "endloop", "endlop")),
              AllOf(HasSubstr("line 7"), HasSubstr("'endlop' in place of 'endloop'")));
  for (const char* face : {"4 0 2 3 8", "4 0 2 3 -1", "4 0 2 3", "-4 0 2 3 1", "2 0 2",
                           "4000000000 0 2 3 1", "nan 0 2 3 1"})
    EXPECT_NE(refused("face.off", with(off(), "4 0 2 3 1", face)), "") << face;
  for (const char* kind : {"4OFF", "nOFF", "SKEL", "OFF BINARY", "OOF", "\xff\xff"})
    EXPECT_NE(refused("kind.off", with(off(), "OFF", kind)), "") << kind;
}

TEST_F(DamagedShells, APlyThatClaimsWhatIsNotThereTakesNoMemoryForIt) {
  // The length of the first face's list, in a file of 300 bytes.
  for (const bool big : {false, true})
    for (const std::uint32_t length : {0U, 2U, 5U, 0x7fffffffU, 0xfffffffeU, 0xffffffffU}) {
      std::string bytes = binary_ply(big);
      std::string raw;
      put(raw, length, big);
      bytes.replace(bytes.size() - 6 * 20, 4, raw);
      EXPECT_NE(refused("list.ply", bytes), "") << length;
    }
  const std::string ply = text_ply();
  EXPECT_NE(refused("a.ply", with(ply, "element vertex",
                                  "element edge 9000000000000000000\n"
                                  "property int a\nelement vertex")),
            "");
  // One without properties takes no bytes: however many there are, nothing has to be read.
  EXPECT_EQ(refused("b.ply", with(ply, "element vertex",
                                  "element edge 9000000000000000000\nelement vertex")),
            "");
  for (const char* property : {"property float q", "property list uchar float x", "property odd x",
                               "property", "property list", "property list uchar int", ""})
    EXPECT_NE(refused("x.ply", with(ply, "property float x", property)), "") << property;
  for (const char* list : {"property list uchar int corners", "property int vertex_indices", ""})
    EXPECT_NE(refused("l.ply", with(ply, "property list uchar int vertex_indices", list)), "")
        << list;
  for (const char* format : {"format", "format ebcdic 1.0", "", "property float w"})
    EXPECT_NE(refused("f.ply", with(ply, "format ascii 1.0", format)), "") << format;
  EXPECT_NE(refused("none.ply", with(ply, "end_header", "end_of_header")), "");
}

TEST_F(DamagedShells, AnStlOfAnyCountOfTriangles) {
  const std::string stl = binary_stl();
  for (const std::uint32_t count : {0U, 13U, 20'000'001U, 0x7fffffffU, 0xffffffffU}) {
    std::string raw;
    put(raw, count);
    std::string bytes = stl;
    EXPECT_NE(refused("count.stl", bytes.replace(80, 4, raw)), "") << count;
  }
  for (const float value : {std::nanf(""), INFINITY, -INFINITY, 3e38F, 1e6F}) {
    std::string raw, bytes = stl;
    put(raw, value);
    EXPECT_NE(refused("value.stl", bytes.replace(84 + 12, 4, raw)), "") << value;
  }
}

TEST_F(DamagedShells, OfFacesWithoutAreaNothingIsLeft) {
  const Shell shell = read_shell(written("line.obj", "v 0 0 0\nv 4 0 0\nv 8 0 0\nf 1 2 3\n"));
  EXPECT_THROW(static_cast<void>(close_shell(shell)), InputError);
}

TEST_F(DamagedShells, WhatIsNoFileOrOfAnotherKindIsRefused) {
  for (const char* extension : {".stl", ".ply", ".obj", ".off"}) {
    const std::string name = std::string("x") + extension;
    EXPECT_THAT(refused(name, ""), HasSubstr("is empty")) << name;
    for (const Sample& sample : samples())
      if (!sample.name.ends_with(extension)) {
        EXPECT_NE(refused(name, sample.bytes), "") << sample.name << " as " << name;
      }
    fs::remove(folder_ / name);
    fs::create_directory(folder_ / name);
    EXPECT_THAT(refusal((folder_ / name).string()), HasSubstr("is a folder"));
    fs::remove(folder_ / name);
    fs::create_symlink("/dev/zero", folder_ / name);
    EXPECT_THAT(refusal((folder_ / name).string()), HasSubstr("is a device"));
    fs::remove(folder_ / name);
    fs::create_symlink(name, folder_ / name);  // to itself
    EXPECT_THAT(refusal((folder_ / name).string()), HasSubstr("cannot be read"));
  }
  EXPECT_THAT(refused("box.vtk", binary_stl()), HasSubstr("none of .stl"));
}

}  // namespace
}  // namespace toothprep
