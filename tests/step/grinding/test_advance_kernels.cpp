// How fast elements advance must not depend on the processor.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "toothprep/step/grinding/advance_kernels.h"

namespace toothprep {
namespace {

struct Found {
  std::vector<float> advance, range, left;
  std::vector<std::int32_t> worth;
  bool operator==(const Found&) const = default;
};

// A count that is no multiple of what a vector holds.
constexpr int kCount = 1003;

using Arrays = std::vector<std::vector<float>>;

Found run(const AdvanceKernel& kernel, const Arrays& a, const FeedOfElements& feed, bool turns) {
  Found found{std::vector<float>(kCount), std::vector<float>(kCount), a[16],
              std::vector<std::int32_t>(kCount)};
  const AdvancingElements elements = {
      kCount,           a[0].data(),  a[1].data(),          a[2].data(),        a[3].data(),
      a[4].data(),      a[5].data(),  a[6].data(),          a[7].data(),        a[8].data(),
      a[9].data(),      a[10].data(), a[11].data(),         a[12].data(),       a[13].data(),
      a[14].data(),     a[15].data(), found.advance.data(), found.range.data(), found.worth.data(),
      found.left.data()};
  (turns ? kernel.turning : kernel.straight)(elements, feed);
  return found;
}

TEST(AdvanceKernels, AllGiveTheSameBits) {
  std::mt19937 random(5);
  const auto number = [&] { return static_cast<float>(random()) / 2147483648.0f - 1; };
  Arrays arrays(17, std::vector<float>(kCount));
  for (auto& array : arrays)
    for (float& value : array) value = number();
  const FeedOfElements feed = {number(), number(), number(), 1, number(), number(), number()};
  // Every second one was looked at along its own velocity.
  for (std::size_t i = 0; i < kCount; i += 2) {
    const float x = arrays[0][i], y = arrays[1][i], z = arrays[2][i];
    const float ux = feed.vx + feed.oy * z - feed.oz * y, uy = feed.vy + feed.oz * x - feed.ox * z,
                uz = feed.vz + feed.ox * y - feed.oy * x;
    const float speed = std::hypot(ux, uy, uz);
    arrays[13][i] = ux / speed, arrays[14][i] = uy / speed, arrays[15][i] = uz / speed;
  }
  const std::vector<AdvanceKernel> kernels = advance_kernels();
  for (const bool turns : {false, true}) {
    const Found first = run(kernels.front(), arrays, feed, turns);
    for (const AdvanceKernel& kernel : kernels)
      EXPECT_EQ(run(kernel, arrays, feed, turns), first) << kernel.name;
    EXPECT_EQ(run(fastest_advance_kernel(), arrays, feed, turns), first);
    int worth = 0, stand = 0;
    for (std::size_t i = 0; i < kCount; ++i)
      worth += first.worth[i], stand += first.left[i] == arrays[16][i] ? 1 : 0;
    EXPECT_GT(worth, kCount / 4);
    EXPECT_LT(worth, kCount);
    EXPECT_GE(stand, turns ? kCount / 2 : kCount);
    EXPECT_EQ(stand < kCount, turns);
  }
}

}  // namespace
}  // namespace toothprep
