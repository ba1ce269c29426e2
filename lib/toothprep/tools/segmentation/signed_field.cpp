#include "toothprep/tools/segmentation/signed_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>

namespace toothprep {

namespace {

constexpr int kPlanes = 16;  // so that a chunk never lies in two parts
constexpr std::uint32_t kNegative = 0, kPositive = 1, kStored = 2;

}  // namespace

// The planes first .. first + kPlanes - 1: which chunks are stored, and their values.
void SignedField::add_planes(const Index3& size, const FillPlane& fill, int first,
                             std::vector<float>& stored) {
  const auto row = static_cast<std::size_t>(size.x()),
             plane = row * static_cast<std::size_t>(size.y());
  const int low = std::max(0, first - 1), last = std::min(size.z(), first + kPlanes),
            high = std::min(size.z(), last + 1);
  std::vector<float> values(static_cast<std::size_t>(high - low) * plane);
  for (int k = low; k < high; ++k)
    fill(k, values.data() + static_cast<std::size_t>(k - low) * plane);
  const std::array<std::size_t, 3> strides = {1, row, plane};
  // A neighbour across the end of a row stores a chunk too many at most.
  const auto changes = [&](std::size_t v) {
    const bool positive = values[v] > 0;
    return std::any_of(strides.begin(), strides.end(), [&](std::size_t stride) {
      return (v >= stride && (values[v - stride] > 0) != positive) ||
             (v + stride < values.size() && (values[v + stride] > 0) != positive);
    });
  };
  const std::size_t begin = static_cast<std::size_t>(first - low) * plane,
                    end = static_cast<std::size_t>(last - low) * plane;
  std::size_t c = static_cast<std::size_t>(first) * plane / kChunk;
  for (std::size_t v = begin; v < end; v += kChunk, ++c) {
    const std::size_t chunk_end = std::min(end, v + kChunk);
    chunk_[c] = values[v] > 0 ? kPositive : kNegative;
    for (std::size_t u = v; u < chunk_end && chunk_[c] != kStored; ++u)
      if (changes(u)) chunk_[c] = kStored;
    if (chunk_[c] != kStored) continue;
    stored.insert(stored.end(), values.data() + v, values.data() + chunk_end);
    stored.resize((stored.size() + kChunk - 1) / kChunk * kChunk);
  }
}

SignedField::SignedField(const Index3& size, const FillPlane& fill) {
  const std::size_t n = static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()) *
                        static_cast<std::size_t>(size.z());
  chunk_.resize((n + kChunk - 1) / kChunk);
  std::vector<std::vector<float>> stored(
      static_cast<std::size_t>((size.z() + kPlanes - 1) / kPlanes));
  tbb::parallel_for(std::size_t{0}, stored.size(), [&](std::size_t part) {
    add_planes(size, fill, static_cast<int>(part) * kPlanes, stored[part]);
  });
  std::uint32_t count = kStored;
  for (std::uint32_t& c : chunk_)
    if (c == kStored) c = count++;
  values_.reserve(count * kChunk);
  values_.resize(kChunk, -0.5f);
  values_.resize(2 * kChunk, 0.5f);
  for (std::vector<float>& part : stored) {
    values_.insert(values_.end(), part.begin(), part.end());
    std::vector<float>().swap(part);
  }
}

SignedField::SignedField(const Index3& size, const std::vector<float>& values)
    : SignedField(size, [&](int k, float* plane) {
        const std::size_t area =
            static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y());
        std::copy_n(values.data() + static_cast<std::size_t>(k) * area, area, plane);
      }) {}

void SignedField::copy(std::size_t first, std::size_t count, float* values) const {
  for (std::size_t v = first; v < first + count;) {
    const std::size_t end = std::min(first + count, (v / kChunk + 1) * kChunk);
    const float* from = values_.data() + std::size_t{chunk_[v / kChunk]} * kChunk + v % kChunk;
    values = std::copy(from, from + (end - v), values);
    v = end;
  }
}

}  // namespace toothprep
