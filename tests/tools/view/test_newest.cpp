// The newest value between two threads that don't wait for each other.
#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "toothprep/tools/view/newest.h"

namespace toothprep::testing {
namespace {

TEST(Newest, IsThereOnce) {
  Newest<int> newest;
  int value = -1;
  EXPECT_FALSE(newest.read(value));
  newest.write(1);
  newest.write(2);
  EXPECT_TRUE(newest.read(value));
  EXPECT_EQ(value, 2);
  EXPECT_FALSE(newest.read(value));
  EXPECT_EQ(value, 2);
  newest.write(3);
  EXPECT_TRUE(newest.read(value));
  EXPECT_EQ(value, 3);
}

TEST(Newest, IsWholeAndNeverOlderWhileAnotherThreadWrites) {
  using Value = std::array<long, 64>;
  constexpr long kLast = 200'000;
  Newest<Value> newest;
  std::jthread writer([&] {
    for (long n = 1; n <= kLast; ++n) {
      Value value;
      value.fill(n);
      newest.write(value);
    }
  });
  long seen = 0;
  Value value{};
  while (seen < kLast) {
    if (!newest.read(value)) continue;
    ASSERT_GT(value.front(), seen);
    seen = value.front();
    for (const long one : value) ASSERT_EQ(one, seen);
  }
}

}  // namespace
}  // namespace toothprep::testing
