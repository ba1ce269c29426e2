#include "toothprep/tools/segmentation/mask_parts.h"

#include <algorithm>
#include <cstring>

namespace toothprep {
namespace {

// Joined runs point to the first of them, by way of others.
class Joined {
 public:
  void add() { first_.push_back(static_cast<std::uint32_t>(first_.size())); }
  std::uint32_t first_of(std::uint32_t r) {
    while (first_[r] != r) r = first_[r] = first_[first_[r]];
    return r;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = first_of(a);
    b = first_of(b);
    if (a != b) first_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> first_;
};

// Runs from .. to - 1 of one row against `other` .. of a row beside it.
void join_rows(const MaskParts& parts, std::size_t from, std::size_t to, std::size_t other,
               std::size_t other_end, Joined& joined) {
  while (from < to && other < other_end) {
    const MaskParts::Run &a = parts.runs[from], &b = parts.runs[other];
    if (a.first < b.end && b.first < a.end)
      joined.join(static_cast<std::uint32_t>(from), static_cast<std::uint32_t>(other));
    if (a.end < b.end)
      ++from;
    else
      ++other;
  }
}

// Runs of the value.
void find_runs(const std::uint8_t* row, std::size_t length, int value, MaskParts& parts,
               Joined& joined) {
  std::size_t at = 0;
  while (const auto* begin =
             static_cast<const std::uint8_t*>(std::memchr(row + at, value, length - at))) {
    const auto first = static_cast<std::size_t>(begin - row);
    const auto* end =
        static_cast<const std::uint8_t*>(std::memchr(begin, 1 - value, length - first));
    at = end ? static_cast<std::size_t>(end - row) : length;
    parts.runs.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(at), 0});
    joined.add();
  }
}

// Numbers the parts from the largest down, and counts them.
void number_parts(const Index3& size, Joined& joined, MaskParts& parts) {
  std::vector<std::uint32_t> firsts;  // the first run of each part
  std::vector<std::size_t> voxels(parts.runs.size(), 0);
  for (std::uint32_t r = 0; r < parts.runs.size(); ++r) {
    const std::uint32_t first = joined.first_of(r);
    if (first == r) firsts.push_back(r);
    voxels[first] += parts.runs[r].end - parts.runs[r].first;
  }
  std::stable_sort(firsts.begin(), firsts.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return voxels[a] > voxels[b]; });
  for (std::uint32_t n = 0; n < firsts.size(); ++n) {
    parts.voxels.push_back(voxels[firsts[n]]);
    voxels[firsts[n]] = n;  // from here on, the part's number
  }
  parts.at_edge.assign(parts.voxels.size(), 0);
  const auto last = static_cast<std::uint32_t>(size.x());
  std::uint32_t r = 0;
  for (std::size_t j = 0; j < parts.row_end.size(); ++j) {
    const auto y = static_cast<int>(j % static_cast<std::size_t>(size.y())),
               z = static_cast<int>(j / static_cast<std::size_t>(size.y()));
    const bool edge_row = y == 0 || z == 0 || y == size.y() - 1 || z == size.z() - 1;
    for (; r < parts.row_end[j]; ++r) {
      MaskParts::Run& run = parts.runs[r];
      run.part = static_cast<std::uint32_t>(voxels[joined.first_of(r)]);
      if (edge_row || run.first == 0 || run.end == last) parts.at_edge[run.part] = 1;
    }
  }
}

}  // namespace

MaskParts parts_of(const Index3& size, const Mask& mask, bool of_rest) {
  const auto length = static_cast<std::size_t>(size.x());
  return parts_of(
      size, [&](std::size_t row) { return mask.data() + row * length; }, of_rest);
}

MaskParts parts_of(const Index3& size, const std::function<const std::uint8_t*(std::size_t)>& row,
                   bool of_rest) {
  MaskParts parts;
  parts.row = static_cast<std::size_t>(size.x());
  const auto ny = static_cast<std::size_t>(size.y()), nz = static_cast<std::size_t>(size.z());
  parts.row_end.reserve(ny * nz);
  Joined joined;
  const auto row_begin = [&](std::size_t j) {
    return j == 0 ? std::size_t{0} : std::size_t{parts.row_end[j - 1]};
  };
  for (std::size_t j = 0; j < ny * nz; ++j) {
    const std::size_t from = parts.runs.size();
    find_runs(row(j), parts.row, of_rest ? 0 : 1, parts, joined);
    parts.row_end.push_back(static_cast<std::uint32_t>(parts.runs.size()));
    if (j % ny > 0)
      join_rows(parts, from, parts.runs.size(), row_begin(j - 1), parts.row_end[j - 1], joined);
    if (j >= ny)
      join_rows(parts, from, parts.runs.size(), row_begin(j - ny), parts.row_end[j - ny], joined);
  }
  number_parts(size, joined, parts);
  return parts;
}

void keep_largest_component(const Index3& size, Mask& mask) {
  parts_of(size, mask).for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (part != 0) std::fill(mask.data() + first, mask.data() + end, std::uint8_t{0});
  });
}

void fill_enclosed(const Index3& size, Mask& mask, std::uint8_t value) {
  const MaskParts rest = parts_of(size, mask, /*of_rest=*/true);
  rest.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (!rest.at_edge[part]) std::fill(mask.data() + first, mask.data() + end, value);
  });
}

}  // namespace toothprep
