// Tooth files: OpenVDB (.vdb) grids `tissue` (Int32), `solid`, `enamel`, `dentin`, `pulp` (level
// sets, mm), as any OpenVDB program reads them.
#pragma once

#include <string>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Throws InputError (file, grid, condition) for what is not a tooth: unreadable, truncated, not
// .vdb, another schema, grids missing or on different lattices, rotated or non-cubic voxels, NaN,
// labels outside 0..4, absurd size.
LayeredTooth read_tooth(const std::string& path);

// Same tooth, same bytes: the archive's random id is derived from the content. Writes `path`
// itself; callers go through Outputs.
void write_tooth(const LayeredTooth& tooth, const std::string& path);

}  // namespace toothprep
