// The page's own files, built into the program.
#pragma once

#include <optional>
#include <string_view>

#include "toothprep/tools/view/page_server.h"

namespace toothprep {

// Of the path after the token; "" is the page itself. Empty: there is none of that name.
[[nodiscard]] std::optional<PageAnswer> page_asset(std::string_view path);

}  // namespace toothprep
