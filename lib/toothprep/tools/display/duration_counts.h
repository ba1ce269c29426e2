// How long things took, counted in bins of 2 %: quantiles of any number of durations in 8 KB.
#pragma once

#include <array>
#include <cstdint>

namespace toothprep {

class DurationCounts {
 public:
  void add(double seconds);

  std::uint64_t count() const { return count_; }
  // The duration that the part q (0 .. 1) of all doesn't exceed, to 2 %; 0 if there is none.
  double quantile(double q) const;
  double largest() const { return largest_; }  // exact

 private:
  static constexpr int kBins = 1024;  // from 1 µs to 600 s; what is shorter or longer, in the ends
  std::array<std::uint64_t, kBins> bins_{};
  std::uint64_t count_ = 0;
  double largest_ = 0;
};

}  // namespace toothprep
