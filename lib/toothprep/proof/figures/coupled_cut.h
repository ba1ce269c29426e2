// Cuts for kind "transparency": a cylinder that stands in a block from the start, with the session's
// own step, and what the handle feels of it.
#pragma once

#include <vector>

#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/device/closed_loop.h"

namespace toothprep::figures {

struct CoupledCut {
  double radius = 0.6, length = 3;  // mm, of the cylinder
  Tissue tissue = Tissue::kDentin;  // of the whole block
  Parameters parameters;            // valid
  double voxel = 0.1;               // mm
};

// u, alpha and N of the cut's tissue.
reference::Grinding grinding_of(const CoupledCut& cut);

// Fed along -y at `feed` (mm/s) with the handle ahead by F/k from the first step on: how the bur
// moves and lags over the last two thirds of `duration` (s).
struct SteadyFeed {
  Vec3 speed = Vec3::Zero();     // mm/s, mean
  Vec3 lag = Vec3::Zero();       // mm, handle less bur, at the end
  Vec3 expected = Vec3::Zero();  // mm, F/k
};
SteadyFeed steady_feed(const CoupledCut& cut, double feed, double duration);

// Plunged along its axis, feed (1 + sum of a cos 2 pi f t) with a = 0.8 over the number of
// frequencies (whole Hz): amplitude of the force at each, N. In direct drive that of the tissue,
// whatever the coupling.
std::vector<double> plunge(const CoupledCut& cut, Drive drive, double feed,
                           const std::vector<double>& frequencies);

// A closed loop on a simulated device and hand that feeds along -y, of 1.6 s, figures of the last
// 1.1 s. In the first 0.1 s the hand goes ahead by what friction, force and coupling will take, so
// that a coupled cut is steady from there on; in direct drive by the friction's share alone.
struct LoopCut {
  ClosedLoopFigures felt;  // along the feed
  double at_bur = 0;       // N, RMS above 20 Hz of the grinding force along the feed
  double jump = 0;         // N, largest change of the motors' force in a tick
  double force = 0;        // N, mean of the last half second against the feed
  double way = 0;          // mm, of the handle along the feed over the last 1.1 s
};
// `block` is loop_block() of the cut's tissue.
LoopCut loop_cut(const CoupledCut& cut, const LayeredTooth& block, Drive drive,
                 const PhantomModel& device, const HandModel& hand, double feed);
// What it cuts, whatever the coupling, the drive and the device.
LayeredTooth loop_block(const CoupledCut& cut, double feed);

}  // namespace toothprep::figures
