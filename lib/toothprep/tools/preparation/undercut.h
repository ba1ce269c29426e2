// Path of draw and undercuts: can what is cast to this shape be taken out along a straight line?
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "toothprep/tools/mesh/triangle_tree.h"
#include "toothprep/tools/preparation/cut_facets.h"

namespace toothprep {

// The direction nearest to `axis` along which the facets draw best: it minimises the sum over
// facets of area · max(0, sin 1° - n·p)², plus a small term that keeps p at the axis where nothing
// is gained. Searched within 30° of the axis. Unit.
Vec3 best_path_of_draw(const CutFacets& facets, const Vec3& axis);

struct Undercut {
  std::vector<std::uint32_t> facets;  // deeper than the threshold
  double area = 0;                    // mm², of those
  double deepest = 0;                 // mm; 0 if there is none
  std::optional<Vec3> place;          // of the deepest
};

// A point is undercut if the line from it along `path` meets the prepared surface again. Its depth
// is how far it would have to move across the path for the line to be free: the most that has to be
// blocked out there, as the field measures undercuts with a surveyor. Exact on the mesh to 1 µm. In a
// corner of two undercut walls it is what the way out, within 60° of where the wall faces, leads
// across that wall; the way around the other one doesn't count. A floor below them is undercut, too,
// but how deep is said of walls and ceilings only.
// Facets within two of a line angle don't count: voxels bevel it, which looks like an undercut of
// half a voxel. But a dovetail is deepest there: from facets near the floor the depth is extended
// along the wall down to it. ways_down: per facet the way along its slope to the floor, mm, or NaN
// where it isn't known or is too long to be bridged.
Undercut find_undercuts(const CutFacets& facets, const TriangleTree& prepared, const Vec3& path,
                        double threshold, const std::vector<double>& ways_down);

}  // namespace toothprep
