// What a tooth's file says of the labels (a segmentation in voxels) that its surfaces come from.
#pragma once

#include <map>
#include <optional>
#include <string>

namespace toothprep {

struct LabelSource {
  double spacing_mm = 0;  // the largest of the labels' voxels: what their surfaces are known to
  bool smooth = true;     // their steps were smoothed away
};

// As `labels_spacing_mm` and `labels_surface` ("smooth" or "as labelled").
void record_labels(const LabelSource& source, std::map<std::string, std::string>& provenance);

// What record_labels() wrote; nothing of a tooth from another source, or if it can't be read.
[[nodiscard]] std::optional<LabelSource> recorded_labels(
    const std::map<std::string, std::string>& provenance);

}  // namespace toothprep
