// Which readings of a hand are believed.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live/reading_check.h"

namespace toothprep {
namespace {

using F = ReadingFault;

// A hand that moves at 1 kHz, 30 mm/s with tremor, as encoders of 0.023 mm see it.
DeviceReading reading(int tick) {
  DeviceReading r;
  r.tick = tick;
  r.time = 1e-3 * tick;
  const double x = 0.03 * tick + 0.1 * std::sin(2 * 3.14159 * 9 * r.time);
  r.hand.position = Vec3(0.023 * std::round(x / 0.023), 0, 0.023 * std::round(0.5 * x / 0.023));
  r.hand.orientation = Quat(Eigen::AngleAxisd(0.001 * tick, Vec3::UnitX()));
  return r;
}

class Readings : public ::testing::Test {
 protected:
  F judge(const DeviceReading& r) { return check_.judge(r); }
  int good(int from, int to) {  // how many are rejected
    int rejected = 0;
    for (int i = from; i < to; ++i) rejected += judge(reading(i)) != F::kNone;
    return rejected;
  }
  ReadingCheck check_{ReadingLimits{}};
};

TEST_F(Readings, OfAHandAreAllBelieved) { EXPECT_EQ(good(0, 5000), 0); }

TEST_F(Readings, OfAFastHandInTheAirAreBelieved) {
  // 0.15 m at 2.5 Hz: 1.2 m/s, 18 m/s².
  for (int i = 0; i < 3000; ++i) {
    DeviceReading r = reading(i);
    r.hand.position = Vec3(75 * std::sin(2 * 3.14159 * 2.5 * r.time), 0, 0);
    EXPECT_EQ(judge(r), F::kNone) << i;
  }
}

TEST_F(Readings, ThatComeLateAreBelieved) {
  int tick = 0;
  for (int i = 0; i < 500; ++i) {
    EXPECT_EQ(judge(reading(tick)), F::kNone) << tick;
    tick += i % 7 == 3 ? 12 : 1;
  }
}

TEST_F(Readings, OfOneTickFarAwayAreRejectedAndTheNextOnesBelieved) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading glitch = reading(1000);
  glitch.hand.position.y() += 20;
  EXPECT_EQ(judge(glitch), F::kJump);
  EXPECT_EQ(judge(reading(1001)), F::kNone);
  EXPECT_TRUE(check_.resumed());
  EXPECT_EQ(good(1002, 2000), 0);
  EXPECT_FALSE(check_.resumed());
}

TEST_F(Readings, AMillimetreAwayAreRejectedToo) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading glitch = reading(1000);
  glitch.hand.position.y() += 1;
  EXPECT_EQ(judge(glitch), F::kJump);
}

TEST_F(Readings, ThatStayElsewhereAreNeverBelievedAndTheHandIsLostAfterATenthOfASecond) {
  EXPECT_EQ(good(0, 1000), 0);
  for (int i = 1000; i < 1200; ++i) {
    DeviceReading r = reading(i);
    r.hand.position.y() += 20;
    EXPECT_NE(judge(r), F::kNone) << i;
    EXPECT_EQ(check_.lost(), i > 1100 - 1) << i;
  }
}

TEST_F(Readings, ThatAreRightAgainLeaveAHandThatMovedOnTimeToComeBack) {
  for (const bool finite : {true, false}) {
    check_ = ReadingCheck{ReadingLimits{}};
    EXPECT_EQ(good(0, 1000), 0);
    for (int i = 1000; i < 1040; ++i) {
      DeviceReading wrong = reading(i);
      wrong.hand.position.y() += 20;
      if (!finite) wrong.hand = reading(999).hand, wrong.fault = DeviceFault::kBadReading;
      EXPECT_EQ(judge(wrong), finite ? F::kJump : F::kNotFinite);
    }
    for (int i = 1040; i < 3000; ++i) {
      DeviceReading moved_on = reading(i);
      moved_on.hand.position.y() += 12;
      EXPECT_EQ(judge(moved_on), F::kGap) << i;
    }
    EXPECT_FALSE(check_.lost());
    DeviceReading back = reading(3000);
    back.hand = reading(1000).hand;
    EXPECT_EQ(judge(back), F::kNone);
  }
}

TEST_F(Readings, ThatJumpAndJumpLoseTheHandAfterATenthOfASecond) {
  EXPECT_EQ(good(0, 1000), 0);
  int last = 1000;
  for (; last < 3000 && !check_.lost(); ++last) {
    DeviceReading wrong = reading(last);
    wrong.hand.position.y() += last % 2 ? 20 : -20;
    EXPECT_NE(judge(wrong), F::kNone);
  }
  EXPECT_NEAR(last, 1100, 5);
}

TEST_F(Readings, OfAHandThatMovedDuringAPauseLeaveItTimeToComeBack) {
  EXPECT_EQ(good(0, 1000), 0);
  for (int i = 1000; i < 6000; ++i) {
    DeviceReading moved_on = reading(i);
    moved_on.time += i < 3000 ? 0.115 : 0.3;  // and another pause
    moved_on.hand.position.y() += i < 3000 ? 12 : 20;
    EXPECT_EQ(judge(moved_on), F::kGap) << i;
  }
  EXPECT_FALSE(check_.lost());
}

TEST_F(Readings, AfterALateOneMayBeAsOldAsThat) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading late = reading(1000);
  late.time += 0.04;  // what it read before the pause
  EXPECT_EQ(judge(late), F::kNone);
  EXPECT_EQ(judge(reading(1041)), F::kNone);
}

// A hand on a straight way, and a servo that is held up after a second: readings that are as old as
// the tick before, or not, and a second hold-up soon after the first.
class HeldUp : public Readings {
 protected:
  struct Pause {
    double length;  // s, of the tick before the reading
    bool old;       // it was made before the pause
  };
  static DeviceReading at(double time, double made, double speed) {
    DeviceReading r;
    r.time = time;
    r.hand.position = Vec3(0.023 * std::round(1e3 * speed * made / 23), 0, 0);
    r.hand.orientation = Quat(Eigen::AngleAxisd(1e-3 * speed * made, Vec3::UnitX()));
    return r;
  }
  // The time after two pauses with `between` ticks between them; no reading may be rejected.
  double through(double speed, Pause first, int between, Pause second) {
    double time = 0;
    const auto tick = [&](double length, bool old) {
      const double made = old && length > 2e-3 ? time + 1e-4 : time + length;
      time += length;
      EXPECT_EQ(judge(at(time, made, speed)), F::kNone)
          << "hand at " << speed << " mm/s, held up for " << first.length
          << (first.old ? " old" : "") << ", " << between << " ticks later for " << second.length
          << (second.old ? " old" : "") << ", at " << time;
    };
    for (int i = 0; i < 1000; ++i) tick(1e-3, false);
    tick(first.length, first.old);
    for (int i = 0; i < between; ++i) tick(i == 0 ? 2e-4 : 1e-3, false);
    tick(second.length, second.old);
    tick(2e-4, false);
    for (int i = 0; i < 20; ++i) tick(1e-3, false);
    return time;
  }
};

TEST_F(HeldUp, ReadingsAreAllBelieved) {
  const double pauses[] = {1e-3, 2.3e-3, 4e-3, 12e-3, 0.0497, 0.0503, 0.0717, 0.4, 12};
  for (const double speed : {0.0, 5.0, 23.0, 300.0, 1000.0})
    for (const double first : pauses)
      for (const double second : pauses)
        for (const int between : {0, 1, 2, 15})
          for (const int old : {0, 1, 2, 3}) {
            // A hand that goes on for so long is elsewhere, by the rule of the gap.
            if (speed > 0 && std::max(first, second) > 0.1) continue;
            check_ = ReadingCheck{ReadingLimits{}};
            through(speed, {first, (old & 1) != 0}, between, {second, (old & 2) != 0});
            if (HasFailure()) return;
          }
}

TEST_F(HeldUp, HandsAreNotKickedByAReadingAside) {
  for (const bool old : {false, true}) {
    check_ = ReadingCheck{ReadingLimits{}};
    double time = through(23, {0.06, old}, 1, {1e-3, false});
    const double last = time;
    time += 0.06;
    EXPECT_EQ(judge(at(time, old ? last + 1e-4 : time, 23)), F::kNone);
    EXPECT_TRUE(check_.resumed());
    time += 2e-4;
    DeviceReading aside = at(time, time, 23);
    aside.hand.position.y() += 5;
    EXPECT_EQ(judge(aside), F::kGap) << "5 mm aside";
    EXPECT_EQ(judge(at(time + 1e-3, time + 1e-3, 23)), F::kNone) << "back on its way";
    EXPECT_TRUE(check_.resumed());
  }
}

TEST_F(HeldUp, APoseIsNotTakenForFrozen) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading same = reading(999);
  same.time += 2;
  EXPECT_EQ(judge(same), F::kNone) << "it was made before the pause";
  EXPECT_TRUE(check_.resumed());
  DeviceReading next = reading(1000);
  next.time = same.time + 1e-3;
  EXPECT_EQ(judge(next), F::kNone);
}

TEST_F(HeldUp, AHandThatMovedHasTenSecondsOfReadingsToComeBack) {
  for (const bool old : {false, true}) {
    check_ = ReadingCheck{ReadingLimits{}};
    EXPECT_EQ(good(0, 1000), 0);
    if (old) {
      DeviceReading r = reading(999);
      r.time = 3600;  // the program was stopped for an hour
      EXPECT_EQ(judge(r), F::kNone);
    }
    int last = 1;
    for (; last < 20000 && !check_.lost(); ++last) {
      DeviceReading r = reading(last);
      r.time += last < 4000 ? 3600 : 7200;  // and for another
      r.hand.position.y() += 1000;
      EXPECT_EQ(judge(r), F::kGap) << last;
    }
    EXPECT_NEAR(last, 9950, 60);
  }
}

TEST_F(Readings, OfAFastHandAreBelievedAfterEachOfTwoGlitches) {
  for (int i = 0; i < 1100; ++i) {
    DeviceReading r = reading(i);
    r.hand.position = Vec3(0.4 * i, 0, 0);
    const bool glitch = i == 1000 || i == 1002;
    if (glitch) r.hand.position.y() = 20;
    EXPECT_EQ(judge(r) != F::kNone, glitch) << i;
  }
}

TEST_F(Readings, OfAnOrientationThatJumpsAreRejected) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading r = reading(1000);
  r.hand.orientation = r.hand.orientation * Quat(Eigen::AngleAxisd(0.6, Vec3::UnitY()));
  EXPECT_EQ(judge(r), F::kTurned);
}

TEST_F(Readings, ThatTheServoFoundNotFiniteAreRejected) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading r = reading(999);  // the last good one is held
  for (int i = 1000; i < 1200; ++i) {
    r.time = 1e-3 * i;
    r.fault = DeviceFault::kBadReading;
    EXPECT_EQ(judge(r), F::kNotFinite);
  }
  EXPECT_TRUE(check_.lost());
}

TEST_F(Readings, OfAPoseThatFreezesWhileTheHandMovesAreRejectedUntilItChanges) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading r = reading(1000);
  int first = 0;
  for (int i = 1000; i < 2000; ++i) {
    r.time = 1e-3 * i;
    if (judge(r) == F::kFrozen && first == 0) first = i;
  }
  EXPECT_NEAR(first, 1250, 2);
  EXPECT_FALSE(check_.lost()) << "it may come back for ten seconds";
  r.time = 2;
  r.hand.position.x() += 0.023;
  EXPECT_EQ(judge(r), F::kNone);
  EXPECT_TRUE(check_.resumed());
}

TEST_F(Readings, OfAHandThatRestsFromTheStartAreBelieved) {
  DeviceReading r = reading(500);
  for (int i = 0; i < 3000; ++i) {
    r.time = 1e-3 * i;
    EXPECT_EQ(judge(r), F::kNone) << i;
  }
}

TEST_F(Readings, AfterAPauseCountOnlyWhereTheHandWas) {
  EXPECT_EQ(good(0, 1000), 0);
  DeviceReading r = reading(999);
  r.time = 4;  // the program was stopped
  r.hand.position.y() += 30;
  EXPECT_EQ(judge(r), F::kGap);
  EXPECT_FALSE(check_.lost());
  r.time = 6;
  r.hand.position.y() -= 29.8;
  EXPECT_EQ(judge(r), F::kNone);
  EXPECT_TRUE(check_.resumed());
}

TEST_F(Readings, FarOutsideOfTheWorkspaceAreRejected) {
  ReadingLimits limits;
  limits.workspace = Eigen::AlignedBox3d(Vec3(-80, -60, -35), Vec3(80, 60, 35));
  ReadingCheck check(limits);
  DeviceReading r = reading(0);
  r.hand.position = Vec3(150, 0, 0);
  EXPECT_EQ(check.judge(r), F::kNone) << "usable workspaces are smaller than the arm's reach";
  ReadingCheck other(limits);
  r.hand.position = Vec3(165, 0, 0);
  EXPECT_EQ(other.judge(r), F::kOutside);
}

TEST(ReadingLimits, ThatMeanNothingAreRefused) {
  ReadingLimits limits;
  limits.speed = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(ReadingCheck{limits}, Error);
}

}  // namespace
}  // namespace toothprep
