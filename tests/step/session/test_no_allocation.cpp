// The step allocates nothing: neither by new nor by malloc or realloc.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cstdlib>
#include <vector>

#include "../../support/allocation_counter.h"
#include "experiment.h"

namespace toothprep::testing {
namespace {

// What lies beyond x = 0 is a neighbour's.
void share_among_bodies(LayeredTooth& tooth) {
  LabelGrid of = make_body_grid(tooth.tissue, 2);
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    std::uint8_t* body = of.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) body[v] = of.brick_origin(b).x() + (v >> 6) < 0 ? 1 : 2;
  }
  set_bodies(tooth, {{"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}}, std::move(of));
}

TEST(NoAllocation, StepsThatGrindAndCarveAllocateNothing) {
  const Bur bur = paper_cylinder();
  LayeredTooth tooth = block(0.1, 2, Vec3(6, 6, 6));
  Parameters parameters = preset_parameters("paper");
  for (int variant = 0; variant < 6; ++variant) {
    if (variant == 4) share_among_bodies(tooth);  // and with these both drives again
    const Drive drive = variant % 2 == 0 ? Drive::kCoupled : Drive::kDirect;
    parameters.engine = variant / 2 == 1 ? EngineKind::kVoxel : EngineKind::kLevelset;
    const auto path = straight_path({Vec3(0, 0.8, 0.4), Vec3(0.3, -3, 0.2)}, 1.5);
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, parameters, drive, path.front());
    const std::size_t bricks = workpiece.cut().bricks_stored();
    const long before = allocations;
    for (std::size_t i = 1; i < path.size(); ++i) session.step(path[i]);
    EXPECT_EQ(allocations, before);
    EXPECT_GT(workpiece.cut().bricks_stored(), bricks);  // it did carve into new bricks
    EXPECT_GT(session.totals().removed[0], 0);
    if (variant >= 4) {
      EXPECT_GT(session.totals().bodies.at(1).removed, 0);
      EXPECT_GT(session.totals().bodies.at(1).contact_steps, 0);
    }
  }
}

TEST(NoAllocation, TheCounterSeesNewMallocReallocAndAlignedMemory) {
  long counted = allocations;
  std::vector<int> one(1);
  EXPECT_EQ(allocations, ++counted) << one.size();
  void* p = std::malloc(16);
  EXPECT_EQ(allocations, ++counted) << p;
  p = std::realloc(p, 1 << 20);
  EXPECT_EQ(allocations, ++counted) << p;
  std::free(p);
  const Eigen::VectorXd many = Eigen::VectorXd::Zero(1000);
  EXPECT_EQ(allocations, ++counted) << many.size();
  const LayeredTooth small = block(0.5, 1, Vec3(2, 2, 2));
  counted = allocations;
  LevelSet copy = small.solid;  // a pool of bricks, which grows by realloc
  EXPECT_GT(allocations, counted) << copy.bricks_stored();
}

}  // namespace
}  // namespace toothprep::testing
