#include "toothprep/tools/segmentation/signed_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace toothprep {

namespace {

constexpr std::uint32_t kNegative = 0, kPositive = 1, kStored = 2;

using Bytes = std::int8_t __attribute__((vector_size(16)));  // of a chunk
Bytes load(const std::uint8_t* labels) {
  Bytes bytes;
  std::memcpy(&bytes, labels, sizeof bytes);
  return bytes;
}

// Where a voxel of the chunk from v on has a neighbour with the other sign. One across the end of a row
// counts as well: a value too many at most.
template <std::size_t kChunk>
std::array<std::uint8_t, kChunk> changes_at(std::size_t v, std::size_t count,
                                            const std::array<std::size_t, 3>& strides,
                                            const std::vector<std::uint8_t>& labels,
                                            std::uint8_t inside) {
  const std::uint8_t* here = labels.data() + v;
  std::array<std::uint8_t, kChunk> changes{};
  if (v >= strides[2] && v + kChunk + strides[2] <= labels.size()) {
    const Bytes of = Bytes{} + static_cast<std::int8_t>(inside), own = load(here) == of;
    Bytes differ{};
    for (const std::size_t stride : strides)
      differ |= (own ^ (load(here - stride) == of)) | (own ^ (load(here + stride) == of));
    std::memcpy(changes.data(), &differ, kChunk);
    return changes;
  }
  const auto compare = [&](const std::uint8_t* there, std::size_t from, std::size_t to) {
    for (std::size_t n = from; n < to; ++n)
      changes[n] |= (here[n] == inside) != (there[n - from] == inside);
  };
  for (const std::size_t stride : strides) {
    const std::size_t from = v >= stride ? 0 : std::min(count, stride - v),
                      after = labels.size() - std::min(labels.size(), v + stride);
    if (from < count) compare(labels.data() + (v + from - stride), from, count);
    if (after > 0) compare(labels.data() + (v + stride), 0, std::min(count, after));
  }
  return changes;
}

}  // namespace

SignedField::SignedField(const Index3& size, const std::vector<std::uint8_t>& labels,
                         std::uint8_t inside, const ValueAt& value) {
  const auto row = static_cast<std::size_t>(size.x());
  const std::array<std::size_t, 3> strides = {1, row, row * static_cast<std::size_t>(size.y())};
  chunk_.resize((labels.size() + kChunk - 1) / kChunk);
  // work(place, first voxel, how many, where signs change) for each chunk.
  const auto for_each_chunk = [&](const auto& wanted, const auto& work) {
    tbb::parallel_for(std::size_t{0}, chunk_.size(), [&](std::size_t c) {
      if (!wanted(chunk_[c])) return;
      const std::size_t v = c * kChunk, count = std::min(kChunk, labels.size() - v);
      work(chunk_[c], v, count, changes_at<kChunk>(v, count, strides, labels, inside));
    });
  };
  for_each_chunk([](std::uint32_t) { return true; },
                 [&](std::uint32_t& place, std::size_t v, std::size_t, const auto& changes) {
                   place = changes != std::array<std::uint8_t, kChunk>{} ? kStored
                           : labels[v] == inside                         ? kPositive
                                                                         : kNegative;
                 });
  std::uint32_t end = kStored;
  for (std::uint32_t& c : chunk_)
    if (c == kStored) c = end++;
  values_.resize(end * kChunk);
  std::fill_n(values_.begin(), kChunk, -0.5f);
  std::fill_n(values_.begin() + kChunk, kChunk, 0.5f);
  for_each_chunk(
      [](std::uint32_t place) { return place >= kStored; },
      [&](std::uint32_t place, std::size_t v, std::size_t count, const auto& changes) {
        float* to = values_.data() + std::size_t{place} * kChunk;
        for (std::size_t n = 0; n < kChunk; ++n)
          to[n] = changes[n] ? value(v + n) : n < count && labels[v + n] == inside ? 0.5f : -0.5f;
      });
}

SignedField::SignedField(const Index3& size, const std::vector<float>& values) {
  Mask positive(values.size());
  for (std::size_t v = 0; v < values.size(); ++v) positive[v] = values[v] > 0;
  *this = SignedField(size, positive, 1, [&](std::size_t v) { return values[v]; });
}

RowPart SignedField::signs(std::size_t first, int count, std::uint8_t* positive) const {
  RowPart part{count, 0};
  for (int i = 0; i < count;) {
    const std::size_t v = first + static_cast<std::size_t>(i);
    const std::uint32_t place = chunk_[v / kChunk];
    const int end = std::min(count, i + static_cast<int>(kChunk - v % kChunk));
    if (place < kStored) {
      std::fill(positive + i, positive + end, static_cast<std::uint8_t>(place));
    } else {
      const float* values = values_.data() + std::size_t{place} * kChunk + v % kChunk;
      for (int n = i; n < end; ++n) positive[n] = values[n - i] > 0;
      part = {std::min(part.first, i), end};
    }
    i = end;
  }
  return part;
}

void SignedField::copy(std::size_t first, std::size_t count, float* values) const {
  for (std::size_t v = first; v < first + count;) {
    const std::size_t end = std::min(first + count, (v / kChunk + 1) * kChunk);
    const float* from = values_.data() + std::size_t{chunk_[v / kChunk]} * kChunk + v % kChunk;
    values = std::copy(from, from + (end - v), values);
    v = end;
  }
}

}  // namespace toothprep
