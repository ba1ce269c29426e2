#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh_files/mesh_file.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

constexpr std::uint64_t kMostTriangles = 20'000'000;
constexpr double kLongest = 200, kShortest = 0.5;  // of a box around teeth, mm
constexpr auto kNone = static_cast<std::uint32_t>(-1);

void check_size(const std::string& path, const Shell& shell) {
  Vec3 low = shell.points[0], high = shell.points[0];
  for (const Vec3& p : shell.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double longest = (high - low).maxCoeff();
  if (longest > kLongest || longest < kShortest) {
    const MeshUnit* unit = likely_mesh_unit(longest);
    throw InputError(
        path, "", fmt::format("its longest side would be {:.4g} mm", longest),
        unit ? fmt::format("coordinates must be mm; in {} it would be {:.4g} mm: --length-unit {} "
                           "of voxelize and score says so",
                           unit->word, longest * unit->mm, unit->name)
             : std::string("coordinates must be mm; --length-unit of voxelize and score says "
                           "another unit"));
  }
  if (std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff()) > 1e5)
    throw InputError(path, "", "lies more than 100 m from the frame's zero");
}

// Per point of the file, the first that equals it. -0 is 0.
std::vector<std::uint32_t> first_equal(const std::vector<Vec3>& points) {
  std::vector<std::uint32_t> order(points.size()), same(points.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Vec3 &p = points[a], &q = points[b];
    if (p.x() != q.x()) return p.x() < q.x();
    if (p.y() != q.y()) return p.y() < q.y();
    if (p.z() != q.z()) return p.z() < q.z();
    return a < b;
  });
  for (std::size_t k = 0; k < points.size(); ++k)
    same[order[k]] =
        k > 0 && points[order[k]] == points[order[k - 1]] ? same[order[k - 1]] : order[k];
  return same;
}

// A quad is cut along its shorter diagonal, a larger face into a fan. `face` is counted from 1.
void add_triangles(std::vector<std::uint32_t>& corner, std::uint32_t face, Shell& shell) {
  const auto at = [&](std::size_t k) { return shell.points[corner[k]]; };
  if (corner.size() == 4 && (at(1) - at(3)).squaredNorm() < (at(0) - at(2)).squaredNorm())
    std::rotate(corner.begin(), corner.begin() + 1, corner.end());
  for (std::size_t k = 1; k + 1 < corner.size(); ++k) {
    shell.triangles.push_back({corner[0], corner[k], corner[k + 1]});
    shell.face.push_back(face);
  }
  if (shell.triangles.size() > kMostTriangles)
    throw InputError(shell.file, "", "has more than 20 million triangles", "thin it out first");
}

}  // namespace

const std::vector<MeshUnit>& mesh_units() {
  static const std::vector<MeshUnit> units = {{"mm", "millimetres", 1},
                                              {"m", "metres", 1000},
                                              {"um", "micrometres", 1e-3},
                                              {"cm", "centimetres", 10},
                                              {"in", "inches", 25.4}};
  return units;
}

const MeshUnit* likely_mesh_unit(double longest) {
  // A root's tip to a cusp: 15 to 30 mm; a crown's stump: 5; a jaw: 90.
  constexpr double kLeast = 3, kMost = 120;
  for (const MeshUnit& unit : mesh_units())
    if (longest * unit.mm >= kLeast && longest * unit.mm <= kMost)
      return unit.mm == 1 ? nullptr : &unit;
  return nullptr;
}

Shell read_shell(const std::string& path, std::optional<double> mm_per_unit, bool any_size) {
  MeshFile mesh = read_mesh_file(path);
  if (mesh.ends.empty()) throw InputError(path, "", "holds no faces");
  Shell shell;
  shell.file = path;
  const std::size_t n = mesh.points.size();
  if (n >= kNone) throw InputError(path, "", "has too many points");
  for (std::size_t k = 0; k < n; ++k) {
    mesh.points[k] = mesh.points[k] * mm_per_unit.value_or(1) + Vec3::Zero();
    if (!mesh.points[k].allFinite())
      throw InputError(path, "point " + std::to_string(k + 1), "a coordinate is not finite");
  }
  // Equal points are one point, numbered in the order of their first appearance.
  const std::vector<std::uint32_t> same = first_equal(mesh.points);
  std::vector<std::uint32_t> number(n, kNone), corner;
  for (std::size_t f = 0, c = 0; f < mesh.ends.size(); ++f) {
    const std::string place = "face " + std::to_string(f + 1);
    if (mesh.ends[f] < c + 3) throw InputError(path, place, "has fewer than three corners");
    corner.clear();
    for (; c < mesh.ends[f]; ++c) {
      const std::uint32_t point = mesh.corners[c];
      if (point >= n) throw InputError(path, place, "names a point that does not exist");
      std::uint32_t& known = number[same[point]];
      if (known == kNone) {
        known = static_cast<std::uint32_t>(shell.points.size());
        shell.points.push_back(mesh.points[same[point]]);
      }
      corner.push_back(known);
    }
    add_triangles(corner, static_cast<std::uint32_t>(f + 1), shell);
  }
  if (!any_size) check_size(path, shell);
  return shell;
}

}  // namespace toothprep
