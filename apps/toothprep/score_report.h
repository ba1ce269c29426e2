// The folder that `score --report` leaves: the page, and the surfaces for other programs.
#pragma once

#include <string>

#include "toothprep/tools/score/assess.h"

namespace toothprep::app {

// Writes report.html and prepared.ply into an existing folder; with a target also deviation.ply and
// deviation.vtk.
void write_score_report(const Assessment& assessment, const ProcessOptions& process,
                        const std::string& folder);

}  // namespace toothprep::app
