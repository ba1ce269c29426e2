#include "fuzz_target.h"
#include "toothprep/step/bur/bur_library.h"

namespace toothprep {

const fuzz::Registered k_bur_profile({"bur_profile", {"bur.toml"}, [](const std::string& path) {
                                        static_cast<void>(read_bur_file(path));
                                      }});

}  // namespace toothprep
