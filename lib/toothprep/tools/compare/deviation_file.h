// The deviation as a colour map on the prepared surface, in files for other programs.
//
// .ply (binary): per vertex `deviation_mm` (NaN outside the region), `quality` (the same, but 0
// outside the region: the scalar that MeshLab reads, which NaN would spoil), tissue and colour.
// .vtk (legacy binary polydata): point data `deviation_mm`, `tissue`, for ParaView, whose PLY
// reader drops the scalars.
//
// Colours, as metrology has them: blue where too much was taken (negative), white where prepared
// and target agree, red where material was left (positive); grey outside the region. Full colour
// at +-limit, by the map of mesh/diverging_colour.h, as in the pictures of render.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

constexpr double kDeviationColourLimit = 0.5;  // mm

using Rgb = std::array<std::uint8_t, 3>;  // sRGB

Rgb deviation_colour(double deviation_mm, double limit_mm = kDeviationColourLimit);

// By extension .ply or .vtk. Throws Error for another one, or if there is not one deviation per
// vertex. Writes `path` itself; callers go through Outputs.
void write_deviation(const TriangleMesh& prepared, const std::vector<float>& deviation_mm,
                     const std::string& path, double limit_mm = kDeviationColourLimit);

}  // namespace toothprep
