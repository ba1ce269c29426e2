#include "strictness.h"

#include <fmt/format.h>

#include <cmath>

#include "command.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/tooth_file.h"

namespace toothprep::app {

using Json = nlohmann::ordered_json;

void add_strict(CLI::App& sub, bool& strict, const std::string& what) {
  sub.add_flag("--strict", strict, "Exit 1, with nothing written, for " + what);
}

void warn_or_refuse(const std::vector<std::string>& warnings, bool strict) {
  if (warnings.empty()) return;
  if (strict)
    throw Error(warnings.front() + " (--strict" +
                (warnings.size() > 1 ? fmt::format("; {} more", warnings.size() - 1) : "") + ")");
  for (const std::string& w : warnings) warn(w);
}

void warn_or_refuse(const std::string& subject, const std::vector<Finding>& findings, bool strict) {
  std::vector<std::string> warnings;
  for (const Finding& f : findings) warnings.push_back(subject + ": " + message_of(f));
  warn_or_refuse(warnings, strict);
}

LayeredTooth load_tooth(const std::string& path, bool strict) {
  ToothReading reading = read_tooth_with_warnings(path);
  warn_or_refuse(reading.warnings, strict);
  return std::move(reading.tooth);
}

Json findings_json(const std::vector<Finding>& findings) {
  Json list = Json::array();
  for (const Finding& f : findings)
    list.push_back({{"kind", name_of(f.what)},
                    {"value", std::isfinite(f.value) ? Json(f.value) : Json(nullptr)},
                    {"text", f.text},
                    {"cause", f.cause}});
  return list;
}

void put_judgement(Json& j, const Audit& audit, const std::vector<Finding>& findings) {
  j["energy_audit"] = name_of(audit.verdict);
  j["energy_audit_range"] = {audit.low, audit.high};
  j["plausible"] = findings.empty();
  j["findings"] = findings_json(findings);
}

}  // namespace toothprep::app
