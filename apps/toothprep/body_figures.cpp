#include "body_figures.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "toothprep/step/session/body_warnings.h"

namespace toothprep::app {
namespace {

BodyTotals totals_of(const SessionTotals& totals, std::size_t body) {
  return body < totals.bodies.size() ? totals.bodies[body] : BodyTotals();
}

}  // namespace

void put_bodies(nlohmann::ordered_json& j, const std::vector<Body>& list,
                const SessionTotals& totals) {
  for (std::size_t b = 0; b < list.size(); ++b) {
    const BodyTotals t = totals_of(totals, b);
    auto& of = j["bodies"][list[b].name];
    of["kind"] = kBodyKindNames[static_cast<std::size_t>(list[b].kind)];
    of["contact_steps"] = t.contact_steps;
    of["shank_contact_steps"] = t.shank_contact_steps;
    of["removed_mm3"] = t.removed;
    of["first_removal_s"] =
        t.first_removal ? nlohmann::ordered_json(*t.first_removal) : nlohmann::ordered_json();
  }
}

std::vector<std::string> body_lines(const std::vector<Body>& list, const SessionTotals& totals) {
  std::vector<std::string> lines;
  for (std::size_t b = 0; b < list.size(); ++b) {
    const BodyTotals t = totals_of(totals, b);
    if (t.contact_steps + t.shank_contact_steps == 0 && !(t.removed > 0)) continue;
    std::string line = fmt::format("{}: {:.3f} mm^3 removed, contact in {} steps",
                                   body_text(list[b]).substr(4), t.removed, t.contact_steps);
    if (t.shank_contact_steps > 0)
      line += fmt::format(", of the shank in {}", t.shank_contact_steps);
    lines.push_back(line);
  }
  return lines;
}

}  // namespace toothprep::app
