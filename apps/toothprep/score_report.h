// The folder that `score --report` leaves: the page, and the surfaces for other programs.
#pragma once

#include <functional>
#include <string>

#include "toothprep/tools/score/assess.h"

namespace toothprep::app {

// Writes report.html, thumbnail.png and prepared.ply into an existing folder; with a target also
// deviation.ply and deviation.vtk. `progress` may be empty.
void write_score_report(const Assessment& assessment, const ProcessOptions& process,
                        const std::string& folder,
                        const std::function<void(const std::string& stage, double done)>& progress);

}  // namespace toothprep::app
