// A recording of another lab as columns of numbers, before anybody has said what they mean.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace toothprep {

// What a format fixes by itself, whatever the columns are called.
struct FormatConventions {
  std::optional<double> mm_per_unit;      // of positions
  std::optional<double> second_per_unit;  // of times
  std::optional<double> newton_per_unit;  // of forces
};

struct RecordedTable {
  std::string kind;                          // for people: "table, separated by tabs"
  std::vector<std::string> names;            // of the columns; "1", "2", ... without a header
  std::vector<std::vector<double>> columns;  // as many rows each; NaN where there is no number
  std::vector<std::uint32_t> lines;          // of the rows in the file, from 1; empty: no text file
  std::vector<std::string> notes;            // what was passed over or assumed, a sentence each
  FormatConventions conventions;

  std::size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  // "line 17" or "row 16": where a row stands.
  std::string place(std::size_t row) const;
};

// Reads a table of text, whoever wrote it: separated by tabs, semicolons, commas or blanks (the one
// that makes most numbers of the lines); decimal points or decimal commas; UTF-8 or UTF-16 with a
// byte order mark; lines of comment (#, %, //) and lines before the header; a header, which may be
// commented out, or none; a line of units below the header, which is put into the names as "(unit)";
// quotes round fields. Whole numbers that a double can't hold (ROS time stamps in nanoseconds) are
// counted from the first row's. In a column of which nothing reads as a number, clock times and ISO
// dates with times are seconds; any other is NaN. Empty fields and nan are NaN.
//
// Throws InputError with the line for rows of different length, text in a column of numbers, fewer
// than two rows, more than kMostSamples, and what is no table.
[[nodiscard]] RecordedTable read_text_table(const std::string& path);

// The recordings that a file of a simulator's own format holds.
struct SimulatorRecording {
  RecordedTable motion;
  std::optional<RecordedTable> anatomy;  // the pose of what is drilled, with its own times
  std::optional<RecordedTable> force;    // with its own times
};

// An HDF5 file of FIVRS (LCSR-SICKKIDS/volumetric_drilling): drill poses at high frequency
// (/high_frequency_poses or /physics_data/continuous_data/high_frequency_poses, with drill_pose and
// anatomy_pose), or with the pictures (/data), metres, quaternions x, y, z, w; the wrench of
// drill_force_feedback. Throws InputError if it holds none of them, and as h5::Reader.
[[nodiscard]] SimulatorRecording read_simulator_hdf5(const std::string& path);

}  // namespace toothprep
