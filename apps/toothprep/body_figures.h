// What a run did to each body of a tooth file, as JSON and as lines.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "toothprep/step/session/session.h"
#include "toothprep/step/tooth/tooth_bodies.h"

namespace toothprep::app {

// The key `bodies`, by name; nothing where the tooth has no list of them.
void put_bodies(nlohmann::ordered_json& j, const std::vector<Body>& list,
                const SessionTotals& totals);

// A line for each body that was met.
std::vector<std::string> body_lines(const std::vector<Body>& list, const SessionTotals& totals);

}  // namespace toothprep::app
