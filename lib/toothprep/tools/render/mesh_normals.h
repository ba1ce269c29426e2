// Normals for shading a triangle mesh.
#pragma once

#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// Three unit normals per triangle, one for each corner: the mean of the triangles around the
// corner, by area and angle, of those that lean less than 40° against this one, so that sharp edges
// stay sharp. First each triangle's normal is averaged `passes` times with those around it that
// lean less than 50°: the levels of marching cubes show as ripples otherwise. Vertices at the same
// place count as one. A triangle without area has zero normals.
std::vector<Eigen::Vector3f> corner_normals(const TriangleMesh& mesh, int passes);

}  // namespace toothprep
