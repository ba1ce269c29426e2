// The report of a score: one HTML page that holds everything (pictures, drawings, plots, styles)
// and loads nothing: no font, no request, no script but the scene's own, which are known by their
// hashes (a content policy in the page forbids all else). It
// is well-formed XML too. Same page, same bytes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/preparation/section.h"
#include "toothprep/tools/score/score_file.h"
#include "toothprep/tools/score_report/plots.h"

namespace toothprep {

struct PagePicture {
  std::string caption;
  std::string png;  // the file's bytes
};

struct ScorePage {
  std::string title;  // empty: made from the prepared tooth's file name
  ScoreSheet sheet;
  std::vector<PagePicture> pictures;
  std::vector<Section> sections;
  std::optional<DeviationHistogram> deviation;  // with a target only
  std::optional<TracePlot> trace;               // with a recording only
  std::string scene;  // markup of a part that shows the surfaces, with its scripts; or empty
  std::string script_policy;  // of its scripts: what the page's policy says of them
};

// Texts of the sheet (file names, notes, reasons) may hold anything: they are escaped. Throws Error
// for a picture that is not a PNG.
std::string score_page_html(const ScorePage& page);

}  // namespace toothprep
