// What is said of an element in contact, and of what many of them answer: shared by the sets of the
// two kinds of law (contact_set.h, nonlinear_contact.h).
#pragma once

#include <cstdint>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/tissue.h"

namespace toothprep {

// An element by its places in B and its factors.
struct ContactElement {
  float nx, ny, nz;  // n_n
  float mx, my, mz;  // r x n_n, mm
  float tx, ty;      // n_t
  float weight;      // dphi dl, mm
  float arm;         // r, mm
  float area;        // ds, mm²
};

// Which elements in contact advance, identified by their number and the sum of their places: what changes
// from one trial velocity to the next are neighbours at the border of the set, and that changes one
// of the two.
struct AdvancingSet {
  std::int32_t count = 0, places = 0;
  bool operator==(const AdvancingSet&) const = default;
};

// The response of the contact to the feed, linear for the advancing set of one trial velocity, in
// B, for N = 1 rev/s: F = (B v + f0) / N, T = (b·v + t0) / N. With a linear law f0 and t0 are from
// the handle's rotation.
struct GrindingResponse {
  Mat3 B = Mat3::Zero();
  Vec3 f0 = Vec3::Zero();
  Vec3 b = Vec3::Zero();
  double t0 = 0;
  AdvancingSet set;
};

// One tissue's part of the force, for N = 1 rev/s, B: what u = 1 N/mm² makes along n_t and
// u/alpha = 1 N/mm² against n_n. Times u and u/alpha, summed over the tissues, it is B v + f0.
struct TissueBasis {
  Vec3 tangential = Vec3::Zero();  // mm²·rev/s
  Vec3 normal = Vec3::Zero();      // mm²·rev/s
  double torque = 0;               // mm³·rev/s, for u = 1
};

// How a law that isn't linear is put as one that is, around a trial velocity: by what goes through
// zero advance and the force there (which can't overshoot), or by its slope (which is closer).
enum class LinearForm { kSecant, kTangent };

// Rates of the energy audit.
struct GrindingRates {
  PerTissue<double> cut{};    // N·mm/s: power that cuts
  PerTissue<double> swept{};  // mm³/s, by the elements' advance
  double rubbed = 0;          // N·mm/s: power that rubs
};

}  // namespace toothprep
