// A path in a tooth before anything is cut: what it would take, and how near it comes to what must
// stay. Geometry alone: a bur on a spring lags behind the path and takes less.
#pragma once

#include <optional>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/tools/placement/tooth_grid.h"

namespace toothprep {

struct PathPlace {          // of the path, at most 0.15 mm from the one before
  double time = 0;          // s
  Vec3 tip = Vec3::Zero();  // mm, W
  // Along the occlusal axis, mm: from the tip up to the surface of the tooth as it is and to the
  // enamel-dentin border; nothing where neither lies over the tip.
  std::optional<double> below_surface, below_dentin;
  // Of the head, mm, negative: it reaches through. Nothing without dentin, or pulp.
  std::optional<double> to_dentin, to_pulp;
};

struct PathCheck {                   // what a path would do
  std::vector<PathPlace> places;     // along it
  double clearance_at_start = 0;     // mm, of the head from the tooth at the first sample
  double least_distance = 0;         // mm, of the head from the tooth along the path; 0: it touches
  PerTissue<double> removed{};       // mm³ inside the head, on a grid of 0.1 to 0.2 mm
  double deepest_below_surface = 0;  // mm; 0 if the tip is never below
  double deepest_below_dentin = 0;   // mm
  std::optional<double> least_to_pulp;    // mm; nothing without pulp
  Vec3 least_to_pulp_at = Vec3::Zero();   // mm, W: of the pulp
  double least_to_pulp_time = 0;          // s
  std::optional<double> least_to_other;   // mm, of the head from neighbours and gum; nothing
                                          // where none are within 2 mm of its way
  Vec3 least_to_other_at = Vec3::Zero();  // mm, W: of them
  double least_to_other_time = 0;         // s
  double shank_overlap = 0;               // mm³ of tissue inside the shank at once, at most
  double shank_time = 0;                  // s: when first
  Box tips;                               // mm, W: around the tips
};

// `frame`: the tooth's own (own_frame()), of which the z axis counts. Positions of `path` in W.
// `whole`: as it was loaded, with its bodies; what is planned on is the tooth alone, and the others
// are what must not be touched.
[[nodiscard]] PathCheck check_path(const LayeredTooth& whole, const Pose& frame, const Bur& bur,
                                   const std::vector<HandleSample>& path);

}  // namespace toothprep
