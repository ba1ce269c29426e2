// The molar with its neighbours: real teeth of enamel, dentin and pulp beside it, up to a whole lower
// arch of 14, and the gum's stand-in. Bodies of their own (step/tooth/tooth_bodies.h).
#pragma once

#include "toothprep/proof/specimen/molar.h"

namespace toothprep {

constexpr int kMostNeighbours = 13;  // with the prepared tooth a whole lower arch

// Which teeth make_arch() makes.
struct ArchOptions {
  MolarOptions tooth;  // 36, the one that is prepared; it stands where make_molar() has it
  // How many of 37, 35, 34, 33, 32, 31, 41, 42, ... 47, in this order, stand beside it. Molars and
  // premolars have the forms of molar.h; canines and incisors are premolars, made smaller.
  int neighbours = 1;  // 0 to 13
  double gap = 0.1;    // mm, between two teeth where they are nearest; 0.02 to 2
  bool gum = false;    // a ridge of `other` about the roots, as the body "gum"
};

// Throws Error as make_molar(), or for options out of range.
[[nodiscard]] LayeredTooth make_arch(const ArchOptions& options);

}  // namespace toothprep
