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

void check(const std::vector<StepRecord>& rows, const ProcessOptions& options) {
  if (rows.size() < 2) throw Error("the recording holds no step: two rows are needed");
  for (std::size_t i = 1; i < rows.size(); ++i)
    if (!(rows[i].handle.time > rows[i - 1].handle.time))
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

ProcessFigures process_figures(const std::vector<StepRecord>& rows, const ProcessOptions& options) {
  check(rows, options);

  double contact_time = 0, cutting_time = 0, stalled_time = 0, pulp_time = 0, other_time = 0;
  double above_force = 0, above_power = 0;
  double path = 0, path_cutting = 0, energy = 0, removed_total = 0;
  double peak_power = 0, lag = 0;
  int stalls = 0;
  std::vector<WeightedValue> forces, felt;
  Episodes contacts(ProcessEventKind::kContact, options.shortest_gap);
  Episodes stall_spans(ProcessEventKind::kStall, options.shortest_gap);
  Episodes pulp_spans(ProcessEventKind::kPulp, options.shortest_gap);
  Episodes other_spans(ProcessEventKind::kNeighbour, options.shortest_gap);
  Episodes force_spans(ProcessEventKind::kForceLimit, options.shortest_gap);

  lag = (rows[0].handle.pose.position - rows[0].bur.position).norm();
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const StepRecord& before = rows[i - 1];
    const StepRecord& row = rows[i];
    const double begin = before.handle.time, end = row.handle.time, h = end - begin;

    PerTissue<bool> touched{};
    bool contact = false;
    for (int k = 0; k < kTissueCount; ++k) {
      const double removed = std::max(0.0, row.removed_volume[k] - before.removed_volume[k]);
      removed_total += removed;
      touched[k] = row.contact_area[k] > 0 || removed > 0;
      contact |= touched[k];
    }
    const bool cutting = contact && !row.stalled;

    const double moved = (row.bur.position - before.bur.position).norm();
    path += moved;
    lag = std::max(lag, (row.handle.pose.position - row.bur.position).norm());
    energy += row.power * h;
    peak_power = std::max(peak_power, row.power);
    if (row.power > options.power_limit) above_power += h;
    if (row.stalled) {
      stalled_time += h;
      stalls += !before.stalled;
      stall_spans.add(begin, end);
    }
    if (cutting) {
      cutting_time += h;
      path_cutting += moved;
    }
    if (contact) {
      contact_time += h;
      contacts.add(begin, end);
      forces.push_back({row.grinding_force.norm(), h});
      felt.push_back({row.device_force.norm(), h});
      if (forces.back().value > options.force_limit) {
        above_force += h;
        force_spans.add(begin, end);
      }
    }
    if (touched[kPulpIndex]) {
      pulp_time += h;
      pulp_spans.add(begin, end);
    }
    if (touched[kOtherIndex]) {
      other_time += h;
      other_spans.add(begin, end);
    }
  }

  const double time = rows.back().handle.time - rows.front().handle.time;
  ProcessFigures result;
  const auto add = [&](const std::string& name, double value) {
    const std::string key = "process." + name;
    result.quantities.push_back({key, value, NAN, find_definition(key)->unit});
  };
  add("time_s", time);
  add("contact_time_s", contact_time);
  add("cutting_time_s", cutting_time);
  add("path_mm", path);
  add("path_cutting_mm", path_cutting);
  add("mean_speed_mm_s", path / time);
  if (cutting_time > 0) add("mean_feed_mm_s", path_cutting / cutting_time);
  if (!forces.empty()) {
    add("peak_force_n", largest(forces));
    add("force_p95_n", weighted_quantile(forces, 0.95));
    add("peak_device_force_n", largest(felt));
    add("device_force_p95_n", weighted_quantile(felt, 0.95));
  }
  add("time_above_force_limit_s", above_force);
  // N·mm is mJ, N·mm/s is mW.
  if (cutting_time > 0) add("mean_power_w", units::to_watt(energy / cutting_time));
  add("peak_power_w", units::to_watt(peak_power));
  add("time_above_power_limit_s", above_power);
  add("energy_j", units::to_watt(energy));
  add("stalls", stalls);
  add("stalled_time_s", stalled_time);
  add("pulp_contact_s", pulp_time);
  add("neighbour_contact_s", other_time);
  add("max_lag_mm", lag);
  if (cutting_time > 0) add("removal_rate_mm3_s", removed_total / cutting_time);
  add("contact_episodes", static_cast<double>(contacts.spans().size()));

  for (const Episodes* episodes :
       {&contacts, &stall_spans, &pulp_spans, &other_spans, &force_spans})
    result.events.insert(result.events.end(), episodes->spans().begin(), episodes->spans().end());
  std::stable_sort(result.events.begin(), result.events.end(),
                   [](const ProcessEvent& a, const ProcessEvent& b) { return a.begin < b.begin; });
  return result;
}

}  // namespace toothprep
