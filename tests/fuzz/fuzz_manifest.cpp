#include "fuzz_target.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {

const fuzz::Registered k_manifest({"manifest", {"batch.toml"}, [](const std::string& path) {
                                     read_manifest(path, batch_commands());
                                   }});

}  // namespace toothprep
