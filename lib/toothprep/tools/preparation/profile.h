// The form of a crown's margin and of its occlusoaxial edge, from profiles in upright planes across
// the finish line.
#pragma once

#include <array>
#include <string_view>

#include "toothprep/tools/preparation/margin.h"

namespace toothprep {

// What a margin is, by its profile from the axial wall to the finish line.
enum class MarginForm { kShoulder, kChamfer, kBevel, kFeatherEdge, kIrregular };
constexpr std::array<std::string_view, 5> kMarginForms = {"shoulder", "chamfer", "bevel",
                                                          "feather_edge", "irregular"};
constexpr double kBevelSlope_deg = 30;  // a straight ledge that falls by more is a bevel
constexpr double kSharpRadius = 0.15;   // mm: an edge below it is sharp
constexpr double kEdgeReach = 1;        // mm, of what is looked at beside the edge

struct MarginProfiles {
  std::array<double, kMarginForms.size()> share{};  // of the profiles, 0..1
  Weighted radius;                                  // mm, between wall and ledge
  Weighted angle;                                   // degrees, between them, out of the tooth
  Weighted cavosurface;  // degrees, in the tooth, between ledge and uncut surface
};

// Wall (known from its middle third), ledge and the arc between them are fitted to each profile. A
// chamfer is a margin of which the arc takes more than half the ledge; of the others the ledge is
// straight: a bevel where it falls outwards by more than kBevelSlope_deg, else a shoulder. A margin
// no wider than kNoMargin is a feather edge; one that the fit misses by more than half a voxel and
// 0.05 mm, irregular. `prepared`: the tree of the mesh of which `facets` are.
MarginProfiles measure_profiles(const Margin& margin, const CutFacets& facets,
                                const PreparationFrame& frame, const TriangleTree& prepared,
                                const TriangleTree& original, double voxel);

struct OuterEdge {   // above a wall: the occlusoaxial edge of a crown
  Weighted radius;   // mm
  Weighted angle;    // degrees, in the tooth
  double sharp = 0;  // share of the circumference with a radius below kSharpRadius, 0..1
};

// Above each place: the wall extended up, the surface within kEdgeReach of it (or 0.4 of the wall's
// height, if that is less), and the arc between them. So is the axiopulpal edge of a class II.
OuterEdge measure_outer_edge(const std::vector<MarginStation>& stations, const CutFacets& facets,
                             const PreparationFrame& frame, const TriangleTree& prepared,
                             double wall_height, double voxel);

}  // namespace toothprep
