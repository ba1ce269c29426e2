// What overlapping straight passes newly sweep: the exact answer for the work of each.
//
// v·n ds is the volume that a surface element removes per time, so the work of the torque over a
// pass, the integral of 2 pi N T dt, equals u_k times the volume of tissue k that the pass sweeps
// and no earlier pass did. For passes with one orientation along one direction, right through the
// block, that volume is the block's length times the area by which the pass's outline, seen along
// the feed, adds to the union of the earlier ones.
//
// Valid for a convex head (a line along the feed meets it in one interval, and so does a line
// across the feed its outline). The closing disc counts as part of the head: the passes must leave
// it outside of the block, since it sweeps without work.
//
// Method: the outline's lower and upper end at kLines positions across the feed, each by golden
// section and bisection of Bur::distance(), linear in between; the union per position is that of
// intervals.
#pragma once

#include <vector>

#include "toothprep/proof/reference/straight_feed.h"
#include "toothprep/step/bur/bur.h"

namespace toothprep::reference {

// mm² per tissue for each pass along x of the block's frame (straight_feed.h), with the tip at
// `tips[i]`, of which x doesn't matter. Relative error below 1e-3 of the first pass's area.
std::vector<PerTissue<double>> newly_swept_sections(const Bur& bur, const Quat& orientation,
                                                    const std::vector<Vec3>& tips,
                                                    const Block& block);

// The same of passes by several burs or with several leans.
struct StraightPass {
  const Bur* bur;
  Quat orientation;
  Vec3 tip;  // mm, in the block's frame
};
std::vector<PerTissue<double>> newly_swept_sections(const std::vector<StraightPass>& passes,
                                                    const Block& block);

// For each pass the load on the bur at its tip, fed along x at `speeds[i]` (mm/s, either sign), right
// in the block's middle: the force law over that part of its surface that advances, lies in the block
// and outside of all that the passes before it swept. The integral is the sum over elements of `size`
// mm, each counted by its middle: error about size / radius of the chip's border, 0.1 % of a chip of
// 0.2 mm with the default.
std::vector<Load> loads_in_swept(const Scene& scene, const Bur& bur, const Quat& orientation,
                                 const std::vector<Vec3>& tips, const std::vector<double>& speeds,
                                 double size = 0.005);

}  // namespace toothprep::reference
