#include "fuzz_target.h"
#include "toothprep/tools/files/tooth_file.h"

namespace toothprep {

const fuzz::Registered k_tooth_vdb({"tooth_vdb", {"tooth.vdb"}, [](const std::string& path) {
                                      static_cast<void>(remaining_volumes_mm3(read_tooth(path)));
                                    }});

}  // namespace toothprep
