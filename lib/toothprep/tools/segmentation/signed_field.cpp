#include "toothprep/tools/segmentation/signed_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace toothprep {

namespace {

constexpr int kPlanesOfPart = 16;  // so that a chunk never lies in two parts
constexpr std::uint32_t kNegative = 0, kPositive = 1, kStored = 2;

using Bytes = std::int8_t __attribute__((vector_size(16)));  // of a chunk
Bytes load(const std::uint8_t* labels) {
  Bytes bytes;
  std::memcpy(&bytes, labels, sizeof bytes);
  return bytes;
}

}  // namespace

// The planes first .. first + kPlanesOfPart - 1: which chunks are stored, and their values.
void SignedField::add_planes(const Index3& size, const std::vector<std::uint8_t>& labels,
                             std::uint8_t inside, const ValueAt& value, int first,
                             std::vector<float>& stored) {
  const auto row = static_cast<std::size_t>(size.x()),
             plane = row * static_cast<std::size_t>(size.y());
  const std::array<std::size_t, 3> strides = {1, row, plane};
  const std::size_t end =
      static_cast<std::size_t>(std::min(size.z(), first + kPlanesOfPart)) * plane;
  for (std::size_t v = static_cast<std::size_t>(first) * plane; v < end; v += kChunk) {
    const std::size_t count = std::min(kChunk, end - v);
    const std::uint8_t* here = labels.data() + v;
    // Where a neighbour has the other sign. One across the end of a row counts as well: a value too
    // many at most.
    std::array<std::uint8_t, kChunk> changes{};
    const auto compare = [&](const std::uint8_t* there, std::size_t from, std::size_t to) {
      for (std::size_t n = from; n < to; ++n)
        changes[n] |= (here[n] == inside) != (there[n - from] == inside);
    };
    if (v >= plane && v + kChunk + plane <= labels.size() && count == kChunk) {
      const Bytes of = Bytes{} + static_cast<std::int8_t>(inside), own = load(here) == of;
      Bytes differ{};
      for (const std::size_t stride : strides)
        differ |= (own ^ (load(here - stride) == of)) | (own ^ (load(here + stride) == of));
      std::memcpy(changes.data(), &differ, kChunk);
    } else {
      for (const std::size_t stride : strides) {
        const std::size_t from = v >= stride ? 0 : std::min(count, stride - v),
                          after = labels.size() - std::min(labels.size(), v + stride);
        if (from < count) compare(labels.data() + (v + from - stride), from, count);
        if (after > 0) compare(labels.data() + (v + stride), 0, std::min(count, after));
      }
    }
    std::uint32_t& place = chunk_[v / kChunk];
    place = *here == inside ? kPositive : kNegative;
    if (changes == std::array<std::uint8_t, kChunk>{}) continue;
    place = kStored;
    for (std::size_t n = 0; n < kChunk; ++n)
      stored.push_back(changes[n] ? value(v + n) : n < count && here[n] == inside ? 0.5f : -0.5f);
  }
}

SignedField::SignedField(const Index3& size, const std::vector<std::uint8_t>& labels,
                         std::uint8_t inside, const ValueAt& value) {
  chunk_.resize((labels.size() + kChunk - 1) / kChunk);
  std::vector<std::vector<float>> stored(
      static_cast<std::size_t>((size.z() + kPlanesOfPart - 1) / kPlanesOfPart));
  tbb::parallel_for(std::size_t{0}, stored.size(), [&](std::size_t part) {
    add_planes(size, labels, inside, value, static_cast<int>(part) * kPlanesOfPart, stored[part]);
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
