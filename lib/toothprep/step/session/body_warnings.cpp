#include "toothprep/step/session/body_warnings.h"

#include <fmt/format.h>

#include <algorithm>

namespace toothprep {

std::string body_text(const Body& body) {
  const std::string_view kind = kBodyKindNames[static_cast<std::size_t>(body.kind)];
  return body.name == kind ? fmt::format("the {}", kind)
                           : fmt::format("the {} {}", kind, body.name);
}

std::vector<std::string> body_warnings(const SessionTotals& totals, const std::vector<Body>& list) {
  std::vector<std::string> warnings;
  for (std::size_t b = 0; b < std::min(list.size(), totals.bodies.size()); ++b) {
    const BodyTotals& body = totals.bodies[b];
    if (list[b].kind == BodyKind::kTooth || !(body.removed > 0)) continue;
    warnings.push_back(fmt::format("{} was cut from {:.3f} s on: {:.3f} mm^3", body_text(list[b]),
                                   body.first_removal.value_or(0), body.removed));
  }
  return warnings;
}

}  // namespace toothprep
