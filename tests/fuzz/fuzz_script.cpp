#include "fuzz_target.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

const fuzz::Registered k_script({"script", {"path.toml"}, [](const std::string& path) {
                                   static_cast<void>(read_script(path));
                                 }});

}  // namespace toothprep
