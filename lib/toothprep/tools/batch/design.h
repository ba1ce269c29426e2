// The points of a sweep: which values its factors take together.
//
//   grid    every combination; the last factor changes fastest
//   list    the factors' values side by side: the first of each, the second of each, ...
//   lhs     Latin hypercube: of n points each factor has one in each n-th part of its range, at a
//           random place there, the parts in a random order of each factor's own (McKay, Beckman,
//           Conover 1979)
//   sobol   the first n points of Sobol's sequence (Boost.Random; direction numbers of Joe and Kuo),
//           without the origin: more points keep the earlier ones
//
// lhs and sobol give numbers in [0, 1): a range takes them evenly (or evenly in the logarithm), a
// list of k values the one in whose k-th part they lie.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace toothprep {

// What one quantity may be: a list of values, or a range.
struct Factor {
  std::string name;
  std::vector<std::string> values;  // a list; empty: a range
  double from = 0, to = 0;
  std::size_t steps = 0;     // of a range in a grid or list: so many values, the ends among them
  bool logarithmic = false;  // evenly in the logarithm; both ends above 0
  bool whole = false;        // rounded to whole numbers

  // The value at u in [0, 1).
  [[nodiscard]] std::string at(double u) const;
  // The values of a list, or the steps of a range.
  [[nodiscard]] std::vector<std::string> all() const;
};

// "LEFT OPERATOR RIGHT", each side a factor, a number or a text; <, <=, >, >=, ==, !=. Numbers are
// compared as numbers, all else as texts, for which there is only == and !=.
struct Constraint {
  std::string text;  // as written
  std::string left, operation, right;
};

// Throws Error (what is wrong, in words) if it is none.
Constraint parse_constraint(const std::string& text);

enum class DesignKind { kGrid, kList, kLatinHypercube, kSobol };

struct Design {
  DesignKind kind = DesignKind::kGrid;
  std::vector<Factor> factors;
  std::size_t samples = 0;  // of lhs and sobol
  std::uint64_t seed = 1;   // of lhs
  std::vector<Constraint> constraints;
};

using DesignPoint = std::vector<std::string>;  // a value per factor

// Whether the point meets all of them. Throws Error where texts are to be ordered.
bool meets(const std::vector<Constraint>& constraints, const std::vector<Factor>& factors,
           const DesignPoint& point);

// Those that meet the constraints, in the design's order; the same for the same design on every
// machine. Throws Error: lists of different lengths, too many dimensions, more than 10 million
// points, or none left.
std::vector<DesignPoint> points_of(const Design& design);

}  // namespace toothprep
