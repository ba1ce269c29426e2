// Feature lines that are straightened a vertex at a time, remembering what they replace.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// A line's vertices are always some of those it began with, in the same order. So an edge and the
// part of the line that it replaces have the same ends, and are as far from one another as the
// farthest replaced vertex is from the edge: both ways, since that part is connected.
class FeatureLines {
 public:
  // points: of all vertices, mm; edges: between two of them each.
  FeatureLines(const std::vector<Vec3>& points,
               const std::vector<std::array<std::uint32_t, 2>>& edges);

  bool on_line(std::uint32_t vertex) const { return !links_[vertex].empty(); }
  bool joined(std::uint32_t a, std::uint32_t b) const { return link(a, b) != nullptr; }

  static constexpr double kNever = std::numeric_limits<double>::infinity();
  // How far the line would be from what it replaces, mm, if `removed` went into its neighbour
  // `kept`. Never where lines meet or end, or for a loop of three.
  double deviation_without(std::uint32_t removed, std::uint32_t kept) const;
  void remove(std::uint32_t removed, std::uint32_t kept);
  // The vertex goes on under another number, which was on no line.
  void rename(std::uint32_t from, std::uint32_t to);

  std::vector<std::array<std::uint32_t, 2>> edges() const;  // present ones, ascending
  double greatest_deviation() const;                        // mm, of the present lines

 private:
  struct Link {
    std::uint32_t to = 0;
    std::vector<std::uint32_t> replaced;  // by first numbers
  };
  const Link* link(std::uint32_t a, std::uint32_t b) const;
  const Link* other_link(std::uint32_t vertex, std::uint32_t not_to) const;
  double deviation(std::uint32_t a, std::uint32_t b,
                   const std::vector<std::uint32_t>& replaced) const;

  std::vector<Vec3> points_;              // by first numbers
  std::vector<std::uint32_t> first_;      // by present number: the vertex's first one
  std::vector<std::vector<Link>> links_;  // by present number
};

}  // namespace toothprep
