#include "toothprep/step/session/intervals.h"

#include <algorithm>
#include <utility>

namespace toothprep {
namespace {

void add(const SessionTotals& more, SessionTotals& sum) {
  sum.torque_work += more.torque_work;
  add_removed(more.cutting_work, sum.cutting_work);
  add_removed(more.swept, sum.swept);
  sum.rubbing_work += more.rubbing_work;
  sum.unsettled_steps += more.unsettled_steps;
  add_removed(more.initial_overlap, sum.initial_overlap);
  sum.stalled_steps += more.stalled_steps;
  sum.stall_onsets += more.stall_onsets;
  sum.contact_steps += more.contact_steps;
  sum.rejected_steps += more.rejected_steps;
  sum.shank_contact_steps += more.shank_contact_steps;
  sum.split_steps += more.split_steps;
  sum.split_steps_cut_short += more.split_steps_cut_short;
  sum.unbalanced_steps += more.unbalanced_steps;
  sum.way_without_contact = more.way_without_contact;
  sum.largest_lag = std::max(sum.largest_lag, more.largest_lag);
  sum.peak_device_force = std::max(sum.peak_device_force, more.peak_device_force);
  sum.bodies.resize(more.bodies.size());
  for (std::size_t b = 0; b < more.bodies.size(); ++b) {
    sum.bodies[b].contact_steps += more.bodies[b].contact_steps;
    sum.bodies[b].shank_contact_steps += more.bodies[b].shank_contact_steps;
    if (!sum.bodies[b].first_removal) sum.bodies[b].first_removal = more.bodies[b].first_removal;
  }
}

void add_bodies(const SessionTotals& more, std::vector<double>& removed) {
  removed.resize(more.bodies.size());
  for (std::size_t b = 0; b < removed.size(); ++b) removed[b] += more.bodies[b].removed;
}

}  // namespace

void add_removed(const PerTissue<double>& before, PerTissue<double>& removed) noexcept {
  for (int k = 0; k < kTissueCount; ++k) removed[k] += before[k];
}

Intervals::Intervals(Workpiece& workpiece, const Parameters& parameters, Drive drive)
    : workpiece_(workpiece), parameters_(parameters), drive_(drive) {}

Session& Intervals::begin(const Bur& bur, const HandleSample& first) {
  Start start{workpiece_.cut_state(), removed_, of_bodies_};
  session_ = std::make_unique<Session>(bur, workpiece_, parameters_, drive_, first);
  starts_.push_back(std::move(start));
  if (starts_.size() > kMostUndos) starts_.pop_front();
  return *session_;
}

void Intervals::end() {
  add_removed(session_->totals().removed, removed_);
  add_removed(session_->totals().removed, ground_);
  add_bodies(session_->totals(), of_bodies_);
  add(session_->totals(), ended_);
  session_.reset();
}

bool Intervals::undo() {
  if (session_ || starts_.empty()) return false;
  workpiece_.restore(starts_.back().cut);
  removed_ = starts_.back().removed;
  of_bodies_ = starts_.back().of_bodies;
  starts_.pop_back();
  return true;
}

SessionTotals Intervals::totals() const {
  SessionTotals totals = ended_;
  totals.removed = removed_;
  std::vector<double> of_bodies = of_bodies_;
  if (session_) {
    add(session_->totals(), totals);
    add_removed(session_->totals().removed, totals.removed);
    add_bodies(session_->totals(), of_bodies);
  }
  of_bodies.resize(totals.bodies.size());
  for (std::size_t b = 0; b < of_bodies.size(); ++b) totals.bodies[b].removed = of_bodies[b];
  return totals;
}

PerTissue<double> Intervals::ground() const {
  PerTissue<double> ground = ground_;
  if (session_) add_removed(session_->totals().removed, ground);
  return ground;
}

}  // namespace toothprep
