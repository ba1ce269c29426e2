// The straight parts of burs' ways as text, as tooth files hold them (data/outputs/README.md). Internal to this folder.
#pragma once

#include <string>

#include "toothprep/step/tooth/cut_way.h"

namespace toothprep {

// JSON without line breaks: heads, columns, and a row per part. Every number is read back bit for bit.
[[nodiscard]] std::string cut_way_text(const CutWay& way);

// Heads and parts of such a text. Throws Error that says which condition it violates.
[[nodiscard]] CutWay parse_cut_way(const std::string& text);

}  // namespace toothprep
