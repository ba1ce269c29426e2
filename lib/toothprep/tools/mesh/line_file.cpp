#include "toothprep/tools/mesh/line_file.h"

#include <algorithm>
#include <map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {

std::vector<NamedLines> lines_of(const SharpSurface& surface) {
  std::vector<NamedLines> lines = {{"margin", surface.margin}, {"line_angles", surface.creases}};
  for (TissueBorder& border : tissue_borders(surface.mesh))
    lines.push_back({std::string(kTissueNames[tissue_index(border.between[0])]) + "_" +
                         std::string(kTissueNames[tissue_index(border.between[1])]),
                     std::move(border.edges)});
  return lines;
}

std::vector<std::vector<std::uint32_t>> polylines_of(
    const std::vector<std::array<std::uint32_t, 2>>& edges) {
  struct Link {
    std::uint32_t to;
    std::size_t edge;
  };
  std::map<std::uint32_t, std::vector<Link>> links;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    links[edges[e][0]].push_back({edges[e][1], e});
    links[edges[e][1]].push_back({edges[e][0], e});
  }
  std::vector<char> done(edges.size(), 0);
  std::vector<std::vector<std::uint32_t>> polylines;
  const auto follow = [&](std::uint32_t from, const Link& first) {
    if (done[first.edge]) return;
    std::vector<std::uint32_t> line = {from, first.to};
    done[first.edge] = 1;
    while (line.back() != from && links.at(line.back()).size() == 2) {
      const auto& both = links.at(line.back());
      const Link& next = both[done[both[0].edge] ? 1 : 0];
      done[next.edge] = 1;
      line.push_back(next.to);
    }
    polylines.push_back(std::move(line));
  };
  for (const auto& [vertex, its] : links)
    if (its.size() != 2)
      for (const Link& link : its) follow(vertex, link);
  for (const auto& [vertex, its] : links) follow(vertex, its[0]);
  return polylines;
}

void write_lines(const TriangleMesh& mesh, const std::vector<NamedLines>& lines,
                 const std::string& path) {
  std::string points = "# toothprep lines of a surface, mm\n", text;
  std::map<std::uint32_t, std::size_t> number;
  for (const NamedLines& its : lines) {
    if (its.edges.empty()) continue;
    text += "g " + its.name + "\n";
    for (const auto& line : polylines_of(its.edges)) {
      text += "l";
      for (const std::uint32_t v : line) {
        const auto [entry, is_new] = number.try_emplace(v, number.size() + 1);
        text += " " + std::to_string(entry->second);
        if (!is_new) continue;
        points += "v";
        for (int k = 0; k < 3; ++k) points += " " + shortest_text(mesh.vertices[v][k]);
        points += "\n";
      }
      text += "\n";
    }
  }
  if (number.empty()) throw Error(path + ": nothing to write, the surface has no such lines");
  write_file(path, points + text);
}

}  // namespace toothprep
