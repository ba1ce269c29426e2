#include "toothprep/tools/rig_check/protocol_force.h"

#include <algorithm>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kWallBelow = 0.5;              // mm
constexpr double kNewtonSecondPerMetre = 1e-3;  // in N·s/mm

}  // namespace

ForceLaw protocol_force(const Protocol& protocol, double period) {
  return [protocol, period, place_0 = Vec3(Vec3::Zero())](double time, const Vec3& place,
                                                          const Vec3& step) mutable -> Vec3 {
    if (time < kProtocolLead) {
      place_0 = place;
      return Vec3::Zero();
    }
    switch (protocol.kind) {
      case ProtocolKind::kRest:
        return Vec3::Zero();
      case ProtocolKind::kStep:
        return protocol_step_on(protocol, time) ? Vec3(0, protocol.force_n, 0) : Vec3(Vec3::Zero());
      case ProtocolKind::kStiffnessSweep: {
        const auto level = protocol_level_at(protocol, time);
        if (!level) return Vec3::Zero();
        return -protocol_level(protocol, *level) * (place - place_0);
      }
      case ProtocolKind::kDampingSweep: {
        const auto level = protocol_level_at(protocol, time);
        if (!level) return Vec3::Zero();
        return -kNewtonSecondPerMetre * protocol_level(protocol, *level) * step / period;
      }
      case ProtocolKind::kWall: {
        const double depth = place_0.y() - kWallBelow - place.y();
        if (!(depth > 0) || time >= protocol_duration(protocol)) return Vec3::Zero();
        return Vec3(0, protocol.stiffness_n_per_mm * std::min(depth, protocol.travel_mm), 0);
      }
    }
    return Vec3::Zero();
  };
}

}  // namespace toothprep
