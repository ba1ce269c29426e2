#include "toothprep/tools/segmentation/near_distance.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

using Squares = std::vector<std::uint16_t>;

// Squared distances along x; `far` where they are more than the reach.
void along_x(const std::uint8_t* mask, int n, int reach, std::uint16_t far, std::uint16_t* out) {
  std::fill(out, out + n, far);
  int last = -1;  // the last voxel of the mask
  for (int i = 0; i < n; ++i) {
    const auto* next =
        static_cast<const std::uint8_t*>(std::memchr(mask + i, 1, static_cast<std::size_t>(n - i)));
    const int at = next ? static_cast<int>(next - mask) : n + reach;  // beyond all reach
    for (int k = last < 0 ? n : last + 1; k < std::min({at, last + reach + 1, n}); ++k)
      out[k] = static_cast<std::uint16_t>((k - last) * (k - last));
    for (int k = std::max(last + 1, at - reach); k < std::min(at, n); ++k)
      out[k] = std::min(out[k], static_cast<std::uint16_t>((at - k) * (at - k)));
    if (at >= n) return;
    for (i = at; i < n && mask[i] == 1; ++i) out[i] = 0;
    last = --i;
  }
}

// out row = min over the rows d = -reach .. reach beside it of (row + d^2). `rows` holds them one
// after another.
void across(const Squares& rows, int count, int row_length, int reach, int at, std::uint16_t* out) {
  const auto length = static_cast<std::size_t>(row_length);
  const std::uint16_t* own = rows.data() + static_cast<std::size_t>(at) * length;
  std::copy(own, own + length, out);
  for (int other = std::max(0, at - reach); other <= std::min(count - 1, at + reach); ++other) {
    const auto square = static_cast<std::uint16_t>((other - at) * (other - at));
    const std::uint16_t* in = rows.data() + static_cast<std::size_t>(other) * length;
    for (std::size_t i = 0; i < length; ++i) {
      const auto sum = static_cast<std::uint16_t>(in[i] + square);
      out[i] = std::min(out[i], sum);
    }
  }
}

// One pass over rows that lie `stride` apart; rows without anything near are left alone.
void pass(std::uint16_t* first, int count, std::size_t stride, int row_length, int reach,
          std::uint16_t far) {
  const auto length = static_cast<std::size_t>(row_length);
  Squares rows(static_cast<std::size_t>(count) * length);
  std::vector<int> before(static_cast<std::size_t>(count) + 1,
                          0);  // rows with something, up to here
  for (int r = 0; r < count; ++r) {
    const std::uint16_t* in = first + static_cast<std::size_t>(r) * stride;
    std::copy(in, in + length, rows.data() + static_cast<std::size_t>(r) * length);
    const bool any = std::any_of(in, in + length, [far](std::uint16_t d) { return d < far; });
    before[static_cast<std::size_t>(r) + 1] = before[static_cast<std::size_t>(r)] + any;
  }
  for (int r = 0; r < count; ++r) {
    const auto low = static_cast<std::size_t>(std::max(0, r - reach)),
               high = static_cast<std::size_t>(std::min(count, r + reach + 1));
    if (before[high] == before[low]) continue;
    across(rows, count, row_length, reach, r, first + static_cast<std::size_t>(r) * stride);
  }
}

}  // namespace

NearDistance::NearDistance(const Index3& size, const Mask& mask, int reach)
    : squared_(mask.size()) {
  reach = std::clamp(reach, 1, kMostReach);
  most_ = static_cast<std::uint16_t>(reach * reach);
  const auto far = static_cast<std::uint16_t>(0xFFFF - most_);  // far + reach^2 fits
  const int nx = size.x(), ny = size.y(), nz = size.z();
  const auto row = static_cast<std::size_t>(nx), plane = row * static_cast<std::size_t>(ny);
  tbb::parallel_for(0, nz, [&](int k) {
    const std::size_t o = static_cast<std::size_t>(k) * plane;
    for (int j = 0; j < ny; ++j)
      along_x(mask.data() + o + static_cast<std::size_t>(j) * row, nx, reach, far,
              squared_.data() + o + static_cast<std::size_t>(j) * row);
    with_wide_vectors([&] { pass(squared_.data() + o, ny, row, nx, reach, far); });
  });
  tbb::parallel_for(0, ny, [&](int j) {
    std::uint16_t* rows = squared_.data() + static_cast<std::size_t>(j) * row;
    with_wide_vectors([&] { pass(rows, nz, plane, nx, reach, far); });
  });
}

namespace {

void keep_in(const std::uint8_t* in, std::size_t count, std::uint8_t* kept) {
  for (std::size_t i = 0; i < count; ++i) kept[i] &= in[i];
}

}  // namespace

Mask outermost_of(const Index3& size, const Mask& mask) {
  const int nx = size.x(), ny = size.y(), nz = size.z();
  const auto row = static_cast<std::size_t>(nx), plane = row * static_cast<std::size_t>(ny);
  Mask result(mask.size(), 0);
  tbb::parallel_for(0, nz, [&](int k) {
    // Of the up to nine rows around: all in the mask; so is what is beyond its ends.
    Mask full(row + 2);
    for (int j = 0; j < ny; ++j) {
      std::fill(full.begin(), full.end(), std::uint8_t{1});
      for (int z = std::max(0, k - 1); z <= std::min(nz - 1, k + 1); ++z)
        for (int y = std::max(0, j - 1); y <= std::min(ny - 1, j + 1); ++y)
          keep_in(
              mask.data() + static_cast<std::size_t>(z) * plane + static_cast<std::size_t>(y) * row,
              row, full.data() + 1);
      const std::size_t o = static_cast<std::size_t>(k) * plane + static_cast<std::size_t>(j) * row;
      const std::uint8_t *in = mask.data() + o, *of = full.data() + 1;
      std::uint8_t* out = result.data() + o;
      for (std::size_t i = 0, n = row; i < n; ++i)
        out[i] = in[i] & ~(of[i - 1] & of[i] & of[i + 1]);
    }
  });
  return result;
}

SurfaceDepth::SurfaceDepth(const Index3& size, const Mask& mask, int reach) {
  NearDistance outermost(size, outermost_of(size, mask), reach);
  const auto codes = static_cast<std::uint16_t>(outermost.most_ + 2);  // on either side
  for (const float side : {1.0f, -1.0f})
    for (int squared = 0; squared < codes; ++squared)
      depth_.push_back(0.5f + side * (squared > outermost.most_
                                          ? std::numeric_limits<float>::infinity()
                                          : std::sqrt(static_cast<float>(squared))));
  Squares& all = outermost.squared_;
  chunk_.resize((all.size() + kChunk - 1) / kChunk);
  const auto far_inside = static_cast<std::uint16_t>(codes - 1),
             far_outside = static_cast<std::uint16_t>(2 * codes - 1);
  const auto end_of = [&](std::size_t c) { return std::min(all.size(), (c + 1) * kChunk); };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, chunk_.size()), [&](const auto& range) {
    for (std::size_t c = range.begin(); c < range.end(); ++c) {
      bool inside = true, outside = true;
      for (std::size_t v = c * kChunk; v < end_of(c); ++v) {
        all[v] = static_cast<std::uint16_t>(std::min(all[v], far_inside) + (mask[v] ? 0 : codes));
        inside &= all[v] == far_inside;
        outside &= all[v] == far_outside;
      }
      chunk_[c] = outside ? kFarOutside : inside ? kFarInside : kNear;
    }
  });
  std::uint32_t count = kNear;
  for (std::uint32_t& c : chunk_)
    if (c == kNear) c = count++;
  code_.assign(count * kChunk, far_outside);
  std::fill_n(code_.begin() + kFarInside * kChunk, kChunk, far_inside);
  for (std::size_t c = 0; c < chunk_.size(); ++c)
    if (chunk_[c] >= kNear)
      std::copy(all.data() + c * kChunk, all.data() + end_of(c), code_.data() + chunk_[c] * kChunk);
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
