// Which part of a prepared surface was cut: its depth below the surface of the original tooth.
//
// A preparation only takes material away, so the prepared surface consists of points on the
// original surface (depth 0) and of points inside the original (depth > 0), the cut. The depth is
// the original's level set with the opposite sign, mm:
//     depth(x) = -phi_original(x),
// trilinear between voxel centres, so clamped to the band of three voxels: +band deep inside,
// -band far outside. On the original's own surface it is 0 to within 2 % of a voxel (the vertices
// of extract_surface lie on lattice edges, where the trilinear field is linear).
//
// A cut shallower than the tolerance looks like the original surface. It cuts a strip of
// that depth off the rim of every wall, too.
#pragma once

#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// Half a voxel: below it a difference of two level sets is within what voxels round away.
constexpr double kCutToleranceVoxels = 0.5;
inline double cut_tolerance(const Lattice& lattice) { return kCutToleranceVoxels * lattice.voxel; }

// Depth of each vertex inside the original, mm (see above).
std::vector<float> depth_inside(const TriangleMesh& surface, const LayeredTooth& original);

// The area that belongs to each vertex, a third of its triangles', mm².
std::vector<double> vertex_areas(const TriangleMesh& surface);

}  // namespace toothprep
