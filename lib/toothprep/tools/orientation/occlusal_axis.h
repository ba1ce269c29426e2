// The occlusal direction, from the form of a tooth with enamel and dentin.
//
// Three to four estimates that hardly depend on each other, and their weights:
//   neck     2    normal of the plane through the enamel's lower border, one place per 7.5° around;
//                 0.5 where the border is as flat as a cut, which may be one at any angle
//   stand    1    normal of the plane on which the crown would stand upside down (cusp tips, or a
//                 worn face), if there is one within 27° of the others
//   cap      1    from the middle of the dentin and pulp to the middle of the enamel
//   long     0.5  principal axis of the whole tooth, where that has roots and is slender
// Their mean is the direction. Its uncertainty (half width of a 95 % interval) is twice the
// standard error of that mean by their scatter, and at least 3°: anatomists' own definitions differ
// by as much. The crown's end is where the enamel is: dentin must reach beyond it at the other end
// by a fifth of the tooth's length, or, of a crown alone, enamel must cover more of what is seen
// from above than from below. What fails that, has more than one tooth, or is uncertain by more
// than 20° is not known.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/orientation/label_block.h"
#include "toothprep/tools/orientation/tooth_frame.h"

namespace toothprep {

struct OcclusalAxis {
  FrameAxis occlusal, long_axis;
  std::optional<FramePlane> cervical, occlusal_plane;
  std::vector<Vec3> cervical_line;  // mm, W
  std::vector<std::string> notes;   // why it isn't known
};

// `given`, a unit vector in W, is taken for the direction; neck and stand are looked for along it.
OcclusalAxis find_occlusal_axis(const LabelBlock& block, const std::optional<Vec3>& given);

}  // namespace toothprep
