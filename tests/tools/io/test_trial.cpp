// Work tried in a child process.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <filesystem>
#include <iterator>
#include <stdexcept>

#include "toothprep/tools/io/trial.h"

namespace toothprep {
namespace {

constexpr std::size_t kMemory = std::size_t{1} << 32;

TEST(Trial, GivesTheTextOfWhatWasThrownAndNothingOtherwise) {
  EXPECT_FALSE(failure_in_trial([] {}, 5, kMemory));
  EXPECT_EQ(failure_in_trial([] { throw std::runtime_error("no"); }, 5, kMemory)->text, "no");
  EXPECT_EQ(failure_in_trial([] { std::abort(); }, 5, kMemory)->text, "");
}

TEST(Trial, AnInputErrorComesThroughWithItsParts) {
  const auto failure = failure_in_trial(
      [] { throw InputError("a: b.h5", "", "is odd; very", "mend it"); }, 5, kMemory);
  ASSERT_TRUE(failure && failure->input);
  EXPECT_EQ(failure->input->file(), "a: b.h5");
  EXPECT_EQ(failure->input->place(), "");
  EXPECT_EQ(failure->input->condition(), "is odd; very");
  EXPECT_EQ(failure->input->remedy(), "mend it");
  EXPECT_STREQ(failure->input->what(), "a: b.h5: is odd; very; mend it");
  EXPECT_FALSE(failure_in_trial([] { throw std::runtime_error("no"); }, 5, kMemory)->input);
}

std::ptrdiff_t threads_of_this_process() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/task"),
                       std::filesystem::directory_iterator());
}

// Forked while one of TBB's threads held a lock, a child waited for ever: one in a hundred on a
// machine with five times as much to do as it has cores, reported as a damaged file.
TEST(Trial, NoWorkerThreadRunsWhenTheChildIsMade) {
  const std::ptrdiff_t before = threads_of_this_process();
  const auto work = [] {
    std::atomic<int> sum = 0;
    tbb::parallel_for(0, 1000, [&sum](int i) {
      for (int k = 0; k < 1000; ++k) sum += i;
    });
  };
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  work();
  ASSERT_GT(threads_of_this_process(), before);
  EXPECT_FALSE(failure_in_trial(work, 10, kMemory));
  EXPECT_EQ(threads_of_this_process(), before);
  work();
}

}  // namespace
}  // namespace toothprep
