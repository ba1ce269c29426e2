#include "toothprep/tools/preparation/cut_facets.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {

CutFacets::CutFacets(const TriangleMesh& surface, const std::vector<float>& depth,
                     double tolerance) {
  const auto corner = [&](std::uint32_t v) -> Vec3 { return surface.vertices[v].cast<double>(); };
  const auto cut = [&](std::uint32_t v) { return depth[v] > tolerance; };
  facet_of_.assign(surface.triangles.size(), -1);
  std::vector<std::uint8_t> beside_uncut(surface.vertices.size(), 0);
  std::vector<Vec3> own_normal;  // times twice the area
  for (std::uint32_t t = 0; t < surface.triangles.size(); ++t) {
    const auto& c = surface.triangles[t];
    const int count = cut(c[0]) + cut(c[1]) + cut(c[2]);
    if (count == 3) {
      const Vec3 a = corner(c[0]), ab = corner(c[1]) - a, ac = corner(c[2]) - a;
      const Vec3 normal = ab.cross(ac);
      facet_of_[t] = static_cast<std::int32_t>(facets_.size());
      facets_.push_back({a + (ab + ac) / 3, Vec3::Zero(), normal.norm() / 2, t});
      own_normal.push_back(normal);
      continue;
    }
    for (const std::uint32_t v : c) beside_uncut[v] = 1;
    if (count == 0) continue;
    std::vector<Vec3> ends;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t p = c[k], q = c[(k + 1) % 3];
      if (cut(p) == cut(q)) continue;
      const double s = (tolerance - depth[p]) / (double{depth[q]} - depth[p]);
      ends.push_back(corner(p) + s * (corner(q) - corner(p)));
    }
    finish_.push_back({(ends[0] + ends[1]) / 2, (ends[1] - ends[0]).norm(), ends[0], ends[1]});
  }

  std::vector<std::uint32_t> first_at(surface.vertices.size() + 1, 0), at;
  for (const Facet& f : facets_)
    for (const std::uint32_t v : surface.triangles[f.triangle]) ++first_at[v + 1];
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) first_at[v + 1] += first_at[v];
  at.resize(facets_.size() * 3);
  std::vector<std::uint32_t> next(first_at.begin(), first_at.end() - 1);
  for (std::uint32_t i = 0; i < facets_.size(); ++i)
    for (const std::uint32_t v : surface.triangles[facets_[i].triangle]) at[next[v]++] = i;

  first_.push_back(0);
  std::vector<std::uint32_t> around;
  for (std::uint32_t i = 0; i < facets_.size(); ++i) {
    around.clear();
    for (const std::uint32_t v : surface.triangles[facets_[i].triangle]) {
      around.insert(around.end(), at.begin() + first_at[v], at.begin() + first_at[v + 1]);
      facets_[i].rim = facets_[i].rim || beside_uncut[v];
    }
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    Vec3 sum = Vec3::Zero();
    for (const std::uint32_t j : around) sum += own_normal[j];
    facets_[i].normal = sum.norm() > 0 ? Vec3(sum.normalized()) : Vec3(own_normal[i].normalized());
    for (const std::uint32_t j : around)
      if (j != i) neighbours_.push_back(j);
    first_.push_back(static_cast<std::uint32_t>(neighbours_.size()));
  }

  const double cosine = std::cos(units::from_degree(20));
  std::vector<std::uint32_t> sharp;
  for (std::uint32_t i = 0; i < facets_.size(); ++i)
    for (const std::uint32_t j : this->around(i))
      if (facets_[i].normal.dot(facets_[j].normal) < cosine) {
        sharp.push_back(i);
        break;
      }
  for (const std::uint32_t i : sharp) {
    facets_[i].crease = true;
    for (const std::uint32_t j : this->around(i)) facets_[j].crease = true;
  }
}

std::vector<std::vector<std::uint32_t>> CutFacets::pieces(
    const std::function<bool(std::size_t)>& member) const {
  std::vector<std::vector<std::uint32_t>> result;
  std::vector<std::uint8_t> open(size());
  for (std::size_t i = 0; i < size(); ++i) open[i] = member(i);
  for (std::uint32_t start = 0; start < size(); ++start) {
    if (!open[start]) continue;
    std::vector<std::uint32_t> piece = {start};
    open[start] = 0;
    for (std::size_t n = 0; n < piece.size(); ++n)
      for (const std::uint32_t j : around(piece[n]))
        if (open[j]) {
          open[j] = 0;
          piece.push_back(j);
        }
    std::sort(piece.begin(), piece.end());
    result.push_back(std::move(piece));
  }
  std::stable_sort(result.begin(), result.end(),
                   [&](const auto& a, const auto& b) { return area(a) > area(b); });
  return result;
}

double CutFacets::area(const std::vector<std::uint32_t>& piece) const {
  double sum = 0;
  for (const std::uint32_t i : piece) sum += facets_[i].area;
  return sum;
}

}  // namespace toothprep
