// What is readable but implausible: warnings, which --strict makes errors.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "toothprep/step/session/plausibility.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep::app {

// `what` completes "Exit 1, with nothing written, for ...".
void add_strict(CLI::App& sub, bool& strict, const std::string& what);

// Warns of each; with `strict` throws Error instead, the first being its text.
void warn_or_refuse(const std::vector<std::string>& warnings, bool strict);
// The same of findings on `subject` (a file's name).
void warn_or_refuse(const std::string& subject, const std::vector<Finding>& findings, bool strict);

// read_tooth_with_warnings(), and these as above.
LayeredTooth load_tooth(const std::string& path, bool strict);

// [{"kind": "speed", "value": 1200, "text": "...", "cause": "..."}, ...]
nlohmann::ordered_json findings_json(const std::vector<Finding>& findings);
// The keys energy_audit, energy_audit_range, plausible and findings of a run.
void put_judgement(nlohmann::ordered_json& j, const Audit& audit,
                   const std::vector<Finding>& findings);

}  // namespace toothprep::app
