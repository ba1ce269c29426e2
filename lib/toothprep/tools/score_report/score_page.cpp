#include "toothprep/tools/score_report/score_page.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/score/definitions.h"
#include "toothprep/tools/score_report/gauge.h"
#include "toothprep/tools/score_report/markup.h"
#include "toothprep/tools/score_report/page_style.h"
#include "toothprep/tools/score_report/section_drawing.h"

namespace toothprep {
namespace {

std::string file_name(const std::string& path) {
  const std::size_t slash = path.find_last_of("/\\");
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

std::string type_name(const std::string& type) {
  if (type == "crown") return "full crown";
  if (type == "class1") return "Class I cavity";
  if (type == "class2") return "Class II cavity";
  return type;
}

// A sentence's first letter, if it is one of ASCII.
std::string capital(std::string text) {
  if (!text.empty() && text[0] >= 'a' && text[0] <= 'z') text[0] = static_cast<char>(text[0] - 32);
  return text;
}

std::string bullets(const char* style, const std::vector<std::string>& texts) {
  if (texts.empty()) return {};
  std::string html = std::string("<ul class=\"") + style + "\">\n";
  for (const std::string& t : texts) html += "<li>" + escaped(capital(t)) + "</li>\n";
  return html + "</ul>\n";
}

std::string fact(const std::string& name, const std::string& markup) {
  return "<dt>" + escaped(name) + "</dt><dd>" + markup + "</dd>\n";
}

std::string uncertainty_text(double u, const std::string& unit) {
  if (!std::isfinite(u) || unit == "yes/no") return {};
  // An uncertainty that rounds to nothing is written with the digits that it needs.
  for (int digits = -1; digits < 7; ++digits) {
    const std::string text = digits < 0 ? value_text(u, unit) : value_text(u, unit, digits);
    if (u == 0 || text.find_first_of("123456789") < text.find_first_of(" °")) return "±" + text;
  }
  return "±" + value_text(u, unit);
}

// Small lengths and volumes with a third decimal.
std::string measured_text(double value, const std::string& unit) {
  const bool small = unit.rfind("mm", 0) == 0 && value != 0 && std::abs(value) < 0.1;
  return small ? value_text(value, unit, 3) : value_text(value, unit);
}

// ---- The parts of the page

std::string total_bar(const RubricResult& r) {
  const auto x = [](double percent) {
    return short_number(2 + 1.8 * std::clamp(percent, 0.0, 100.0));
  };
  const double total = std::clamp(*r.points_percent, 0.0, 100.0);
  return "<svg class=\"total-bar\" role=\"img\" aria-label=\"points\" viewBox=\"0 0 184 18\" "
         "width=\"184\" height=\"18\"><rect class=\"t-back\" x=\"2\" y=\"5\" width=\"180\" "
         "height=\"8\" rx=\"3\"/><rect class=\"t-fill\" x=\"2\" y=\"5\" width=\"" +
         short_number(1.8 * total) + "\" height=\"8\" rx=\"3\"/>" +
         (r.points_percent_high - r.points_percent_low > 0.05
              ? "<line class=\"t-range\" x1=\"" + x(r.points_percent_low) + "\" y1=\"9\" x2=\"" +
                    x(r.points_percent_high) + "\" y2=\"9\"/>"
              : "") +
         "<line class=\"t-pass\" x1=\"" + x(r.pass_points) + "\" y1=\"1\" x2=\"" +
         x(r.pass_points) + "\" y2=\"17\"/></svg>";
}

std::string verdict_box(const std::optional<RubricResult>& result) {
  if (!result)
    return "<div class=\"verdict\"><b>Measured</b><span class=\"total\">no rubric, no "
           "verdict</span></div>\n";
  const RubricResult& r = *result;
  std::string html = std::string("<div class=\"verdict ") + (r.passed ? "pass" : "fail") +
                     "\"><b>" + (r.passed ? "PASSED" : "FAILED") + "</b>";
  if (r.points_percent) {
    html += "<span class=\"total\">" + short_number(*r.points_percent, 1) + " % of the points";
    if (r.points_percent_high - r.points_percent_low > 0.05)
      html += " <span class=\"muted\">(" + short_number(r.points_percent_low, 0) + " to " +
              short_number(r.points_percent_high, 0) + ")</span>";
    html += "</span>" + total_bar(r);
  }
  html += "<span class=\"muted small-text\">passes from " + short_number(r.pass_points, 1) + " %" +
          (r.certain ? "" : "; not certain") + "</span></div>\n";
  return html;
}

std::string head(const ScorePage& page, const std::string& title) {
  const ScoreSheet& s = page.sheet;
  std::string html = "<header>\n<div class=\"top\"><div>\n<h1>" + escaped(title) +
                     "</h1>\n<p class=\"muted\" style=\"margin:0\">Score of a preparation" +
                     (s.type.empty() ? "" : ": " + escaped(type_name(s.type))) + "</p>\n";
  html += "<dl class=\"facts\">\n";
  for (const ScoreInput& input : s.inputs)
    html += fact(input.role == "rubric" ? "rubric file" : input.role,
                 "<span title=\"sha256 " + escaped(input.sha256) + "\">" + escaped(input.file) +
                     "</span> <code>" + escaped(input.sha256.substr(0, 12)) + "</code>");
  if (!s.type.empty())
    html += fact(
        "kind", escaped(type_name(s.type) + (s.type_from.empty() ? "" : " (" + s.type_from + ")")));
  if (s.axis)
    html +=
        fact("axis",
             escaped(short_number(s.axis->x(), 4) + ", " + short_number(s.axis->y(), 4) + ", " +
                     short_number(s.axis->z(), 4) +
                     (s.axis_from.empty() ? ""
                                          : " (" + s.axis_from + ", ±" +
                                                short_number(s.axis_uncertainty_deg, 2) + "°)")));
  if (s.voxel_mm) html += fact("voxel", escaped(short_number(*s.voxel_mm, 4) + " mm"));
  if (s.registered) html += fact("registered", "prepared and target were laid on the original");
  if (s.mm_per_unit)
    html += fact("unit of meshes", escaped(short_number(*s.mm_per_unit, 6) + " mm"));
  if (s.result)
    html += fact("rubric", escaped(s.result->name) + " <span class=\"muted\">" +
                               escaped(s.result->source) + "</span>");
  html += "</dl>\n</div>\n" + verdict_box(s.result) + "</div>\n";
  if (s.result) html += bullets("reasons", s.result->fail_reasons);
  std::vector<std::string> notes = s.notes;
  if (s.result) notes.insert(notes.end(), s.result->notes.begin(), s.result->notes.end());
  return html + bullets("notes", notes) + "</header>\n";
}

std::string chips(const CriterionResult& r) {
  std::string html;
  if (r.failed)
    html = "<span class=\"chip failed\">fails</span>";
  else
    html = std::string("<span class=\"chip ") + name_of(r.verdict) + "\">" + name_of(r.verdict) +
           "</span>";
  if (r.uncertain) html += "<span class=\"chip unsure\">near a limit</span>";
  return html;
}

std::string criteria_table(const RubricResult& result) {
  std::string html =
      "<section>\n<h2>Criteria</h2>\n<table>\n<thead><tr><th>criterion</th><th "
      "class=\"number\">measured</th><th class=\"range\">ideal, tolerated</th><th "
      "class=\"gauge-cell\"></th><th "
      "class=\"number\">points</th></tr></thead>\n<tbody>\n";
  std::string left_out;
  for (const CriterionResult& r : result.criteria) {
    const Criterion& c = r.criterion;
    if (r.verdict == CriterionVerdict::kNotJudged) {
      left_out += (left_out.empty() ? "" : "; ") +
                  ("<span title=\"" + escaped(c.source) + "\">" + escaped(c.name) + "</span>");
      continue;
    }
    const std::string u = uncertainty_text(r.uncertainty, c.unit);
    html += "<tr><td><span title=\"" + escaped(c.source) + "\">" + escaped(capital(c.name)) +
            "</span> " + chips(r);
    // That all is well needs no sentence.
    if (r.verdict != CriterionVerdict::kIdeal || r.uncertain)
      html += "<div class=\"reason\">" + escaped(capital(r.reason)) + "</div>";
    html += "</td><td class=\"number\">" +
            (r.value ? escaped(measured_text(*r.value, c.unit)) : "\u2013") +
            (u.empty() ? "" : "<div class=\"reason\">" + escaped(u) + "</div>") +
            "</td><td class=\"range\">" + escaped(range_text(c.ideal, c.unit));
    const bool same = c.ideal.low == c.tolerated.low && c.ideal.high == c.tolerated.high;
    if (!same)
      html += "<div class=\"reason\">" + escaped(range_text(c.tolerated, c.unit)) + "</div>";
    html += "</td><td class=\"gauge-cell\">" + gauge_svg(r) + "</td><td class=\"number\">" +
            short_number(r.points) + " <span class=\"muted\">/ " + short_number(r.of) + "</span>";
    html += "</td></tr>\n";
  }
  if (!left_out.empty())
    left_out = "<p class=\"muted small-text\">Not measured, so not judged: " + left_out + ".</p>\n";
  return html + "</tbody>\n</table>\n" + left_out +
         "<p class=\"muted small-text\">Bars: green is ideal, amber tolerated "
         "with points falling to none, grey gives no points, red fails the preparation. The mark "
         "is the measured value, the line through it its 95 % interval.</p>\n</section>\n";
}

std::string pictures(const std::vector<PagePicture>& all) {
  if (all.empty()) return {};
  std::string html = "<section>\n<h2>Pictures</h2>\n<div class=\"gallery\">\n";
  for (const PagePicture& p : all) {
    if (p.png.rfind("\x89PNG\r\n\x1a\n", 0) != 0)
      throw Error("report: the picture '" + p.caption + "' is not a PNG");
    html += "<figure><img alt=\"" + escaped(p.caption) + "\" src=\"data:image/png;base64," +
            base64(p.png) + "\"/><figcaption>" + escaped(p.caption) + "</figcaption></figure>\n";
  }
  return html + "</div>\n</section>\n";
}

std::string drawings(const std::vector<Section>& sections) {
  if (sections.empty()) return {};
  std::string html = "<section>\n<h2>Sections</h2>\n<div class=\"drawings\">\n";
  for (const Section& s : sections)
    html += "<figure><figcaption>" + escaped(capital(s.name)) + "</figcaption>\n" + section_svg(s) +
            "</figure>\n";
  return html + "</div>\n" + section_legend(sections) + "</section>\n";
}

std::string quantities_table(const Quantities& quantities) {
  if (quantities.empty()) return {};
  std::string html =
      "<section>\n<h2>All figures</h2>\n<table>\n<thead><tr><th>figure and definition</th><th "
      "class=\"number\">value</th><th class=\"number\">uncertainty (95 %)</th><th>key</th></tr>"
      "</thead>\n";
  // Sections in the table's order; within, as given. What the table doesn't know comes last.
  std::vector<std::string> sections;
  for (const QuantityDefinition& d : quantity_definitions())
    if (std::find(sections.begin(), sections.end(), d.section) == sections.end())
      sections.push_back(d.section);
  sections.push_back("Other");
  for (const std::string& section : sections) {
    std::string rows;
    for (const Quantity& q : quantities) {
      const QuantityDefinition* d = find_definition(q.key);
      if ((d ? d->section : "Other") != section || !std::isfinite(q.value)) continue;
      rows += "<tr><td>";
      if (d)
        rows += "<details><summary title=\"" + escaped(d->definition) + "\">" +
                escaped(quantity_name(q.key)) + "</summary><p>" + escaped(d->definition) +
                (d->source.empty() ? "" : " Source: " + escaped(d->source) + ".") +
                "</p></details>";
      else
        rows += escaped(q.key);
      rows += "</td><td class=\"number\">" + escaped(measured_text(q.value, q.unit)) +
              "</td><td class=\"number\">" + escaped(uncertainty_text(q.uncertainty, q.unit)) +
              "</td><td><code>" + escaped(q.key) + "</code></td></tr>\n";
    }
    if (!rows.empty())
      html += "<tbody>\n<tr class=\"group\"><th colspan=\"4\">" + escaped(section) +
              "</th></tr>\n" + rows + "</tbody>\n";
  }
  return html + "</table>\n</section>\n";
}

std::string plot_section(const char* title, const std::string& svg, const char* remark) {
  return std::string("<section>\n<h2>") + title + "</h2>\n" + svg +
         "<p class=\"muted small-text\">" + remark + "</p>\n</section>\n";
}

}  // namespace

std::string score_page_html(const ScorePage& page) {
  std::string title = page.title;
  if (title.empty()) {
    title = "Preparation";
    for (const ScoreInput& input : page.sheet.inputs)
      if (input.role == "prepared") title = file_name(input.file);
  }
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
      "style-src 'unsafe-inline'" +
      (page.script_policy.empty() ? "" : "; script-src " + page.script_policy) +
      "\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>" +
      escaped(title) + " \u2013 score</title>\n<style>" + kPageStyle +
      "</style>\n</head>\n<body>\n<main>\n";
  html += head(page, title);
  if (page.sheet.result) html += criteria_table(*page.sheet.result);
  html += page.scene;
  html += pictures(page.pictures);
  html += drawings(page.sections);
  if (page.deviation)
    html += plot_section("Deviation from the target", deviation_svg(*page.deviation),
                         "Share of the prepared surface by its signed distance to the target's "
                         "surface. Blue: too much was taken; red: material was left.");
  if (page.trace)
    html +=
        plot_section("Course of the work", trace_svg(*page.trace),
                     "Each column of the curves spans from the least to the largest value in "
                     "it, so that no peak is lost. Shaded: stalls, and contact with the pulp or "
                     "the neighbouring tooth.");
  html += quantities_table(page.sheet.quantities);
  html +=
      "<footer>toothprep " + escaped(page.sheet.toothprep_version) +
      ". Definitions unfold at each figure; all of them, with their sources, are in the "
      "program's lib/toothprep/tools/score/DEFINITIONS.md.</footer>\n</main>\n</body>\n</html>\n";
  return html;
}

}  // namespace toothprep
