// Burs from a shorthand: `shape:` and parameters in mm, each a letter and a number, joined by `x`.
// data/burs/README.md has the letters' ranges and examples.
//
//   D  largest diameter of the head              T  diameter at the tip
//   L  length of the head, closing end to tip    A  angle of the flank, degrees per side
//   R  radius of the corner at the tip           N  diameter of the head's shank end (narrowing)
//   B  height of the largest diameter            S  diameter of the neck (0: none)
//      over the tip
//
//   ball:D                    sphere
//   cylinder:DxL[xR]          flat end; R rounds the corner, up to R = D/2
//   round-cylinder:DxL        hemispherical end
//   cone:DxLxT|A[xR]          flat end of diameter T (before R rounds its corner; 0: a point),
//                             D at the shank's end
//   taper:DxLxT|A             the same with a round end: a sphere of diameter T that the flank
//                             touches
//   inverted-cone:DxLxN|A[xR] flat end of diameter D, narrowing to N at the shank's end
//   pear:DxLxN|A[xR]          round end (R default D/2, less leaves a flat), narrowing to N
//   flame:DxL[xBxNxT]         two arcs that meet with a vertical tangent at height B (default
//                             0.6 L) and narrow to N (default 0.8 D) above; T (default 0) is the
//                             diameter of the sphere that blunts the point
//   torpedo:DxL[xBxT]         an arc from the point to full diameter at height B (default D),
//                             then a cylinder
//
// Without S the neck is half as thick as a ball, 0.8 times as thick as the shank's end of any other
// head, and never above 1.6 mm (a friction-grip shank). It is modelled for 6 mm above the head,
// longer than a crown is high: it only serves to report contact.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"

namespace toothprep {

constexpr double kNeckLength = 6.0;           // mm
constexpr double kLargestNeckDiameter = 1.6;  // mm

// Throws InputError naming `spec`, the parameter and the condition.
Bur bur_from_shorthand(const std::string& spec);

bool is_shape(const std::string& name);               // "ball", "cylinder", ...
std::vector<std::string> shape_names();               // all of them
std::string shape_notation(const std::string& name);  // e.g. "cylinder:D..xL..[xR..]"

// The neck of a head without a stated one.
double default_neck_diameter(const std::vector<ProfilePiece>& head);

}  // namespace toothprep
