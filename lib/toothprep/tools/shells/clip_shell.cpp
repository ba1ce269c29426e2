#include <map>

#include "toothprep/tools/shells/closing.h"
#include "toothprep/tools/shells/shell_topology.h"

namespace toothprep {
namespace {

// Keeps the side where a coordinate (times `sign`) is at most `limit`. Both triangles of an edge see
// the same new point.
Shell clipped_by(const Shell& shell, int axis, double sign, double limit) {
  const auto over = [&](std::uint32_t p) { return sign * shell.points[p][axis] - limit; };
  Shell kept;
  kept.file = shell.file;
  kept.points = shell.points;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> crossing;
  const auto crossing_of = [&](std::uint32_t a, std::uint32_t b) {
    const auto [low, high] = std::minmax(a, b);
    const auto [place, fresh] =
        crossing.try_emplace({low, high}, static_cast<std::uint32_t>(kept.points.size()));
    if (fresh) {
      const double from = over(low), to = over(high);
      Vec3 p = shell.points[low] + from / (from - to) * (shell.points[high] - shell.points[low]);
      p[axis] = sign * limit;
      kept.points.push_back(p);
    }
    return place->second;
  };
  std::vector<std::uint32_t> corner;
  for (std::size_t t = 0; t < shell.triangles.size(); ++t) {
    const auto& v = shell.triangles[t];
    corner.clear();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = v[k], b = v[(k + 1) % 3];
      if (over(a) <= 0) corner.push_back(a);
      if ((over(a) < 0 && over(b) > 0) || (over(a) > 0 && over(b) < 0))
        corner.push_back(crossing_of(a, b));
    }
    for (std::size_t k = 1; k + 1 < corner.size(); ++k) {
      kept.triangles.push_back({corner[0], corner[k], corner[k + 1]});
      kept.face.push_back(shell.face[t]);
    }
  }
  return kept;
}

}  // namespace

Shell clipped(const Shell& shell, const Box& box) {
  Shell part = shell;
  for (int axis = 0; axis < 3; ++axis) {
    part = clipped_by(part, axis, -1, -box.min[axis]);
    part = clipped_by(part, axis, 1, box.max[axis]);
  }
  return shell_topology::kept_faces(part, std::vector<char>(part.triangles.size(), 1));
}

}  // namespace toothprep
