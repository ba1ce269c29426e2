#include "toothprep/tools/decimation/feature_lines.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "toothprep/step/core/errors.h"

namespace toothprep {

FeatureLines::FeatureLines(const std::vector<Vec3>& points,
                           const std::vector<std::array<std::uint32_t, 2>>& edges)
    : points_(points), first_(points.size()), links_(points.size()) {
  std::iota(first_.begin(), first_.end(), 0U);
  for (const auto& [a, b] : edges) {
    if (a >= points.size() || b >= points.size() || a == b || joined(a, b))
      throw Error("a feature line's edge does not join two vertices, or occurs twice");
    links_[a].push_back({b, {}});
    links_[b].push_back({a, {}});
  }
}

const FeatureLines::Link* FeatureLines::link(std::uint32_t a, std::uint32_t b) const {
  for (const Link& l : links_[a])
    if (l.to == b) return &l;
  return nullptr;
}

const FeatureLines::Link* FeatureLines::other_link(std::uint32_t vertex,
                                                   std::uint32_t not_to) const {
  if (links_[vertex].size() != 2) return nullptr;
  return &links_[vertex][links_[vertex][0].to == not_to ? 1 : 0];
}

double FeatureLines::deviation(std::uint32_t a, std::uint32_t b,
                               const std::vector<std::uint32_t>& replaced) const {
  const Vec3 &from = points_[first_[a]], along = points_[first_[b]] - from;
  const double length2 = along.squaredNorm();
  double most = 0;
  for (const std::uint32_t v : replaced) {
    const Vec3 x = points_[v] - from;
    const double t = length2 > 0 ? std::clamp(x.dot(along) / length2, 0.0, 1.0) : 0.0;
    most = std::max(most, (x - t * along).norm());
  }
  return most;
}

double FeatureLines::deviation_without(std::uint32_t removed, std::uint32_t kept) const {
  const Link* between = link(removed, kept);
  const Link* before = other_link(removed, kept);
  if (!between || !before || joined(before->to, kept)) return kNever;
  std::vector<std::uint32_t> replaced = between->replaced;
  replaced.push_back(first_[removed]);
  replaced.insert(replaced.end(), before->replaced.begin(), before->replaced.end());
  return deviation(before->to, kept, replaced);
}

void FeatureLines::remove(std::uint32_t removed, std::uint32_t kept) {
  std::vector<std::uint32_t> replaced = link(removed, kept)->replaced;
  const Link before = *other_link(removed, kept);
  replaced.push_back(first_[removed]);
  replaced.insert(replaced.end(), before.replaced.begin(), before.replaced.end());
  const auto relink = [&](std::uint32_t at, std::uint32_t to) {
    for (Link& l : links_[at])
      if (l.to == removed) l = {to, replaced};
  };
  relink(kept, before.to);
  relink(before.to, kept);
  links_[removed].clear();
}

void FeatureLines::rename(std::uint32_t from, std::uint32_t to) {
  links_[to] = std::move(links_[from]);
  links_[from].clear();
  first_[to] = first_[from];
  for (const Link& l : links_[to])
    for (Link& back : links_[l.to])
      if (back.to == from) back.to = to;
}

std::vector<std::array<std::uint32_t, 2>> FeatureLines::edges() const {
  std::vector<std::array<std::uint32_t, 2>> edges;
  for (std::uint32_t a = 0; a < links_.size(); ++a)
    for (const Link& l : links_[a])
      if (a < l.to) edges.push_back({a, l.to});
  std::sort(edges.begin(), edges.end());
  return edges;
}

double FeatureLines::greatest_deviation() const {
  double most = 0;
  for (std::uint32_t a = 0; a < links_.size(); ++a)
    for (const Link& l : links_[a]) most = std::max(most, deviation(a, l.to, l.replaced));
  return most;
}

}  // namespace toothprep
