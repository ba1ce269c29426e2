// A tooth's frame for JSON output, the same in every command.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "toothprep/tools/orientation/tooth_frame.h"

namespace toothprep::app {

// occlusal, mesial, buccal, long_axis: [x, y, z] or null where it isn't known, each with
// KEY_uncertainty_deg and KEY_source; fossa_mm, cusps_mm, cervical_mm, cervical_normal,
// cervical_line_mm, occlusal_plane_mm, occlusal_plane_normal, form, tooth_number: where there are
// any. Every key begins with `prefix`.
void put_frame(nlohmann::ordered_json& json, const std::string& prefix, const ToothFrame& frame);

}  // namespace toothprep::app
