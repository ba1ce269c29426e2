// A path that is being planned: strokes of the bur in the tooth's frame, the feeds that suit what
// each stroke takes, and the script that `replay` reads.
//
//   F = e v / (4 α N D)        against the feed, of a bur of diameter D that takes e = Σ u_k V_k / l
//                              per mm of its way; times 2.5 where the way is along its axis
//   T = e v / (2 π N)          torque
//
// (data/physics.md, closed forms). A stroke's feed v keeps F below what the drive allows, and T below
// half of the stall torque.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/placement/tooth_grid.h"

namespace toothprep {

constexpr double kCatchUp = 2.5;  // s, of a wait in a corner: a bur on a spring catches up

// What a stroke is for, which decides its feed.
enum class Pace { kAir, kRoughing, kFinishing };

struct Stroke {               // one straight motion, in the grid's frame
  Vec3 to = Vec3::Zero();     // mm
  Vec3 axis = Vec3::UnitZ();  // from tip to shank, unit
  Pace pace = Pace::kAir;     // what for
  double hold = 0;            // s, at its end
  double speed = 0;           // mm/s; of choose_feeds()
  std::string note;           // a comment before it
};

struct Plan {                      // of one bur
  Vec3 start = Vec3::Zero();       // mm, frame of the grid: the tip before the first stroke
  Vec3 axis = Vec3::UnitZ();       // the bur's there, from tip to shank, unit
  std::vector<Stroke> strokes;     // in their order
  std::vector<std::string> facts;  // what it makes, a line each
  double roughing_lag = 0.5;       // mm, that the coupled bur may fall behind in roughing

  // Adds a motion, cut into strokes of 0.4 mm (in air one).
  void go(const Vec3& to, Pace pace, const std::string& note = {});
  void go(const Vec3& to, const Vec3& axis, Pace pace, const std::string& note = {});
  void hold(double seconds);  // at the end of the last one
};

// The speeds of all strokes, by what they take from the grid.
void choose_feeds(Plan& plan, const ToothGrid& grid, const Bur& bur, const Parameters& parameters,
                  Drive drive);

[[nodiscard]] double duration(const Plan& plan);  // s, with its speeds

// The script (data/trajectories/README.md) in W; `facts` and `notes` as comments.
[[nodiscard]] std::string script_of(const Plan& plan, const Pose& frame, const std::string& title);

// The floors of equal layers from `top` down to `floor`, none thicker than `thickest`, mm.
[[nodiscard]] std::vector<double> layer_floors(double top, double floor, double thickest);

// Largest radius of the flat part of the head's end: where the outline is within `depth` of the tip.
[[nodiscard]] double flat_radius(const Bur& bur, double depth);

}  // namespace toothprep
