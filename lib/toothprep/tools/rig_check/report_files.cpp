// The report as files: JSON for programs, tables for the plots.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/io/json_number.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/rig_check/rig_report.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

void header_row(CsvWriter& csv, std::initializer_list<const char*> names) {
  for (const char* name : names) csv.text(name);
  csv.end_row();
}

// Counts in `bins` equal bins up to the 99.9 % value and half of it more; what is beyond falls into
// the last bin.
void write_histogram(std::vector<double> values, double unit, const char* name,
                     const std::string& path) {
  constexpr std::size_t kBins = 240;
  const double least = *std::min_element(values.begin(), values.end());
  const double high = quantile(values, 0.999);
  const double most = *std::max_element(values.begin(), values.end());
  const double end = std::min(most, high + 0.5 * (high - least));
  const double width = std::max((end - least) / static_cast<double>(kBins), 5e-8);
  std::vector<long> counts(kBins, 0);
  for (const double v : values)
    ++counts[std::min(kBins - 1, static_cast<std::size_t>((v - least) / width))];
  CsvWriter csv(path);
  header_row(csv, {name, "width_us", "count"});
  for (std::size_t i = 0; i < kBins; ++i) {
    csv.number((least + static_cast<double>(i) * width) * unit);
    csv.number(width * unit);
    csv.number(static_cast<double>(counts[i]));
    csv.end_row();
  }
  csv.close();
}

}  // namespace

std::string report_json(const RigReport& report, const SessionRecording& r,
                        const std::string& session, const std::string& version,
                        const std::string& build) {
  const SessionHeader& h = r.header;
  Json j;
  j["schema"] = "toothprep-rig-check";
  j["schema_version"] = 1;
  j["toothprep_version"] = version;
  j["build"] = build;
  j["session"] = session;
  j["session_toothprep_version"] = h.trace.toothprep_version;
  j["device_kind"] = h.device_kind;
  j["device_model"] = h.device_model;
  j["device_driver"] = h.device_driver;
  j["device_serial"] = h.device_serial;
  j["host"] = h.host;
  j["rate_hz"] = h.rate_hz;
  j["ticks"] = h.trace.rows.size();
  j["duration_s"] = r.servo_time.back() - r.servo_time.front();
  j["drive"] = h.trace.drive;
  j["protocol"] = h.protocol;
  j["complete"] = r.complete;
  j["end_reason"] = r.end_reason;
  j["verdict"] = name_of(report.overall);
  j["passed"] = report.passed;
  j["failed"] = report.failed;
  j["not_measured"] = report.not_measured;
  for (const RigLine& line : report.lines) j[line.figure->key] = number_or_null(line.value);

  j["lines"] = Json::array();
  for (const RigLine& line : report.lines) {
    Json l;
    l["figure"] = line.figure->key;
    l["section"] = line.figure->section;
    l["value"] = number_or_null(line.value);
    l["unit"] = line.figure->unit;
    l["limit_min"] = line.limit ? number_or_null(line.limit->min) : Json(nullptr);
    l["limit_max"] = line.limit ? number_or_null(line.limit->max) : Json(nullptr);
    l["verdict"] = name_of(line.verdict);
    l["meaning"] = line.figure->meaning;
    if (!line.why_not.empty()) l["why_not"] = line.why_not;
    if (!line.note.empty()) l["note"] = line.note;
    if (line.limit) l["limit_why"] = line.limit->why;
    j["lines"].push_back(l);
  }
  j["events"] = Json::array();
  for (const EventFigures& e : report.events)
    j["events"].push_back({{"name", e.name},
                           {"ticks", e.ticks},
                           {"events", e.events},
                           {"share", e.share},
                           {"longest_s", e.longest}});
  j["faults"] = Json::array();
  for (const FaultFigures& f : report.faults)
    j["faults"].push_back({{"name", f.name},
                           {"ticks", f.ticks},
                           {"onsets", f.onsets},
                           {"final", f.final},
                           {"first_s", f.first},
                           {"description", f.description}});
  if (report.device) {
    const DeviceTraits& d = *report.device;
    j["device_traits"] = {{"name", d.name},
                          {"apparent_mass_g", d.apparent_mass * 1e6},
                          {"damping_n_s_per_m", d.damping * 1e3},
                          {"friction_n", d.friction},
                          {"encoder_count_mm", d.encoder_count},
                          {"delay_ticks", d.delay_ticks},
                          {"status", d.status},
                          {"source", d.source}};
  }
  if (report.sweep) {
    j["levels"] = Json::array();
    for (const LevelFigures& l : report.sweep->levels)
      j["levels"].push_back({{"level", l.level},
                             {"rms_above_20_hz_n", l.rms_above_20},
                             {"counts_rms_n", l.counts_rms},
                             {"peak_to_peak_n", l.peak_to_peak},
                             {"saturated_share", l.saturated_share},
                             {"speed_mm_s", l.speed},
                             {"verdict", name_of(l.verdict)}});
  }
  return json_text(j);
}

void write_plot_data(const RigReport& report, const SessionRecording& r,
                     const std::string& folder) {
  if (report.servo)
    write_histogram(report.servo->periods, 1e6, "period_us", folder + "/periods.csv");
  if (report.step_cost)
    write_histogram(report.step_cost->costs, 1e6, "cost_us", folder + "/step-cost.csv");

  constexpr std::size_t kBlocks = 4000;
  const std::size_t n = r.servo_time.size();
  const std::size_t length = std::max<std::size_t>(1, (n + kBlocks - 1) / kBlocks);
  CsvWriter csv(folder + "/trace.csv");
  header_row(csv, {"time_s", "force_least_n", "force_most_n", "x_mm", "y_mm", "z_mm",
                   "energy_least_mj", "energy_most_mj"});
  for (std::size_t begin = 0; begin < n; begin += length) {
    const std::size_t end = std::min(n, begin + length);
    double least = r.force_sent[begin].norm(), most = least, low = 0, high = 0;
    Vec3 mean = Vec3::Zero();
    for (std::size_t i = begin; i < end; ++i) {
      const double force = r.force_sent[i].norm();
      least = std::min(least, force);
      most = std::max(most, force);
      mean += r.device_position[i] / static_cast<double>(end - begin);
      if (!report.device_port) continue;
      const double energy = report.device_port->energy[i];
      low = i == begin ? energy : std::min(low, energy);
      high = i == begin ? energy : std::max(high, energy);
    }
    for (const double v :
         {r.servo_time[begin] - r.servo_time[0], least, most, mean[0], mean[1], mean[2], low, high})
      csv.number(v);
    csv.end_row();
  }
  csv.close();

  if (report.sweep) {
    CsvWriter levels(folder + "/levels.csv");
    header_row(levels, {"level", "rms_above_20_hz_n", "counts_rms_n", "peak_to_peak_n",
                        "saturated_share", "speed_mm_s", "verdict"});
    for (const LevelFigures& l : report.sweep->levels) {
      for (const double v :
           {l.level, l.rms_above_20, l.counts_rms, l.peak_to_peak, l.saturated_share, l.speed})
        levels.number(v);
      levels.number(static_cast<double>(l.verdict));
      levels.end_row();
    }
    levels.close();
  }
  if (report.step) {
    CsvWriter step(folder + "/step.csv");
    header_row(step, {"time_s", "commanded_n", "sent_n", "displacement_mm"});
    const std::size_t onset = report.step->onset;
    const auto around = static_cast<std::size_t>(0.25 * r.header.rate_hz);
    const Vec3 u = r.force_commanded[onset].normalized();
    for (std::size_t i = onset > around / 5 ? onset - around / 5 : 0;
         i < std::min(n - 1, onset + around); ++i) {
      for (const double v :
           {r.servo_time[i] - r.servo_time[onset], r.force_commanded[i].dot(u),
            r.force_sent[i + 1].dot(u), (r.device_position[i] - r.device_position[onset]).dot(u)})
        step.number(v);
      step.end_row();
    }
    step.close();
  }
}

}  // namespace toothprep
