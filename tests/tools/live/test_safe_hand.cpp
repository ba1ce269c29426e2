// Readings that can't be true, starts and clutches: what the tick makes of them, reading by reading.
#include <gtest/gtest.h>

#include <optional>

#include "live_experiment.h"

namespace toothprep::testing {
namespace {

// A hand whose readings are given as they are, without a device.
class Hand {
 public:
  explicit Hand(const LiveButtons& buttons = {}, const Vec3& from = Vec3(-4.8, -2, 0))
      : loop_(no_watch(), buttons, &rows_), position_(from) {
    loop_.tick(reading(position_));
    HandleSample first;
    first.pose = {position_, orientation_};
    session_.emplace(bur_, workpiece_, parameters_, Drive::kCoupled, first);
    loop_.begin(*session_, HandleFrame(same_frame(), Vec3::Zero(), Vec3::Zero()), same_frame(), {},
                1e-3);
    tick(position_);
  }

  // A tick with the hand there, whether it was there before or not.
  Vec3 tick(const Vec3& position, DeviceFault fault = DeviceFault::kNone) {
    DeviceReading r = reading(position);
    r.fault = fault;
    const Vec3 force = loop_.tick(r);
    steepest_ = std::max(steepest_, (force - force_).norm());
    force_ = force;
    return force;
  }
  // In straight steps; 1 kHz.
  void move(const Vec3& to, double speed) {
    const Vec3 from = position_;
    const int steps = static_cast<int>(std::ceil((to - from).norm() / speed * 1e3));
    for (int i = 1; i <= steps; ++i) {
      position_ = from + (to - from) * i / steps;
      tick(position_);
    }
  }
  void rest(int ticks) {
    for (int i = 0; i < ticks; ++i) tick(position_);
  }
  void turn(double angle, int ticks) {
    for (int i = 0; i < ticks; ++i) {
      orientation_ = orientation_ * Quat(Eigen::AngleAxisd(angle / ticks, Vec3::UnitX()));
      tick(position_);
    }
  }
  void pause(double seconds) { time_ += seconds; }
  void press(std::uint32_t buttons) { buttons_ = buttons; }
  void hold(bool held) { switch_ = held; }
  double removed() { return session_->totals().removed[0]; }
  const std::vector<LiveTick>& rows() {
    loop_.finish();
    return rows_.ticks;
  }

  LiveLoop& loop() { return loop_; }
  const Vec3& position() const { return position_; }
  const Vec3& force() const { return force_; }
  double steepest() const { return steepest_; }

 private:
  DeviceReading reading(const Vec3& position) {
    DeviceReading r;
    r.tick = tick_++;
    r.time = time_ += 1e-3;
    r.hand.position = position;
    r.hand.orientation = orientation_;
    r.hand.buttons = buttons_;
    r.hand.safety_switch = switch_;
    return r;
  }

  Rows rows_;
  LiveLoop loop_;
  Vec3 position_, force_ = Vec3::Zero();
  Quat orientation_ = orientation_of_axis(Vec3(0, 1, 0));
  std::uint32_t buttons_ = 0;
  std::optional<bool> switch_;
  std::int64_t tick_ = 0;
  double time_ = 0, steepest_ = 0;
  LayeredTooth tooth_ = enamel_block();
  Workpiece workpiece_{tooth_};
  Bur bur_ = paper_cylinder();
  Parameters parameters_ = preset_parameters("paper");
  std::optional<Session> session_;
};

// Into the block at 2 mm/s until the bur is in the cut and the force is there.
void into_the_cut(Hand& hand) {
  hand.move(Vec3(-3.2, -2, 0), 2);
  ASSERT_GT(hand.force().norm(), 0.1);
}

TEST(ReadingFarAway, ForOneTickCutsNothingAndIsNotFelt) {
  Hand hand;
  into_the_cut(hand);
  const double removed = hand.removed();
  EXPECT_EQ(hand.tick(hand.position() + Vec3(0, -20, 0)), Vec3(Vec3::Zero()));
  EXPECT_EQ(hand.removed(), removed);
  EXPECT_EQ(hand.loop().status().reading, ReadingFault::kJump);
  const Vec3 next = hand.tick(hand.position());
  EXPECT_LT(next.norm(), 0.05) << "it is ramped in";
  hand.move(Vec3(-3.0, -2, 0), 2);
  EXPECT_EQ(hand.loop().status().reading, ReadingFault::kNone);
  const auto& rows = hand.rows();
  const auto rejected = std::count_if(rows.begin(), rows.end(),
                                      [](const LiveTick& t) { return t.row.handle.rejected; });
  EXPECT_EQ(rejected, 1);
}

TEST(ReadingFarAway, ForGoodEndsTheSessionAndCutsNothing) {
  Hand hand;
  into_the_cut(hand);
  const double removed = hand.removed();
  const Vec3 away = hand.position() + Vec3(1, -6, 3);
  for (int i = 0; i < 150; ++i) EXPECT_EQ(hand.tick(away), Vec3(Vec3::Zero()));
  EXPECT_TRUE(hand.loop().status().hand_lost);
  EXPECT_EQ(hand.removed(), removed);
}

TEST(ReadingThatIsNotFinite, HoldsTheBurWhereItIs) {
  Hand hand;
  into_the_cut(hand);
  const double removed = hand.removed();
  for (int i = 0; i < 50; ++i)
    EXPECT_EQ(hand.tick(hand.position(), DeviceFault::kBadReading), Vec3(Vec3::Zero()));
  EXPECT_EQ(hand.removed(), removed);
  EXPECT_FALSE(hand.loop().status().hand_lost);
}

TEST(Pause, OfTheProgramRampsTheForceInAgain) {
  Hand hand;
  into_the_cut(hand);
  hand.pause(3);
  EXPECT_LT(hand.tick(hand.position()).norm(), 0.05);
}

TEST(Replay, LeavesTheRejectedTicksOutAndMatchesToTheBit) {
  Hand hand;
  into_the_cut(hand);
  for (int i = 0; i < 7; ++i) hand.tick(hand.position() + Vec3(0, -20, 0));
  hand.move(Vec3(-2.9, -2, 0), 2);
  const auto& rows = hand.rows();
  std::vector<HandleSample> path;
  for (const LiveTick& t : rows) path.push_back(t.row.handle);
  const LayeredTooth tooth = enamel_block();
  Workpiece workpiece(tooth);
  const ReplayResult again =
      replay(paper_cylinder(), workpiece, preset_parameters("paper"), Drive::kCoupled, path);
  EXPECT_EQ(again.totals.rejected_steps, 7);
  for (std::size_t n = 0; n < path.size(); ++n) {
    ASSERT_EQ(again.rows[n].bur.position, rows[n].row.bur.position) << n;
    ASSERT_EQ(again.rows[n].device_force, rows[n].row.device_force) << n;
    ASSERT_EQ(again.rows[n].removed_volume, rows[n].row.removed_volume) << n;
  }
}

TEST(Pedal, ThatIsHeldAtTheStartStartsNothingUntilItWasReleased) {
  Hand hand({1, 0});
  hand.press(1);
  hand.move(Vec3(-3.2, -2, 0), 2);
  EXPECT_EQ(hand.removed(), 0);
  EXPECT_TRUE(hand.loop().status().locked);
  hand.press(0);
  hand.rest(1);
  hand.press(1);
  hand.move(Vec3(-2.2, -2, 0), 2);  // removal is due every voxel of the bur's way
  EXPECT_GT(hand.removed(), 0);
  EXPECT_FALSE(hand.loop().status().locked);
}

TEST(BurWithoutAPedal, TurnsOnlyAfterItWasClearOfTheToothForHalfASecond) {
  Hand near({}, Vec3(-3.65, -2, 0));
  near.move(Vec3(-3.2, -2, 0), 2);  // at the tooth within 25 ms
  near.rest(1000);
  EXPECT_EQ(near.removed(), 0);
  near.move(Vec3(-4.5, -2, 0), 5);
  near.rest(500);
  near.move(Vec3(-2.5, -2, 0), 1);
  EXPECT_GT(near.removed(), 0);
}

TEST(Clutch, HoldsThePoseAndFadesTheForce) {
  // What the bur removes as it comes to rest at the held handle, while the hand turns and moves away, or all but rests.
  const auto removed = [](bool away) {
    Hand hand({0, 2});
    into_the_cut(hand);
    hand.press(2);
    hand.move(hand.position() + Vec3(0, 0.05, 0), 0.5);
    EXPECT_EQ(hand.force(), Vec3(Vec3::Zero()));
    hand.move(hand.position() + Vec3(0, 0.2, 0), 0.5);
    const double before = hand.removed();
    if (away)
      hand.turn(1.0, 500);
    else
      hand.move(hand.position() + Vec3(0, 0.05, 0), 0.1);
    hand.move(hand.position() + (away ? Vec3(0, 8, 5) : Vec3(0, 0.08, 0.05)), away ? 40 : 0.4);
    const double after = hand.removed();
    hand.press(0);
    hand.rest(1);
    EXPECT_LT(hand.force().norm(), 0.05) << "it is ramped in";
    return after - before;
  };
  EXPECT_EQ(removed(true), removed(false));  // turning it without the clutch took 0.13 mm³ more
}

TEST(SafetySwitch, OfAStylusThatNobodyHoldsTakesTheForceAtOnceAndCutsNothing) {
  Hand hand;
  hand.hold(true);
  into_the_cut(hand);
  const double removed = hand.removed();
  hand.hold(false);
  EXPECT_EQ(hand.tick(hand.position()), Vec3(Vec3::Zero()));
  EXPECT_TRUE(hand.loop().status().let_go);
  hand.move(Vec3(-2.5, -2, 0), 20);  // it falls into the tooth
  EXPECT_EQ(hand.force(), Vec3(Vec3::Zero()));
  EXPECT_EQ(hand.removed(), removed);
  hand.hold(true);
  hand.rest(1);
  EXPECT_LT(hand.force().norm(), 0.05) << "it is ramped in";
  hand.rest(1000);
  EXPECT_EQ(hand.removed(), removed) << "the motor waits until the bur was clear of the tooth";
  const auto& rows = hand.rows();
  const auto open = std::count_if(rows.begin(), rows.end(),
                                  [](const LiveTick& t) { return t.flags & kSwitchOpen; });
  EXPECT_NEAR(static_cast<double>(open), 1 + 35, 1) << "steps of the last move are rounded up";
}

TEST(SafetySwitch, ThatIsIgnoredIsRecordedOnly) {
  Hand hand({0, 0, false});
  hand.hold(false);
  into_the_cut(hand);
  EXPECT_GT(hand.force().norm(), 0.1);
  EXPECT_TRUE(hand.rows().back().flags & kSwitchOpen);
}

TEST(Force, IsRampedOutOnRequestWithoutAKick) {
  Hand hand;
  into_the_cut(hand);
  const double before = hand.force().norm();
  Hand& h = hand;
  h.loop().fade_out(true);
  Vec3 last = h.force();
  int ticks = 0;
  for (; ticks < 200 && !h.loop().status().faded; ++ticks) {
    h.rest(1);
    EXPECT_LT((h.force() - last).norm(), before / 20) << ticks;
    last = h.force();
  }
  EXPECT_NEAR(ticks, 50, 5);
  EXPECT_EQ(h.force(), Vec3(Vec3::Zero()));
}

}  // namespace
}  // namespace toothprep::testing
