#include "toothprep/tools/io/scan_uncertainty.h"

#include <fmt/format.h>

#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

std::string key_of(std::size_t surface) {
  return std::string("scan_half_width_") + kScanSurfaceNames[surface] + "_mm";
}

}  // namespace

ScanHalfWidths SurfaceUncertainty::half_widths() const {
  ScanHalfWidths widths{};
  for (std::size_t s = 0; s < widths.size(); ++s) widths[s] = figures[s].half_width;
  return widths;
}

void record_scan_half_widths(const ScanHalfWidths& widths,
                             std::map<std::string, std::string>& provenance) {
  for (std::size_t s = 0; s < widths.size(); ++s)
    if (widths[s] > 0) provenance[key_of(s)] = fmt::format("{:.4g}", widths[s]);
}

std::optional<ScanHalfWidths> recorded_scan_half_widths(
    const std::map<std::string, std::string>& provenance) {
  ScanHalfWidths widths{};
  bool any = false;
  for (std::size_t s = 0; s < widths.size(); ++s) {
    const auto found = provenance.find(key_of(s));
    if (found == provenance.end()) continue;
    const std::optional<double> mm = decimal_number(found->second);
    if (!mm || !(*mm > 0)) continue;
    widths[s] = *mm;
    any = true;
  }
  if (!any) return {};
  return widths;
}

}  // namespace toothprep
