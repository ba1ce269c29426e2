#include "toothprep/tools/segmentation/near_distance.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

// Squares are bytes or words.

// Squared distances along x; `far` where they are more than the reach.
template <class Square>
void along_x(const std::uint8_t* mask, int n, int reach, Square far, Square* out) {
  std::fill(out, out + n, far);
  int last = -1;  // the last voxel of the mask
  for (int i = 0; i < n; ++i) {
    const auto* next =
        static_cast<const std::uint8_t*>(std::memchr(mask + i, 1, static_cast<std::size_t>(n - i)));
    const int at = next ? static_cast<int>(next - mask) : n + reach;  // beyond all reach
    for (int k = last < 0 ? n : last + 1; k < std::min({at, last + reach + 1, n}); ++k)
      out[k] = static_cast<Square>((k - last) * (k - last));
    for (int k = std::max(last + 1, at - reach); k < std::min(at, n); ++k)
      out[k] = std::min(out[k], static_cast<Square>((at - k) * (at - k)));
    if (at >= n) return;
    for (i = at; i < n && mask[i] == 1; ++i) out[i] = 0;
    last = --i;
  }
}

// out row = min over the rows d = -reach .. reach beside it of (row + d^2). `rows` holds them one
// after another.
template <class Square>
void across(const std::vector<Square>& rows, int count, std::size_t length, int reach, int at,
            Square* out) {
  const Square* own = rows.data() + static_cast<std::size_t>(at) * length;
  std::copy(own, own + length, out);
  for (int other = std::max(0, at - reach); other <= std::min(count - 1, at + reach); ++other) {
    const auto square = static_cast<Square>((other - at) * (other - at));
    const auto most = static_cast<Square>(std::numeric_limits<Square>::max() - square);
    const Square* in = rows.data() + static_cast<std::size_t>(other) * length;
    for (std::size_t i = 0; i < length; ++i) {
      const auto sum = static_cast<Square>(std::min(in[i], most) + square);
      out[i] = std::min(out[i], sum);
    }
  }
}

// One pass over rows that lie `stride` apart; rows without anything near are left alone.
template <class Square>
void pass(Square* first, int count, std::size_t stride, std::size_t length, int reach, Square far) {
  std::vector<Square> rows(static_cast<std::size_t>(count) * length);
  std::vector<int> before(static_cast<std::size_t>(count) + 1,
                          0);  // rows with something, up to here
  for (int r = 0; r < count; ++r) {
    const Square* in = first + static_cast<std::size_t>(r) * stride;
    std::copy(in, in + length, rows.data() + static_cast<std::size_t>(r) * length);
    Square least = far;
    for (std::size_t i = 0; i < length; ++i) least = std::min(least, in[i]);
    before[static_cast<std::size_t>(r) + 1] = before[static_cast<std::size_t>(r)] + (least < far);
  }
  for (int r = 0; r < count; ++r) {
    const auto low = static_cast<std::size_t>(std::max(0, r - reach)),
               high = static_cast<std::size_t>(std::min(count, r + reach + 1));
    if (before[high] == before[low]) continue;
    across(rows, count, length, reach, r, first + static_cast<std::size_t>(r) * stride);
  }
}

template <class Square>
std::unique_ptr<Square[]> squares_to(const Index3& size, const NearDistance::MaskRow& mask,
                                     int reach) {
  const int nx = size.x(), ny = size.y(), nz = size.z();
  const auto row = static_cast<std::size_t>(nx), plane = row * static_cast<std::size_t>(ny);
  constexpr Square far = std::numeric_limits<Square>::max();
  auto squares = std::make_unique_for_overwrite<Square[]>(plane * static_cast<std::size_t>(nz));
  tbb::parallel_for(0, nz, [&](int k) {
    Square* first = squares.get() + static_cast<std::size_t>(k) * plane;
    Mask scratch(row);
    for (int j = 0; j < ny; ++j)
      along_x(mask(j, k, scratch.data()), nx, reach, far,
              first + static_cast<std::size_t>(j) * row);
    with_wide_vectors([&] { pass(first, ny, row, row, reach, far); });
  });
  tbb::parallel_for(0, ny, [&](int j) {
    Square* rows = squares.get() + static_cast<std::size_t>(j) * row;
    with_wide_vectors([&] { pass(rows, nz, plane, row, reach, far); });
  });
  return squares;
}

}  // namespace

NearDistance::NearDistance(const Index3& size, const Mask& mask, int reach)
    : NearDistance(
          size,
          [&](int j, int k, std::uint8_t* /*scratch*/) {
            const auto row = static_cast<std::size_t>(k) * static_cast<std::size_t>(size.y()) +
                             static_cast<std::size_t>(j);
            return mask.data() + row * static_cast<std::size_t>(size.x());
          },
          reach) {}

NearDistance::NearDistance(const Index3& size, const MaskRow& row, int reach) {
  reach = std::clamp(reach, 1, kMostReach);
  most_ = reach * reach;
  if (most_ < std::numeric_limits<std::uint8_t>::max())
    bytes_ = squares_to<std::uint8_t>(size, row, reach);
  else
    words_ = squares_to<std::uint16_t>(size, row, reach);
}

namespace {

void keep_in(const std::uint8_t* in, std::size_t count, std::uint8_t* kept) {
  for (std::size_t i = 0; i < count; ++i) kept[i] &= in[i];
}

// The voxels of the mask that have one outside of it beside them, across a face, an edge or a corner: a row
// of them.
void outermost_in_row(const Index3& size, const Mask& mask, int j, int k, std::uint8_t* out) {
  const auto row = static_cast<std::size_t>(size.x()),
             plane = row * static_cast<std::size_t>(size.y());
  // Of the up to nine rows around: all in the mask; so is what is beyond its ends.
  Mask full(row + 2, 1);
  for (int z = std::max(0, k - 1); z <= std::min(size.z() - 1, k + 1); ++z)
    for (int y = std::max(0, j - 1); y <= std::min(size.y() - 1, j + 1); ++y)
      keep_in(mask.data() + static_cast<std::size_t>(z) * plane + static_cast<std::size_t>(y) * row,
              row, full.data() + 1);
  const std::uint8_t *in = mask.data() + static_cast<std::size_t>(k) * plane +
                           static_cast<std::size_t>(j) * row,
                     *of = full.data() + 1;
  for (std::size_t i = 0, n = row; i < n; ++i) out[i] = in[i] & ~(of[i - 1] & of[i] & of[i + 1]);
}

}  // namespace

SurfaceDepth::SurfaceDepth(const Index3& size, const Mask& mask, int reach)
    : voxels_(mask.size()), chunk_((mask.size() + kChunk - 1) / kChunk) {
  const NearDistance outermost(
      size,
      [&](int j, int k, std::uint8_t* scratch) {
        outermost_in_row(size, mask, j, k, scratch);
        return scratch;
      },
      reach);
  const int far = outermost.most_ + 1, codes = far + 1;  // on either side
  for (const float side : {1.0f, -1.0f})
    for (int squared = 0; squared < codes; ++squared)
      depth_.push_back(0.5f + side * (squared == far ? std::numeric_limits<float>::infinity()
                                                     : std::sqrt(static_cast<float>(squared))));
  const auto code_at = [&](std::size_t v) {
    return static_cast<std::uint16_t>(std::min(outermost.squared(v), far) + (mask[v] ? 0 : codes));
  };
  tbb::parallel_for(std::size_t{0}, chunk_.size(), [&](std::size_t c) {
    const std::size_t first = c * kChunk, end = std::min(voxels_, first + kChunk);
    const std::uint8_t inside = mask[first];
    bool all_far = true;
    for (std::size_t v = first; v < end; ++v)
      all_far &= outermost.squared(v) >= far && mask[v] == inside;
    chunk_[c] = !all_far ? kNear : inside ? kFarInside : kFarOutside;
  });
  std::uint32_t count = kNear;
  for (std::uint32_t& c : chunk_)
    if (c == kNear) c = count++;
  code_.assign(count * kChunk, static_cast<std::uint16_t>(far + codes));
  std::fill_n(code_.begin() + kFarInside * kChunk, kChunk, static_cast<std::uint16_t>(far));
  for_each_chunk([&](std::size_t first, std::size_t end, bool all_far) {
    if (all_far) return;
    std::uint16_t* code = code_.data() + chunk_[first / kChunk] * kChunk;
    for (std::size_t v = first; v < end; ++v) code[v - first] = code_at(v);
  });
}

void SurfaceDepth::above(float least, std::size_t first, std::size_t end, std::uint8_t* out) const {
  const auto is_above = above(least);
  while (first < end) {
    const std::size_t next = std::min(end, (first / kChunk + 1) * kChunk);
    if (chunk_[first / kChunk] < kNear)
      std::fill(out, out + (next - first), static_cast<std::uint8_t>(is_above(first)));
    else
      for (std::size_t v = first; v < next; ++v) out[v - first] = is_above(v);
    out += next - first;
    first = next;
  }
}

void SurfaceDepth::keep(float outside, float inside) {
  std::uint32_t count = kNear;
  for (std::uint32_t& c : chunk_) {
    if (c < kNear) continue;
    const std::uint16_t* codes = code_.data() + c * kChunk;
    const auto all = [&](const auto& far) {
      return std::all_of(codes, codes + kChunk, [&](std::uint16_t d) { return far(depth_[d]); });
    };
    if (all([&](float d) { return d <= -outside; })) {
      c = kFarOutside;
    } else if (all([&](float d) { return d >= inside; })) {
      c = kFarInside;
    } else {
      std::copy_n(codes, kChunk, code_.data() + count * kChunk);
      c = count++;
    }
  }
  code_.resize(count * kChunk);
  code_.shrink_to_fit();
}

}  // namespace toothprep
