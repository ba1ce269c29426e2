// What every figure of a score means: key, unit, name, definition, source. One table, from which
// the rubrics' keys are checked, the report takes its explanations, and DEFINITIONS.md is written.
//
// To add a quantity: a row in definitions.cpp, then write the page anew (README.md says how).
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace toothprep {

// A quantity, or a group of quantities that are the same for several places or tissues.
struct QuantityDefinition {
  std::string section;               // "Volumes", "Cavity", ...: a heading
  std::string key;                   // of the quantity, or of the group
  std::vector<std::string> members;  // of a group; its keys are key.member. Empty: not a group
  std::string unit;                  // as Quantity::unit
  std::string name;                  // short, in plain words
  std::string definition;            // one or two sentences
  std::string source;                // citation, or "by construction", ...; may be empty
};

// In the order in which they are reported.
const std::vector<QuantityDefinition>& quantity_definitions();

// Of a full key ("removed_mm3.enamel"); nullptr: not in the table.
const QuantityDefinition* find_definition(const std::string& key);

// "floor tilt", "wall angle (mesial)"; the key itself if it isn't in the table.
std::string quantity_name(const std::string& key);

// Every full key, in the table's order.
std::vector<std::string> known_quantity_keys();

// What a rubric may judge: the full keys, and "group.*" for each group.
std::vector<std::string> known_criterion_keys();

// "12.3°", "0.15 mm", "4.20 mm³", "yes". With `digits` that many decimals instead of the unit's.
std::string value_text(double value, const std::string& unit, std::optional<int> digits = {});

// DEFINITIONS.md: the table as a page.
std::string definitions_page();

}  // namespace toothprep
