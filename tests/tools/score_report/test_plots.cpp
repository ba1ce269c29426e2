#include <gtest/gtest.h>

#include <numeric>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/score_report/plots.h"

namespace toothprep {
namespace {

double all_of(const DeviationHistogram& h) {
  return std::accumulate(h.share.begin(), h.share.end(), h.below + h.above);
}
// Between two edges of bins.
double share_between(const DeviationHistogram& h, double low, double high) {
  double sum = 0;
  for (std::size_t i = 0; i < h.share.size(); ++i) {
    const double middle = h.low + h.bin * (static_cast<double>(i) + 0.5);
    if (middle > low && middle < high) sum += h.share[i];
  }
  return sum;
}

TEST(DeviationHistogram, CountsByAreaAndLosesNothing) {
  // A quarter of the area at -0.15 mm, the rest at 0.05 mm.
  const DeviationHistogram h = deviation_histogram({-0.15, 0.05, 0.05}, {1, 1, 2});
  EXPECT_NEAR(share_between(h, -0.2, -0.1), 0.25, 1e-12);
  EXPECT_NEAR(share_between(h, 0, 0.1), 0.75, 1e-12);
  EXPECT_NEAR(all_of(h), 1, 1e-12);
}

TEST(DeviationHistogram, FarOnesAreToldAsBeyond) {
  std::vector<double> values(1000, 0.01);
  values[0] = 7;
  values[1] = values[2] = -3;
  const DeviationHistogram h = deviation_histogram(values);
  EXPECT_NEAR(h.low, -0.3, 1e-12);
  EXPECT_NEAR(h.above, 0.001, 1e-12);
  EXPECT_NEAR(h.below, 0.002, 1e-12);
  EXPECT_NEAR(all_of(h), 1, 1e-12);
  EXPECT_NE(deviation_svg(h).find("0.2 % beyond"), std::string::npos);
}

TEST(DeviationHistogram, TheVeryEndsBelongToTheirBins) {
  const DeviationHistogram h = deviation_histogram({-0.3, 0.3, 0.0});
  EXPECT_EQ(h.below, 0);
  EXPECT_EQ(h.above, 0);
  EXPECT_NEAR(all_of(h), 1, 1e-12);
}

TEST(DeviationHistogram, WithoutAFiniteValueItIsRefused) {
  EXPECT_THROW(deviation_histogram({}), Error);
  EXPECT_THROW(deviation_histogram({NAN}), Error);
  EXPECT_THROW(deviation_histogram({1.0}, {0.0}), Error);
  EXPECT_THROW(deviation_histogram({1.0, 2.0}, {1.0}), Error);
}

TEST(DeviationHistogram, AFinerOneIsCutToWhatMatters) {
  // 200 bins of 0.02 mm over +-2 mm: all in one bin near 0.05 mm, but 0.4 % each far out.
  std::vector<double> area(200, 0);
  area[102] = 248;
  area[3] = area[190] = 1;
  const DeviationHistogram h = deviation_histogram(-2, 0.02, area);
  EXPECT_NEAR(h.low, -0.3, 1e-9);
  EXPECT_EQ(h.share.size(), 30u);
  EXPECT_NEAR(h.below, 0.004, 1e-12);
  EXPECT_NEAR(h.above, 0.004, 1e-12);
  EXPECT_NEAR(share_between(h, 0.04, 0.06), 0.992, 1e-12);
  EXPECT_NEAR(all_of(h), 1, 1e-12);
  // A narrow one stays as it is.
  EXPECT_EQ(deviation_histogram(-0.1, 0.1, {1, 1}).share.size(), 2u);
  EXPECT_THROW(deviation_histogram(-1, 0.1, {1, 1}), Error);
  EXPECT_THROW(deviation_histogram(-0.1, 0.1, {0, 0}), Error);
}

std::vector<StepRecord> rows(std::size_t n) {
  std::vector<StepRecord> all(n);
  for (std::size_t i = 0; i < n; ++i) {
    all[i].handle.time = 0.001 * static_cast<double>(i);
    all[i].grinding_force = Vec3(1, 0, 0);
  }
  return all;
}

TEST(TracePlot, APeakOfASingleRowStays) {
  std::vector<StepRecord> all = rows(100000);
  all[54321].grinding_force = Vec3(0, 0, -7);
  all[54321].power = 2500;
  const TracePlot plot = trace_plot(all, {}, {});
  double most = 0, power = 0;
  int columns = 0;
  for (const TracePlot::Column& c : plot.columns) {
    most = std::max(most, c.force_most);
    power = std::max(power, c.power_most);
    columns += c.force_most > 2;
    EXPECT_EQ(c.force_least, 1);
  }
  EXPECT_EQ(most, 7);
  EXPECT_EQ(power, 2.5);  // W
  EXPECT_EQ(columns, 1);
}

TEST(TracePlot, AFewRowsLeaveColumnsEmpty) {
  const TracePlot plot = trace_plot(rows(3), {}, {}, 100);
  int any = 0;
  for (const TracePlot::Column& c : plot.columns) any += c.any;
  EXPECT_EQ(any, 3);
  EXPECT_NE(trace_svg(plot).find("curve-force"), std::string::npos);
}

TEST(TracePlot, StallsAndForbiddenContactAreShaded) {
  std::vector<StepRecord> all = rows(2000);
  for (std::size_t i = 500; i < 700; ++i) all[i].stalled = true;
  for (std::size_t i = 900; i < 950; ++i) all[i].contact_area[2] = 0.1;
  const ProcessFigures process = process_figures(all, {});
  const std::string svg = trace_svg(trace_plot(all, process.events, {}));
  EXPECT_NE(svg.find("ev-stall shade"), std::string::npos);
  EXPECT_NE(svg.find("ev-pulp shade"), std::string::npos);
  EXPECT_EQ(svg.find("ev-neighbour"), std::string::npos);
  EXPECT_NE(svg.find("stall ×1"), std::string::npos);
}

TEST(TracePlot, WithoutStepsItIsRefused) { EXPECT_THROW(trace_plot(rows(1), {}, {}), Error); }

}  // namespace
}  // namespace toothprep
