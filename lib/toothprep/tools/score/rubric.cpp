#include "toothprep/tools/score/rubric.h"

#include <algorithm>
#include <cstdlib>

#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/score/definitions.h"

namespace toothprep {
namespace {

// ---- Reading

std::string words(StrictTable& table, const std::string& key, const std::string& example) {
  const std::optional<std::string> value = table.text(key);
  if (!value) table.missing(key, "\"" + example + "\"");
  if (value->empty()) table.refuse(key, "must not be empty");
  return *value;
}

// A member of a group belongs to "group.*" too.
std::string group_of(const std::string& key) {
  const std::size_t dot = key.rfind('.');
  return dot == std::string::npos ? std::string() : key.substr(0, dot) + ".*";
}

bool is_group(const std::string& key) {
  return key.size() > 2 && key.compare(key.size() - 2, 2, ".*") == 0;
}

// Of a full key or of "group.*".
const QuantityDefinition* definition_of(const std::string& key) {
  if (!is_group(key)) return find_definition(key);
  for (const QuantityDefinition& row : quantity_definitions())
    if (!row.members.empty() && row.key + ".*" == key) return &row;
  return nullptr;
}

Range read_range(StrictTable& table, const std::string& key) {
  const auto ends = table.range(key);
  return {(*ends)[0], (*ends)[1]};
}

bool inside(const Range& inner, const Range& outer) {
  return inner.low >= outer.low && inner.high <= outer.high;
}

Criterion read_criterion(StrictTable& table) {
  Criterion c;
  c.key = words(table, "key", "floor_tilt_deg");
  const QuantityDefinition* definition = definition_of(c.key);
  if (!definition)
    table.refuse("key", "\"" + c.key.substr(0, 60) + "\" is not a quantity of a score",
                 "did you mean \"" + nearest_name(c.key, known_criterion_keys()) + "\"?");
  c.name = table.text("name").value_or("");
  if (c.name.empty()) c.name = is_group(c.key) ? definition->name : quantity_name(c.key);
  c.unit = words(table, "unit", definition->unit);
  if (c.unit != definition->unit)
    table.refuse("unit", "\"" + c.unit.substr(0, 60) + "\" is not the unit of " + c.key,
                 "write unit = \"" + definition->unit + "\" and the limits in it");
  if (!table.has("ideal")) table.missing("ideal", "[low, high] (inf where it is open)");
  c.ideal = read_range(table, "ideal");
  c.tolerated = table.has("tolerated") ? read_range(table, "tolerated") : c.ideal;
  if (!inside(c.ideal, c.tolerated))
    table.refuse("ideal", "does not lie inside tolerated", "widen tolerated");
  if (std::isinf(c.ideal.low) && std::isinf(c.ideal.high))
    table.refuse("ideal", "has no limit, so that it judges nothing", "give low or high");
  for (const auto& [ideal, tolerated] :
       {std::pair(c.ideal.low, c.tolerated.low), std::pair(c.ideal.high, c.tolerated.high)})
    if (std::isfinite(ideal) != std::isfinite(tolerated))
      table.refuse("tolerated", "is open where ideal ends, so that points can't fall between them",
                   "close it, or open ideal");
  if (table.is_list("hard_fail")) {
    c.hard_fail = read_range(table, "hard_fail");
    if (!inside(c.tolerated, *c.hard_fail))
      table.refuse("hard_fail", "fails what is tolerated", "it must reach as far as tolerated");
  } else if (table.boolean("hard_fail").value_or(false)) {
    c.hard_fail = c.tolerated;
  }
  const std::optional<double> weight = table.number("weight");
  if (!weight) table.missing("weight", "1");
  if (!(*weight > 0 && *weight <= 1e6))
    table.refuse("weight", "must be above 0 and at most 1000000",
                 "leave the criterion out if it should not count");
  c.weight = *weight;
  c.required = table.boolean("required").value_or(false);
  c.source = words(table, "source", "where the numbers come from");
  c.too_low = table.text("too_low").value_or("");
  c.too_high = table.text("too_high").value_or("");
  table.done();
  return c;
}

// ---- Judging

double credit(const Criterion& c, double x) {
  if (c.ideal.contains(x)) return 1;
  if (!c.tolerated.contains(x)) return 0;
  return x < c.ideal.low ? (x - c.tolerated.low) / (c.ideal.low - c.tolerated.low)
                         : (c.tolerated.high - x) / (c.tolerated.high - c.ideal.high);
}

CriterionVerdict verdict_of(const Criterion& c, double x) {
  if (c.ideal.contains(x)) return CriterionVerdict::kIdeal;
  return c.tolerated.contains(x) ? CriterionVerdict::kTolerated : CriterionVerdict::kOutside;
}

bool fails(const Criterion& c, double x) { return c.hard_fail && !c.hard_fail->contains(x); }

// How far x lies beyond what is ideal.
double excess(const Criterion& c, double x) {
  return std::max({c.ideal.low - x, x - c.ideal.high, 0.0});
}

constexpr int kMostDigits = 9;

// The decimals that show a limit as the rubric has it; nothing: the unit's own do.
std::optional<int> digits_for(double limit, const std::string& unit) {
  const auto shows = [&](const std::string& text) {
    return std::abs(std::strtod(text.c_str(), nullptr) - limit) <= 1e-9 * std::abs(limit);
  };
  if (unit == "yes/no" || shows(value_text(limit, unit))) return {};
  int digits = 1;
  while (digits < kMostDigits && !shows(value_text(limit, unit, digits))) ++digits;
  return digits;
}

std::string limit_text(double limit, const std::string& unit) {
  return value_text(limit, unit, digits_for(limit, unit));
}

// A value and a limit that it is not, with the same decimals, and so many that they differ.
std::pair<std::string, std::string> distinct_texts(double value, double limit,
                                                   const std::string& unit) {
  std::optional<int> digits = digits_for(limit, unit);
  std::pair texts(value_text(value, unit, digits), value_text(limit, unit, digits));
  for (digits = digits.value_or(1); texts.first == texts.second && *digits <= kMostDigits;
       ++*digits)
    texts = {value_text(value, unit, digits), value_text(limit, unit, digits)};
  return texts;
}

// "floor tilt is 12.3°, above the tolerated 10.0°: the floor is tilted"
std::string reason_of(const CriterionResult& r, const std::string& name) {
  const Criterion& c = r.criterion;
  const double x = *r.value;
  const std::string is = c.unit == "yes/no" ? ": " : " is ";
  if (r.verdict == CriterionVerdict::kIdeal)
    return name + is + value_text(x, c.unit) + ", as it should be (" + range_text(c.ideal, c.unit) +
           ")";
  const bool low = x < c.ideal.low;
  const bool outside = r.verdict == CriterionVerdict::kOutside;
  const Range& missed = r.failed ? *c.hard_fail : outside ? c.tolerated : c.ideal;
  const auto [value, limit] = distinct_texts(x, low ? missed.low : missed.high, c.unit);
  std::string text = name + is + value;
  if (c.unit == "yes/no") {
    text += ", must be " + range_text(c.ideal, c.unit);
  } else {
    text += (low ? ", below the " : ", above the ");
    text += r.failed ? (low ? "least that can pass, " : "most that can pass, ")
                     : std::string(outside ? "tolerated " : "ideal ");
    text += limit;
  }
  const std::string& meaning = low ? c.too_low : c.too_high;
  if (!meaning.empty()) text += ": " + meaning;
  return text;
}

// The limit within the uncertainty of x at which the judgement changes.
std::optional<double> near_limit(const Criterion& c, double x, double u) {
  std::vector<double> limits = {c.ideal.low, c.ideal.high, c.tolerated.low, c.tolerated.high};
  if (c.hard_fail) limits.insert(limits.end(), {c.hard_fail->low, c.hard_fail->high});
  std::optional<double> nearest;
  for (const double limit : limits)
    if (std::abs(x - limit) <= u && (!nearest || std::abs(x - limit) < std::abs(x - *nearest)))
      nearest = limit;
  return nearest;
}

struct Judged {
  const Quantity* quantity = nullptr;
  double u = 0;  // 0: not stated
  double credit = 0, low = 0, high = 0;
  bool failed = false, may_fail = false, must_fail = false;
};

Judged judge_value(const Criterion& c, const Quantity& q) {
  Judged j;
  j.quantity = &q;
  j.u = std::isfinite(q.uncertainty) && q.uncertainty > 0 ? q.uncertainty : 0;
  j.credit = credit(c, q.value);
  // Credit rises to the ideal range and falls beyond it: over an interval the least is at an end,
  // and the most too, unless the interval reaches the ideal range.
  const double below = credit(c, q.value - j.u), above = credit(c, q.value + j.u);
  j.low = std::min({below, above, j.credit});
  const bool reaches = q.value - j.u <= c.ideal.high && q.value + j.u >= c.ideal.low;
  j.high = reaches ? 1 : std::max({below, above, j.credit});
  j.failed = fails(c, q.value);
  if (c.hard_fail) {
    j.may_fail = fails(c, q.value - j.u) || fails(c, q.value + j.u);
    j.must_fail = q.value - j.u > c.hard_fail->high || q.value + j.u < c.hard_fail->low;
  }
  return j;
}

struct CriterionOutcome {
  CriterionResult result;
  bool may_fail = false, must_fail = false;
};

CriterionOutcome judge_criterion(const Criterion& c, const Quantities& quantities,
                                 const std::vector<AbsentQuantity>& absent) {
  std::vector<Judged> values;
  const std::string prefix = is_group(c.key) ? c.key.substr(0, c.key.size() - 1) : "";
  for (const Quantity& q : quantities) {
    const bool meant = prefix.empty() ? q.key == c.key : q.key.rfind(prefix, 0) == 0;
    if (meant && std::isfinite(q.value)) values.push_back(judge_value(c, q));
  }
  CriterionOutcome outcome;
  CriterionResult& r = outcome.result;
  r.criterion = c;
  r.key = c.key;
  if (values.empty()) {
    const auto a = std::find_if(absent.begin(), absent.end(),
                                [&](const AbsentQuantity& q) { return q.key == c.key; });
    if (a != absent.end()) {
      r.reason = c.name + " is not judged: " + a->reason + "; its weight is left out";
    } else if (c.required) {
      r.of = c.weight;
      r.verdict = CriterionVerdict::kOutside;
      r.reason = c.name + " could not be measured, and the rubric requires it: no points";
    } else {
      r.reason = c.name + " was not measured: not judged, its weight is left out";
    }
    return outcome;
  }
  const Judged& worst =
      *std::min_element(values.begin(), values.end(), [&](const Judged& a, const Judged& b) {
        if (a.failed != b.failed) return a.failed;
        if (a.credit != b.credit) return a.credit < b.credit;
        return excess(c, a.quantity->value) > excess(c, b.quantity->value);
      });
  r.key = worst.quantity->key;
  r.value = worst.quantity->value;
  r.uncertainty = worst.quantity->uncertainty;
  r.of = c.weight;
  r.points = c.weight * worst.credit;
  r.points_low = r.points_high = r.points;
  double low = 1, high = 1;
  for (const Judged& j : values) {
    low = std::min(low, j.low);
    high = std::min(high, j.high);
    outcome.may_fail |= j.may_fail || j.failed;
    outcome.must_fail |= j.must_fail;
  }
  r.points_low = c.weight * low;
  r.points_high = c.weight * high;
  r.verdict = verdict_of(c, *r.value);
  r.failed = worst.failed;
  const std::string name =
      prefix.empty() ? c.name : c.name + " (" + r.key.substr(prefix.size()) + ")";
  r.reason = reason_of(r, name);
  if (worst.u > 0)
    if (const std::optional<double> limit = near_limit(c, *r.value, worst.u)) {
      r.uncertain = true;
      r.reason += "; the limit of " + limit_text(*limit, c.unit) + " is within its uncertainty, ±" +
                  value_text(worst.u, c.unit);
    }
  return outcome;
}

}  // namespace

const std::vector<std::string>& preparation_types() {
  static const std::vector<std::string> types = {"crown", "class1", "class2"};
  return types;
}

const char* name_of(CriterionVerdict verdict) noexcept {
  switch (verdict) {
    case CriterionVerdict::kIdeal:
      return "ideal";
    case CriterionVerdict::kTolerated:
      return "tolerated";
    case CriterionVerdict::kOutside:
      return "outside";
    case CriterionVerdict::kNotJudged:
      return "not judged";
  }
  return "";
}

std::string range_text(const Range& range, const std::string& unit) {
  const bool low = std::isfinite(range.low), high = std::isfinite(range.high);
  if (unit == "yes/no") {
    const bool no = range.contains(0), yes = range.contains(1);
    return no && yes ? "any" : no ? "no" : "yes";
  }
  if (low && high) {
    if (range.low == range.high) return limit_text(range.low, unit);
    // "1.50 to 2.00 mm": the unit once.
    std::string from = limit_text(range.low, unit), to = limit_text(range.high, unit);
    const std::size_t end = from.find(' ');
    return (end == std::string::npos ? from : from.substr(0, end)) + " to " + to;
  }
  if (low) return "at least " + limit_text(range.low, unit);
  if (high) return "at most " + limit_text(range.high, unit);
  return "any";
}

Rubric parse_rubric(const std::string& text, const std::string& where) {
  const toml::table root_table = parse_toml(text, where);
  StrictTable root(root_table, where);
  Rubric rubric;
  rubric.name = words(root, "name", "Class I, amalgam");
  const std::optional<std::string> type = root.choice("type", preparation_types());
  if (!type) root.missing("type", "\"class1\"");
  rubric.type = *type;
  rubric.source = words(root, "source", "where the rubric comes from");
  const std::optional<double> pass = root.number("pass_points");
  if (!pass) root.missing("pass_points", "60");
  if (!(*pass >= 0 && *pass <= 100)) root.refuse("pass_points", "must be 0 to 100 (percent)");
  rubric.pass_points = *pass;
  std::optional<std::vector<StrictTable>> criteria = root.tables("criterion");
  root.done();
  if (!criteria || criteria->empty())
    throw InputError(where, "criterion", "is missing", "add a table [[criterion]] for each");
  for (StrictTable& table : *criteria) {
    Criterion c = read_criterion(table);
    for (const Criterion& other : rubric.criteria)
      if (c.key == other.key || group_of(c.key) == other.key || c.key == group_of(other.key))
        table.refuse("key", c.key + " is judged twice, also by " + other.key);
    rubric.criteria.push_back(std::move(c));
  }
  return rubric;
}

Rubric read_rubric(const std::string& path) { return parse_rubric(read_small_text(path), path); }

RubricResult judge(const Rubric& rubric, const Quantities& quantities,
                   const std::vector<AbsentQuantity>& absent) {
  RubricResult result;
  result.name = rubric.name;
  result.type = rubric.type;
  result.source = rubric.source;
  result.pass_points = rubric.pass_points;
  double points = 0, low = 0, high = 0, of = 0, left_out = 0;
  bool may_fail = false, must_fail = false;
  int not_judged = 0, uncertain = 0;
  for (const Criterion& c : rubric.criteria) {
    CriterionOutcome outcome = judge_criterion(c, quantities, absent);
    CriterionResult& r = outcome.result;
    points += r.points;
    low += r.points_low;
    high += r.points_high;
    of += r.of;
    may_fail |= outcome.may_fail;
    must_fail |= outcome.must_fail;
    uncertain += r.uncertain;
    if (r.verdict == CriterionVerdict::kNotJudged) {
      ++not_judged;
      left_out += c.weight;
    }
    if (r.failed) result.fail_reasons.push_back(r.reason);
    result.criteria.push_back(std::move(r));
  }
  if (of <= 0) {
    result.fail_reasons.push_back("none of the rubric's criteria could be judged");
    return result;
  }
  result.points_percent = 100 * points / of;
  result.points_percent_low = 100 * low / of;
  result.points_percent_high = 100 * high / of;
  // A sum of thirds must not miss the limit by its last bit.
  const double enough = rubric.pass_points - 1e-9;
  if (*result.points_percent < enough)
    result.fail_reasons.push_back(value_text(*result.points_percent, "1", 1) +
                                  " % of the points, below the " +
                                  value_text(rubric.pass_points, "1", 1) + " % that pass");
  result.passed = result.fail_reasons.empty();
  const bool could_pass = result.points_percent_high >= enough && !must_fail;
  const bool could_fail = result.points_percent_low < enough || may_fail;
  result.certain = !(could_pass && could_fail);
  if (not_judged > 0)
    result.notes.push_back(std::to_string(not_judged) + " of " +
                           std::to_string(rubric.criteria.size()) +
                           " criteria could not be judged; their weight, " +
                           value_text(left_out, "1", left_out == std::floor(left_out) ? 0 : 1) +
                           ", is left out of the total");
  for (const AbsentQuantity& a : absent)
    for (const CriterionResult& r : result.criteria)
      if (r.key == a.key && !r.value) result.notes.push_back(r.reason);
  if (uncertain > 0)
    result.notes.push_back(std::to_string(uncertain) +
                           (uncertain == 1 ? " criterion lies" : " criteria lie") +
                           " within the uncertainty of a limit");
  if (!result.certain)
    result.notes.push_back(std::string("the verdict is not certain: within the uncertainty it "
                                       "could also have been ") +
                           (result.passed ? "a fail" : "a pass"));
  return result;
}

}  // namespace toothprep
