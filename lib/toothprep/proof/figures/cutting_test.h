// Published cutting tests as data (data/validation): what was measured, under which conditions, and
// what a simulation of it assumes beside.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "toothprep/step/core/tissue.h"

namespace toothprep::figures {

enum class CutGeometry {
  kFullSlot,  // the whole width of the bur
  kHalfSlot,  // half of it
  kSkim,      // a radial depth off a side
  kFace       // the bur's side pressed into a face, from the first contact on
};

// One cut with everything known: a cylinder fed along -y, its axis along z.
struct Cut {
  CutGeometry geometry = CutGeometry::kFullSlot;
  Tissue tissue = Tissue::kDentin;
  bool climb = false;     // half slot and skim: down-cutting
  double diameter = 1.2;  // mm
  double length = 3;      // mm, engaged
  double depth = 0;       // mm: radial, of a skim; reached, of a face
  double load = 0;        // N, on a rail along the feed; 0: the feed is imposed
  double feed = 0;        // mm/s
  double electric_rate =
      0;                   // rev/s: a handpiece that holds it, in place of a drooping one; 0: none
  double rate_factor = 1;  // on the parameters' rotation rate
  double torque_factor = 1;  // on the parameters' stall torque
  double density = 1;        // mg/mm³
  double way = 0;            // mm, of the whole cut
};

enum class Quantity {
  kRemovalRate,      // mm³/s
  kMassRate,         // mg/s
  kCutTime,          // s, for `way`
  kFeed,             // mm/s
  kForcePerFeed,     // N·s/mm
  kTangentialForce,  // N, torque over radius
  kNormalForce,      // N, across it
  kForceRatio,       // tangential over normal
  kSpeedLoss,        // %, of the free speed
  kSpecificEnergy,   // J/mm³, power over removal rate
  kLoadGain,         // removal rate at the last load over that at the first
  kStallLoad,        // N
  kPeakPowerSpeed    // speed at the greatest power over the free speed
};

struct CuttingTest {
  std::string name;  // of its file
  std::string title;
  std::vector<std::string> rows;  // of measurements.csv
  Quantity quantity = Quantity::kRemovalRate;
  std::string quantity_name, unit;
  std::string confidence;  // "high", "medium", "low"
  std::vector<std::string> assumes;
  std::array<double, 2> measured{};  // of `quantity`; the upper end may be infinite
  std::vector<Cut> cuts;             // all that the conditions allow
  // A trend in place of a measured value: how the quantity was seen to change from `cuts` to
  // `second`: "rises", "falls" or "level". Empty: none.
  std::string observed;
  std::vector<Cut> second;
};

// The tests in FOLDER/tests, in order of their names. Throws InputError for what isn't as
// data/validation/README.md says, and for a row that FOLDER/measurements.csv does not have.
std::vector<CuttingTest> read_cutting_tests(const std::string& folder);

}  // namespace toothprep::figures
