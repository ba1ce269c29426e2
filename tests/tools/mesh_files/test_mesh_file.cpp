// What a mesh file says, as it stands there; what is damaged is tested with the shells made of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "../../support/cpu_time.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh_files/mesh_file.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class MeshFiles : public testing::Test {
 protected:
  MeshFiles()
      : folder_(fs::temp_directory_path() / ("toothprep_mesh_files_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~MeshFiles() override { fs::remove_all(folder_); }
  std::string written(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return (folder_ / name).string();
  }
  static std::string refusal(const std::string& path) {
    try {
      read_mesh_file(path);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  }
  fs::path folder_;
};

TEST_F(MeshFiles, APlysFacesAndThePropertiesThatAreAskedForAreRead) {
  const std::string file =
      written("a.ply",
              "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
              "property float z\nproperty float quality\nproperty uchar tissue\n"
              "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
              "0 0 0 0.5 1\n1 0 0 -0.25 2\n1 1 0 2 2\n0 1 0 3 1\n3 0 1 2\n4 0 1 2 3\n");
  const MeshFile mesh = read_mesh_file(file, {"quality", "absent"});
  EXPECT_EQ(mesh.format, "ply, ascii");
  ASSERT_EQ(mesh.points.size(), 4u);
  EXPECT_EQ(mesh.points[2], Vec3(1, 1, 0));
  EXPECT_THAT(mesh.corners, ElementsAre(0, 1, 2, 0, 1, 2, 3));
  EXPECT_THAT(mesh.ends, ElementsAre(3, 7));
  ASSERT_EQ(mesh.values.size(), 1u);
  EXPECT_THAT(mesh.values.at("quality"), ElementsAre(0.5f, -0.25f, 2.0f, 3.0f));
  EXPECT_TRUE(read_mesh_file(file).values.empty());
}

TEST_F(MeshFiles, GigabytesOfZerosAreRefusedAtOnceAndInLittleMemory) {
  rusage before{};
  getrusage(RUSAGE_SELF, &before);
  for (const char* name : {"a.ply", "a.obj", "a.off", "a.stl"}) {
    SCOPED_TRACE(name);
    const std::string file = written(name, "");
    fs::resize_file(file, 3ull << 30);
    const double start = cpu_seconds();
    if (file.ends_with(".stl"))  // a binary one of no triangles, with much behind it
      EXPECT_TRUE(read_mesh_file(file).ends.empty());
    else
      EXPECT_NE(refusal(file), "");
    EXPECT_LT(cpu_seconds() - start, 1);
    fs::remove(file);
  }
  rusage after{};
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 50'000);  // kB
}

TEST_F(MeshFiles, WhatIsNoRegularFileIsRefusedAtOnce) {
  for (const char* name : {"a.ply", "a.obj", "a.off", "a.stl"}) {
    const std::string file = (folder_ / name).string();
    ASSERT_EQ(mkfifo(file.c_str(), 0600), 0);
    EXPECT_THAT(refusal(file), HasSubstr("FIFO")) << name;
    fs::remove(file);
    fs::create_symlink("/dev/zero", file);
    EXPECT_THAT(refusal(file), HasSubstr("device")) << name;
  }
}

}  // namespace
}  // namespace toothprep
