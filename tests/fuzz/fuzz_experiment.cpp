#include <filesystem>

#include "fuzz_target.h"
#include "toothprep/proof/figures/experiment.h"

namespace toothprep {

const fuzz::Registered k_experiment(
    {"experiment", {"experiment.toml"}, [](const std::string& path) {
       figures::read_experiment(std::filesystem::path(path).parent_path().string());
     }});

}  // namespace toothprep
