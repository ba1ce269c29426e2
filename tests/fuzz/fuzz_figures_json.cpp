#include "fuzz_target.h"
#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

const fuzz::Registered k_figures_json({"figures_json", {"score.json"}, [](const std::string& path) {
                                         read_figures(path, {"time"});
                                       }});

}  // namespace toothprep
