// A school's rubric: which figures count, what is ideal, what is tolerated, what fails; and the
// judgement of a preparation by it. Rubrics are files (data/rubrics), not code.
//
// Credit of a value: 1 inside `ideal`, 0 outside `tolerated`, linear between their ends; where both
// end at the same limit it drops there from 1 to 0. Points are weight times credit; the total is
// the points over the weights of what could be judged, in percent. Beyond `hard_fail` the whole
// preparation fails, whatever its points.
//
// A value that is known to +-u (95 %) is judged as it is; where the judgement would change inside
// value +- u the criterion is marked uncertain, and the total comes with the range that it has when
// every criterion is as bad, or as good, as its interval allows.
#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/preparation/quantity.h"

namespace toothprep {

struct Range {                                                     // closed
  double low = -std::numeric_limits<double>::infinity();           // included
  double high = std::numeric_limits<double>::infinity();           // included
  bool contains(double x) const { return x >= low && x <= high; }  // ends included
};

// "1.5 to 2.0 mm", "at most 10°", "at least 4.00 mm", "no".
[[nodiscard]] std::string range_text(const Range& range, const std::string& unit);

struct Criterion {                 // one [[criterion]] of a rubric
  std::string key;                 // of a quantity, or "group.*": every member, judged by the worst
  std::string name, unit;          // as reports write them
  Range ideal, tolerated;          // full points; points fall to 0 at its ends
  std::optional<Range> hard_fail;  // outside: the whole preparation fails
  double weight = 1;               // points for `ideal`
  bool required = false;           // a quantity that could not be measured gives 0 points; else it
                                   // isn't judged
  std::string source;              // where the numbers come from
  std::string too_low, too_high;   // what that means ("the cut is too deep"); may be empty
};

struct Rubric {                     // a rubric file
  std::string name, type, source;   // type: one of preparation_types()
  double pass_points = 0;           // percent
  std::vector<Criterion> criteria;  // in the file's order
};

[[nodiscard]] const std::vector<std::string>& preparation_types();  // crown, class1, class2

// Throws InputError (file, key, condition): not TOML, unknown keys and quantities (with the nearest
// known), a unit that is not the quantity's, NaN, low above high, `ideal` not inside `tolerated`,
// `tolerated` not inside `hard_fail`, points that would have to fall towards infinity, weights not
// above 0, a quantity judged twice, no criterion at all.
[[nodiscard]] Rubric read_rubric(const std::string& path);
[[nodiscard]] Rubric parse_rubric(const std::string& toml, const std::string& where);

enum class CriterionVerdict { kIdeal, kTolerated, kOutside, kNotJudged };  // where a value lies
[[nodiscard]] const char* name_of(CriterionVerdict verdict) noexcept;  // "ideal", ..., "not judged"

struct CriterionResult {        // of one criterion
  Criterion criterion;          // as the rubric has it
  std::string key;              // of the quantity that was judged: of a group the worst member
  std::optional<double> value;  // nothing: missing
  double uncertainty = NAN;     // half width of the 95 % interval
  double points = 0, of = 0;    // of: 0 when not judged
  double points_low = 0, points_high = 0;                   // within the uncertainty
  CriterionVerdict verdict = CriterionVerdict::kNotJudged;  // of the value
  bool failed = false;                                      // beyond hard_fail
  bool uncertain = false;  // the judgement would change within the uncertainty
  std::string reason;      // a sentence without its full stop
};

struct RubricResult {                                      // of the whole
  std::string name, type, source;                          // of the rubric
  double pass_points = 0;                                  // percent
  std::vector<CriterionResult> criteria;                   // in the rubric's order
  std::optional<double> points_percent;                    // nothing: no criterion could be judged
  double points_percent_low = 0, points_percent_high = 0;  // within the uncertainties
  bool passed = false;                                     // enough points, and nothing failed hard
  bool certain = true;                    // passed or not throughout the uncertainty
  std::vector<std::string> fail_reasons;  // empty when passed
  std::vector<std::string> notes;         // what a reader must know
};

// Values that are not finite count as missing. Quantities in `absent` are not judged,
// required or not.
[[nodiscard]] RubricResult judge(const Rubric& rubric, const Quantities& quantities,
                                 const std::vector<AbsentQuantity>& absent = {});

}  // namespace toothprep
