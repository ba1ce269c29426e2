// What a run did to bodies that aren't to be touched.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/session/session.h"
#include "toothprep/step/tooth/tooth_bodies.h"

namespace toothprep {

// "the neighbour 37", "the gum": how sentences call a body.
[[nodiscard]] std::string body_text(const Body& body);

// A sentence for each neighbour and gum that was cut: since when, and how much.
[[nodiscard]] std::vector<std::string> body_warnings(const SessionTotals& totals,
                                                     const std::vector<Body>& list);

}  // namespace toothprep
