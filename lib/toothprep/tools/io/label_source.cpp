#include "toothprep/tools/io/label_source.h"

#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

constexpr const char* kSpacing = "labels_spacing_mm";
constexpr const char* kSurface = "labels_surface";
constexpr const char* kSmooth = "smooth";
constexpr const char* kAsLabelled = "as labelled";

}  // namespace

void record_labels(const LabelSource& source, std::map<std::string, std::string>& provenance) {
  provenance[kSpacing] = shortest_text(source.spacing_mm);
  provenance[kSurface] = source.smooth ? kSmooth : kAsLabelled;
}

std::optional<LabelSource> recorded_labels(const std::map<std::string, std::string>& provenance) {
  const auto spacing = provenance.find(kSpacing), surface = provenance.find(kSurface);
  if (spacing == provenance.end()) return {};
  const std::optional<double> mm = decimal_number(spacing->second);
  if (!mm || !(*mm > 0)) return {};
  return LabelSource{*mm, surface == provenance.end() || surface->second == kSmooth};
}

}  // namespace toothprep
