#include "fuzz_target.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

const fuzz::Registered k_trajectory_csv({"trajectory_csv",
                                         {"path.csv"},
                                         [](const std::string& path) {
                                           static_cast<void>(read_csv_trajectory(path));
                                         }});

}  // namespace toothprep
