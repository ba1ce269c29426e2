// Logs of haptic devices as H3D and HAPI write them (DeviceLog): text, or binary.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/tools/recordings/recorded_table.h"

namespace toothprep {

// A name for each number behind a header's words: a log names vectors by one word ("TIME POSITION
// ORIENTATION"). Nothing for words that aren't a log's.
[[nodiscard]] std::optional<std::vector<std::string>> device_log_names(
    const std::vector<std::string_view>& words);

// What such a log fixes: its kind, metres, seconds.
void set_device_log_conventions(RecordedTable& table);

// Whether a file begins as a binary log does: a word of its header and a NUL.
[[nodiscard]] bool is_binary_device_log(const std::string& path);

// A binary log: the header's words, each ended by a NUL, and one more NUL; then rows without gaps in
// the words' order, of little-endian doubles (an orientation is axis and angle) and, for BUTTONS, an
// integer of 32 bits. A last row that isn't whole is left out, with a note. Throws InputError for a
// header with other words, fewer than two rows, more than kMostSamples, and values that can't be
// times of a log (what is no log, or one of floats).
[[nodiscard]] RecordedTable read_binary_device_log(const std::string& path);

}  // namespace toothprep
