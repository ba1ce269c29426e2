// A recorded session stepped again on a thread of its own, for the tooth at every moment of it.
//
// The step is the library's, and its input what the recording holds, so that the tooth is the
// recorded one to the last bit if the same version with the same parameters stepped it. How far the
// new rows are from the recorded ones is measured.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/view/key_frames.h"

namespace toothprep {

struct Recording {  // of a session on a tooth
  Bur bur;
  Parameters parameters;
  Drive drive = Drive::kCoupled;
  std::vector<HandleSample> path;            // at the parameters' time step
  Interventions interventions;               // what was done to the session
  std::vector<StepRecord> rows;              // as recorded, one per sample
  std::vector<std::uint32_t> flags, faults;  // of a live session, one per row; else empty
  std::vector<std::int32_t> missed;          // the same
  std::vector<Pose> mirror;                  // of a second device, its own frame; or empty
};

class Rerun {
 public:
  // Both must outlive it.
  Rerun(const Recording& recording, const LayeredTooth& tooth);

  struct Progress {
    std::vector<std::size_t> frame_rows;  // of each frame from `from` on: the row after which it is
    double done = 0;                      // share of the steps
    bool finished = false;
    double bur_difference = 0, force_difference = 0;  // mm, N: largest, of what was stepped so far
    std::string failure;                              // why it gave up; empty: it didn't
  };
  Progress progress(std::size_t from) const;

  // As KeyFrames::blocks(), of frames that there are.
  std::vector<BlockMesh> blocks(int frame, int seen) { return frames_.blocks(frame, seen); }
  int frames() const { return frames_.frames(); }

 private:
  void run(const std::stop_token& stop);
  void step_all(const std::stop_token& stop);
  void add_frame(std::size_t row);

  const Recording& recording_;
  Workpiece workpiece_;
  KeyFrames frames_;
  mutable std::mutex guard_;  // of what follows
  std::vector<std::size_t> frame_rows_;
  Progress progress_;    // without its rows
  std::jthread worker_;  // last: it ends before what it uses
};

}  // namespace toothprep
