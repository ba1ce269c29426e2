#include "fuzz_target.h"
#include "toothprep/tools/live/registration.h"

namespace toothprep {

const fuzz::Registered k_registration({"registration",
                                       {"registration.toml"},
                                       [](const std::string& path) {
                                         static_cast<void>(read_registration(path));
                                       }});

}  // namespace toothprep
