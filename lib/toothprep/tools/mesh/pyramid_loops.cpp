#include "toothprep/tools/mesh/pyramid_loops.h"

#include <algorithm>
#include <utility>

namespace toothprep {
namespace {

// Edges are numbered: those of the base from 0, each from its corner to the next, then those from
// the corners to the middle.
constexpr int kMostEdges = 8;

bool on_one_side(int e, int f, int corners) {
  if (e > f) std::swap(e, f);
  const auto neighbours = [&](int i, int j) {
    return (i + 1) % corners == j || (j + 1) % corners == i;
  };
  if (f < corners) return true;  // the base
  if (e < corners) return f - corners == e || f - corners == (e + 1) % corners;
  return neighbours(e - corners, f - corners);
}

// Adds a side's segments: from the edge where a run of inside corners is entered to the one where
// it is left, walking counter-clockwise seen from outside.
void add_side(const std::array<bool, 4>& inside, const std::array<int, 4>& edge, int size,
              std::array<int, kMostEdges>& next) {
  for (int i = 0; i < size; ++i) {
    if (inside[i] || !inside[(i + 1) % size]) continue;
    int last = i + 1;
    while (inside[(last + 1) % size]) ++last;
    next[edge[i]] = edge[last % size];
  }
}

int fan_apex_of(const std::array<int, 6>& edge, int size, int corners) {
  for (int apex = 0; apex < size; ++apex) {
    bool free_of_sides = true;
    for (int d = 2; d < size - 1; ++d)
      free_of_sides &= !on_one_side(edge[apex], edge[(apex + d) % size], corners);
    if (free_of_sides) return apex;
  }
  return 0;  // does not occur
}

}  // namespace

PyramidLoops pyramid_loops(const std::array<int, 4>& base, int corners, unsigned negative) {
  const auto is_inside = [&](int corner) { return (negative >> corner & 1) != 0; };
  const bool middle = is_inside(kCellMiddle);
  std::array<int, kMostEdges> next;
  next.fill(-1);
  std::array<bool, 4> inside{};
  for (int i = 0; i < corners; ++i) inside[i] = is_inside(base[i]);
  add_side(inside, {0, 1, 2, 3}, corners, next);
  for (int i = 0; i < corners; ++i) {
    const int j = (i + 1) % corners;
    add_side({inside[j], inside[i], middle, false}, {i, corners + i, corners + j, 0}, 3, next);
  }
  PyramidLoops loops;
  for (int start = 0; start < 2 * corners; ++start) {
    if (next[start] < 0) continue;
    PyramidLoop& loop = loops.loop[loops.count++];
    std::array<int, 6> edge{};
    for (int e = start; next[e] >= 0; e = std::exchange(next[e], -1)) {
      edge[loop.size] = e;
      const int a = base[e % corners], b = e < corners ? base[(e + 1) % corners] : kCellMiddle;
      loop.edge[loop.size++] = {std::min(a, b), std::max(a, b)};
    }
    loop.apex = fan_apex_of(edge, loop.size, corners);
  }
  return loops;
}

}  // namespace toothprep
