#include "fuzz_target.h"
#include "toothprep/tools/segmentation/hounsfield.h"

namespace toothprep {

const fuzz::Registered k_hounsfield({"hounsfield",
                                     {"hounsfield.toml"},
                                     [](const std::string& path) {
                                       read_hounsfield_presets(path);
                                     }});

}  // namespace toothprep
