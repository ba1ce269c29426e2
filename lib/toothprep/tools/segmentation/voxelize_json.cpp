#include "toothprep/tools/segmentation/voxelize_json.h"

#include <nlohmann/json.hpp>

#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/label_source.h"

namespace toothprep {

std::string voxelize_json(const LayeredTooth& tooth, const std::string& file, double seconds,
                          const std::vector<std::string>& notes, const MadeBy& program,
                          const VoxelizeReport* grey_scan) {
  nlohmann::json json = {{"schema", "toothprep-voxelize"},
                         {"schema_version", 1},
                         {"toothprep_version", program.version},
                         {"build", program.build},
                         {"source", tooth.provenance.at("source")},
                         {"source_sha256", tooth.provenance.at("source_sha256")},
                         {"tooth", nullptr},
                         {"tooth_sha256", tooth_sha256(tooth)},
                         {"voxel_mm", tooth.lattice.voxel},
                         {"seconds", seconds},
                         {"notes", notes}};
  if (!file.empty()) json["tooth"] = file;
  const PerTissue<double> volumes = remaining_volumes_mm3(tooth);
  for (int t = 0; t < kTissueCount; ++t)
    json["volume_mm3"][std::string(kTissueNames[t])] = volumes[t];
  if (const auto labels = recorded_labels(tooth.provenance)) {
    json["labels_spacing_mm"] = labels->spacing_mm;
    json["labels_surface"] = tooth.provenance.at("labels_surface");
  }
  if (grey_scan) {
    json["threshold_dentin"] = grey_scan->threshold_dentin;
    json["threshold_enamel"] = grey_scan->threshold_enamel;
    json["grey_surroundings"] = grey_scan->surroundings;
    json["grey_dentin"] = grey_scan->dentin;
    json["grey_enamel"] = grey_scan->enamel;
    const ScanHalfWidths widths = grey_scan->uncertainty.half_widths();
    for (std::size_t s = 0; s < widths.size(); ++s)
      if (widths[s] > 0) json["half_width_mm"][kScanSurfaceNames[s]] = widths[s];
    if (grey_scan->blur_fwhm_mm > 0) {
      json["blur_fwhm_mm"] = grey_scan->blur_fwhm_mm;
      json["thin_enamel_mm2"] = grey_scan->thin_enamel_mm2;
    }
  }
  return json_text(json);
}

}  // namespace toothprep
