// Teeth that were made one by one as the bodies of one tooth file.
#pragma once

#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// One tooth for each body of the list. Where two overlap, a voxel is of the one in which it lies
// deeper. Provenance is that of the tooth that is prepared; histories of cuts are not kept. Throws
// Error as check_bodies(), or if the lattices differ by more than whole voxels, or if two bodies have
// the very same box: then one tooth was taken twice.
[[nodiscard]] LayeredTooth combine_teeth(const std::vector<LayeredTooth>& teeth,
                                         const std::vector<Body>& list);

}  // namespace toothprep
