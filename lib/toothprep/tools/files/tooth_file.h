// Tooth files: OpenVDB (.vdb) grids `tissue` (Int32), `solid`, `enamel`, `dentin`, `pulp` (level
// sets, mm), as any OpenVDB program reads them; of a prepared tooth also its parts, `intact` and
// `cut`.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/read_policy.h"

namespace toothprep {

// Throws InputError (file, grid, condition) for what is not a tooth: unreadable, truncated, not
// .vdb, another schema, grids missing or on different lattices, rotated or non-cubic voxels, NaN,
// labels outside 0..4, absurd size, one of the parts without the other, parts that don't make the
// solid.
//
// OpenVDB's reader trusts what it finds. A file of ours proves by its checksum that it is as we
// wrote it; any other is first read by a child process with limits on time and memory, unless the
// policy is kDirect (tools/io/read_policy.h).
[[nodiscard]] LayeredTooth read_tooth(const std::string& path,
                                      ReadPolicy policy = ReadPolicy::kTrial);

// The same, and what is odd about the tooth though it can be read: it isn't the one that the file's
// tooth_sha256 is of (another program changed and saved it), or it lies where no tooth does.
struct ToothReading {
  LayeredTooth tooth;                 // as read
  std::vector<std::string> warnings;  // a sentence each, with the file's name
};
[[nodiscard]] ToothReading read_tooth_with_warnings(
    const std::string& path, ReadPolicy policy = ReadPolicy::kTrial);  // errors as read_tooth()

// Same tooth, same bytes: the archive's random id is derived from the content. Writes `path`
// itself; callers go through Outputs.
void write_tooth(const LayeredTooth& tooth, const std::string& path);

}  // namespace toothprep
