#include "fuzz_target.h"
#include "toothprep/tools/rig_check/rig_limits.h"

namespace toothprep {

const fuzz::Registered k_rig_limits({"rig_limits", {"limits.toml"}, [](const std::string& path) {
                                       read_rig_limits(path);
                                     }});

}  // namespace toothprep
