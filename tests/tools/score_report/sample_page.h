// Score pages that are made up, with everything that a page can show.
#pragma once

#include "toothprep/tools/score_report/score_page.h"

namespace toothprep::testing {

// A spoiled Class II cavity: tilted floor, an undercut wall, the pulp open; with a target, a
// recording and hostile file names.
ScorePage spoiled_class2();
// A crown as it should be, without target and recording.
ScorePage good_crown();

}  // namespace toothprep::testing
