#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/placement/path_check.h"
#include "toothprep/tools/preparation_paths/cavity_plan.h"
#include "toothprep/tools/preparation_paths/crown_plan.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

// The molar's own frame: z occlusal, x mesial, origin in its central fossa (tests of specimens).
Pose molar_frame() {
  Mat3 axes;
  axes << Vec3(0, -1, 0), Vec3(1, 0, 0), Vec3(0, 0, 1);
  return {Vec3(6.1, 5.3, 16.4), Quat(axes)};
}

struct Molar {
  LayeredTooth tooth = make_molar({0.3});
  ToothGrid grid{tooth, molar_frame(), 0.15};
  CavityGround ground{Vec2::Zero(), Vec2::UnitX(), {}};
};
const Molar& molar() {
  static const Molar the_one;
  return the_one;
}
const Bur& bur57() {
  static const Bur bur = bur_from_shorthand("cylinder:D1.0xL4.0");
  return bur;
}

// Its lobes meet along a line within 1 mm of the axis, whatever direction the grid has.
TEST(Fissure, OfTheMolarRunsFromMesialToDistalInAnyFrame) {
  for (const double turn : {0.0, 0.4, 1.9}) {
    Pose frame = molar_frame();
    frame.orientation = frame.orientation * Quat(Eigen::AngleAxisd(turn, Vec3::UnitZ()));
    const ToothGrid grid(molar().tooth, frame, 0.15);
    const Vec2 mesial(std::cos(turn), -std::sin(turn));
    const Fissure fissure = find_fissure(grid, crown_map(grid), {Vec2(0, 0), mesial, 2.3, 5});
    const Vec3 along = frame.orientation * Vec3(fissure.direction.x(), fissure.direction.y(), 0);
    EXPECT_GT(std::abs(along.y()), std::cos(units::from_degree(15))) << turn;
    EXPECT_GT(length_of(fissure.points), 3.5);
    for (const Vec2& p : fissure.points)
      EXPECT_LT(std::abs(frame.to_world({p.x(), p.y(), 0}).x() - 6.1), 1.0);
  }
}

// A round crown of 10 mm, its top at z = `height(x, y)`.
template <class Height>
LayeredTooth crown_with(const Height& height) {
  const auto field = [&](const Vec3& x) {
    ToothSample s;
    const double across = std::hypot(x.x(), x.y()) - 5;
    s.solid = static_cast<float>(std::max({across, x.z() - height(x.x(), x.y()), -3 - x.z()}));
    s.tissue = {s.solid, 9, 9};
    if (s.solid < 0) s.label = Tissue::kEnamel;
    return s;
  };
  return build_tooth({Vec3::Zero(), 0.2}, Index3::Constant(-32), Index3::Constant(32), field, true);
}

TEST(Fissure, APlateauShowsNoDirection) {
  const LayeredTooth tooth = crown_with([](double, double) { return 3.0; });
  const ToothGrid grid(tooth, Pose{}, 0.2);
  EXPECT_THROW(static_cast<void>(find_fissure(grid, crown_map(grid), {Vec2(0, 0), {}, 2, 5})),
               Error);
}

// Real fissures end in slits and pits far below the floor of their groove.
TEST(Fissure, APitInTheFossaIsNoOutlineOfTheTooth) {
  const LayeredTooth tooth = crown_with([](double x, double y) {
    const double groove = 3 - std::max(0.0, 1 - std::abs(y) / 1.5) * (std::abs(x) < 3.5 ? 1 : 0);
    return std::hypot(x, y) < 0.25 ? groove - 2 : groove;
  });
  const ToothGrid grid(tooth, Pose{}, 0.1);
  const CrownMap map = crown_map(grid);
  const Fissure one = find_fissure(grid, map, {Vec2(0, 0), Vec2(1, 0.2), 2.3, 5});
  const Fissure other = find_fissure(grid, map, {Vec2(0, 0), Vec2(-1, -0.2), 2.3, 5});
  EXPECT_GT(length_of(one.points), 4.5);
  for (const Vec2& p : one.points) EXPECT_LT(std::abs(p.y()), 0.3);
  EXPECT_NEAR(length_of(one.points), length_of(other.points), 0.15);
  EXPECT_LT((one.points.front() - other.points.back()).norm(), 0.2);
}

TEST(Class1, TheFloorIsFlatAndAsDeepAsAskedFor) {
  CavityShape shape;
  shape.depth = 1.6;
  const Plan plan = plan_class1(molar().grid, bur57(), shape, molar().ground);
  double lowest = 1e9;
  for (const Stroke& s : plan.strokes) {
    lowest = std::min(lowest, s.to.z());
    EXPECT_LT((s.axis - Vec3::UnitZ()).norm(), 1e-12);
  }
  for (const Stroke& s : plan.strokes) {
    if (s.pace == Pace::kFinishing) {
      EXPECT_NEAR(s.to.z(), lowest, 1e-9);
    }
  }
  // The fissure lies below the median of the surface over the floor.
  EXPECT_LT(lowest, -0.9);
  EXPECT_GT(lowest, -1.6);
}

TEST(Class1, WidthBelowTheBursDiameterIsRefused) {
  CavityShape shape;
  shape.width = 0.9;
  EXPECT_THROW(static_cast<void>(plan_class1(molar().grid, bur57(), shape, molar().ground)), Error);
}

TEST(Class2, TheBoxOpensTheSideThatXPointsTo) {
  const Plan plan = plan_class2(molar().grid, bur57(), {}, molar().ground);
  double lowest = 1e9, outermost = -1e9;
  for (const Stroke& s : plan.strokes) lowest = std::min(lowest, s.to.z());
  for (const Stroke& s : plan.strokes)
    if (s.to.z() < lowest + 0.1) outermost = std::max(outermost, s.to.x());
  EXPECT_GT(outermost, 5.3);             // beyond the mesial surface, 5.3 mm from the axis
  EXPECT_GT(lowest + 16.4, 12.6 + 0.5);  // above the neck at z = 12.6 on that side (molar.cpp)
}

// The feeds keep torque and force in their limits by the closed forms: a slot of 0.4 x 1 mm in enamel
// takes u·0.4·1 per mm of way.
TEST(Feeds, ASlotInEnamelIsFedAtTheForceOfTheClosedForm) {
  const LayeredTooth& tooth = molar().tooth;
  const ToothGrid& grid = molar().grid;
  const Parameters p = preset_parameters("paper");
  Plan plan = plan_class1(grid, bur57(), {}, molar().ground);
  choose_feeds(plan, grid, bur57(), p, Drive::kCoupled);
  double slowest = 1e9, fastest = 0;
  for (const Stroke& s : plan.strokes) {
    ASSERT_GT(s.speed, 0);
    slowest = std::min(slowest, s.speed);
    fastest = std::max(fastest, s.speed);
  }
  EXPECT_NEAR(fastest, 6, 1e-9);
  // 0.5 N at most: full slots of 0.45 mm allow 4αN·0.5/(u·0.45) = 0.37 mm/s; twice that where it
  // plunges or cells are counted twice.
  EXPECT_GT(slowest, 0.03);
  EXPECT_LT(slowest, 0.4);
  EXPECT_FALSE(tooth.provenance.empty());
}

TEST(Feeds, ALawBeyondThePapersIsRefused) {
  Parameters p = preset_parameters("paper");
  p.tissue[0].up_cutting = 0.2;
  Plan plan = plan_class1(molar().grid, bur57(), {}, molar().ground);
  EXPECT_THROW(choose_feeds(plan, molar().grid, bur57(), p, Drive::kCoupled), Error);
}

TEST(Script, ReadsBackAsTheSamePath) {
  Plan plan = plan_class1(molar().grid, bur57(), {}, molar().ground);
  choose_feeds(plan, molar().grid, bur57(), preset_parameters("paper"), Drive::kDirect);
  const Trajectory path = parse_script(script_of(plan, molar_frame(), "test"), "test");
  EXPECT_NEAR(path.samples.back().time, duration(plan), 0.01 * duration(plan));  // speeds: 3 digits
  EXPECT_LT(
      (path.samples.back().pose.position - molar_frame().to_world(plan.strokes.back().to)).norm(),
      1e-4);
  const PathCheck check = check_path(molar().tooth, molar_frame(), bur57(), path.samples);
  EXPECT_GT(check.clearance_at_start, 1);
  EXPECT_GT(*check.least_to_pulp, 1);
  EXPECT_EQ(check.shank_overlap, 0);
}

TEST(Crown, TheMarginStaysAboveTheNeckAllAround) {
  const Bur bur = bur_from_shorthand("cone:D1.8xL8.0xA2xR0.3");
  const Plan plan = plan_crown(molar().grid, bur, {});
  double lowest = 1e9;
  for (const Stroke& s : plan.strokes) lowest = std::min(lowest, s.to.z() + 16.4);
  EXPECT_GT(lowest, 11.4 + 0.4);  // the neck's lowest place is at z = 11.4 (molar.cpp)
  EXPECT_LT(lowest, 11.4 + 1.1);
  CrownShape shape;
  shape.margin_width = 2;
  EXPECT_THROW(static_cast<void>(plan_crown(molar().grid, bur, shape)), Error);
}

}  // namespace
}  // namespace toothprep
