// Whether a run is plausible. A unit taken for another, a damaged sample or a quaternion in another
// order gives figures that look like any others. Evidence of it in the inputs (time steps, speeds,
// extents, parameters) and in the energy audit is judged here.
//
//   finding          limit                                 likely cause
//   time_step        median of the steps above 0.1 s       milliseconds taken for seconds
//   position         beyond 10 m from the origin           a damaged sample, micrometres
//   extent           whole path within 0.1 mm              metres taken for millimetres
//   speed            handle above 0.5 m/s                  a lost sample, another unit
//   turning          handle above 30 rad/s                 the quaternion's order, the bur's own spin
//   specific_energy  u outside 1e-4 .. 100 J/mm³ (not 0)   J/m³, N/mm²
//   force_ratio      alpha outside 0.01 .. 10              F_n/F_t, a lost exponent
//   rotation_rate    above 10 000 rev/s                    rpm
//   rotor_inertia    time constant above 10 s              g·cm² or kg·m² taken for g·mm²
//   stiffness        coupling of 200 N/mm or more          N/m
//   step             time step above 0.02 s                milliseconds
//   force            peak above 50 N                       one of those, or too fast a feed
//   energy_audit     work / removed energy, see Audit      one of those
//
// The limits are wide: a hand moves a handpiece at some 10 mm/s (reaching out, 0.3 m/s), presses it
// with 0.1 to 5 N, and turns it at a few rad/s; published u lie in 0.01 .. 20 J/mm³.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"

namespace toothprep {

enum class Implausible {  // see the table above
  kTimeStep,
  kPosition,
  kExtent,
  kSpeed,
  kTurning,
  kSpecificEnergy,
  kForceRatio,
  kRotationRate,
  kRotorInertia,
  kStiffness,
  kStep,
  kForce,
  kEnergyAudit
};

[[nodiscard]] const char* name_of(Implausible what);  // as in the table: "time_step", ...

struct Finding {      // one implausibility
  Implausible what;   // the row of the table
  double value = 0;   // in the unit of the limit
  std::string text;   // what is odd, with its place
  std::string cause;  // the likely one
};

// "TEXT; likely cause: CAUSE"
[[nodiscard]] std::string message_of(const Finding& finding);

// Of a motion as it was recorded (before it was resampled). In the order of the table. With the
// drive `load` only the first position means something: extent and speed are not judged.
[[nodiscard]] std::vector<Finding> judge_motion(const std::vector<HandleSample>& recorded,
                                                Drive drive = Drive::kCoupled);

[[nodiscard]] std::vector<Finding> judge_parameters(
    const Parameters& parameters);  // the same of parameters

// The energy audit: the torque's work over the energy of what was removed. Sound for a ratio of 0.9
// to 1.1 with the level-set engine, 0.9 to 1.8 with the voxel engine (its cavity is a voxel too
// small on every side). Not judged if less than 0.01 mJ was removed (unless the work exceeds
// 0.1 mJ), if what was removed has u = 0, or if the parameters ask for a reading of the model in
// which work and removal need not agree.
struct Audit {
  enum class Verdict { kNotJudged, kWithin, kOutside };  // of the ratio
  Verdict verdict = Verdict::kNotJudged;                 // see why_not_judged
  double work = 0, removed_energy = 0;                   // mJ
  double ratio = 0;                                      // NaN without removed energy
  double low = 0, high = 0;                              // the ratio's limits
  std::string why_not_judged;                            // empty if it was
};

[[nodiscard]] const char* name_of(Audit::Verdict verdict);  // "not judged", "within", "outside"

// `removed` in mm³.
[[nodiscard]] Audit judge_audit(double work, double removed_energy,
                                const PerTissue<double>& removed, const Parameters& parameters);

// A line for the user: what the audit came to.
[[nodiscard]] std::string audit_text(const Audit& audit);

// What a finished run says of itself, after `findings` on its inputs: these, then those on force and
// audit, whose likely cause is the first of them.
[[nodiscard]] std::vector<Finding> judge_run(std::vector<Finding> findings, const Audit& audit,
                                             double peak_force, double largest_lag, Drive drive);

}  // namespace toothprep
