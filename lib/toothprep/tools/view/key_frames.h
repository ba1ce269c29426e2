// The surface of a tooth at many moments of a session: which bricks of the cut changed from one
// moment to the next, with their values, and the meshes of any moment made from them when somebody
// asks.
//
// A frame costs 2 kB for each brick that changed since the frame before (a bur of 1.2 mm that moves
// at 2 mm/s in voxels of 0.1 mm changes some twenty in 0.1 s); meshes would be fifty times that. A
// block is meshed in 0.3 ms, so that any frame is ready in a few tens of milliseconds.
//
// One thread adds frames while another asks.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <mutex>
#include <vector>

#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/tools/display/block_mesh.h"

namespace toothprep {

class KeyFrames {
 public:
  // Frame 0: the workpiece as it is. Its tooth must outlive this.
  explicit KeyFrames(Workpiece& workpiece);

  // The next frame: what has changed in the same workpiece.
  void add(Workpiece& workpiece);

  int frames() const;
  std::size_t bytes() const;  // of what is kept

  // Meshes as of `frame` of the blocks that look different then than in frame `seen` (-1: of all
  // that have any surface); those without surface are empty. Both below frames().
  std::vector<BlockMesh> blocks(int frame, int seen);

 private:
  using Values = std::array<float, kBrickVoxels>;
  struct Version {
    int since;  // frame
    bool uniform;
    float value;         // if uniform
    std::size_t stored;  // else its place in values_
  };
  // The brick's version in a frame; null: as in frame 0.
  const Version* version(std::size_t brick, int frame) const;
  void bring_cut_to(int frame);

  const LayeredTooth& tooth_;
  LevelSet first_;  // the cut in frame 0
  LevelSet cut_;    // in frame at_
  int at_ = 0;
  BlockRange range_;

  mutable std::mutex guard_;  // of what follows
  int frames_ = 1;
  std::vector<std::vector<Version>> versions_;  // per brick, in order of time
  std::vector<std::size_t> changed_;            // bricks with versions
  std::deque<Values> values_;
};

}  // namespace toothprep
