#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/rig_check/protocol.h"

namespace toothprep {
namespace {

constexpr ProtocolKind kKinds[] = {ProtocolKind::kRest, ProtocolKind::kStep,
                                   ProtocolKind::kStiffnessSweep, ProtocolKind::kDampingSweep,
                                   ProtocolKind::kWall};

std::string error_of(const std::string& text) {
  try {
    parse_protocol(text);
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(Protocol, ANameAloneIsTheDefault) {
  for (const ProtocolKind kind : kKinds) {
    EXPECT_EQ(parse_protocol(name_of(kind)), default_protocol(kind));
    EXPECT_NO_THROW(validate(default_protocol(kind)));
  }
}

TEST(Protocol, WordsAndValuesGoRoundBitForBit) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> part(0.001, 1);
  for (int i = 0; i < 500; ++i)
    for (const ProtocolKind kind : kKinds) {
      Protocol p = default_protocol(kind);
      if (p.duration_s > 0) p.duration_s *= part(random);
      if (p.force_n > 0) p.force_n *= part(random);
      if (p.count > 0) {
        p.from *= part(random);
        p.to /= part(random) * 0.5 + 0.5;
        p.count = 2 + static_cast<int>(part(random) * 98);
        p.hold_s = 0.5 + part(random);
        p.geometric = part(random) > 0.5;
      }
      p.stiffness_n_per_mm *= part(random);
      p.travel_mm *= part(random);
      EXPECT_EQ(parse_protocol(print_protocol(p)), p) << print_protocol(p);
    }
}

TEST(Protocol, ReadsWhatPeopleWrite) {
  const Protocol sweep = parse_protocol("  stiffness-sweep 0.2..2N/mm in 10 steps of 2s ");
  EXPECT_EQ(sweep.from, 0.2);
  EXPECT_EQ(sweep.to, 2);
  EXPECT_EQ(sweep.count, 10);
  EXPECT_EQ(sweep.hold_s, 2);
  EXPECT_FALSE(sweep.geometric);
  EXPECT_EQ(parse_protocol("damping-sweep 1..100 N\u00b7s/m in 5 geometric steps of 1 s"),
            parse_protocol("damping-sweep 1..100 N*s/m in 5 geometric steps of 1 s"));
  EXPECT_EQ(parse_protocol("wall 0.5 N/mm travel 2 mm for 5 s").travel_mm, 2);
}

TEST(Protocol, RefusesWhatItDoesNotUnderstandAndSaysWhatItWould) {
  using ::testing::HasSubstr;
  EXPECT_THAT(error_of("stifness-sweep"), HasSubstr("did you mean \"stiffness-sweep\""));
  EXPECT_THAT(error_of(""), HasSubstr("known: rest, step"));
  EXPECT_THAT(error_of("rest 10 minutes"), HasSubstr("expected 's'"));
  EXPECT_THAT(error_of("step 0.5 N"), HasSubstr("expected 'for' at its end"));
  EXPECT_THAT(error_of("step 0.5 N for 2 s or so"), HasSubstr("expected the end"));
  EXPECT_THAT(error_of("step 50 N for 2 s"), HasSubstr("at most 5"));
  EXPECT_THAT(error_of("step nan N for 2 s"), HasSubstr("expected a number"));
  EXPECT_THAT(error_of("rest -1 s"), HasSubstr("above 0"));
  EXPECT_THAT(error_of("stiffness-sweep 2..0.2 N/mm in 10 steps of 2 s"),
              HasSubstr("above the first"));
  EXPECT_THAT(error_of("stiffness-sweep 0.2..2 N/mm in 1 steps of 2 s"), HasSubstr("at least 2"));
  EXPECT_THAT(error_of("stiffness-sweep 0.2..2 N/mm in 2.5 steps of 2 s"), HasSubstr("steps"));
  EXPECT_THAT(error_of("damping-sweep 1..2 N/mm in 3 steps of 2 s"), HasSubstr("N*s/m"));
}

TEST(Protocol, LevelsFollowEachOtherAfterTheLead) {
  const Protocol p = parse_protocol("stiffness-sweep 1..4 N/mm in 4 steps of 2 s");
  EXPECT_FALSE(protocol_level_at(p, 0.999));
  EXPECT_EQ(protocol_level_at(p, 1.0), 0);
  EXPECT_EQ(protocol_level_at(p, 2.999), 0);
  EXPECT_EQ(protocol_level_at(p, 3.0), 1);
  EXPECT_EQ(protocol_level_at(p, 8.5), 3);
  EXPECT_FALSE(protocol_level_at(p, 9.0));
  EXPECT_FALSE(protocol_level_at(p, std::numeric_limits<double>::quiet_NaN()));
  EXPECT_EQ(protocol_duration(p), 9.0);
  EXPECT_EQ(protocol_level(p, 1), 2);
  EXPECT_EQ(protocol_level(p, 3), 4);
  Protocol g = p;
  g.geometric = true;  // the ratio is 4^(1/3)
  EXPECT_NEAR(protocol_level(g, 1), std::cbrt(4), 1e-15);
  EXPECT_EQ(protocol_level(g, 3), 4);
}

TEST(Protocol, AStepIsOnInTheMiddleHalf) {
  const Protocol p = parse_protocol("step 0.5 N for 4 s");
  EXPECT_FALSE(protocol_step_on(p, 0.5));
  EXPECT_FALSE(protocol_step_on(p, 1.999));
  EXPECT_TRUE(protocol_step_on(p, 2.0));
  EXPECT_TRUE(protocol_step_on(p, 3.999));
  EXPECT_FALSE(protocol_step_on(p, 4.0));
}

}  // namespace
}  // namespace toothprep
