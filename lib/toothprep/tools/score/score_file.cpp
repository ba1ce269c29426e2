#include "toothprep/tools/score/score_file.h"

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/io/json_number.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

Json range_json(const Range& range) {
  return Json::array({number_or_null(range.low), number_or_null(range.high)});
}

Json value_json(double value, const std::string& unit) {
  if (unit == "yes/no") return value != 0;
  if (unit == "count") return std::llround(value);
  return value;
}

// Puts `value` at the place that the dots of `key` name.
void put(Json& root, const std::string& key, Json value) {
  Json* place = &root;
  std::size_t begin = 0;
  for (std::size_t dot; (dot = key.find('.', begin)) != std::string::npos; begin = dot + 1) {
    place = &(*place)[key.substr(begin, dot - begin)];
    if (!place->is_null() && !place->is_object())
      throw Error("score: '" + key + "' would lie inside another quantity");
  }
  Json& leaf = (*place)[key.substr(begin)];
  if (!leaf.is_null()) throw Error("score: the key '" + key + "' is given twice");
  leaf = std::move(value);
}

Json criterion_json(const CriterionResult& r) {
  const Criterion& c = r.criterion;
  Json j;
  j["key"] = r.key;
  j["name"] = c.name;
  j["unit"] = c.unit;
  if (r.value) j["value"] = value_json(*r.value, c.unit);
  if (r.value && std::isfinite(r.uncertainty)) j["uncertainty"] = r.uncertainty;
  j["ideal"] = range_json(c.ideal);
  j["tolerated"] = range_json(c.tolerated);
  if (c.hard_fail) j["hard_fail"] = range_json(*c.hard_fail);
  j["weight"] = c.weight;
  j["points"] = r.points;
  j["points_low"] = r.points_low;
  j["points_high"] = r.points_high;
  j["of"] = r.of;
  j["verdict"] = name_of(r.verdict);
  j["failed"] = r.failed;
  j["uncertain"] = r.uncertain;
  j["reason"] = r.reason;
  j["source"] = c.source;
  return j;
}

}  // namespace

std::string score_json(const ScoreSheet& sheet) {
  Json j;
  j["schema"] = "toothprep-score";
  j["schema_version"] = 1;
  j["toothprep_version"] = sheet.toothprep_version;
  j["build"] = sheet.build;
  j["inputs"] = Json::object();
  for (const ScoreInput& input : sheet.inputs)
    j["inputs"][input.role] = {{"file", input.file}, {"sha256", input.sha256}};
  j["options"] = {{"type", sheet.type}, {"type_from", sheet.type_from}};
  Json& options = j["options"];
  if (sheet.axis) options["axis"] = {sheet.axis->x(), sheet.axis->y(), sheet.axis->z()};
  if (!sheet.axis_from.empty()) {
    options["axis_from"] = sheet.axis_from;
    options["axis_known"] = sheet.axis_known;
    options["axis_uncertainty_deg"] = sheet.axis_uncertainty_deg;
  }
  if (sheet.voxel_mm) options["voxel_mm"] = *sheet.voxel_mm;
  options["registered"] = sheet.registered;
  if (sheet.mm_per_unit) options["mm_per_unit"] = *sheet.mm_per_unit;

  for (const char* later :
       {"uncertainty", "rubric", "criteria", "points_percent", "passed", "points_percent_low",
        "points_percent_high", "verdict_certain", "fail_reasons", "notes", "plausible", "warnings"})
    for (const Quantity& q : sheet.quantities)
      if (q.key == later || q.key.rfind(std::string(later) + ".", 0) == 0)
        throw Error("score: '" + q.key + "' cannot be the name of a quantity");
  Json uncertainty = Json::object();
  for (const Quantity& q : sheet.quantities) {
    if (!std::isfinite(q.value)) continue;
    put(j, q.key, value_json(q.value, q.unit));
    if (std::isfinite(q.uncertainty)) uncertainty[q.key] = q.uncertainty;
  }
  j["uncertainty"] = std::move(uncertainty);

  std::vector<std::string> notes = sheet.notes;
  if (sheet.result) {
    const RubricResult& r = *sheet.result;
    j["rubric"] = {
        {"name", r.name}, {"type", r.type}, {"source", r.source}, {"pass_points", r.pass_points}};
    j["criteria"] = Json::array();
    for (const CriterionResult& c : r.criteria) j["criteria"].push_back(criterion_json(c));
    if (r.points_percent) {
      j["points_percent"] = *r.points_percent;
      j["points_percent_low"] = r.points_percent_low;
      j["points_percent_high"] = r.points_percent_high;
    }
    j["passed"] = r.passed;
    j["verdict_certain"] = r.certain;
    j["fail_reasons"] = r.fail_reasons;
    notes.insert(notes.end(), r.notes.begin(), r.notes.end());
  }
  j["notes"] = notes;
  j["plausible"] = sheet.warnings.empty();
  if (!sheet.warnings.empty()) j["warnings"] = sheet.warnings;
  return json_text(j);
}

void write_score(const ScoreSheet& sheet, const std::string& path) {
  write_file(path, score_json(sheet));
}

ScoredInputs read_scored_inputs(const std::string& path) {
  namespace fs = std::filesystem;
  const auto score = nlohmann::json::parse(read_small_text(path), nullptr, false);
  const auto at = [&](const char* place) {
    return score.value(nlohmann::json::json_pointer(place), nlohmann::json());
  };
  if (!score.is_object() || at("/schema") != "toothprep-score")
    throw InputError(path, "schema", "this is not a result of `score`");
  ScoredInputs inputs;
  const auto find_file = [&](const std::string& role, bool required) -> std::string {
    const auto named = at(("/inputs/" + role + "/file").c_str());
    if (named.is_null() && !required) return {};
    if (!named.is_string()) throw InputError(path, "inputs." + role, "is missing");
    fs::path file = named.get<std::string>();
    if (!fs::exists(file)) file = fs::path(path).parent_path() / file;
    if (!fs::exists(file))
      throw InputError(path, "inputs." + role,
                       "names " + named.get<std::string>() + ", which does not exist",
                       "run this where `score` was run");
    if (at(("/inputs/" + role + "/sha256").c_str()) != sha256_of_file(file.string()))
      inputs.changed.push_back(file.string());
    return file.string();
  };
  inputs.original = find_file("original", true);
  inputs.prepared = find_file("prepared", true);
  inputs.target = find_file("target", false);
  inputs.registered = at("/options/registered") == true;
  for (const auto& [key, value] : {std::pair("/options/mm_per_unit", &inputs.mm_per_unit),
                                   std::pair("/options/voxel_mm", &inputs.voxel_mm)})
    if (const auto number = at(key); number.is_number() && number.get<double>() > 0)
      *value = number;
  return inputs;
}

}  // namespace toothprep
