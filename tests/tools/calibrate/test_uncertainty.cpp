#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

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

// An AR(1) process has the integrated correlation time h (1 + a)/(1 - a); outliers to one side, a
// percent of the samples and fifty times the noise, must not show in it.
TEST(Uncertainty, OutliersDoNotLengthenTheCorrelation) {
  std::mt19937_64 random(3);
  const auto normal = [&] {  // of twelve uniform numbers, the same in every library
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += static_cast<double>(random() >> 11) * 0x1p-53;
    return sum;
  };
  const double a = 0.6, h = 0.004;
  std::vector<double> x(6000);
  double value = normal();
  for (double& v : x) v = value, value = a * value + std::sqrt(1 - a * a) * normal();
  const double exact = h * (1 + a) / (1 - a);
  EXPECT_NEAR(correlation_time(x, h) / exact, 1, 0.2);
  for (std::size_t i = 50; i < x.size(); i += 100) x[i] += 50;
  EXPECT_NEAR(correlation_time(x, h) / exact, 1, 0.3);
}

}  // namespace
}  // namespace toothprep
