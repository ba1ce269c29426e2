#include "toothprep/tools/display/duration_counts.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kShortest = 1e-6;  // s, the end of the first bin
constexpr double kRatio = 1.02;     // of one bin's end to the next's

}  // namespace

void DurationCounts::add(double seconds) {
  const double bin =
      std::ceil(std::log(std::max(seconds, kShortest) / kShortest) / std::log(kRatio));
  ++bins_[static_cast<std::size_t>(std::min(bin, static_cast<double>(kBins - 1)))];
  ++count_;
  largest_ = std::max(largest_, seconds);
}

double DurationCounts::quantile(double q) const {
  if (count_ == 0) return 0;
  const double wanted = q * static_cast<double>(count_);
  std::uint64_t below = 0;
  for (int bin = 0; bin < kBins; ++bin) {
    below += bins_[static_cast<std::size_t>(bin)];
    if (below > 0 && static_cast<double>(below) >= wanted)
      return std::min(largest_, kShortest * std::pow(kRatio, bin));
  }
  return largest_;
}

}  // namespace toothprep
