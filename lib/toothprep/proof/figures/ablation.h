// What may be taken out of the paper's method, to see what it does (ablated_session.h).
#pragma once

namespace toothprep::figures {

// How removal follows contact (one_layer_engine.h).
enum class Layers {
  kTwo,    // the paper's: only what lies deeper than a voxel is removed
  kMet,    // without the second layer: every voxel that was found in contact, too
  kInside  // without it: every voxel whose centre lies within the bur
};

// How the bur on its spring is integrated.
enum class Integrator {
  kBackward,      // backward Euler, the paper's
  kSemiImplicit,  // v+ from the forces at the step's start, P+ = P + h v+
  kExplicit       // the same, P+ = P + h v
};

struct Ablation {
  Layers layers = Layers::kTwo;  // other than kTwo: voxel engine only
  Integrator integrator = Integrator::kBackward;
  // Voxel engine, two layers: 0: the part of the bur's true surface that each boundary voxel stands
  // for. 6, 18 or 26: the same area for every cell with so many kinds of neighbours
  // (equal_area_engine.h).
  int equal_area = 0;
  double filter_hz = 0;  // direct drive: cutoff of a low-pass on the velocity; 0: none

  bool operator==(const Ablation&) const = default;
};

}  // namespace toothprep::figures
