#include "fuzz_target.h"
#include "toothprep/tools/recordings/import_recording.h"

namespace toothprep {

const fuzz::Registered k_foreign_table({"foreign_table",
                                        {"table.csv"},
                                        [](const std::string& path) {
                                          static_cast<void>(import_recording(path, {}));
                                        }});

}  // namespace toothprep
