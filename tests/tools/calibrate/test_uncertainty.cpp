#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/tools/calibrate/uncertainty.h"

namespace toothprep {
namespace {

// Two-sided 95 % points of Student's t from the NIST/SEMATECH e-Handbook of Statistical Methods,
// 1.3.6.7.2, to the digits printed there. One and two degrees of freedom have closed forms:
// tan(0.95 pi/2), and p sqrt(2 / (1 - p²)) with p = 0.95.
TEST(Uncertainty, StudentsFactorIsThatOfTheTables) {
  const std::pair<double, double> table[] = {{1, 12.706}, {2, 4.303},  {3, 3.182},  {5, 2.571},
                                             {10, 2.228}, {30, 2.042}, {100, 1.984}};
  for (const auto& [freedom, factor] : table)
    EXPECT_NEAR(student_95(freedom), factor, 0.0005) << freedom;
  EXPECT_NEAR(student_95(1), std::tan(0.475 * M_PI), 1e-11);
  EXPECT_NEAR(student_95(2), 0.95 * std::sqrt(2 / (1 - 0.95 * 0.95)), 1e-12);
  EXPECT_NEAR(student_95(1e9), 1.959964, 1e-6);  // the normal distribution's
}

}  // namespace
}  // namespace toothprep
