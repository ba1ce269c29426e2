// Renaming that never destroys anything.
#pragma once

#include <filesystem>

namespace toothprep {

// kPlain is what file systems without the calls for it (some network and removable ones) get; for
// the tests it can be asked for.
enum class RenameCalls { kBest, kPlain };

// `from` becomes `to`, where nothing stands. 0, or the error (EEXIST: something does).
int rename_to_new(const std::filesystem::path& from, const std::filesystem::path& to,
                  RenameCalls calls = RenameCalls::kBest);

// The two change places, files or folders. 0, or the error, and nothing has changed. kPlain: if the
// process is killed in between, what stood at `to` is found beside it, under the name of `from`
// with "-old".
int exchange(const std::filesystem::path& from, const std::filesystem::path& to,
             RenameCalls calls = RenameCalls::kBest);

}  // namespace toothprep
