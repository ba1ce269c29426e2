// Walls of a preparation: their angle to the axis, their height, how far they stand apart.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/tools/preparation/floors.h"

namespace toothprep {

// The side of the preparation on which a wall stands, by the quarter into which it faces.
enum class Side { kMesial, kDistal, kBuccal, kLingual };
constexpr std::array<Side, 4> kSides = {Side::kMesial, Side::kDistal, Side::kBuccal,
                                        Side::kLingual};
Vec3 outward(Side side, const PreparationFrame& frame);  // unit, W: from the middle to that side
Side opposite(Side side);
// "mesial" and so on; "u_plus", "u_minus", "v_plus", "v_minus" where the sides aren't known.
std::string side_name(Side side, const PreparationFrame& frame);

// A facet of a wall with its way down to the floor and up to the rim, along the wall's slope.
struct WallFacet {
  std::uint32_t facet = 0;
  Side side = Side::kMesial;
  int floor = -1;            // index of the floor below, -1: none of them
  double foot = 0, rim = 0;  // mm along the slope, both positive
  bool plain = true;         // no line angle between walls within two facets
  bool in_middle_third() const {
    const double t = foot / (foot + rim);
    return t > 1.0 / 3 && t < 2.0 / 3;
  }
};

// Every cut facet steeper than 45°, with a floor or a finish line below and an edge above; the
// others are left out. A cavity's wall stands on the side it faces away from, a crown's on the one
// it faces. `prepared` is the tree of the mesh of which `facets` are.
std::vector<WallFacet> find_walls(const CutFacets& facets, const std::vector<Floor>& floors,
                                  const PreparationFrame& frame, const TriangleTree& prepared,
                                  PreparationType type, double voxel);

struct Wall {
  Side side = Side::kMesial;
  std::vector<WallFacet> middle;   // of its middle third
  double area = 0;                 // mm², of all of it
  double angle_deg = 0;            // to d; positive where it faces the opening
  double height = 0;               // mm along d, foot to rim; the median over area
  double distance = 0, level = 0;  // mm: mean distance from the origin to its side, and the height
                                   // at which that is
  bool cavity = true;

  // The mean distance to its side at another height.
  double distance_at(double height_of_point) const;
};

// The wall on a side made of those facets; area 0 if there are fewer than ten in its middle third.
Wall wall_of(const std::vector<WallFacet>& walls, Side side, const CutFacets& facets,
             const PreparationFrame& frame, PreparationType type);

}  // namespace toothprep
