// A tooth's frame from its form, and from what a person knows of it.
#pragma once

#include <optional>

#include "toothprep/tools/orientation/tooth_frame.h"

namespace toothprep {

// What a person says. Directions in W, any length; sources are kGiven, kLandmarks or kRecorded.
struct KnownAxes {
  FrameAxis occlusal, mesial, buccal;  // those that are not known are estimated, or stay so
  std::optional<Vec3> fossa;           // mm, W: the central fossa; else as the form shows it
  std::optional<int> tooth_number;     // FDI: 11-18 ... 41-48, 51-55 ... 81-85
};

// Of the tooth that is worked on, if several are listed. Form alone gives the occlusal direction,
// the long axis, and places. Mesial and buccal have to be given: no form says which of four sides
// is which. Of the two one is enough where the tooth's number is known, since that fixes the hand:
// right upper and left lower teeth are mirror images of the others. Throws Error for directions
// that are zero, not finite or parallel, for a number that isn't FDI's, and for a mesial and a
// buccal direction that contradict the number.
[[nodiscard]] ToothFrame estimate_frame(const LayeredTooth& tooth, const KnownAxes& known = {});

// What a recorded frame holds that was not estimated: to be kept when the tooth is looked at again.
[[nodiscard]] KnownAxes known_axes(const ToothFrame& recorded);

// What is known of either; `first` counts where both know it.
[[nodiscard]] KnownAxes both(const KnownAxes& first, KnownAxes second);

}  // namespace toothprep
