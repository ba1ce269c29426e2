#include "toothprep/tools/mesh/cut_creases.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace toothprep {

std::vector<Segment> segments_on_faces(unsigned negative, unsigned divided) {
  std::vector<Segment> segments;
  const auto add = [&](const std::vector<int>& corners, int face, bool divided_face) {
    const std::size_t count = corners.size(), before = segments.size();
    const auto inside = [&](std::size_t i) { return (negative >> corners[i % count] & 1) != 0; };
    const auto edge = [&](std::size_t i) {
      const int a = corners[i % count], b = corners[(i + 1) % count];
      return std::array{std::min(a, b), std::max(a, b)};
    };
    for (std::size_t i = 0; i < count; ++i) {
      if (inside(i) || !inside(i + 1)) continue;
      std::size_t last = i + 1;
      while (inside(last + 1)) ++last;
      segments.push_back({{edge(i), edge(last)}, face, false});
    }
    if (segments.size() == before + 1) segments.back().lone = !divided_face;
  };
  for (int face = 0; face < 6; ++face) {
    const std::array<int, 4> c = corners_of_face(face / 2, face % 2);
    if ((divided >> face & 1) == 0) {
      add({c[0], c[1], c[2], c[3]}, face, false);
      continue;
    }
    add({c[0], c[1], c[2]}, face, true);
    add({c[0], c[2], c[3]}, face, true);
  }
  return segments;
}

namespace {

bool is_one_loop(const std::vector<Segment>& segments) {
  if (segments.empty()) return false;
  std::size_t passed = 0, at = 0;
  do {
    const std::array<int, 2>& end = segments[at].edge[1];
    at = static_cast<std::size_t>(std::find_if(segments.begin(), segments.end(),
                                               [&](const Segment& s) { return s.edge[0] == end; }) -
                                  segments.begin());
    ++passed;
  } while (at != 0);
  return passed == segments.size();
}

Index3 voxel_in_brick(int v) { return Index3(v >> 6, v >> 3 & 7, v & 7); }

Index3 behind(const Index3& cell, int face) {
  return cell + (2 * (face % 2) - 1) * Index3::Unit(face / 2);
}

}  // namespace

CutCreases::CutCreases(const Fields& fields, const LayeredTooth& tooth)
    : fields_(fields), tooth_(tooth), within_(fields.bricks()), bare_(fields.bricks()) {
  find_within();
  beyond_ = found_by([&](const Index3& cell) { return protruding_from(cell); });
  joints_ = found_by([&](const Index3& cell) { return joint_in(cell); });
}

const Crease* CutCreases::at(const Index3& cell) const {
  for (const PerBrick* creases : {&within_, &beyond_, &joints_})
    if (const Crease* crease = among(*creases, cell)) return crease;
  return nullptr;
}

void CutCreases::find_within() {
  tbb::parallel_for(std::size_t{0}, within_.size(), [&](std::size_t brick) {
    const Index3 first = fields_.brick_origin(brick);
    if (!fields_.may_pass(first)) return;
    const BrickSamples samples(fields_, first);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 in = voxel_in_brick(v);
      const CellValues corner = samples.cell(in);
      if (kind_of(corner) != CellKind::kCut) continue;
      const CreaseFinder finder(tooth_.parts->cut, tooth_.lattice.voxel, first + in);
      if (!finder.has_faces() ||
          !is_one_loop(segments_on_faces(negative_corners(corner, 1), samples.divided_faces(in))))
        continue;
      if (std::optional<Crease> crease = finder.in(first + in))
        within_[brick].push_back({v, *std::move(crease)});
      else
        bare_[brick].push_back(v);
    }
  });
}

// By what `find` says of each bare cell that has no crease yet.
template <class Find>
CutCreases::PerBrick CutCreases::found_by(const Find& find) const {
  PerBrick creases(bare_.size());
  tbb::parallel_for(std::size_t{0}, creases.size(), [&](std::size_t brick) {
    for (const int v : bare_[brick]) {
      const Index3 cell = fields_.brick_origin(brick) + voxel_in_brick(v);
      if (at(cell) != nullptr) continue;
      if (std::optional<Crease> crease = find(cell))
        creases[brick].push_back({v, *std::move(crease)});
    }
  });
  return creases;
}

const Crease* CutCreases::among(const PerBrick& creases, const Index3& cell) const {
  const std::optional<std::size_t> brick = fields_.brick_of(cell);
  if (!brick || creases.empty()) return nullptr;
  const Index3 in = cell - fields_.brick_origin(*brick);
  const int voxel = in.x() << 6 | in.y() << 3 | in.z();
  const auto& its = creases[*brick];
  const auto found = std::lower_bound(its.begin(), its.end(), voxel,
                                      [](const auto& c, int v) { return c.first < v; });
  return found != its.end() && found->first == voxel ? &found->second : nullptr;
}

std::optional<Crease> CutCreases::protruding_from(const Index3& cell) const {
  const CreaseFinder finder(tooth_.parts->cut, tooth_.lattice.voxel, cell);
  for (int n = 0; n < 27; ++n) {
    const Index3 there = cell + Index3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
    if (!is_passed_by(there)) continue;
    std::optional<Crease> crease = finder.in(there);
    if (crease && protrudes(*crease, cell)) return crease;
  }
  return std::nullopt;
}

// Whether a cell within the tooth has no surface by its corners.
bool CutCreases::is_passed_by(const Index3& cell) const {
  if (fields_.kind(cell) != CellKind::kEmpty) return false;
  for (int c = 0; c < 8; ++c)
    if (fields_.at(cell + corner_offset(c))[0] > 0) return false;
  return true;
}

// Whether a crease in such a cell comes out of `cell`: the first with a surface and without a
// crease of its own on the way between the crease's faces.
bool CutCreases::protrudes(const Crease& crease, const Index3& cell) const {
  constexpr double kWay = 1.2, kStep = 0.05;
  for (double way = 0; way < kWay; way += kStep) {
    const Vec3 x = crease.at + way * crease.into;
    const Index3 here = x.array().floor().cast<int>();
    if (here == cell) return true;
    if (fields_.kind(here) != CellKind::kEmpty && among(within_, here) == nullptr) return false;
  }
  return false;
}

std::optional<Crease> CutCreases::joint_in(const Index3& cell) const {
  CellValues corner;
  for (int c = 0; c < 8; ++c) corner[c] = fields_.at(cell + corner_offset(c));
  std::vector<Index3> ends;
  for (const Segment& s : segments_on_faces(negative_corners(corner, 1), 0))
    if (const Index3 end = behind(cell, s.face); s.lone && at(end) != nullptr) ends.push_back(end);
  // Not where another cell joins them already.
  if (ends.size() != 2 || among(within_, ends[0] + ends[1] - cell) != nullptr) return std::nullopt;
  return CreaseFinder(tooth_.parts->cut, tooth_.lattice.voxel, cell)
      .near((at(ends[0])->at + at(ends[1])->at) / 2);
}

}  // namespace toothprep
