// Where one tissue ends and the next begins, on the surface of what remains of a tooth.
//
// The tooth's level sets of its tissues are those of what remains: max(tissue, solid). Between a
// voxel inside and one outside of the solid they are no longer those of the tissue, and the nearer
// the surface, the less they say how deep in its own tissue a voxel is. So interpolating them at the
// surface misplaces a border by up to half a voxel, from voxel to voxel differently. But
// inside of the solid the distance to every *other* tissue is exact, and its negative is the depth
// in the own one. These, of the voxels inside within two voxels (four in a sharp wedge), are fitted
// by a linear function each (weighted least squares), and the fit is evaluated on the surface.
//
// Error: about half the curvature of the border times the mean square distance of those voxels (1
// voxel²), and a little where a tissue ends in a feather edge (measured in README.md).
#pragma once

#include <optional>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Per tissue how far from it a place is, in voxels, negative in it: of two, the lesser is at home.
using TissueDistances = PerTissue<double>;

// At a place on the surface of the solid, or inside, in voxels of the lattice. Nothing if no voxel
// inside is near.
[[nodiscard]] std::optional<TissueDistances> tissue_distances(const LayeredTooth& tooth,
                                                              const Vec3& at);

// The least of them; of equals the first.
[[nodiscard]] Tissue nearest_tissue(const TissueDistances& distances);

// The tissue at such a place: that of the voxels inside about it if it is the same, else by the
// distances; if none is near, the label of the nearest voxel.
[[nodiscard]] Tissue tissue_near(const LayeredTooth& tooth, const Vec3& at);

}  // namespace toothprep
