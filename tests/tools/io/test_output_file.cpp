#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/output_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;

class OutputFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) /
              ("toothprep_output_" + std::to_string(getpid()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }
  std::size_t entries() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }
  static void write(const std::string& path, const std::string& text) {
    std::ofstream(path) << text;
  }
  static std::string read(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }
  fs::path folder_;
};

TEST_F(OutputFileTest, AppearsOnlyAtCommit) {
  OutputFile out(at("a.txt"), false);
  write(out.temporary(), "new");
  EXPECT_FALSE(fs::exists(at("a.txt")));
  EXPECT_EQ(fs::path(out.temporary()).extension(), ".txt");
  EXPECT_EQ(fs::path(out.temporary()).parent_path(), folder_);  // a rename, never a copy
  out.commit();
  EXPECT_EQ(read(at("a.txt")), "new");
  EXPECT_EQ(entries(), 1u);
}

TEST_F(OutputFileTest, LeavesNothingBehindWhenTheWorkFails) {
  try {
    OutputFile out(at("a.txt"), false);
    write(out.temporary(), "half");
    throw Error("the work failed");
  } catch (const Error&) {
  }
  EXPECT_EQ(entries(), 0u);
}

TEST_F(OutputFileTest, ReplacesAnExistingFileOnlyWithForceAndOnlyAtCommit) {
  write(at("a.txt"), "old");
  EXPECT_THROW(OutputFile(at("a.txt"), false), Error);
  EXPECT_EQ(read(at("a.txt")), "old");
  {
    OutputFile out(at("a.txt"), true);
    write(out.temporary(), "half");
  }  // not committed: the old one is untouched
  EXPECT_EQ(read(at("a.txt")), "old");
  OutputFile out(at("a.txt"), true);
  write(out.temporary(), "new");
  out.commit();
  EXPECT_EQ(read(at("a.txt")), "new");
}

TEST_F(OutputFileTest, RefusesAMissingFolderAFolderInItsPlaceAndAnEmptyName) {
  EXPECT_THROW(OutputFile(at("none/a.txt"), false), Error);
  fs::create_directory(at("sub"));
  EXPECT_THROW(OutputFile(at("sub"), true), Error);
  EXPECT_THROW(OutputFile("", false), Error);
  write(at("file"), "");
  EXPECT_THROW(OutputFile(at("file"), true, true), Error);
}

TEST_F(OutputFileTest, AFolderIsReplacedWhole) {
  fs::create_directory(at("d"));
  write(at("d/old"), "1");
  OutputFile out(at("d"), true, true);
  EXPECT_TRUE(fs::is_directory(out.temporary()));
  write(out.temporary() + "/new", "2");
  out.commit();
  EXPECT_FALSE(fs::exists(at("d/old")));
  EXPECT_EQ(read(at("d/new")), "2");
  EXPECT_EQ(entries(), 1u);
}

TEST_F(OutputFileTest, AFolderWithFoldersIsReplacedOnlyWithItsMarkerAndNothingDeeper) {
  fs::create_directories(at("d/part"));
  write(at("d/part/old"), "1");
  EXPECT_THROW(OutputFile(at("d"), true, true), Error);
  EXPECT_THROW(OutputFile(at("d"), true, true, "table.json"), Error);  // no marker in it
  write(at("d/table.json"), "{}");
  {
    OutputFile out(at("d"), true, true, "table.json");
    out.commit();
  }
  EXPECT_FALSE(fs::exists(at("d/part")));
  fs::create_directories(at("d/part/of/a/project"));
  write(at("d/table.json"), "{}");
  EXPECT_THROW(OutputFile(at("d"), true, true, "table.json"), Error);
}

}  // namespace
}  // namespace toothprep
