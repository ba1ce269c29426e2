#include "toothprep/step/session/implicit_step.h"

#include <Eigen/LU>

namespace toothprep {

Vec3 implicit_velocity(const Coupling& c, double h, const CouplingState& s, const Mat3& resistance,
                       const Vec3& f0) noexcept {
  const double diagonal = c.bur_mass / h + h * c.stiffness + c.damping;
  const Mat3 system = diagonal * Mat3::Identity() - resistance;
  const Vec3 right =
      coupling_force(c, s) + resistance * s.velocity + f0 - h * c.stiffness * s.velocity;
  return s.velocity + system.inverse() * right;
}

}  // namespace toothprep
