#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sample_page.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/score_report/gauge.h"
#include "toothprep/tools/score_report/section_drawing.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++n;
  return n;
}

TEST(ScorePage, SamePageSameBytes) {
  EXPECT_EQ(score_page_html(testing::spoiled_class2()), score_page_html(testing::spoiled_class2()));
}

TEST(ScorePage, AnEmptySheetStillMakesAPage) {
  const std::string html = score_page_html({});
  EXPECT_THAT(html, HasSubstr("no rubric"));
  EXPECT_THAT(html, Not(HasSubstr("<table")));
}

TEST(ScorePage, EveryCriterionAndEveryFigureIsTold) {
  const ScorePage page = testing::spoiled_class2();
  const std::string html = score_page_html(page);
  EXPECT_EQ(count(html, "<code>") - page.sheet.inputs.size(), page.sheet.quantities.size());
  EXPECT_EQ(count(html, "<span title=\"") - page.sheet.inputs.size(),
            page.sheet.result->criteria.size());
  EXPECT_THAT(html, HasSubstr("a_figure_that_the_table_lacks_mm"));
}

TEST(ScorePage, TitleIsThePreparedToothsFileUnlessGiven) {
  ScorePage page = testing::good_crown();
  EXPECT_THAT(score_page_html(page), HasSubstr("<h1>crown.vdb</h1>"));
  page.title = "A & B";
  EXPECT_THAT(score_page_html(page), HasSubstr("<h1>A &amp; B</h1>"));
}

TEST(ScorePage, APictureThatIsNoPngIsRefused) {
  ScorePage page;
  page.pictures = {{"broken", "GIF89a"}};
  EXPECT_THROW(score_page_html(page), Error);
}

Section square() {
  Section s;
  s.name = "square";
  Outline o;
  o.points = {{0, 0}, {10, 0}, {10, 5}, {0, 5}};
  o.closed = true;
  s.original = s.prepared = {o};
  return s;
}

// 10 mm x 5 mm fill the width of 410 px: 41 px per mm on both axes, within a rim of 14 px.
TEST(SectionDrawing, HasEqualAspectAndYUp) {
  const std::string svg = section_svg(square());
  EXPECT_THAT(svg, HasSubstr("class=\"prepared\" d=\"M14 219L424 219L424 14L14 14Z\""));
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 438 255\""));
}

TEST(SectionDrawing, OfATallToothItShowsWhatWasMeasured) {
  Section s = square();
  for (Vec2& p : s.original[0].points) p.y() *= 5;  // 25 mm high
  for (Vec2& p : s.prepared[0].points) p.y() *= 5;
  SectionMark mark;
  mark.from = {4, 23};
  mark.to = {6, 23};
  mark.text = "2.00 mm";
  mark.dimension = true;
  s.marks = {mark};
  // From 20.5 mm (2.5 mm around the mark) to the top at 25 mm, not from 0. Across, 1.5 to 8.5 mm is
  // most of the tooth, so all of it is shown: 41 px/mm again, and 4.5 mm are 184.5 px.
  const std::string svg = section_svg(s);
  EXPECT_THAT(svg, HasSubstr("viewBox=\"0 0 438 234.5\""));
  EXPECT_THAT(svg, HasSubstr("2.00 mm"));
}

TEST(SectionDrawing, AnOutlineCutAtAnEdgeIsFilledAndAnotherOpenOneIsNot) {
  Section s = square();
  s.prepared[0].closed = false;
  s.prepared[0].points = {{0, 0}, {0, 5}, {10, 5}, {10, 0}};
  EXPECT_THAT(section_svg(s), HasSubstr("class=\"tooth\""));
  s.prepared[0].points = {{0, 0}, {0, 5}, {10, 5}, {10, 3}};
  EXPECT_THAT(section_svg(s), Not(HasSubstr("class=\"tooth\"")));
  EXPECT_THAT(section_svg(s), HasSubstr("class=\"prepared\""));
}

TEST(SectionDrawing, NothingAndNotFiniteAreDrawnAsNothing) {
  EXPECT_THAT(section_svg({}), HasSubstr("Nothing lies in this section"));
  Section s = square();
  s.prepared[0].points[1].x() = NAN;
  SectionMark mark;
  mark.from.x() = INFINITY;
  s.marks = {mark};
  const std::string svg = section_svg(s);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

CriterionResult tilt(double value, double u = NAN) {
  const Rubric r = parse_rubric(
      "name='r'\ntype='class1'\nsource='s'\npass_points=60\n[[criterion]]\nkey='floor_tilt_deg'\n"
      "unit='deg'\nideal=[-inf,5]\ntolerated=[-inf,10]\nhard_fail=[-inf,20]\nweight=1\nsource='s'"
      "\n",
      "r");
  return judge(r, {{"floor_tilt_deg", value, u, "deg"}}).criteria[0];
}

TEST(Gauge, ShowsBandsMarkAndWhisker) {
  const std::string svg = gauge_svg(tilt(7, 3));
  for (const char* part : {"g-ideal", "g-tolerated", "g-fail", "g-mark", "g-whisker"})
    EXPECT_THAT(svg, HasSubstr(part));
  EXPECT_THAT(gauge_svg(tilt(7)), Not(HasSubstr("g-whisker")));
  EXPECT_EQ(gauge_svg(tilt(NAN)), "");
}

// Limits 5, 10 and 20: drawn from 0 to 27.5 over 174 px, beginning at 8 px.
TEST(Gauge, TheMarkLiesWhereTheValueIs) {
  EXPECT_THAT(gauge_svg(tilt(13.75)), HasSubstr("class=\"g-mark\" d=\"M95 "));
}

TEST(Gauge, AFarValueIsAnArrowAtTheRim) {
  EXPECT_THAT(gauge_svg(tilt(500)), HasSubstr("class=\"g-mark\" d=\"M189 "));
}

}  // namespace
}  // namespace toothprep
