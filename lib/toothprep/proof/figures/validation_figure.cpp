// Published cutting tests beside what the presets, and the parameters that were given, predict.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/cut_simulation.h"
#include "toothprep/proof/figures/figure_context.h"

namespace toothprep::figures {
namespace {

constexpr double kLevel = 0.1;  // a smaller relative change is none

struct Named {
  std::string name;
  Parameters parameters;
};

// All presets, and what was given if it is neither.
std::vector<Named> parameter_sets(const Parameters& given) {
  std::vector<Named> sets;
  bool known = false;
  for (const char* name : kPresets) {
    sets.push_back({name, preset_parameters(name)});
    known = known || to_toml(given) == to_toml(sets.back().parameters);
  }
  if (!known) sets.push_back({"given", given});
  return sets;
}

// "M01, M02", of more than two the first and the last.
std::string rows_text(const std::vector<std::string>& rows) {
  if (rows.empty()) return "";
  if (rows.size() == 1) return rows.front();
  return rows.front() + (rows.size() == 2 ? ", " : " to ") + rows.back();
}

std::string verdict_of(const Comparison& c) {
  if (c.predicted_high < c.measured_low) return "below";
  if (c.predicted_low > c.measured_high) return "above";
  return c.predicted_low >= c.measured_low && c.predicted_high <= c.measured_high ? "inside"
                                                                                  : "partly";
}

Comparison compare(const CuttingTest& test, const Named& set, KnownCuts& known) {
  Comparison c;
  c.test = test.name;
  c.title = test.title;
  c.rows = rows_text(test.rows);
  c.parameters = set.name;
  c.quantity = test.quantity_name;
  c.unit = test.unit;
  c.confidence = test.confidence;
  c.measured_low = test.measured[0];
  c.measured_high = test.measured[1];
  c.assumes = test.assumes;
  const Prediction prediction = predict(test, test.cuts, set.parameters, known);
  const std::vector<double>& values = prediction.values;
  c.predicted_low = c.predicted_high = c.ratio = std::nan("");
  if (values.empty()) {
    c.verdict = prediction.stalled ? "stalls" : "no prediction";
    return c;
  }
  c.predicted_low = *std::min_element(values.begin(), values.end());
  c.predicted_high = *std::max_element(values.begin(), values.end());
  const double top = std::isfinite(c.measured_high) ? c.measured_high : c.measured_low;
  c.ratio = std::sqrt(c.predicted_low * c.predicted_high / (c.measured_low * top));
  c.verdict = verdict_of(c);
  return c;
}

double middle(const std::vector<double>& values) {
  if (values.empty()) return std::nan("");
  double sum = 0;
  for (const double x : values) sum += std::log(x);
  return std::exp(sum / static_cast<double>(values.size()));
}

Trend trend_of(const CuttingTest& test, const Named& set, KnownCuts& known) {
  Trend t;
  t.test = test.name;
  t.title = test.title;
  t.rows = rows_text(test.rows);
  t.parameters = set.name;
  t.quantity = test.quantity_name;
  t.observed = test.observed;
  t.assumes = test.assumes;
  t.factor = middle(predict(test, test.second, set.parameters, known).values) /
             middle(predict(test, test.cuts, set.parameters, known).values);
  t.predicted = !std::isfinite(t.factor)      ? "no prediction"
                : t.factor > 1 + kLevel       ? "rises"
                : t.factor < 1 / (1 + kLevel) ? "falls"
                                              : "level";
  t.agrees = t.predicted == t.observed;
  return t;
}

}  // namespace

FigureReport validation_figure(const Experiment& experiment, FigureContext& context) {
  const std::vector<CuttingTest> tests = read_cutting_tests(experiment.measurements);
  const std::vector<Named> sets = parameter_sets(context.options().base);
  std::vector<Comparison> comparisons(tests.size() * sets.size());
  std::vector<Trend> trends(comparisons.size());
  KnownCuts known;
  std::vector<FigureContext::Job> jobs;
  for (std::size_t i = 0; i < tests.size(); ++i)
    jobs.push_back({experiment.name + ", " + tests[i].name, [&, i] {
                      for (std::size_t k = 0; k < sets.size(); ++k)
                        if (tests[i].observed.empty())
                          comparisons[i * sets.size() + k] = compare(tests[i], sets[k], known);
                        else
                          trends[i * sets.size() + k] = trend_of(tests[i], sets[k], known);
                    }});
  context.run(jobs);
  FigureReport figure;
  for (Comparison& c : comparisons)
    if (!c.test.empty()) figure.comparisons.push_back(std::move(c));
  for (Trend& t : trends)
    if (!t.test.empty()) figure.trends.push_back(std::move(t));
  return figure;
}

}  // namespace toothprep::figures
