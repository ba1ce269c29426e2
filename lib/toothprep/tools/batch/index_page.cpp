#include "toothprep/tools/batch/index_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "toothprep/tools/score_report/markup.h"
#include "toothprep/tools/score_report/page_style.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargestPicture = 1 << 20;  // bytes, of one that the page takes in
constexpr std::size_t kMostRows = 2000;

constexpr const char* kTableStyle = R"css(
td.rank { font-size: 18px; font-weight: 600; text-align: right; }
td img { display: block; width: 160px; height: auto; border-radius: 6px; }
td.points { white-space: nowrap; font-variant-numeric: tabular-nums; }
.tag { display: inline-block; padding: 1px 9px; border-radius: 9px; font-size: 13px; white-space: nowrap; }
.tag.pass { background: var(--good-soft); color: var(--good); }
.tag.fail { background: var(--bad-soft); color: var(--bad); }
.tag.warn { background: var(--warn-soft); color: var(--warn); }
)css";

// In a link: what is no letter, digit or one of -._~/ becomes %XX.
std::string link_text(const std::string& path) {
  std::string text;
  for (const unsigned char c : path)
    if (std::isalnum(c) ||
        std::string_view("-._~/").find(static_cast<char>(c)) != std::string_view::npos)
      text += static_cast<char>(c);
    else
      text += fmt::format("%{:02X}", c);
  return text;
}

std::string picture_of(const fs::path& folder) {
  const fs::path path = folder / "report" / "thumbnail.png";
  std::error_code error;
  if (const auto size = fs::file_size(path, error); error || size > kLargestPicture) return {};
  std::ifstream in(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  return "<img alt=\"\" src=\"data:image/png;base64," + base64(bytes) + "\"/>";
}

std::string links_of(const ItemRow& row, const fs::path& folder) {
  std::string links;
  for (const auto& [file, text] : {std::pair{"report/report.html", "report"},
                                   {"score.json", "score.json"},
                                   {"trace.h5", "trace.h5"},
                                   {"log.txt", "log"}}) {
    std::error_code error;
    if (!fs::exists(folder / file, error)) continue;
    links += (links.empty() ? "" : " · ") + std::string("<a href=\"") +
             escaped(link_text((row.folder.empty() ? row.name : row.folder) + "/" + file)) + "\">" +
             text + "</a>";
  }
  return links;
}

std::string removed_of(const ItemRow& row) {
  double total = 0;
  bool known = false;
  for (const auto& [key, value] : row.figures)
    if (key.rfind("removed_mm3.", 0) == 0 && key != "removed_mm3.total") {
      total += std::atof(value.c_str());
      known = true;
    }
  return known ? fmt::format("{:.2f}", total) : std::string();
}

std::string status_tag(const ItemRow& row) {
  const char* kind = row.failed() ? "fail" : row.status == "done" ? "pass" : "warn";
  return std::string("<span class=\"tag ") + kind + "\">" + row.status + "</span>";
}

std::string verdict_tag(const ItemRow& row) {
  const std::string passed = row.figure("passed");
  if (passed.empty()) return {};
  const bool certain = row.figure("verdict_certain") != "false";
  return std::string("<span class=\"tag ") + (passed == "true" ? "pass" : "fail") + "\">" +
         (passed == "true" ? "passed" : "failed") + "</span>" +
         (certain ? "" : " <span class=\"muted small-text\">within the uncertainty</span>");
}

std::string row_html(const ItemRow& row, std::size_t rank, const fs::path& top) {
  const fs::path folder = top / (row.folder.empty() ? row.name : row.folder);
  const std::string points = row.figure("points_percent");
  std::string html = "<tr><td class=\"rank\">" + (rank > 0 ? std::to_string(rank) : "") +
                     "</td><td>" + picture_of(folder) + "</td><td><b>" + escaped(row.name) +
                     "</b><br/><span class=\"small-text\">" + links_of(row, folder) +
                     "</span></td><td>" + status_tag(row);
  if (!row.reason.empty())
    html += "<br/><span class=\"small-text\">" + escaped(row.reason) + "</span>";
  html += "</td><td class=\"points\">" +
          (points.empty() ? "" : fmt::format("{:.1f} %", std::atof(points.c_str()))) + "</td><td>" +
          verdict_tag(row) + "</td><td class=\"points\">" + removed_of(row) + "</td></tr>\n";
  return html;
}

}  // namespace

std::string index_page(const ItemRows& rows, const std::string& folder,
                       const std::string& version) {
  struct Place {
    double points;
    std::string name;
    std::size_t row;
  };
  std::vector<Place> order;
  std::size_t failed = 0, warned = 0, passed = 0, judged = 0;
  for (const ItemRow& row : rows) {
    failed += row.failed();
    warned += row.status == "done with warning";
    passed += row.figure("passed") == "true";
    judged += !row.figure("passed").empty();
    const std::string points = row.figure("points_percent");
    order.push_back({points.empty() ? -1.0 : std::atof(points.c_str()), row.name, order.size()});
  }
  std::stable_sort(order.begin(), order.end(), [](const Place& a, const Place& b) {
    return a.points != b.points ? a.points > b.points : a.points >= 0 && a.name < b.name;
  });
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\n<meta "
      "name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>Batch</title>\n"
      "<style>" +
      std::string(kPageStyle) + kTableStyle + "</style></head><body><main>\n<header><h1>" +
      std::to_string(rows.size()) + (rows.size() == 1 ? " item" : " items") + "</h1><p>" +
      (judged > 0 ? fmt::format("{} of {} passed; ", passed, judged) : std::string()) +
      fmt::format("{} done, {} of them with a warning, {} failed. ", rows.size() - failed, warned,
                  failed) +
      "All figures: <a href=\"batch.csv\">batch.csv</a>, <a href=\"batch.json\">batch.json</a>. " +
      (rows.size() > kMostRows ? fmt::format("Below are {} of them. ", kMostRows) : std::string()) +
      "<span class=\"muted\">toothprep " + escaped(version) +
      "</span></p></header>\n<section><table>\n<tr><th></th><th></th><th>name</th>"
      "<th>status</th><th>points</th><th>verdict</th><th>removed, mm³</th></tr>\n";
  std::size_t rank = 0, place = 0;
  double last = -1;
  for (const Place& at : order) {
    if (++place > kMostRows) break;
    if (at.points >= 0 && at.points != last) rank = place;  // equal points, equal rank
    last = at.points;
    html += row_html(rows[at.row], at.points >= 0 ? rank : 0, folder);
  }
  return html + "</table></section></main></body></html>\n";
}

}  // namespace toothprep
