#include "toothprep/tools/batch/design.h"

#include <algorithm>
#include <boost/random/sobol.hpp>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostPoints = 10'000'000;
constexpr std::size_t kMostSobolFactors = 100;

std::string value_text(double value, bool whole) {
  if (whole) return shortest_text(static_cast<long long>(std::llround(value)));
  return shortest_text(value);
}

double between(const Factor& f, double share) {
  if (share <= 0) return f.from;
  if (share >= 1) return f.to;
  if (f.logarithmic) return f.from * std::pow(f.to / f.from, share);
  return f.from + share * (f.to - f.from);
}

void check_count(double count) {
  if (count > static_cast<double>(kMostPoints)) throw Error("has more than 10 million points");
}

std::vector<DesignPoint> grid(const std::vector<Factor>& factors) {
  std::vector<std::vector<std::string>> values;
  double count = 1;
  for (const Factor& f : factors) {
    values.push_back(f.all());
    check_count(count *= static_cast<double>(values.back().size()));
  }
  std::vector<DesignPoint> points;
  points.reserve(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    DesignPoint point(factors.size());
    std::size_t rest = i;
    for (std::size_t k = factors.size(); k-- > 0; rest /= values[k].size())
      point[k] = values[k][rest % values[k].size()];
    points.push_back(std::move(point));
  }
  return points;
}

std::vector<DesignPoint> side_by_side(const std::vector<Factor>& factors) {
  std::vector<DesignPoint> points;
  for (std::size_t k = 0; k < factors.size(); ++k) {
    const std::vector<std::string> values = factors[k].all();
    if (k == 0) points.assign(values.size(), DesignPoint(factors.size()));
    if (values.size() != points.size())
      throw Error("lists of different lengths: '" + factors[0].name + "' has " +
                  std::to_string(points.size()) + " values, '" + factors[k].name + "' " +
                  std::to_string(values.size()));
    for (std::size_t i = 0; i < values.size(); ++i) points[i][k] = values[i];
  }
  return points;
}

// In [0, 1), the same on every machine.
double uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

std::vector<DesignPoint> latin_hypercube(const Design& d) {
  std::mt19937_64 random(d.seed);
  const std::size_t n = d.samples;
  std::vector<DesignPoint> points(n, DesignPoint(d.factors.size()));
  for (std::size_t k = 0; k < d.factors.size(); ++k) {
    std::vector<std::size_t> part(n);
    std::iota(part.begin(), part.end(), std::size_t{0});
    // Fisher and Yates; std::shuffle differs between libraries.
    for (std::size_t i = n; i > 1; --i)
      std::swap(part[i - 1],
                part[static_cast<std::size_t>(uniform(random) * static_cast<double>(i))]);
    for (std::size_t i = 0; i < n; ++i)
      points[i][k] = d.factors[k].at((static_cast<double>(part[i]) + uniform(random)) /
                                     static_cast<double>(n));
  }
  return points;
}

std::vector<DesignPoint> sobol(const Design& d) {
  if (d.factors.size() > kMostSobolFactors)
    throw Error("has more than " + std::to_string(kMostSobolFactors) + " factors");
  boost::random::sobol sequence(d.factors.size());
  std::vector<DesignPoint> points(d.samples, DesignPoint(d.factors.size()));
  for (DesignPoint& point : points)
    for (std::size_t k = 0; k < point.size(); ++k)
      point[k] = d.factors[k].at(static_cast<double>(sequence() >> 11) * 0x1p-53);
  return points;
}

}  // namespace

std::string Factor::at(double u) const {
  if (values.empty()) return value_text(between(*this, u), whole);
  const auto k = static_cast<std::size_t>(u * static_cast<double>(values.size()));
  return values[std::min(k, values.size() - 1)];
}

std::vector<std::string> Factor::all() const {
  if (!values.empty()) return values;
  std::vector<std::string> result;
  for (std::size_t i = 0; i < steps; ++i) {
    const double share = steps > 1 ? static_cast<double>(i) / static_cast<double>(steps - 1) : 0;
    std::string text = value_text(between(*this, share), whole);
    if (result.empty() || result.back() != text) result.push_back(std::move(text));
  }
  return result;
}

Constraint parse_constraint(const std::string& text) {
  const std::size_t at = text.find_first_of("<>=!");
  if (at == std::string::npos)
    throw Error("is no comparison; write for example \"depth_mm <= 1.5\"");
  const std::size_t end = text.find_first_not_of("<>=!", at);
  const auto trimmed = [](std::string part) {
    part.erase(0, part.find_first_not_of(" \t"));
    part.erase(part.find_last_not_of(" \t") + 1);
    return part;
  };
  Constraint c{text, trimmed(text.substr(0, at)),
               text.substr(at, end == std::string::npos ? end : end - at),
               end == std::string::npos ? "" : trimmed(text.substr(end))};
  const std::vector<std::string> known = {"<", "<=", ">", ">=", "==", "!="};
  if (std::find(known.begin(), known.end(), c.operation) == known.end())
    throw Error("has '" + c.operation + "' where one of <, <=, >, >=, ==, != should be");
  if (c.left.empty() || c.right.empty()) throw Error("has nothing on one side");
  return c;
}

bool meets(const std::vector<Constraint>& constraints, const std::vector<Factor>& factors,
           const DesignPoint& point) {
  const auto value_of = [&](const std::string& side) {
    for (std::size_t k = 0; k < factors.size(); ++k)
      if (factors[k].name == side) return point[k];
    return side;
  };
  for (const Constraint& c : constraints) {
    const std::string left = value_of(c.left), right = value_of(c.right);
    const std::optional<double> a = decimal_number(left), b = decimal_number(right);
    const bool numbers = a && b, equal = numbers ? *a == *b : left == right;
    if (c.operation == "==" || c.operation == "!=") {
      if (equal != (c.operation == "==")) return false;
      continue;
    }
    if (!numbers)
      throw Error("'" + c.text + "' compares '" + (a ? right : left) + "', which is no number");
    const bool less = *a < *b;
    if (!(c.operation[0] == '<' ? less || (equal && c.operation == "<=")
                                : (!less && !equal) || (equal && c.operation == ">=")))
      return false;
  }
  return true;
}

std::vector<DesignPoint> points_of(const Design& design) {
  check_count(static_cast<double>(design.samples));
  std::vector<DesignPoint> points = design.kind == DesignKind::kGrid ? grid(design.factors)
                                    : design.kind == DesignKind::kList
                                        ? side_by_side(design.factors)
                                    : design.kind == DesignKind::kSobol ? sobol(design)
                                                                        : latin_hypercube(design);
  std::erase_if(points, [&](const DesignPoint& point) {
    return !meets(design.constraints, design.factors, point);
  });
  if (points.empty()) throw Error("has no point left that meets 'where'");
  return points;
}

}  // namespace toothprep
