#include "fuzz_target.h"
#include "toothprep/tools/score/rubric.h"

namespace toothprep {

const fuzz::Registered k_rubric({"rubric", {"rubric.toml"}, [](const std::string& path) {
                                   static_cast<void>(read_rubric(path));
                                 }});

}  // namespace toothprep
