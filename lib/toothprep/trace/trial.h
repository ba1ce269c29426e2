// Trying something that may crash, hang or ask for all memory, without doing so.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

namespace toothprep {

// Runs `work` in a child process, whose other results are lost. Gives nothing if it came to its
// end, what() of the std::exception that it threw, or an empty text if it crashed or took more than
// `seconds` or more than `memory` bytes. Nothing, too, if no child can be made. No other thread may
// hold a lock that `work` takes.
std::optional<std::string> failure_in_trial(const std::function<void()>& work, unsigned seconds,
                                            std::size_t memory);

}  // namespace toothprep
