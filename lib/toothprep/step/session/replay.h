// A whole path through a session: the rows of a trace and the figures of the run.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/step/core/session_event.h"
#include "toothprep/step/session/intervals.h"
#include "toothprep/step/session/session.h"

namespace toothprep {

struct ReplayResult {            // what `toothprep replay` writes and prints
  std::vector<StepRecord> rows;  // one per sample; row 0 is the initial state
  SessionTotals totals;          // of the session, at its end
  PerTissue<double> ground{};    // mm³: totals.removed and what was undone
  double removed_energy = 0;     // N·mm = mJ: sum of u_k V_k over all intervals, also undone ones
  double energy_ratio = 0;       // torque work / removed energy; NaN if nothing was removed
  bool ran_off = false;  // drive `load`: the bur went kMostWayWithoutContact without contact,
                         // and the rows end there
  double seconds_simulated = 0;                              // from the first row to the last
  double seconds_computed = 0;                               // wall time of the steps
  double step_us_p50 = 0, step_us_p99 = 0, step_us_max = 0;  // of single steps
};

// What was done to a session while it was recorded, with the burs that it could change to.
struct Interventions {
  std::vector<SessionEvent> events;  // in order of time
  std::vector<Bur> burs;             // as SessionEvents::burs; the first is the path's own
  std::string source;                // the file that holds them, for messages
};

// A path through a session, row by row.
class PathStepper {
 public:
  // Keeps references to all but the parameters. Throws Error for a path of fewer than two samples.
  PathStepper(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
              const std::vector<HandleSample>& path, const Interventions& interventions);

  // The next row, of as many as the path has samples. What is due is removed with the last one.
  // Throws as Session's constructor where an interval begins, and InputError for an event that
  // doesn't fit: not at the time of a sample, or not in this order.
  StepRecord next();
  // Ends before the path does, at the row of the last next(); returns it as it then is.
  StepRecord end();
  const Intervals& intervals() const { return intervals_; }
  // mm, of the bur since it last met tissue.
  double way_without_contact() const {
    return session_ ? session_->totals().way_without_contact : 0;
  }

 private:
  bool apply(const SessionEvent& event);
  [[noreturn]] void refuse(const SessionEvent& event, const char* condition) const;

  const Bur* bur_;
  const std::vector<HandleSample>& path_;
  const Interventions& interventions_;
  Intervals intervals_;
  Session* session_ = nullptr;  // null in a pause
  std::size_t row_ = 0, event_ = 0;
  StepRecord last_;
};

// Runs `path` (samples at parameters.time_step) and carves `workpiece`. `progress`, if given, is
// called now and then with the fraction done. Throws as PathStepper.
ReplayResult replay(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                    const std::vector<HandleSample>& path,
                    const std::function<void(double)>& progress = {},
                    const Interventions& interventions = {});

// Smallest distance from a path's tip positions to the box around the solid, mm.
[[nodiscard]] double distance_to_tooth(const std::vector<HandleSample>& path, const Box& box);

}  // namespace toothprep
