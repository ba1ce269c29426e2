// The tooth's own frame T as a frame for paths, and paths moved between frames.
//
//   origin   the central fossa (its deepest place), or a place that is given
//   +z       occlusal
//   +x       mesial; y = z x x, so that +y is buccal of right upper and left lower teeth (FDI
//            quadrants 1, 3, 5, 7) and lingual of the others
//
// A path that is written in T fits any tooth whose T is known. Between a left and a right tooth it
// would have to be mirrored, which turning can't do.
#pragma once

#include <optional>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/orientation/tooth_frame.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

// T in W: x_W = pose.to_world(x_T). `origin` (mm, W) is taken for the fossa. `turn` turns T about its
// own z, radians; where mesial isn't known it is counted from W's x (y, if x is near the occlusal
// direction) laid across occlusal, and has to be given. Throws Error naming what isn't known.
[[nodiscard]] Pose own_frame(const ToothFrame& frame, const std::optional<Vec3>& origin = {},
                             const std::optional<double>& turn = {});

[[nodiscard]] Pose operator*(const Pose& a, const Pose& b);  // first b, then a
// The motion back.
[[nodiscard]] Pose inverse(const Pose& pose);

// The path, and the forces measured on it, seen from the frame in which `pose` places the path's.
[[nodiscard]] Trajectory placed(Trajectory path, const Pose& pose);

struct FittedPlaces {  // a rigid motion between two sets of places
  Pose pose;           // takes `from` to `to`
  double rms = 0;      // mm, what is left between them
  double largest = 0;  // mm
};
// The rigid motion that takes places to others, with the least sum of squares. Throws Error for
// fewer than three, different counts, and places on a line.
[[nodiscard]] FittedPlaces fit_places(const std::vector<Vec3>& from, const std::vector<Vec3>& to);

// Whether it is a file of such places; what is no TOML is refused as that.
[[nodiscard]] bool holds_place_pairs(const std::string& path);
// A file with such places: path_mm = [[x, y, z], ...] in the path's frame, tooth_mm = [[x, y, z],
// ...] the same places in the tooth's file. Throws InputError for anything else.
[[nodiscard]] FittedPlaces read_place_pairs(const std::string& path);

}  // namespace toothprep
