// The proximal box of a class II cavity: where it lies on the tooth, and the strokes that cut it.
//
// The frame of the grid has z occlusal and x to the side of the box. Beside a neighbour the bur
// can't pass outside of the tooth: it goes out only as far as it stays clear, and comes down along
// the outermost row in place of from outside. What remains between the two then is a shell of
// enamel, as thick as the clearance is wider than the gap.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/preparation_paths/cavity_plan.h"
#include "toothprep/tools/preparation_paths/crown_map.h"
#include "toothprep/tools/preparation_paths/plan.h"

namespace toothprep {

struct Proximal {        // the proximal surface that a box opens
  double middle = 0;     // mm, y of the contact area
  double contact = 0;    // mm, z of the outermost place
  double neck = 0;       // mm, z of the enamel's lower border
  double outermost = 0;  // mm, x
};

// The side of the tooth that x points to; `middle` (x, y) lies within the tooth, `top` (z) is where
// the search downwards begins.
[[nodiscard]] Proximal proximal_side(const ToothGrid& grid, const Vec2& middle, double top);

// Where the tip goes in a box, in the grid's frame.
class ProximalBox {
 public:
  // `pulpal`: z of the occlusal part's floor. Throws Error where no box fits, or where neighbours
  // or gum (`ground.others`) leave no space for it.
  ProximalBox(const ToothGrid& grid, const CrownMap& map, const Bur& bur, const CavityShape& shape,
              const CavityGround& ground, const Proximal& side, double pulpal);

  double middle() const { return middle_; }              // mm, y
  double floor() const { return floor_; }                // mm, z of the gingival floor
  double wall_x(double y) const;                         // mm, of the tip along the axial wall
  bool beside_others() const { return !near_.empty(); }  // whether the way out is limited

  // The thickest that remains between the box and what limits it, mm; 0 where it opens the side.
  [[nodiscard]] double shell() const { return shell_; }

  // Layer by layer down to the floor; the plan's last stroke ends above the tooth.
  void rough(Plan& plan, double thickest) const;
  // Along the walls, once each way.
  void finish(Plan& plan) const;

 private:
  double outside(double y) const;
  Vec3 tip(double y, double off, double z) const;
  void across(Plan& plan, double from, double to, double off, double from_z, double to_z,
              Pace pace) const;
  void outwards_to(Plan& plan, double y, double z) const;
  void layer(Plan& plan, double z, const std::string& note) const;
  void find_others(const ToothGrid& grid, const CavityGround& ground);

  const Bur& bur_;
  double middle_ = 0, half_ = 0;  // mm: y of the tip's lanes, middle +- half
  double floor_ = 0, top_ = 0, outside_ = 0, clear_ = 0, shell_ = 0;
  Vec3 wall_ = Vec3::Zero();        // x = a + b y + c y², y from the middle
  std::vector<SurfacePlace> near_;  // of others, where the bur could meet them
};

}  // namespace toothprep
