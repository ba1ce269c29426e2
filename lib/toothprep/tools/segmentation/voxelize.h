// A CT scan, or a segmentation made elsewhere, to a layered tooth.
//
// The tooth stands where the scan has it (LPS, mm), on the lattice whose voxels lie side by side
// from the frame's zero (faces at multiples of the voxel size, as the specimens' do), so that the
// same tooth gets the same lattice whatever file, crop or axes it came with. This folder's README
// describes the method and its measured accuracy.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/io/scan_uncertainty.h"
#include "toothprep/tools/scan_files/scan_source.h"

namespace toothprep {

struct VoxelizeOptions {  // of scans; of labels `voxel`, the tooth, smoothing and the callbacks
  double voxel = 0.1;     // mm, of the tooth
  // Grey values of the borders surroundings|dentin and dentin|enamel; automatic when absent.
  std::optional<std::array<double, 2>> thresholds;
  // Borders pulp|dentin and dentin|enamel that are typical of this kind of scan: they only separate the
  // classes apart, the thresholds are then measured. Not with `thresholds`.
  std::optional<std::array<double, 2>> typical;
  bool thin_enamel = true;  // find enamel that is too thin to reach its grey (thin_enamel.h)
  // Which one of several teeth: the n-th largest piece, or the one at a place (mm, W).
  int tooth = 1;
  std::optional<Vec3> tooth_at;  // wins over `tooth`
  bool one_tooth = false;        // of labels: one of several; else everything named counts
  bool smooth_labels = true;     // of labels: surfaces without their steps (smooth_labels.h)
  bool keep_greys = false;       // for the report's pictures
  // Called with what is being done and how much of the whole is done (0..1), now and then.
  std::function<void(const std::string& stage, double done)> progress;
  // Told in advance what memory and time the work will take, if that is much.
  std::function<void(const std::string&)> announce;
};

// What was found on the way, for the user.
struct VoxelizeReport {
  double threshold_dentin = 0, threshold_enamel = 0;          // grey values; of a grey scan only
  double surroundings = 0, dentin = 0, enamel = 0, pulp = 0;  // typical grey values; pulp 0 if none
  // Full width at half maximum of all that blurs the surface, voxels included, mm; 0 if not known or
  // not asked for (thin_enamel). Enamel's outer surface where it is too thin to reach its grey.
  double blur_fwhm_mm = 0, thin_enamel_mm2 = 0;
  SurfaceUncertainty uncertainty;  // of a grey scan only
  std::vector<std::string> notes;  // what a user ought to look at
  ImageVolume<float> greys;        // of the scan, no finer than the tooth; if they were to be kept
};

// Grey scan to tooth: the chosen bright component, of dentin and enamel, and the dark cavity inside
// as pulp; what is far brighter than enamel is `other`. The scan is read in slabs, once, or twice
// if the tooth's voxels are about as small as the scan's; memory grows with the tooth's box (about
// 15 bytes a voxel), not with the scan. Surfaces of a tooth much finer than its scan are found on a lattice of 0.6
// of the scan's smallest voxel, and interpolated. Throws Error when no tooth can be separated from its
// surroundings (flat image, one class, nothing but noise) or when it looks like a segmentation,
// naming what was found, when its two brightest classes can't be dentin and enamel (plausibility.h),
// or when the tooth would take more memory than there is. Provenance gets threshold_dentin,
// threshold_enamel and what record_scan_half_widths() writes.
[[nodiscard]] LayeredTooth voxelize_scan(ScanSource& scan, const VoxelizeOptions& options,
                                         VoxelizeReport* report = nullptr);
[[nodiscard]] LayeredTooth voxelize_scan(const ImageVolume<float>& scan,
                                         const VoxelizeOptions& options,
                                         VoxelizeReport* report = nullptr);

// Labels to tooth. `tissues` maps label values to tissues; label values not named are air. Every
// named voxel counts, floating pieces too: volumes are those of the labels. With `one_tooth` only one
// piece of enamel, dentin and pulp that hangs together by faces counts, and of `other` what lies
// within 1 mm of its box; the notes list the teeth. Throws Error if a label of the map or that tooth
// does not occur, or when the tooth would take more memory than there is. Provenance gets what
// record_labels() writes.
[[nodiscard]] LayeredTooth voxelize_labels(const ImageVolume<std::uint16_t>& labels,
                                           const std::map<std::uint16_t, Tissue>& tissues,
                                           const VoxelizeOptions& options,
                                           VoxelizeReport* report = nullptr);

}  // namespace toothprep
