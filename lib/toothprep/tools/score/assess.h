// From files to figures: the whole assessment of a preparation.
//
//   original ─┐                           ┌─▶ volumes, deviation   (compare)
//   prepared ─┼─▶ one frame, one lattice ─┼─▶ floors, walls, ...    (preparation)
//   target   ─┘    (compare)              └─▶ rubric               (score)
//   recording ────────────────────────────────▶ process figures    (score)
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/compare/deviation.h"
#include "toothprep/tools/compare/registration.h"
#include "toothprep/tools/compare/solid.h"
#include "toothprep/tools/compare/volumes.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/preparation/preparation.h"
#include "toothprep/tools/score/process.h"
#include "toothprep/tools/score/score_file.h"

namespace toothprep {

struct AssessmentOptions {              // what the options of `toothprep score` say
  std::string original, prepared;       // files: .vdb, or closed meshes
  std::string target;                   // a file; empty: none
  std::vector<std::string> traces;      // files, in the order of the work: one per bur
  std::optional<PreparationType> type;  // absent: the rubric's, or else found
  std::optional<Rubric> rubric;         // absent: figures without points
  // Lays prepared and target on the original before anything is compared.
  bool register_teeth = false;
  double voxel = 0.1;                 // mm, for an original that is a mesh
  std::optional<double> mm_per_unit;  // of meshes; absent: mm
  PreparationOptions preparation;     // its type is overwritten
  ProcessOptions process;             // of the recording
  // Called with what is being done and how much of the whole is done (0..1), now and then.
  std::function<void(const std::string& stage, double done)> progress;
};

struct Assessment {                       // everything that was measured
  Solid original, prepared;               // on one lattice
  std::optional<Solid> target;            // on the same lattice
  std::optional<Deviation> deviation;     // of prepared.surface; with a target
  Preparation preparation;                // floors, walls, margin, ...
  TriangleMesh preparation_surface;       // on which it was measured
  std::optional<Trace> trace;             // with recordings: the rows of all, one after another
  std::optional<ProcessFigures> process;  // with a recording
  ScoreSheet
      sheet;  // with the rubric's result if there is a rubric; toothprep_version and build are not set
};

// The first half of assess(): the teeth on each other, their volumes, the deviation from the target.
// Throws as assess() does.
[[nodiscard]] Assessment compare_teeth(const AssessmentOptions& options);

// Throws InputError or Error as the parts do: files that can't be read, meshes that aren't closed,
// teeth that don't match, an empty preparation, a target outside the tooth.
[[nodiscard]] Assessment assess(const AssessmentOptions& options);

// assess() and judge() as the user asks: `rubric` is a file, "none", or empty for the one in
// `rubrics_folder` for the type, given or found. The rubric is among the sheet's inputs.
Assessment assess_by_rubric(AssessmentOptions options, const std::string& rubric,
                            const std::string& rubrics_folder);

}  // namespace toothprep
