// A session in intervals: from its start, or where it was resumed, to the next pause each is a
// Session of its own on the same tooth (core/session_event.h). Live and replay use this, so that a
// replay repeats what was done to a session, bit for bit.
#pragma once

#include <deque>
#include <memory>
#include <optional>

#include "toothprep/step/session/session.h"

namespace toothprep {

constexpr std::size_t kMostUndos = 20;  // whose teeth are kept

class Intervals {  // on one tooth
 public:
  // Keeps a reference to the workpiece.
  Intervals(Workpiece& workpiece, const Parameters& parameters, Drive drive);

  // An interval begins; throws as Session's constructor. The bur must outlive it.
  Session& begin(const Bur& bur, const HandleSample& first);
  void end();   // after the session's finish()
  bool undo();  // between intervals; false: there is none to be undone
  std::size_t undoable() const { return starts_.size() - (session_ ? 1 : 0); }

  // mm³, before the interval that goes on, without what was undone; rows add it.
  const PerTissue<double>& removed_before() const { return removed_; }

  // Sums over all intervals; `removed` without what was undone.
  SessionTotals totals() const;
  // mm³, that was removed in all intervals, also what was undone: what the torque's work stands
  // against.
  PerTissue<double> ground() const;

 private:
  struct Start {
    Workpiece::CutState cut;
    PerTissue<double> removed{};
    std::vector<double> of_bodies;
  };
  Workpiece& workpiece_;
  Parameters parameters_;
  Drive drive_;
  std::unique_ptr<Session> session_;
  PerTissue<double> removed_{}, ground_{};
  std::vector<double> of_bodies_;  // removed of each, mm³
  SessionTotals ended_;
  std::deque<Start> starts_;  // of the intervals that were not undone
};

// A volume that was counted since `before`, from the start on.
void add_removed(const PerTissue<double>& before, PerTissue<double>& removed) noexcept;

}  // namespace toothprep
