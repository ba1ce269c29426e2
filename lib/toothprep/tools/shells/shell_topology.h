// Points, edges and faces of a shell, and CGAL's mesh of it; for this module's own .cpp files.
#pragma once

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/tools/shells/shells.h"

namespace toothprep::shell_topology {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;

inline Point cgal(const Vec3& p) { return {p.x(), p.y(), p.z()}; }

// "(1.000, 2.000, 3.000) mm", "face 12 at (...) mm", "1 face", "12 faces"
std::string at(const Vec3& p);
Vec3 centre(const Shell& shell, std::size_t t);
std::string face_at(const Shell& shell, std::size_t t);
std::string count_of(std::size_t n, const std::string& one, const std::string& many);

// Sets that are joined, each named by its least member.
std::uint32_t root_of(std::vector<std::uint32_t>& parent, std::uint32_t k);
void join(std::vector<std::uint32_t>& parent, std::uint32_t a, std::uint32_t b);

struct HalfEdge {
  std::uint32_t low, high;  // points
  std::uint32_t corner;     // 3 * triangle + the corner it starts at
  bool forward;             // low to high

  bool same_edge(const HalfEdge& o) const { return low == o.low && high == o.high; }
};
std::vector<HalfEdge> half_edges(const Shell& shell);  // those of an edge beside each other

// use(first, last) for the half-edges of every edge.
template <class Use>
void for_each_edge(const std::vector<HalfEdge>& edges, Use&& use) {
  for (std::size_t k = 0; k < edges.size();) {
    std::size_t end = k + 1;
    while (end < edges.size() && edges[end].same_edge(edges[k])) ++end;
    use(&edges[k], &edges[0] + end);
    k = end;
  }
}

// For every triangle the first one with the same three points.
std::vector<std::uint32_t> first_alike(const Shell& shell);

// Which triangles must turn for neighbours to agree: the fewer ones of each part. Not possible if a
// part has only one side (edges of more than two triangles are passed over).
struct Turn {
  bool possible = true;
  std::vector<char> triangle;
  std::size_t count = 0;
};
Turn turns_needed(const Shell& shell, const std::vector<HalfEdge>& edges);

// Per triangle the number of its part, counted from 0; parts hang together by edges, and the one
// with the largest area comes first.
struct Parts {
  std::vector<std::uint32_t> of;
  std::vector<double> area;  // mm², of each
};
Parts parts_of(const Shell& shell, const std::vector<HalfEdge>& edges);

// The triangles for which `keep` isn't 0, and their points.
Shell kept_faces(const Shell& shell, const std::vector<char>& keep);

// CGAL's mesh of the shell, its faces in the same order. Where sheets meet in a single point, each
// sheet gets a point of its own; `point` is the shell's point of every vertex.
struct Meshed {
  Mesh mesh;
  std::vector<std::uint32_t> point;
};
Meshed meshed(const Shell& shell, const std::vector<HalfEdge>& edges);

std::array<std::uint32_t, 3> corners(const Mesh& mesh, Mesh::Face_index f);

// Pairs of triangles that meet elsewhere than at what they share; the lower number first, sorted.
std::vector<std::pair<std::size_t, std::size_t>> intersecting_faces(const Shell& shell,
                                                                    const Meshed& m);

// Triangles of parts that face the wrong way: outermost parts inward, cavities outward.
std::vector<std::size_t> inside_out(const Mesh& mesh);

}  // namespace toothprep::shell_topology
