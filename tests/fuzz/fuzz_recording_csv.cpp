#include "fuzz_target.h"
#include "toothprep/tools/calibrate/recording.h"

namespace toothprep {

const fuzz::Registered k_recording_csv({"recording_csv", {"rig.csv"}, [](const std::string& path) {
                                          read_recording(path);
                                        }});

}  // namespace toothprep
