#include "toothprep/proof/figures/report.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/tissue.h"
#include "toothprep/tools/io/json_number.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep::figures {
namespace {

using Json = nlohmann::ordered_json;

std::string text(double x, fmt::format_string<double> format = "{:.4g}") {
  return std::isfinite(x) ? fmt::vformat(format, fmt::make_format_args(x)) : "–";
}

Json json_of(const Claim& c) {
  Json j;
  j["claim"] = c.claim;
  j["engine"] = c.engine;
  j["quantity"] = c.quantity;
  j["unit"] = c.unit;
  j["expected_from"] = c.from;
  j["expected"] = number_or_null(c.expected);
  j["measured"] = number_or_null(c.measured);
  j["error"] = number_or_null(c.error);
  j["error_unit"] = c.error_unit;
  j["tolerance"] = number_or_null(c.tolerance);
  j["holds"] = c.holds;
  return j;
}

Json json_of(const RunReport& r) {
  Json j;
  j["run"] = r.run;
  j["engine"] = r.engine;
  j["drive"] = r.drive;
  j["voxel_mm"] = r.voxel_mm;
  j["trace"] = r.trace;
  j["exact"] = r.exact;
  if (r.compared) {
    j["force_rms_deviation_percent"] = r.force_rms_percent;
    j["force_max_deviation_percent"] = r.force_max_percent;
    j["torque_rms_deviation_percent"] = r.torque_rms_percent;
    j["torque_max_deviation_percent"] = r.torque_max_percent;
  }
  if (r.has_plateau) {
    j["voxel_effect_percent"] = r.voxel_effect_percent;
    j["voxel_effect_above_2_hz_percent"] = r.voxel_effect_above_2_hz_percent;
  }
  j["energy_ratio"] = number_or_null(r.energy_ratio);
  j["energy_audit"] = r.energy_audit;
  j["findings"] = r.findings;
  j["peak_force_n"] = r.peak_force_n;
  j["largest_lag_mm"] = r.largest_lag_mm;
  j["stalled_steps"] = r.stalled_steps;
  j["stall_onsets"] = r.stall_onsets;
  j["shank_contact_steps"] = r.shank_contact_steps;
  for (std::size_t k = 0; k < r.removed_mm3.size(); ++k)
    j["removed_mm3"][std::string(kTissueNames[k])] = r.removed_mm3[k];
  j["seconds_simulated"] = r.seconds_simulated;
  return j;
}

Json json_of(const Comparison& c) {
  return {{"test", c.test},
          {"title", c.title},
          {"rows", c.rows},
          {"parameters", c.parameters},
          {"quantity", c.quantity},
          {"unit", c.unit},
          {"confidence", c.confidence},
          {"measured_low", c.measured_low},
          {"measured_high", number_or_null(c.measured_high)},
          {"predicted_low", number_or_null(c.predicted_low)},
          {"predicted_high", number_or_null(c.predicted_high)},
          {"ratio", number_or_null(c.ratio)},
          {"verdict", c.verdict},
          {"assumes", c.assumes}};
}

Json json_of(const Trend& t) {
  return {{"test", t.test},           {"title", t.title},
          {"rows", t.rows},           {"parameters", t.parameters},
          {"quantity", t.quantity},   {"observed", t.observed},
          {"predicted", t.predicted}, {"factor", number_or_null(t.factor)},
          {"agrees", t.agrees},       {"assumes", t.assumes}};
}

Json json_of(const Plot& p) {
  Json j;
  j["file"] = p.file;
  j["title"] = p.title;
  j["tissues"] = p.tissues;
  j["stalled"] = p.stalled;
  j["from_s"] = p.from_s;
  j["to_s"] = p.to_s;
  for (const Panel& panel : p.panels) {
    Json q;
    q["label"] = panel.label;
    for (const Curve& c : panel.curves)
      q["curves"].push_back({{"label", c.label},
                             {"file", c.file},
                             {"column", c.column},
                             {"style", c.style},
                             {"scale", c.scale}});
    j["panels"].push_back(q);
  }
  return j;
}

Json json_of(const MapPlot& m) {
  Json j;
  j["file"] = m.file;
  j["title"] = m.title;
  j["x_label"] = m.x_label;
  j["y_label"] = m.y_label;
  j["value_label"] = m.value_label;
  j["x"] = m.x;
  j["y"] = m.y;
  j["values"] = m.values;
  j["least"] = m.least;
  j["most"] = m.most;
  j["logarithmic"] = m.logarithmic;
  j["verdicts"] = m.verdicts;
  j["lines"] = Json::array();
  for (const MapPlot::Line& line : m.lines)
    j["lines"].push_back({{"label", line.label}, {"x", line.x}, {"y", line.y}});
  return j;
}

Json json_of(const MetricTable& t) {
  Json j;
  j["title"] = t.title;
  j["columns"] = t.columns;
  for (const MetricTable::Row& row : t.rows) {
    Json values = Json::array();
    for (const double x : row.values) values.push_back(number_or_null(x));
    j["rows"].push_back({{"run", row.run}, {"title", row.title}, {"values", values}});
  }
  return j;
}

// Text in a cell of a table.
std::string cell(const std::string& words) {
  std::string safe;
  for (const char c : words) safe += c == '|' ? "\\|" : std::string(1, c);
  return safe;
}

// " N"; nothing for a pure number.
std::string unit_text(const std::string& unit) { return unit == "1" ? "" : " " + unit; }

// "2.2 to 5.9 N", "at least 4.9 N", "–".
std::string band(double low, double high, const std::string& unit) {
  if (!std::isfinite(low)) return "–";
  if (!std::isfinite(high)) return "at least " + text(low) + unit_text(unit);
  return text(low) + (text(low) == text(high) ? "" : " to " + text(high)) + unit_text(unit);
}

std::string assumptions(const std::string& title, const std::vector<std::string>& assumes) {
  if (assumes.empty()) return "";
  std::string md = "- " + title + ":";
  for (const std::string& text : assumes) md += " " + text + ";";
  md.back() = '.';
  return md + "\n";
}

std::string comparisons_text(const FigureReport& f) {
  std::string md, assumed, last;
  if (!f.comparisons.empty())
    md +=
        "\n| measured | rows | confidence | quantity | measured | parameters | predicted | ratio | "
        "|\n|---|---|---|---|---|---|---|---|---|\n";
  for (const Comparison& c : f.comparisons) {
    const std::string verdict = c.verdict == "inside" ? c.verdict : "**" + c.verdict + "**";
    md += "| " + cell(c.title) + " | " + c.rows + " | " + c.confidence + " | " + c.quantity +
          " | " + band(c.measured_low, c.measured_high, c.unit) + " | " + c.parameters + " | " +
          band(c.predicted_low, c.predicted_high, c.unit) + " | " + text(c.ratio, "{:.2f}") +
          " | " + verdict + " |\n";
    if (c.test != last) assumed += assumptions(c.title, c.assumes);
    last = c.test;
  }
  if (!f.trends.empty())
    md +=
        "\n| trend | rows | quantity | observed | parameters | predicted | factor | |\n"
        "|---|---|---|---|---|---|---|---|\n";
  for (const Trend& t : f.trends) {
    md += "| " + cell(t.title) + " | " + t.rows + " | " + t.quantity + " | " + t.observed + " | " +
          t.parameters + " | " + t.predicted + " | " + text(t.factor, "{:.2f}") + " | " +
          (t.agrees                  ? "agrees"
           : std::isfinite(t.factor) ? "**disagrees**"
                                     : "–") +
          " |\n";
    if (t.test != last) assumed += assumptions(t.title, t.assumes);
    last = t.test;
  }
  return assumed.empty() ? md : md + "\nAssumed where the source does not say:\n\n" + assumed;
}

std::string table_text(const MetricTable& t) {
  std::string md = "\n" + t.title + "\n\n| |", rule = "|---|";
  for (const std::string& column : t.columns) {
    md += " " + cell(column) + " |";
    rule += "---|";
  }
  md += "\n" + rule + "\n";
  for (const MetricTable::Row& row : t.rows) {
    md += "| " + cell(row.title) + " |";
    for (const double x : row.values) md += " " + text(x, "{:.3g}") + " |";
    md += "\n";
  }
  return md;
}

std::string markdown(const ReportHeader& header, const std::vector<FigureReport>& figures) {
  std::size_t claims = 0, holding = 0;
  for (const FigureReport& f : figures)
    for (const Claim& c : f.claims) {
      ++claims;
      holding += c.holds;
    }
  std::string md = "# The paper's experiments\n\ntoothprep " + header.version + ", voxels of " +
                   text(header.voxel_mm) + " mm, engines: " + header.engines + ". " +
                   std::to_string(holding) + " of " + std::to_string(claims) +
                   " claims hold. Deviations are in percent of the plateau's force.\n";
  for (const FigureReport& f : figures) {
    md += "\n## " + f.title + "\n\n";
    for (const Plot& p : f.plots) md += "![" + p.title + "](" + p.file + ".png)\n";
    for (const MapPlot& m : f.maps) md += "![" + m.title + "](" + m.file + ".png)\n";
    for (const Picture& p : f.pictures) md += "![" + p.title + "](" + p.file + ")\n";
    if (!f.comparisons.empty()) md += "![" + f.title + "](" + f.name + "/predicted.png)\n";
    md += comparisons_text(f);
    for (const MetricTable& t : f.tables) md += table_text(t);
    if (f.claims.empty()) continue;
    md +=
        "\n| claim | engine | quantity | expected | from | measured | error | allowed | |\n"
        "|---|---|---|---|---|---|---|---|---|\n";
    for (const Claim& c : f.claims)
      md += "| " + cell(c.claim) + " | " + c.engine + " | " + cell(c.quantity) + " | " +
            text(c.expected) + unit_text(c.unit) + " | " + cell(c.from) + " | " + text(c.measured) +
            unit_text(c.unit) + " | " + text(c.error, "{:.3g}") + unit_text(c.error_unit) + " | " +
            text(c.tolerance, "{:.3g}") + unit_text(c.error_unit) + " | " +
            (c.holds ? "holds" : "**does not hold**") + " |\n";
    if (f.runs.empty()) continue;
    md +=
        "\n| run | engine | drive | voxel mm | force RMS % | force max % | torque RMS % | torque "
        "max % | voxel effect % | above 2 Hz % | energy ratio | peak N | lag mm | stalls |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n";
    for (const RunReport& r : f.runs) {
      const double none = std::nan("");
      const auto compared = [&](double x) { return text(r.compared ? x : none, "{:.3f}"); };
      const auto plateau = [&](double x) { return text(r.has_plateau ? x : none, "{:.3f}"); };
      md += "| " + cell(r.run) + " | " + r.engine + " | " + r.drive + " | " + text(r.voxel_mm) +
            " | " + compared(r.force_rms_percent) + " | " + compared(r.force_max_percent) + " | " +
            compared(r.torque_rms_percent) + " | " + compared(r.torque_max_percent) + " | " +
            plateau(r.voxel_effect_percent) + " | " + plateau(r.voxel_effect_above_2_hz_percent) +
            " | " + text(r.energy_ratio) + " | " + text(r.peak_force_n) + " | " +
            text(r.largest_lag_mm) + " | " + std::to_string(r.stall_onsets) + " |\n";
    }
  }
  return md;
}

}  // namespace

Claim near(const std::string& claim, const std::string& engine, const std::string& quantity,
           const std::string& unit, const std::string& from, double expected, double measured,
           double tolerance_percent, double scale) {
  Claim c{claim, engine, quantity, unit, from, expected, measured};
  c.error = 100 * std::abs(measured - expected) / (scale > 0 ? scale : std::abs(expected));
  c.tolerance = tolerance_percent;
  c.holds = c.error <= tolerance_percent;
  return c;
}

Claim bound(const std::string& claim, const std::string& engine, const std::string& quantity,
            const std::string& unit, const std::string& from, double expected, double measured,
            bool at_least) {
  Claim c{claim,    engine,  (at_least ? "at least: " : "at most: ") + quantity, unit, from,
          expected, measured};
  c.error_unit = unit;
  c.error = std::max(0.0, at_least ? expected - measured : measured - expected);
  c.holds = at_least ? measured >= expected : measured <= expected;
  return c;
}

void write_report(const ReportHeader& header, const std::vector<FigureReport>& figures,
                  const std::string& folder) {
  Json j;
  j["schema"] = "toothprep-figures";
  j["schema_version"] = 1;
  j["toothprep_version"] = header.version;
  j["build"] = header.build;
  j["voxel_mm"] = header.voxel_mm;
  j["engines"] = header.engines;
  j["parameters"] = header.parameters_toml;
  j["figures"] = Json::array();
  for (const FigureReport& f : figures) {
    Json g;
    g["name"] = f.name;
    g["title"] = f.title;
    g["claims"] = Json::array();
    for (const Claim& c : f.claims) g["claims"].push_back(json_of(c));
    g["runs"] = Json::array();
    for (const RunReport& r : f.runs) g["runs"].push_back(json_of(r));
    g["plots"] = Json::array();
    for (const Plot& p : f.plots) g["plots"].push_back(json_of(p));
    g["maps"] = Json::array();
    for (const MapPlot& m : f.maps) g["maps"].push_back(json_of(m));
    g["pictures"] = Json::array();
    for (const Picture& p : f.pictures)
      g["pictures"].push_back({{"file", p.file},
                               {"title", p.title},
                               {"mesh", p.mesh},
                               {"compare", p.compare},
                               {"view", p.view},
                               {"occlusal", p.occlusal}});
    if (!f.comparisons.empty() || !f.trends.empty()) {
      g["comparisons"] = Json::array();
      for (const Comparison& c : f.comparisons) g["comparisons"].push_back(json_of(c));
      g["trends"] = Json::array();
      for (const Trend& t : f.trends) g["trends"].push_back(json_of(t));
    }
    for (const MetricTable& t : f.tables) g["tables"].push_back(json_of(t));
    j["figures"].push_back(g);
  }
  write_file(folder + "/figures.json", json_text(j));
  write_file(folder + "/figures.md", markdown(header, figures));
}

}  // namespace toothprep::figures
