// Which grey values are surroundings, dentin and enamel, and roughly where the tooth lies.
//
// Peaks are sought in the histogram of homogeneous places only (small gradient), so that the
// blurred borders, whose greys belong to no class, neither fill the valleys nor shift the peaks.
// The two brightest peaks that matter are dentin and enamel; a peak that lies too far above the
// others to be enamel is metal. What surrounds the tooth is measured around the tooth: it need be
// neither the darkest class (an empty pulp chamber may be darker) nor the value at the scan's edge.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/segmentation/dense_filters.h"

namespace toothprep {

// What is known of a scan before any of its greys is seen.
struct GreyHints {
  // Borders surroundings|dentin and dentin|enamel, taken as they are.
  std::optional<std::array<double, 2>> thresholds;
  // Borders pulp|dentin and dentin|enamel of scans of this kind: they separate the classes, the
  // borders themselves are measured.
  std::optional<std::array<double, 2>> typical;
  // Of several teeth: by volume (1 is the largest), or at a place (mm, W).
  int tooth = 1;
  std::optional<Vec3> tooth_at;
};

// A bright component that could be a tooth.
struct ToothPiece {
  double volume = 0;           // mm^3
  Vec3 centre = Vec3::Zero();  // mm, W
};

struct GreyClasses {
  double surroundings = 0, dentin = 0, enamel = 0;  // typical grey values
  double threshold_dentin = 0;                      // border surroundings | dentin
  double threshold_enamel = 0;                      // border dentin | enamel
  bool enamel_seen = true;  // else too little is that bright, and enamel's grey is a guess
  // The nearest class below dentin, whichever it is: border for "certainly no dentin".
  double below_dentin = 0;
  double darkest = 0;  // of the scan, a few voxels aside
  // Above this grey it is metal (or what else is too bright for enamel), if there is any.
  std::optional<double> threshold_metal;

  // Box of the chosen component, in (fractional) voxels of the scan, inclusive.
  Vec3 box_min = Vec3::Zero(), box_max = Vec3::Zero();
  bool touches_edge = false;  // the tooth reaches the scan's border

  std::vector<ToothPiece> pieces;  // at least a tenth of the largest, the largest first
  std::size_t chosen = 0;          // of them
  // Where components other than the chosen one are, if there are such: on the lattice of the means.
  ImageFrame others_frame;
  Mask others;
};

// How many voxels of a scan along each axis make one of the means below.
Index3 block_for_classes(const Index3& scan_size);

// `means`: the scan in blocks of `block` voxels. Throws Error if no tooth can be separated from its
// surroundings, naming what was found, or if the tooth that is asked for isn't there.
GreyClasses find_grey_classes(ImageVolume<float> means, const Index3& block,
                              const Index3& scan_size, const GreyHints& hints);

}  // namespace toothprep
