#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/tools/score_report/markup.h"

namespace toothprep {
namespace {

TEST(Markup, WhatIsMarkupIsEscaped) {
  EXPECT_EQ(escaped("<a href=\"x\">'&'</a>"),
            "&lt;a href=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/a&gt;");
}

TEST(Markup, Utf8StaysAndWhatIsNotIsReplaced) {
  EXPECT_EQ(escaped("Müller ° 歯 🦷"), "Müller ° 歯 🦷");
  const std::string r = "\xEF\xBF\xBD";
  EXPECT_EQ(escaped("\xff"), r);
  EXPECT_EQ(escaped("a\xc3"), "a" + r);                   // cut off
  EXPECT_EQ(escaped("\xc0\xbc"), r + r);                  // overlong '<'
  EXPECT_EQ(escaped("\xed\xa0\x80"), r + r + r);          // a surrogate
  EXPECT_EQ(escaped("\xf5\x80\x80\x80"), r + r + r + r);  // beyond U+10FFFF
  EXPECT_EQ(escaped(std::string("a\0b\x01\n", 5)), "a" + r + "b" + r + "\n");
}

TEST(Markup, NumbersAreShort) {
  EXPECT_EQ(short_number(12.50), "12.5");
  EXPECT_EQ(short_number(3), "3");
  EXPECT_EQ(short_number(100), "100");
  EXPECT_EQ(short_number(-0.001), "0");
  EXPECT_EQ(short_number(0.12345, 4), "0.1235");
  EXPECT_EQ(short_number(NAN), "0");
}

// The smallest double's first digit but zero is the 324th behind the point; 750 more are exact.
TEST(Markup, ANumberOfManyDigitsIsNotCut) {
  EXPECT_EQ(short_number(5e-324, 324), "0." + std::string(323, '0') + "5");
  EXPECT_GT(short_number(5e-324, 420).size(), 410U);
}

// RFC 4648, section 10.
TEST(Markup, Base64) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST(Markup, TicksAreOneTwoOrFive) {
  for (const double span : {0.003, 0.7, 1.0, 9.9, 42.0, 12345.0}) {
    const double step = tick_step(span, 4);
    EXPECT_GE(span / step, 4 - 1e-9);
    EXPECT_LE(span / step, 10 + 1e-9);
    const double mantissa = step / std::pow(10, std::floor(std::log10(step) + 1e-9));
    EXPECT_TRUE(std::abs(mantissa - 1) < 1e-9 || std::abs(mantissa - 2) < 1e-9 ||
                std::abs(mantissa - 5) < 1e-9)
        << mantissa;
  }
  EXPECT_EQ(tick_text(0.3, 0.1), "0.3");
  EXPECT_EQ(tick_text(0.30000000000000004, 0.05), "0.3");
  EXPECT_EQ(tick_text(20, 10), "20");
}

}  // namespace
}  // namespace toothprep
