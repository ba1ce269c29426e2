// Which grey values are surroundings, dentin and enamel, and roughly where the tooth lies.
//
// Peaks are sought in the histogram of homogeneous places only (small gradient), so that the
// blurred borders, whose greys belong to no class, neither fill the valleys nor shift the peaks.
// The two brightest peaks that matter are dentin and enamel. What surrounds the tooth is measured
// around the tooth: it need be neither the darkest class (an empty pulp chamber may be darker) nor
// the value at the scan's edge.
#pragma once

#include <array>
#include <optional>

#include "toothprep/core/image_volume.h"

namespace toothprep {

struct GreyClasses {
  double surroundings = 0, dentin = 0, enamel = 0;  // typical grey values
  double threshold_dentin = 0;                      // border surroundings | dentin
  double threshold_enamel = 0;                      // border dentin | enamel
  // The nearest class below dentin, whichever it is: border for "certainly no dentin".
  double below_dentin = 0;
  // Box of the largest bright component, in (fractional) voxels of the scan, inclusive.
  Vec3 box_min = Vec3::Zero(), box_max = Vec3::Zero();
  bool touches_edge = false;  // the tooth reaches the scan's border
};

// Throws Error if no tooth can be told from its surroundings, naming what was found. `thresholds`,
// if given, are taken as they are and only the classes' typical values are measured.
GreyClasses find_grey_classes(const ImageVolume<float>& scan,
                              const std::optional<std::array<double, 2>>& thresholds);

}  // namespace toothprep
