// One consistent unit set for the whole toolkit: millimetre, second, newton.
//
//   length mm · time s · force N · torque N·mm (= mN·m) · stiffness N/mm · damping N·s/mm
//   mass N·s²/mm (= 1000 kg) · specific grinding energy N/mm² (= 1e-3 J/mm³)
//   rotation rate rev/s · power N·mm/s (= mW) · energy N·mm (= mJ) · angle rad
//
// Files and options use the units a user thinks in and carry the unit in their name. The named
// conversions below are the only place where a factor stands; formulas contain none.
#pragma once

#include <numbers>

namespace toothprep::units {

constexpr double kPi = std::numbers::pi;  // half a turn, rad

constexpr double from_micrometre(double um) { return um * 1e-3; }               // mm
constexpr double to_micrometre(double length) { return length * 1e3; }          // from mm
constexpr double from_gram(double g) { return g * 1e-6; }                       // N·s²/mm
constexpr double to_gram(double mass) { return mass * 1e6; }                    // from N·s²/mm
constexpr double from_joule_per_mm3(double u) { return u * 1e3; }               // N/mm²
constexpr double to_joule_per_mm3(double u) { return u * 1e-3; }                // from N/mm²
constexpr double to_watt(double power) { return power * 1e-3; }                 // from N·mm/s
constexpr double from_degree(double degrees) { return degrees * kPi / 180.0; }  // rad
constexpr double to_degree(double radians) { return radians * 180.0 / kPi; }    // from rad

}  // namespace toothprep::units
