// Vertices of a mesh that are moved to the creases of a cut, as far as the mesh stays free of
// self-intersections and folds.
//
// Before it was moved each vertex was on its way between lattice points, or on the edge or in the
// triangle that it divides: there nothing intersects. Where one moves over the edge opposite, that
// edge is replaced by the other diagonal of both its triangles. Vertices whose triangles still cross
// others, or look elsewhere than the surface does, are moved back until none do.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

class CreaseVertices {
 public:
  explicit CreaseVertices(TriangleMesh& mesh, double voxel) : mesh_(mesh), voxel_(voxel) {}
  // A vertex of the mesh. Places are mm.
  void add(std::uint32_t vertex, const Vec3& to);
  // One that divides an edge or a triangle: its place there by the weights of the corners, which
  // were added before if they are moved too.
  void add_dividing(std::uint32_t vertex, const std::vector<std::uint32_t>& corners,
                    const std::vector<double>& weights, const Vec3& to);
  // Whether a triangle's normal (unit, out of the tooth) fits its surface.
  using LooksWell = std::function<bool(std::size_t, const Vec3&)>;
  // Whether the edge between two triangles may be replaced.
  using MayFlip =
      std::function<bool(std::size_t, std::size_t, const std::array<std::uint32_t, 2>&)>;
  void place(const LooksWell& looks_well, const MayFlip& may_flip);

 private:
  struct Its {
    std::uint32_t vertex;
    std::vector<std::uint32_t> corners;  // none: of the mesh
    std::vector<double> weights;
    Vec3 from, to;
    double part;  // of the way
    double most;  // of it
    bool moved;   // or one of the corners is
  };
  class Neighbours;
  class Flips;
  Vec3 at(std::uint32_t vertex) const { return mesh_.vertices[vertex].cast<double>(); }
  Vec3 normal(const std::array<std::uint32_t, 3>& triangle) const;
  bool is_moved(std::uint32_t v) const { return index_[v] >= 0 && its_[index_[v]].moved; }
  void put_all();
  std::vector<Eigen::AlignedBox3f> reach();
  bool is_changed(std::size_t triangle) const;
  std::vector<std::size_t> moved_triangles() const;
  bool is_on_line(std::size_t triangle) const;
  void flip_folded(std::vector<std::size_t> folded, const LooksWell& looks_well,
                   const MayFlip& may_flip, bool lines_count);
  struct Seen {  // of the triangles as they were when they were last looked at
    std::vector<std::uint8_t> elsewhere;               // whether each looks elsewhere
    std::vector<std::array<std::size_t, 2>> crossing;  // pairs that cross
  };
  void look_at(const std::vector<std::size_t>& triangles, const Neighbours& neighbours,
               const LooksWell& looks_well, Seen& seen) const;
  // Of each triangle that crosses or looks elsewhere, it and what it crosses.
  using Bad = std::vector<std::vector<std::size_t>>;
  Bad bad_among(const std::vector<std::size_t>& triangles, const Seen& seen) const;
  std::vector<bool> corners_of(const Bad& bad) const;  // of vertices, whether they are
  bool move_back(const Bad& bad);
  Bad try_to_place(const LooksWell& looks_well, const MayFlip& may_flip);

  TriangleMesh& mesh_;
  double voxel_;
  std::vector<std::array<std::uint32_t, 3>> as_given_;  // the mesh's triangles
  std::vector<Its> its_;
  std::vector<std::int32_t> index_;  // among these, per vertex of the mesh, or -1
};

}  // namespace toothprep
