// Where the occlusal axis and the tooth's sides point.
#pragma once

#include "toothprep/tools/preparation/cut_facets.h"
#include "toothprep/tools/preparation/preparation.h"

namespace toothprep {

// The frame of a preparation. What isn't given in `options` is read from the original's frame in its
// metadata, else found, to 20° or worse:
//   d   the mean, by area, of the original surface's normals where that surface was cut away. For
//       class II, where the proximal surface went too, the normal of the largest floor within 45°
//       of it. The floor's tilt then says nothing, and a note says so.
//   u   across d, along the walls: the direction in which the walls' normals gather when angles are
//       folded by four; of its four images the one along which the cut is longest
// `height_above_prepared` is that of each vertex of the original's surface above what remains
// (mm). Throws Error for directions that are zero, not finite, or parallel to each other.
PreparationFrame find_frame(const LayeredTooth& original, const TriangleMesh& original_surface,
                            const std::vector<float>& height_above_prepared,
                            const CutFacets& facets, const PreparationOptions& options,
                            double tolerance, std::vector<std::string>& notes);

}  // namespace toothprep
