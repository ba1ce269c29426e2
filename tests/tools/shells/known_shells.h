// Closed shells of known form, for the tests of what reads, closes and fills shells.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "toothprep/tools/shells/closing.h"

namespace toothprep {

// With each triangle's number in its file.
inline Shell numbered(Shell shell) {
  shell.face.resize(shell.triangles.size());
  for (std::size_t t = 0; t < shell.face.size(); ++t)
    shell.face[t] = static_cast<std::uint32_t>(t + 1);
  return shell;
}

inline void append(Shell& shell, const Shell& other) {
  const auto offset = static_cast<std::uint32_t>(shell.points.size());
  shell.points.insert(shell.points.end(), other.points.begin(), other.points.end());
  for (auto t : other.triangles) {
    for (auto& v : t) v += offset;
    shell.triangles.push_back(t);
  }
  shell = numbered(shell);
}

// An octahedron whose triangles are cut in four `times` times, its points put on the sphere.
inline Shell octahedral_ball(double radius, const Vec3& centre, int times) {
  Shell shell;
  shell.file = "ball.stl";
  shell.points = {Vec3::UnitX(),  -Vec3::UnitX(), Vec3::UnitY(),
                  -Vec3::UnitY(), Vec3::UnitZ(),  -Vec3::UnitZ()};
  shell.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                     {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int n = 0; n < times; ++n) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [place, fresh] =
          middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(shell.points.size()));
      if (fresh) shell.points.push_back((shell.points[a] + shell.points[b]).normalized());
      return place->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    for (const auto& [a, b, c] : shell.triangles) {
      const auto ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    shell.triangles = finer;
  }
  for (Vec3& p : shell.points) p = centre + radius * p;
  return numbered(shell);
}

}  // namespace toothprep
