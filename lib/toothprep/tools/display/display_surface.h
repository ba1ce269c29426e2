// The surface of a session's workpiece for a display, kept up to date on a thread of its own while
// the servo grinds.
//
//   servo thread            worker, every 1/rate            viewers, whenever they like
//   session.step(...)       apply the bricks that came      blocks_since(generation)
//   surface.tick()  ──ring──▶ mesh the blocks they touch ──▶  or mesh()
//                           publish them all at once
//
// The servo never locks, allocates or waits (brick_feed.h). The worker has its own copy of the cut
// and reads the tooth itself, which grinding never writes. Viewers get blocks that no one changes
// any more; a mutex guards only the list of them. Blocks of one pass appear together, so that what
// a viewer holds after each update joins without cracks (block_mesh.h).
//
// Whether or not the worker keeps up, and should it fail, the servo runs as without a display.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "toothprep/tools/display/block_mesh.h"
#include "toothprep/tools/display/brick_feed.h"
#include "toothprep/tools/display/display_stats.h"
#include "toothprep/tools/display/duration_counts.h"

namespace toothprep {

struct DisplayOptions {
  double rate = 30;  // Hz, passes of the worker
  FeedOptions feed;
};

class DisplaySurface {
 public:
  // Copies the cut and extracts the surface (generation 1). Keeps references: tooth and workpiece
  // must outlive it. Not while the session steps. Throws Error unless rate is in (0, 1000] and the
  // feed's options are positive.
  explicit DisplaySurface(Workpiece& workpiece, const DisplayOptions& options = {});
  ~DisplaySurface();
  DisplaySurface(const DisplaySurface&) = delete;
  DisplaySurface& operator=(const DisplaySurface&) = delete;

  // The servo thread, once after each step.
  void tick() noexcept { feed_.tick(); }

  // The worker. It inherits the scheduling of the thread that starts it: not from a real-time one.
  void start();
  void stop();
  // One pass, here and now, instead of the worker's; true if it published something.
  bool pass();
  // Once the servo has stopped: stops the worker and brings the surface up to exactly what remains.
  void finish();

  // For viewers, from any thread. An update's blocks replace those of the same place; an empty one
  // clears its place.
  struct Update {
    std::uint64_t generation = 0;                          // to ask with the next time
    std::vector<std::shared_ptr<const BlockMesh>> blocks;  // shared: viewers keep what was replaced
  };
  Update blocks_since(std::uint64_t generation) const;  // all if 0
  DisplayMesh mesh() const;                             // all blocks joined
  DisplayStats stats() const;

 private:
  using Clock = BrickFeed::Clock;
  void extract_all();
  void apply(const BrickFeed::Change& change);
  void work(const std::stop_token& stop);

  const LayeredTooth& tooth_;
  const DisplayOptions options_;
  BrickFeed feed_;
  LevelSet cut_;  // the worker's
  BlockRange range_;
  BlockMesher mesher_;

  // Of the pass under way.
  std::vector<std::uint8_t> dirty_;  // per block
  std::vector<std::size_t> to_mesh_;
  std::vector<Clock::time_point> changed_;  // when what it will publish changed

  mutable std::mutex published_;                          // guards what follows
  std::vector<std::shared_ptr<const BlockMesh>> blocks_;  // by block; null: never had surface
  std::uint64_t generation_ = 0;
  DurationCounts latency_, pass_time_;
  DisplayStats counts_;  // what is only counted
  double gaps_ = 0, gap_seconds_ = 0;

  std::mutex sleeping_;
  std::condition_variable_any wake_;
  std::jthread worker_;  // last: it ends before what it uses
};

}  // namespace toothprep
