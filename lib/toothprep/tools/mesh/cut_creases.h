// The creases of a prepared tooth's cut, by the cells of its lattice.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "toothprep/tools/mesh/creases.h"
#include "toothprep/tools/mesh/two_fields.h"

namespace toothprep {

// The cut's surface on the faces of a cell: from one edge that it crosses to the next,
// counter-clockwise about what it encloses seen from outside the tooth.
struct Segment {
  std::array<std::array<int, 2>, 2> edge;  // corners
  int face;                                // 2 axis + side
  bool lone;                               // no other on this face, which is not divided
};

// Of a cell by its negative corners. `divided`: the faces, as bits, that are divided in two
// triangles.
std::vector<Segment> segments_on_faces(unsigned negative, unsigned divided);

// Cells have a crease where the cut alone is the surface and passes as one piece:
//   - those that an edge of the cut passes through;
//   - where such an edge also passes through cells of which all corners are on one side, between two
//     lattice points, the cells that it protrudes from (its point is then in another cell than its own);
//   - cells that have two of these as neighbours.
class CutCreases {
 public:
  CutCreases(const Fields& fields, const LayeredTooth& tooth);
  const Crease* at(const Index3& cell) const;  // null if it has none

 private:
  using PerBrick = std::vector<std::vector<std::pair<int, Crease>>>;  // by voxel in the brick
  void find_within();
  template <class Find>
  PerBrick found_by(const Find& find) const;
  const Crease* among(const PerBrick& creases, const Index3& cell) const;
  std::optional<Crease> protruding_from(const Index3& cell) const;
  std::optional<Crease> joint_in(const Index3& cell) const;
  bool is_passed_by(const Index3& cell) const;
  bool protrudes(const Crease& crease, const Index3& cell) const;

  const Fields& fields_;
  const LayeredTooth& tooth_;
  PerBrick within_, beyond_, joints_;
  std::vector<std::vector<int>>
      bare_;  // voxels per brick: of cells with faces, but no crease within
};

}  // namespace toothprep
