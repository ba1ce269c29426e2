#include "toothprep/tools/score/process.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/score/definitions.h"

namespace toothprep {
namespace {

constexpr int kPulpIndex = tissue_index(Tissue::kPulp);
constexpr int kOtherIndex = tissue_index(Tissue::kOther);

double largest(const std::vector<WeightedValue>& values) {
  double most = values.front().value;
  for (const WeightedValue& v : values) most = std::max(most, v.value);
  return most;
}

// Collects the spans in which something is so.
class Episodes {
 public:
  Episodes(ProcessEventKind kind, double shortest_gap) : kind_(kind), gap_(shortest_gap) {}
  void add(double begin, double end) {
    if (!spans_.empty() && begin - spans_.back().end < gap_)
      spans_.back().end = end;
    else
      spans_.push_back({begin, end, kind_});
  }
  const std::vector<ProcessEvent>& spans() const { return spans_; }

 private:
  ProcessEventKind kind_;
  double gap_;
  std::vector<ProcessEvent> spans_;
};

bool is_start(const std::vector<std::size_t>& starts, std::size_t row) {
  return std::find(starts.begin(), starts.end(), row) != starts.end();
}

void check(const std::vector<StepRecord>& rows, const ProcessOptions& options,
           const std::vector<std::size_t>& starts) {
  if (rows.size() < 2) throw Error("the recording holds no step: two rows are needed");
  for (std::size_t i = 1; i < rows.size(); ++i)
    if (!(rows[i].handle.time > rows[i - 1].handle.time) && !is_start(starts, i))
      throw Error("the recording's time doesn't increase at row " + std::to_string(i));
  for (const double limit : {options.force_limit, options.power_limit, options.shortest_gap})
    if (!(std::isfinite(limit) && limit > 0))
      throw Error("limits of force, power and gaps must be finite and above 0");
}

}  // namespace

const char* name_of(ProcessEventKind kind) noexcept {
  switch (kind) {
    case ProcessEventKind::kContact:
      return "contact";
    case ProcessEventKind::kStall:
      return "stall";
    case ProcessEventKind::kPulp:
      return "pulp touched";
    case ProcessEventKind::kNeighbour:
      return "neighbour touched";
    case ProcessEventKind::kForceLimit:
      return "force limit";
  }
  return "";
}

namespace {

// The sums over a recording, row by row.
class Process {
 public:
  Process(const StepRecord& first, const ProcessOptions& options, const std::vector<Body>& bodies)
      : options_(options),
        bodies_(bodies),
        body_time_(bodies.size(), 0.0),
        contacts_(ProcessEventKind::kContact, options.shortest_gap),
        stall_spans_(ProcessEventKind::kStall, options.shortest_gap),
        pulp_spans_(ProcessEventKind::kPulp, options.shortest_gap),
        other_spans_(ProcessEventKind::kNeighbour, options.shortest_gap),
        force_spans_(ProcessEventKind::kForceLimit, options.shortest_gap),
        lag_((first.handle.pose.position - first.bur.position).norm()) {}

  void add(const StepRecord& before, const StepRecord& row) {
    const double begin = before.handle.time, end = row.handle.time, h = end - begin;
    PerTissue<bool> touched{};
    bool contact = false;
    for (int k = 0; k < kTissueCount; ++k) {
      const double removed = std::max(0.0, row.removed_volume[k] - before.removed_volume[k]);
      removed_total_ += removed;
      touched[k] = row.contact_area[k] > 0 || removed > 0;
      contact |= touched[k];
    }
    const double moved = (row.bur.position - before.bur.position).norm();
    path_ += moved;
    lag_ = std::max(lag_, (row.handle.pose.position - row.bur.position).norm());
    energy_ += row.power * h;
    peak_power_ = std::max(peak_power_, row.power);
    if (row.power > options_.power_limit) above_power_ += h;
    if (row.stalled) {
      stalled_time_ += h;
      stalls_ += !before.stalled;
      stall_spans_.add(begin, end);
    }
    if (contact && !row.stalled) {
      cutting_time_ += h;
      path_cutting_ += moved;
    }
    if (contact) add_contact(row, begin, end);
    if (touched[kPulpIndex]) {
      pulp_time_ += h;
      pulp_spans_.add(begin, end);
    }
    if (bodies_.empty() ? touched[kOtherIndex] : touches_bodies(row, h)) {
      other_time_ += h;
      other_spans_.add(begin, end);
    }
  }

  // Counts the time for each body; whether a neighbour is among them.
  bool touches_bodies(const StepRecord& row, double h) {
    bool neighbour = false, gum = false;
    for (const BodyArea& other : row.other_bodies) {
      if (!(other.area > 0) || other.body == 0 || other.body > bodies_.size()) continue;
      body_time_[other.body - 1u] += h;
      (bodies_[other.body - 1u].kind == BodyKind::kGum ? gum : neighbour) = true;
    }
    if (gum) gum_time_ += h;
    return neighbour;
  }

  ProcessFigures figures(double time) const {
    ProcessFigures result;
    const auto put = [&](const std::string& name, double value) {
      const std::string key = "process." + name;
      result.quantities.push_back({key, value, NAN, find_definition(key)->unit});
    };
    put("time_s", time);
    put("contact_time_s", contact_time_);
    put("cutting_time_s", cutting_time_);
    put("path_mm", path_);
    put("path_cutting_mm", path_cutting_);
    put("mean_speed_mm_s", path_ / time);
    if (cutting_time_ > 0) put("mean_feed_mm_s", path_cutting_ / cutting_time_);
    if (!forces_.empty()) {
      put("peak_force_n", largest(forces_));
      put("force_p95_n", weighted_quantile(forces_, 0.95));
      put("peak_device_force_n", largest(felt_));
      put("device_force_p95_n", weighted_quantile(felt_, 0.95));
    }
    put("time_above_force_limit_s", above_force_);
    // N·mm is mJ, N·mm/s is mW.
    if (cutting_time_ > 0) put("mean_power_w", units::to_watt(energy_ / cutting_time_));
    put("peak_power_w", units::to_watt(peak_power_));
    put("time_above_power_limit_s", above_power_);
    put("energy_j", units::to_watt(energy_));
    put("stalls", stalls_);
    put("stalled_time_s", stalled_time_);
    put("pulp_contact_s", pulp_time_);
    put("neighbour_contact_s", other_time_);
    for (std::size_t b = 0; b < bodies_.size(); ++b)
      if (bodies_[b].kind != BodyKind::kTooth)
        put("body_contact_s." + bodies_[b].name, body_time_[b]);
    if (has_gum()) put("gum_contact_s", gum_time_);
    put("max_lag_mm", lag_);
    if (cutting_time_ > 0) put("removal_rate_mm3_s", removed_total_ / cutting_time_);
    put("contact_episodes", static_cast<double>(contacts_.spans().size()));
    for (const Episodes* episodes :
         {&contacts_, &stall_spans_, &pulp_spans_, &other_spans_, &force_spans_})
      result.events.insert(result.events.end(), episodes->spans().begin(), episodes->spans().end());
    std::stable_sort(
        result.events.begin(), result.events.end(),
        [](const ProcessEvent& a, const ProcessEvent& b) { return a.begin < b.begin; });
    return result;
  }

 private:
  bool has_gum() const {
    return std::any_of(bodies_.begin(), bodies_.end(),
                       [](const Body& b) { return b.kind == BodyKind::kGum; });
  }
  void add_contact(const StepRecord& row, double begin, double end) {
    const double h = end - begin;
    contact_time_ += h;
    contacts_.add(begin, end);
    forces_.push_back({row.grinding_force.norm(), h});
    felt_.push_back({row.device_force.norm(), h});
    if (forces_.back().value > options_.force_limit) {
      above_force_ += h;
      force_spans_.add(begin, end);
    }
  }

  const ProcessOptions& options_;
  const std::vector<Body>& bodies_;
  std::vector<double> body_time_;  // s, of contact with each
  double gum_time_ = 0;
  Episodes contacts_, stall_spans_, pulp_spans_, other_spans_, force_spans_;
  std::vector<WeightedValue> forces_, felt_;  // N, by the time they lasted
  double contact_time_ = 0, cutting_time_ = 0, stalled_time_ = 0, pulp_time_ = 0, other_time_ = 0;
  double above_force_ = 0, above_power_ = 0;
  double path_ = 0, path_cutting_ = 0, energy_ = 0, removed_total_ = 0;
  double peak_power_ = 0, lag_ = 0;
  int stalls_ = 0;
};

}  // namespace

ProcessFigures process_figures(const std::vector<StepRecord>& rows, const ProcessOptions& options,
                               const std::vector<std::size_t>& starts,
                               const std::vector<Body>& bodies) {
  check(rows, options, starts);
  Process process(rows.front(), options, bodies);
  for (std::size_t i = 1; i < rows.size(); ++i)
    if (!is_start(starts, i)) process.add(rows[i - 1], rows[i]);
  return process.figures(rows.back().handle.time - rows.front().handle.time);
}

std::size_t append_recording(std::vector<StepRecord>& rows, const std::vector<StepRecord>& next) {
  const std::size_t start = rows.size();
  if (next.empty()) return start;
  const double shift = rows.empty() ? 0 : rows.back().handle.time - next.front().handle.time;
  const PerTissue<double> removed = rows.empty() ? PerTissue<double>{} : rows.back().removed_volume;
  for (StepRecord row : next) {
    row.handle.time += shift;
    for (int k = 0; k < kTissueCount; ++k) row.removed_volume[k] += removed[k];
    rows.push_back(row);
  }
  return start;
}

}  // namespace toothprep
