// score.json: what was scored, how, with what result.
//
//   schema "toothprep-score", schema_version 1, toothprep_version, build
//   inputs       {original: {file, sha256}, prepared: ..., ...}
//   options      {type, type_from, axis, axis_from, axis_known, axis_uncertainty_deg, voxel_mm, ...}
//   QUANTITIES   at the top level; a dot in a key makes an object ("removed_mm3": {"enamel": ...}).
//                What is yes or no is a boolean, what is counted an integer.
//   uncertainty  {KEY: half width of the 95 % interval}, full keys with their dots
//   rubric       {name, type, source, pass_points}      these only when a rubric was given
//   criteria     [{key, name, unit, value, uncertainty, ideal, tolerated, hard_fail, points, of,
//                verdict, ...}]
//   points_percent, points_percent_low, points_percent_high, passed, verdict_certain, fail_reasons
//   notes        sentences for people
//
// A number that is not finite is never written: the key is absent, an open end of a range is null.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/preparation/quantity.h"
#include "toothprep/tools/score/rubric.h"

namespace toothprep {

struct ScoreInput {    // a file that was read
  std::string role;    // "original", "prepared", "target", "trace", "rubric": the key
  std::string file;    // as the user wrote it
  std::string sha256;  // of the file
};

struct ScoreSheet {                      // what score.json holds
  std::string toothprep_version, build;  // of the program: version.h, build_info.h
  std::vector<ScoreInput> inputs;        // all files
  std::string type, type_from;           // "class1"; "given", "the rubric", "found"
  std::optional<Vec3> axis;              // unit, W: from the tooth towards its opening
  std::string axis_from;                 // as PreparationFrame::axis_source
  bool axis_known = true;                // false: guessed from the cut
  double axis_uncertainty_deg = 0;       // half width of the 95 % interval
  std::optional<double> voxel_mm;        // the coarser of both teeth
  bool registered = false;               // prepared and target were laid on the original
  std::optional<double> mm_per_unit;     // of meshes, if it was given
  Quantities quantities;                 // keys are unique
  std::optional<RubricResult> result;    // nothing: no rubric
  std::vector<AbsentQuantity> absent;    // not defined for these inputs
  std::vector<std::string> notes;        // remarks; the rubric's own are added
  std::vector<std::string> warnings;     // of implausible inputs
};

// The file's text. Same sheet, same text. Throws Error if two quantities have the same key, one is
// a group and a quantity at once, or one has the name of another member of the file.
[[nodiscard]] std::string score_json(const ScoreSheet& sheet);

// Writes it to `path` (callers go through Outputs). Throws Error if that fails.
void write_score(const ScoreSheet& sheet, const std::string& path);

struct ScoredInputs {                           // what a score was made from
  std::string original, prepared, target;       // files; no target: empty
  bool registered = false;                      // prepared and target were laid on the original
  std::optional<double> mm_per_unit, voxel_mm;  // as in ScoreSheet
  std::vector<std::string> changed;             // those that are other files now
};

// Of the score that write_score() wrote. Files are sought as they were named, then in the score's
// folder. Throws InputError for anything else than a score, or a file that is gone.
[[nodiscard]] ScoredInputs read_scored_inputs(const std::string& path);

}  // namespace toothprep
