// What the columns of a recording mean, by their names or as the user says.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/recordings/recorded_table.h"

namespace toothprep {

// ASCII letters in lower case.
[[nodiscard]] std::string lower(std::string text);

// A quantity of a recording. A column is named for one by --columns and by the keys of this list:
//   time; x, y, z; qx, qy, qz, qw; rx, ry, rz (angles about the axes) or e1, e2, e3 (in the order of
//   the turns); r11 ... r33 (rows of a rotation matrix); axis_x, axis_y, axis_z, angle; fx, fy, fz;
//   buttons; rotation_rate; torque; stalled
[[nodiscard]] const std::vector<std::string>& quantity_keys();

struct ColumnRole {
  std::size_t column = 0;  // of the table
  std::string unit;        // as the column's name has it: "mm"; empty: it has none
};

struct ColumnRoles {
  std::map<std::string, ColumnRole> of;  // by the keys above
  bool scalar_first = false;             // q0 .. q3 with the scalar at q0
  std::vector<std::string> notes;

  bool has(const std::string& key) const { return of.count(key) > 0; }
  bool has_all(const std::vector<std::string>& keys) const;
};

// By the names: "Time (s)", "PosX", "field.pose.position.x", "Tip_X [mm]", "qw", "Fz_N", "roll".
// Throws InputError where several columns could be meant, naming them; a quantity without a column
// has no role.
[[nodiscard]] ColumnRoles recognise_columns(const RecordedTable& table, const std::string& path);

// "time=Time,x=PosX,y=5": keys and names, or numbers of columns from 1. Replaces what `roles` says
// of a quantity: whoever names one of x, y, z (of a quaternion, ...) names all. Throws InputError
// for unknown keys, columns that aren't there, and names that stand twice.
void set_columns(const std::string& text, const RecordedTable& table, ColumnRoles& roles);

}  // namespace toothprep
