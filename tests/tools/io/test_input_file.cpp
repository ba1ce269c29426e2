#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "../../support/cpu_time.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/large_file.h"
#include "toothprep/tools/io/memory_limit.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class InputFileTest : public ::testing::Test {
 protected:
  InputFileTest()
      : folder_(fs::temp_directory_path() / ("toothprep_input_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~InputFileTest() override { fs::remove_all(folder_); }
  std::string refusal(const std::string& path) {
    try {
      InputFile file(path);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  }
  fs::path folder_;
};

TEST_F(InputFileTest, KnowsItsSizeAndReadsWhatIsThere) {
  const std::string path = (folder_ / "digits").string();
  std::ofstream(path) << "0123456789";
  const InputFile file(path);
  EXPECT_EQ(file.size(), 10u);
  char bytes[8] = {};
  EXPECT_EQ(file.read(7, 8, bytes), 3u);  // to the end
  EXPECT_STREQ(bytes, "789");
  EXPECT_EQ(bytes_of_file(path), "0123456789");
  EXPECT_THROW(bytes_of_file(path, 9), InputError);
}

TEST_F(InputFileTest, OfALargeFileThePiecesComeInOrder) {
  const std::string path = (folder_ / "large").string();
  std::string content((std::size_t{5} << 21) + 5, '\0');  // two pieces and a half
  for (std::size_t i = 0; i < content.size(); ++i)
    content[i] = static_cast<char>(i * 2654435761u >> 24);
  std::ofstream(path, std::ios::binary) << content;
  std::string joined;
  const FileBytes bytes = large_file(path, content.size(), [&](std::span<const char> piece) {
    joined.append(piece.begin(), piece.end());
  });
  EXPECT_TRUE(joined == content);
  EXPECT_TRUE(std::equal(content.begin(), content.end(), bytes.all().begin(), bytes.all().end()));
  const auto ignore = [](std::span<const char>) {};
  EXPECT_THROW(large_file(path, content.size() - 1, ignore), InputError);
  EXPECT_THROW(large_file(path, content.size(), [](std::span<const char>) { throw Error("no"); }),
               Error);
  std::ofstream(path, std::ios::trunc).close();
  EXPECT_EQ(large_file(path, 0, ignore).size, 0u);
}

TEST_F(InputFileTest, RefusesAtOnceWhatWouldBlockOrNeverEnd) {
  const std::string fifo = (folder_ / "fifo").string(), link = (folder_ / "link").string();
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  fs::create_symlink("/dev/zero", link);
  const double start = cpu_seconds();
  EXPECT_THAT(refusal(fifo), HasSubstr("is a FIFO or pipe, not a regular file"));
  EXPECT_THAT(refusal("/dev/zero"), HasSubstr("is a device, not a regular file"));
  EXPECT_THAT(refusal(link), HasSubstr("is a device, not a regular file"));
  EXPECT_THAT(refusal(folder_.string()), HasSubstr("is a folder, not a regular file"));
  EXPECT_THAT(refusal((folder_ / "absent").string()), HasSubstr("does not exist"));
  EXPECT_LT(cpu_seconds() - start, 1);
}

TEST(MemoryLimit, FollowsTheLimitOfTheAddressSpace) {
#if defined(TOOTHPREP_SANITIZED)
  GTEST_SKIP() << "the sanitizer's own address space is beyond any limit";
#endif
  const std::uint64_t before = available_memory();
  EXPECT_GT(before, std::uint64_t{1} << 26);
  rlimit old{};
  ASSERT_EQ(getrlimit(RLIMIT_AS, &old), 0);
  const rlimit small{std::uint64_t{1} << 31, old.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_AS, &small), 0);
  const std::uint64_t within = available_memory();
  ASSERT_EQ(setrlimit(RLIMIT_AS, &old), 0);
  EXPECT_LT(within, std::uint64_t{1} << 31);
}

TEST(MemoryLimit, SaysBytesInDecimalUnits) {
  EXPECT_EQ(size_text(1.94e9), "1.9 GB");
  EXPECT_EQ(size_text(35.2e6), "35 MB");
  EXPECT_EQ(size_text(999.9e6), "1.0 GB");
  EXPECT_EQ(size_text(12.4e9), "12 GB");
}

}  // namespace
}  // namespace toothprep
