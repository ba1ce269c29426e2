// Keeps a mesh free of self-intersections and folds about the vertices of its creases.
//
// A crease's vertex within its cell is joined to a border on the faces of that cell (and to such
// vertices of its neighbours), so nothing there intersects. One in another cell can bring triangles
// to cross: it is moved towards its own cell until none do. And where faces were not found well, a
// vertex can stick out of the surface: it is moved to the middle of the border.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/tools/mesh/creases.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/mesh/two_fields.h"

namespace toothprep {

class CreaseVertices {
 public:
  // `first_triangle`: of the triangles that each brick's cells gave, and the end.
  CreaseVertices(TriangleMesh& mesh, const Lattice& lattice, const Fields& fields,
                 std::vector<std::size_t> first_triangle);
  void add(std::uint32_t vertex, const Index3& cell, const Crease& crease);
  void keep_clear();

 private:
  struct Its {
    std::uint32_t vertex;
    Index3 cell;
    const Crease* crease;
    double beyond;  // the part of the way from its cell to the crease
  };
  struct About {  // the triangles about one
    std::vector<std::size_t> own, others;
  };
  About about(const Its& its) const;
  bool crosses(const About& about) const;
  bool sticks_out(const About& about, const Crease& crease) const;
  Vec3 middle_of_border(const Its& its, const About& about) const;
  void move(const Its& its, const Vec3& to);  // in voxels

  TriangleMesh& mesh_;
  const Lattice& lattice_;
  const Fields& fields_;
  std::vector<std::size_t> first_triangle_;
  std::vector<Its> vertices_;
};

}  // namespace toothprep
