// The display's surface while a session grinds.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <thread>

#include "same_surface.h"
#include "slot.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/display/display_surface.h"

namespace toothprep::testing {
namespace {

constexpr double kFast = 30;  // mm/s: 220 steps for the slot

// Ticks without steps until the display has all, as in a pause of the bur.
void catch_up(DisplaySurface& surface, const Workpiece& workpiece) {
  while (!workpiece.changed().empty()) {
    surface.tick();
    surface.pass();
  }
  surface.pass();
}

class Slot : public ::testing::TestWithParam<EngineKind> {};

TEST_P(Slot, IsTheSurfaceInOnePieceBeforeDuringAndAfter) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  Workpiece workpiece(tooth);
  const auto path = slot_path(kFast);
  Session session(bur, workpiece, slot_parameters(GetParam()), Drive::kDirect, path.front());
  DisplaySurface surface(workpiece);
  const auto expect_right = [&] {
    const DisplayMesh mesh = surface.mesh();
    EXPECT_TRUE(is_closed(mesh));
    // The voxel engine may leave a crumb; the level set leaves one piece without handles.
    if (GetParam() == EngineKind::kLevelset) {
      EXPECT_EQ(euler_characteristic(mesh), 2);
    }
    expect_same_surface(mesh, surface_in_one_piece(workpiece));
  };
  expect_right();
  StepRecord last;
  for (std::size_t i = 1; i < path.size(); ++i) {
    last = session.step(path[i]);
    surface.tick();
    if (i % 20 == 0) {
      surface.pass();  // perhaps with a part of a cut: another shape, but closed
      EXPECT_TRUE(is_closed(surface.mesh()));
    }
    if (i % 55 == 0) {
      catch_up(surface, workpiece);
      expect_right();
    }
  }
  session.finish(last);
  surface.finish();
  expect_right();
  // And what a display made now would show, normals included.
  const DisplayMesh kept = surface.mesh(), fresh = DisplaySurface(workpiece).mesh();
  EXPECT_EQ(kept.vertices, fresh.vertices);
  EXPECT_EQ(kept.normals, fresh.normals);
  EXPECT_EQ(kept.tissue, fresh.tissue);
  EXPECT_EQ(kept.triangles, fresh.triangles);
  // It did cut: the slot's 1.2 x 1.5 x 6 mm, less a voxel all round in the voxel engine.
  EXPECT_GT(session.totals().removed[0] + session.totals().removed[1], 6);
}
INSTANTIATE_TEST_SUITE_P(Engines, Slot,
                         ::testing::Values(EngineKind::kLevelset, EngineKind::kVoxel),
                         [](const auto& i) {
                           return i.param == EngineKind::kLevelset ? "Levelset" : "Voxel";
                         });

TEST(DisplaySurface, OnlyBlocksNearTheBurAreRedone) {
  const LayeredTooth tooth = slot_block(0.05);
  const Bur bur = slot_bur();
  Workpiece workpiece(tooth);
  const auto path = slot_path(kFast);
  Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
  DisplaySurface surface(workpiece);
  const std::size_t all = surface.blocks_since(0).blocks.size();
  ASSERT_GT(all, 60u);
  std::uint64_t generation = surface.blocks_since(0).generation;
  EXPECT_TRUE(surface.blocks_since(generation).blocks.empty());
  std::size_t passes = 0, redone = 0, from = 1;
  for (std::size_t i = 1; i < path.size(); ++i) {
    session.step(path[i]);
    surface.tick();
    if (i % 33 != 0) continue;  // 30 Hz
    while (!workpiece.changed().empty()) surface.tick();
    surface.pass();
    const auto update = surface.blocks_since(generation);
    generation = update.generation;
    ++passes;
    redone += update.blocks.size();
    // Where the bur was since the last update, and a voxel and the cut before, grown by its radius,
    // the narrow band and the two samples that a block reads beyond its last cell.
    const double voxel = workpiece.voxel();
    const double grow = 0.6 + workpiece.band() + 2 * voxel;
    const double back = 2 * voxel + kFast * 1e-3;
    Vec3 low = path[from].pose.position - Vec3(grow + back, grow, grow);
    Vec3 high = path[i].pose.position + Vec3(grow, grow + 3, grow);
    from = i;
    for (const auto& b : update.blocks) {
      const Vec3 first = tooth.lattice.to_world(b->block * kBlockCells);
      const Vec3 last = first + Vec3::Constant(kBlockCells * voxel);
      EXPECT_TRUE((first.array() <= high.array()).all() && (last.array() >= low.array()).all())
          << "block from " << first.transpose() << " far from the bur at "
          << path[i].pose.position.transpose();
    }
  }
  // 1 mm of way a pass, a block is 1.6 mm: the bur's box of (1 + 1.2 + 0.6) x 1.8 x 1.8 mm lies in
  // at most 3 x 3 x 3 blocks.
  EXPECT_GT(redone, 0u);
  EXPECT_LE(redone, 27 * passes);
  EXPECT_EQ(surface.stats().blocks, redone);
  std::printf("blocks with surface: %zu, redone per update: %.1f\n", all,
              static_cast<double>(redone) / static_cast<double>(passes));
}

// A pass with nothing new publishes nothing.
TEST(DisplaySurface, RestsWhileNothingChanges) {
  const LayeredTooth tooth = slot_block();
  Workpiece workpiece(tooth);
  DisplaySurface surface(workpiece);
  const auto before = surface.blocks_since(0);
  for (int i = 0; i < 5; ++i) {
    surface.tick();
    EXPECT_FALSE(surface.pass());
  }
  EXPECT_EQ(surface.blocks_since(0).generation, before.generation);
  EXPECT_EQ(surface.stats().passes, 5u);
  EXPECT_EQ(surface.stats().publications, 0u);
}

// What a tick has no share or no room for goes later; nothing is lost.
TEST(DisplaySurface, ATightFeedOnlyDelays) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  Workpiece workpiece(tooth);
  const auto path = slot_path(kFast);
  Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
  DisplaySurface surface(workpiece, {.rate = 30, .feed = {.bricks_per_tick = 1, .ring_bricks = 5}});
  StepRecord last;
  for (std::size_t i = 1; i < path.size(); ++i) {
    last = session.step(path[i]);
    surface.tick();
    if (i % 33 == 0) surface.pass();
  }
  session.finish(last);
  EXPECT_FALSE(workpiece.changed().empty());
  EXPECT_GT(surface.stats().feed.ring_full, 0u);
  EXPECT_GT(surface.stats().feed.largest_backlog, 5u);
  surface.finish();
  EXPECT_TRUE(workpiece.changed().empty());
  expect_same_surface(surface.mesh(), surface_in_one_piece(workpiece));
}

// Servo, worker and viewer on three threads. The viewer keeps the blocks that it was given; all
// that it ever holds joins to a closed surface.
TEST(DisplaySurface, KeepsUpOnItsOwnThread) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  Workpiece workpiece(tooth);
  const auto path = slot_path(6);
  Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
  DisplaySurface surface(workpiece, {.rate = 60, .feed = {}});

  std::atomic<bool> done = false;
  std::map<std::array<int, 3>, std::shared_ptr<const BlockMesh>> held;
  std::uint64_t generation = 0;
  int updates = 0;
  const auto view = [&] {
    const auto update = surface.blocks_since(generation);
    EXPECT_GE(update.generation, generation);
    if (update.blocks.empty()) return;
    generation = update.generation;
    ++updates;
    for (const auto& b : update.blocks) held[{b->block.x(), b->block.y(), b->block.z()}] = b;
  };
  const auto joined = [&] {
    std::vector<std::shared_ptr<const BlockMesh>> blocks;
    for (const auto& [place, b] : held) blocks.push_back(b);
    return join_blocks(blocks);
  };
  surface.start();
  std::thread viewer([&] {
    while (!done) {
      view();
      EXPECT_TRUE(is_closed(joined()));
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  StepRecord last;
  auto due = std::chrono::steady_clock::now();
  for (std::size_t i = 1; i < path.size(); ++i) {
    std::this_thread::sleep_until(due += std::chrono::milliseconds(1));
    last = session.step(path[i]);
    surface.tick();
  }
  session.finish(last);
  surface.finish();
  done = true;
  viewer.join();
  view();
  expect_same_surface(joined(), surface_in_one_piece(workpiece));
  expect_same_surface(surface.mesh(), surface_in_one_piece(workpiece));

  const DisplayStats s = surface.stats();
  EXPECT_EQ(s.failure, "");
  EXPECT_GT(updates, 2);
  EXPECT_GT(s.publications, 2u);
  EXPECT_EQ(s.feed.ticks, path.size() - 1);
  EXPECT_GT(s.feed.bricks, 0u);
  EXPECT_GT(s.latency_median, 0);
  EXPECT_LE(s.latency_median, s.latency_99);
  EXPECT_LE(s.latency_99, s.latency_worst);
  std::printf(
      "%.1f Hz of 60, longest gap %.1f ms; pass %.2f / %.2f / %.2f ms, latency %.1f / %.1f / %.1f "
      "ms "
      "(median, 99 %%, worst); %lu blocks, %lu bricks, backlog %lu at most; first extraction %.1f "
      "ms\n",
      s.rate, 1e3 * s.longest_gap, 1e3 * s.pass_median, 1e3 * s.pass_99, 1e3 * s.pass_worst,
      1e3 * s.latency_median, 1e3 * s.latency_99, 1e3 * s.latency_worst, s.blocks, s.feed.bricks,
      s.feed.largest_backlog, 1e3 * s.first_extraction);
}

TEST(DisplaySurface, StoppedAndStartedAgainItGoesOnWhereItWas) {
  const LayeredTooth tooth = slot_block(0.2);
  const Bur bur = slot_bur();
  Workpiece workpiece(tooth);
  const auto path = slot_path(kFast);
  Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
  DisplaySurface surface(workpiece);
  std::size_t at = 1;
  std::uint64_t generation = surface.blocks_since(0).generation;
  for (int i = 0; i < 3; ++i) {
    // What is cut while the worker is stopped is published once it runs again.
    for (const std::size_t end = at + path.size() / 4; at < end; ++at) {
      session.step(path[at]);
      surface.tick();
    }
    while (!workpiece.changed().empty()) surface.tick();
    EXPECT_EQ(surface.blocks_since(0).generation, generation) << "nobody works while stopped";
    surface.start();
    surface.start();
    const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (surface.blocks_since(0).generation == generation &&
           std::chrono::steady_clock::now() < patience)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    surface.stop();
    surface.stop();
    EXPECT_GT(surface.blocks_since(0).generation, generation);
    generation = surface.blocks_since(0).generation;
  }
  surface.finish();
  EXPECT_EQ(surface.mesh().triangles, DisplaySurface(workpiece).mesh().triangles);
  surface.start();  // and the destructor ends it
}

// The same steps and passes give the same bytes, whatever the number of threads.
TEST(DisplaySurface, IsDeterministic) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  const auto path = slot_path(kFast);
  std::vector<DisplayMesh> meshes;
  for (int threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Workpiece workpiece(tooth);
    DisplaySurface surface(workpiece);
    Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
    for (std::size_t i = 1; i < path.size() / 2; ++i) {
      session.step(path[i]);
      surface.tick();
      if (i % 16 == 0) surface.pass();
    }
    surface.pass();
    meshes.push_back(surface.mesh());
  }
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_TRUE(same(meshes[0].vertices, meshes[1].vertices));
  EXPECT_TRUE(same(meshes[0].normals, meshes[1].normals));
  EXPECT_TRUE(same(meshes[0].tissue, meshes[1].tissue));
  EXPECT_TRUE(same(meshes[0].triangles, meshes[1].triangles));
}

// Tissue that was removed before the display was made, or between it and the first tick.
TEST(DisplaySurface, MayBeMadeBeforeOrAfterTheSession) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  const auto path = slot_path(kFast);
  for (const bool display_first : {true, false}) {
    Workpiece workpiece(tooth);
    std::unique_ptr<DisplaySurface> surface;
    if (display_first) surface = std::make_unique<DisplaySurface>(workpiece);
    // Starts inside: clears at once what overlaps.
    const Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path[100]);
    ASSERT_GT(session.totals().initial_overlap[0], 0);
    if (!display_first) surface = std::make_unique<DisplaySurface>(workpiece);
    surface->finish();
    expect_same_surface(surface->mesh(), surface_in_one_piece(workpiece));
  }
}

TEST(DisplaySurface, RefusesOptionsThatCannotBe) {
  const LayeredTooth tooth = slot_block(0.2);
  Workpiece workpiece(tooth);
  for (const double rate : {0.0, -1.0, 2000.0, std::nan("")})
    EXPECT_THROW(DisplaySurface(workpiece, {.rate = rate, .feed = {}}), Error);
  EXPECT_THROW(DisplaySurface(workpiece, {.feed = {.bricks_per_tick = 0}}), Error);
  EXPECT_THROW(DisplaySurface(workpiece, {.feed = {.ring_bricks = 0}}), Error);
}

}  // namespace
}  // namespace toothprep::testing
