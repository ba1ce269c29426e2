// A workpiece with several bodies: whose contact and whose removal it is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/session/body_warnings.h"
#include "toothprep/step/session/intervals.h"

namespace toothprep::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kBorder = 1.2;  // mm: what lies beyond in x is the neighbour's
const std::vector<Body> kBodies = {{"37", BodyKind::kNeighbour}, {"36", BodyKind::kTooth}};

// An enamel block of 8 mm of which the part beyond the border is another body.
LayeredTooth shared_block(double voxel) {
  LayeredTooth tooth = block(voxel, 8);
  LabelGrid of = make_body_grid(tooth.tissue, 2);
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    std::uint8_t* body = of.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x = tooth.lattice.to_world(of.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7));
      body[v] = x.x() > kBorder ? 1 : 2;
    }
  }
  set_bodies(tooth, kBodies, std::move(of));
  return tooth;
}

// Down through the top face (y = 0), the axis along z within the block, the middle at x = 1.
const std::vector<Vec3> kDownTheBorder = {{1, 1, -1.5}, {1, -2.5, -1.5}};
constexpr double kCutSpeed = 5, kCutRadius = 0.6, kCutLength = 3;

TEST(Bodies, ContactAndRemovalAreSharedAsTheBorderSharesTheBur) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const std::vector<HandleSample> path = straight_path(kDownTheBorder, kCutSpeed);
  for (const double voxel : {0.1, 0.05}) {
    const LayeredTooth tooth = shared_block(voxel);
    const Outcome r = run(tooth, bur, paper_without_stall(), Drive::kDirect, path);
    // Half the cylinder advances, +-90 degrees about the feed; from asin(0.2 / R) on it is in the
    // neighbour. The border of the elements of 0.1 mm is known to one of them.
    const double half_turn = M_PI * kCutRadius * kCutLength;
    const double beyond =
        (M_PI / 2 - std::asin((kBorder - 1) / kCutRadius)) * kCutRadius * kCutLength;
    const StepRecord& deep = r.rows[r.rows.size() - 2];
    ASSERT_EQ(deep.other_bodies[0].body, 1);
    EXPECT_NEAR(deep.other_bodies[0].area, beyond, 0.11 * kCutLength) << voxel;
    EXPECT_LT(deep.other_bodies[0].area, half_turn);
    EXPECT_EQ(deep.other_bodies[1].body, 0);
    // Of the slot with its round bottom: from x = 0.2 to R beside the middle.
    const auto integral = [](double x) {
      return x / 2 * std::sqrt(kCutRadius * kCutRadius - x * x) +
             kCutRadius * kCutRadius / 2 * std::asin(x / kCutRadius);
    };
    const double exact =
        kCutLength * (2.5 * (kCutRadius - 0.2) + integral(kCutRadius) - integral(kBorder - 1));
    ASSERT_EQ(r.totals.bodies.size(), 2U);
    EXPECT_NEAR(r.totals.bodies[0].removed, exact, 0.01 * exact) << voxel;
    double all = 0;
    for (const double v : r.totals.removed) all += v;
    EXPECT_NEAR(r.totals.bodies[0].removed + r.totals.bodies[1].removed, all, 1e-9);
    EXPECT_EQ(r.totals.bodies[1].contact_steps, r.totals.contact_steps);
    EXPECT_LE(r.totals.bodies[0].contact_steps, r.totals.contact_steps);
    // The neighbour is met later, by R - sqrt(R² - 0.2²) of way.
    const double later = kCutRadius - std::sqrt(kCutRadius * kCutRadius - 0.04);
    EXPECT_NEAR(static_cast<double>(r.totals.contact_steps - r.totals.bodies[0].contact_steps),
                later / kCutSpeed / 1e-3, (0.1 + voxel) / kCutSpeed / 1e-3);
    EXPECT_THAT(body_warnings(r.totals, kBodies),
                ElementsAre(HasSubstr("the neighbour 37 was cut")));
  }
}

TEST(Bodies, AListOfThemChangesNoBitOfTheRest) {
  const Bur bur = make_bur("ball:D1.2", "");
  const std::vector<HandleSample> path = straight_path(kDownTheBorder, kCutSpeed);
  const LayeredTooth shared = shared_block(0.1);
  LayeredTooth plain = shared;
  plain.bodies.reset();
  for (const Drive drive : {Drive::kDirect, Drive::kCoupled}) {
    const Outcome a = run(shared, bur, preset_parameters("paper"), drive, path);
    const Outcome b = run(plain, bur, preset_parameters("paper"), drive, path);
    ASSERT_EQ(a.rows.size(), b.rows.size());
    for (std::size_t i = 0; i < a.rows.size(); ++i) {
      ASSERT_EQ(a.rows[i].device_force, b.rows[i].device_force) << i;
      ASSERT_EQ(a.rows[i].bur.position, b.rows[i].bur.position) << i;
      ASSERT_EQ(a.rows[i].contact_area, b.rows[i].contact_area) << i;
      ASSERT_EQ(a.rows[i].removed_volume, b.rows[i].removed_volume) << i;
      ASSERT_EQ(b.rows[i].other_bodies[0].body, 0) << i;
    }
    EXPECT_TRUE(b.totals.bodies.empty());
  }
}

TEST(Bodies, ABurAwayFromNeighboursTouchesNone) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const std::vector<HandleSample> path = straight_path({{0, 1, -1.5}, {0, -2, -1.5}}, kCutSpeed);
  const Outcome r = run(shared_block(0.1), bur, paper_without_stall(), Drive::kDirect, path);
  EXPECT_EQ(r.totals.bodies[0].contact_steps, 0);
  EXPECT_EQ(r.totals.bodies[0].removed, 0);
  EXPECT_GT(r.totals.bodies[1].removed, 1);
  EXPECT_THAT(body_warnings(r.totals, kBodies), IsEmpty());
}

TEST(Bodies, TheVoxelEngineSharesRemovalToo) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  Parameters p = paper_without_stall();
  p.engine = EngineKind::kVoxel;
  const Outcome r =
      run(shared_block(0.1), bur, p, Drive::kDirect, straight_path(kDownTheBorder, kCutSpeed));
  // It removes what lies a voxel or more below the bur's surface: 10 voxels across, of which 3 lie
  // beyond the border; the round bottom takes a little more from the middle.
  double all = 0;
  for (const double v : r.totals.removed) all += v;
  EXPECT_NEAR(r.totals.bodies[0].removed / all, 3.0 / 10, 0.02);
}

TEST(Bodies, UndoTakesBackWhatWasRemovedOfEach) {
  const Bur bur = make_bur("ball:D1.2", "");
  const LayeredTooth tooth = shared_block(0.1);
  Workpiece workpiece(tooth);
  const std::vector<HandleSample> path = straight_path(kDownTheBorder, kCutSpeed);
  Intervals intervals(workpiece, paper_without_stall(), Drive::kDirect);
  const auto go = [&] {
    Session& session = intervals.begin(bur, path.front());
    StepRecord last = session.initial();
    for (std::size_t i = 1; i < path.size(); ++i) last = session.step(path[i]);
    session.finish(last);
    intervals.end();
    return intervals.totals().bodies[0].removed;
  };
  const double once = go();
  EXPECT_GT(once, 0.1);
  ASSERT_TRUE(intervals.undo());
  EXPECT_EQ(intervals.totals().bodies[0].removed, 0);
  EXPECT_NEAR(go(), once, 1e-12) << "the same again on the tooth as it was";
}

}  // namespace
}  // namespace toothprep::testing
