#include "toothprep/tools/preparation/section.h"

#include <unordered_map>

namespace toothprep {
std::vector<Outline> outlines_of(const TriangleMesh& surface, const Section& section) {
  const Vec3 normal = section.right.cross(section.up).normalized();
  std::vector<double> side(surface.vertices.size());
  for (std::size_t v = 0; v < side.size(); ++v)
    side[v] = (surface.vertices[v].cast<double>() - section.origin).dot(normal);

  // Points on edges, by the edge's ends; each is in two segments of a closed surface.
  struct Node {
    Vec2 point;
    std::array<std::int32_t, 2> next = {-1, -1};
    bool used = false;
  };
  std::vector<Node> nodes;
  std::unordered_map<std::uint64_t, std::int32_t> node_of_edge;
  const auto node_on = [&](std::uint32_t a, std::uint32_t b) {
    if (a > b) std::swap(a, b);
    const auto [found, fresh] = node_of_edge.try_emplace(std::uint64_t{a} << 32 | b,
                                                         static_cast<std::int32_t>(nodes.size()));
    if (fresh) {
      const Vec3 p = surface.vertices[a].cast<double>(), q = surface.vertices[b].cast<double>();
      const Vec3 x = p + side[a] / (side[a] - side[b]) * (q - p) - section.origin;
      nodes.push_back({Vec2(x.dot(section.right), x.dot(section.up)), {-1, -1}, false});
    }
    return found->second;
  };
  for (const auto& t : surface.triangles) {
    std::array<std::int32_t, 2> ends{};
    int count = 0;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      if ((side[a] > 0) != (side[b] > 0)) ends[count++] = node_on(a, b);
    }
    if (count != 2) continue;
    for (int k = 0; k < 2; ++k) {
      auto& next = nodes[ends[k]].next;
      (next[0] < 0 ? next[0] : next[1]) = ends[1 - k];
    }
  }

  std::vector<Outline> result;
  const auto follow = [&](std::int32_t start) {
    Outline outline;
    std::int32_t at = start, last = start;
    while (at >= 0 && !nodes[at].used) {
      nodes[at].used = true;
      outline.points.push_back(nodes[at].point);
      const auto& next = nodes[last = at].next;
      at = next[0] >= 0 && !nodes[next[0]].used ? next[0] : next[1];
    }
    const auto& next = nodes[last].next;
    outline.closed = outline.points.size() > 2 && (next[0] == start || next[1] == start);
    result.push_back(std::move(outline));
  };
  for (std::size_t i = 0; i < nodes.size(); ++i)  // open ones from their ends
    if (!nodes[i].used && nodes[i].next[1] < 0) follow(static_cast<std::int32_t>(i));
  for (std::size_t i = 0; i < nodes.size(); ++i)
    if (!nodes[i].used) follow(static_cast<std::int32_t>(i));
  return result;
}

}  // namespace toothprep
