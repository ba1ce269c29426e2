// Who reads a file first: a child process, or nobody.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {
namespace {

// Whether `work` made a child process: the pages that ended children have touched.
bool makes_a_child(const std::function<void()>& work) {
  const auto pages = [] {
    rusage usage{};
    getrusage(RUSAGE_CHILDREN, &usage);
    return usage.ru_minflt;
  };
  const long before = pages();
  work();
  return pages() != before;
}

class ReadPolicies : public testing::Test {
 protected:
  ReadPolicies() {
    std::filesystem::create_directories(folder_);
    Trace trace;
    trace.rows.resize(3);
    for (int i = 0; i < 3; ++i) trace.rows[i].handle.time = i * 1e-3;
    write_trace(trace, path("trace.h5"));
    BlockOptions small;
    small.size = Vec3(2, 2, 2);
    small.enamel = 1;
    write_tooth(make_block(small), path("ours.vdb"));
    std::ifstream in(path("ours.vdb"), std::ios::binary);
    std::string bytes((std::istreambuf_iterator<char>(in)), {});
    std::ofstream(path("short.vdb"), std::ios::binary) << bytes.substr(0, bytes.size() - 100);
    // Another program's: a random id (UUID version 4) in place of the one that is a checksum.
    std::size_t at = 0;
    while (bytes[at + 8] != '-' || bytes[at + 13] != '-' || bytes[at + 18] != '-') ++at;
    bytes[at + 14] = '4';
    std::ofstream(path("foreign.vdb"), std::ios::binary) << bytes;
    std::ofstream(path("no.h5")) << "no HDF5";
  }
  ~ReadPolicies() override { std::filesystem::remove_all(folder_); }
  std::string path(const char* name) const { return (folder_ / name).string(); }

 private:
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("toothprep-policy-" + std::to_string(getpid()));
};

TEST_F(ReadPolicies, DirectlyNoProcessIsMade) {
  const auto direct = ReadPolicy::kDirect;
  EXPECT_FALSE(makes_a_child([&] {
    EXPECT_EQ(read_trace(path("trace.h5"), direct).rows.size(), 3u);
    EXPECT_EQ(read_h5_trajectory(path("trace.h5"), direct).samples.size(), 3u);
    EXPECT_TRUE(is_trace_file(path("trace.h5"), direct));
    EXPECT_FALSE(is_session_file(path("trace.h5"), direct));
    EXPECT_GT(read_tooth(path("ours.vdb"), direct).solid.bricks_stored(), 0u);
    EXPECT_GT(read_tooth(path("foreign.vdb"), direct).solid.bricks_stored(), 0u);
    EXPECT_THROW(static_cast<void>(read_tooth(path("short.vdb"), direct)), InputError);
    EXPECT_THROW(static_cast<void>(read_session(path("no.h5"), direct)), InputError);
  }));
}

TEST_F(ReadPolicies, UnlessAskedOtherwiseAChildReadsFirstWhatNobodyVouchesFor) {
  EXPECT_TRUE(makes_a_child([&] { EXPECT_EQ(read_trace(path("trace.h5")).rows.size(), 3u); }));
  EXPECT_TRUE(makes_a_child([&] { static_cast<void>(read_tooth(path("foreign.vdb"))); }));
  EXPECT_FALSE(
      makes_a_child([&] { static_cast<void>(read_tooth(path("ours.vdb"))); }));  // by its checksum
}

// What a child found reads as if it had been found here.
TEST_F(ReadPolicies, TheErrorsPartsAreTheSameEitherWay) {
  for (const char* name : {"no.h5", "missing.h5"}) try {
      static_cast<void>(read_trace(path(name), ReadPolicy::kDirect));
      FAIL();
    } catch (const InputError& direct) {
      try {
        static_cast<void>(read_trace(path(name), ReadPolicy::kTrial));
        FAIL();
      } catch (const InputError& trial) {
        EXPECT_EQ(trial.file(), direct.file());
        EXPECT_EQ(trial.place(), direct.place());
        EXPECT_EQ(trial.condition(), direct.condition());
        EXPECT_EQ(trial.remedy(), direct.remedy());
        EXPECT_EQ(trial.remedy().empty(), std::string(name) == "missing.h5");
      }
    }
}

}  // namespace
}  // namespace toothprep
