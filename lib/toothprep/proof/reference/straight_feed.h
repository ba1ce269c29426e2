// The exact load on a bur that is fed straight into a layered block: the integrals of Wu, Wang,
// Wang and Zhang's force law over the bur's true surface, with no voxels, elements or time steps.
//
//   dF = u_k / (2 pi N) (v·n) (n_t - n / alpha_k) dphi dl      N, on the bur (Eqs 6-8)
//   dT = u_k / (2 pi N) (v·n) r dphi dl                        N·mm (Eqs 9, 14)
//
// taken over the grinding surface that advances (v·n > 0) and lies in the block.
//
//   symbol      unit          meaning
//   u_k         N/mm²         specific grinding energy of the tissue at the point
//   alpha_k     1             F_t / F_n of that tissue
//   N           rev/s         rotation rate, constant
//   v           mm/s          velocity of the bur, the same for all its points
//   n           unit          outward normal; n_t: opposite to the surface's own velocity, +phi^
//                             in B for a clockwise bur (seen from the shank), -phi^ otherwise
//   dphi dl     mm            ds / r: angle about the axis, length along the profile
//
// Valid where all advancing surface that lies in the block meets fresh tissue: a convex head on its
// first pass, fed straight or on a path that turns with a radius of at least the bur's. It knows
// nothing of what earlier passes removed, and it takes no account of the shank. The bur's own
// rotation as a body (a turning handle) is not in v.
//
// Frames: the block's own frame is W: top face at y = 0, centred in x and z, enamel from y = 0 to
// -enamel, dentin below.
//
// Method: for each position along the profile the advancing part of the circle of revolution
// within each tissue is a few arcs of phi with exact ends, over which the integral is closed.
// Along the profile Gauss-Kronrod (31 points, adaptive), split where the shape of the contact
// changes (profile_breaks.h), with l = mean - half cos(theta) in each part, which makes square
// roots at the ends smooth. Relative accuracy about Scene::tolerance of each result.
//
// A circle of revolution on which v·n stays below 1e-9 |v| doesn't grind: a flat end that moves in
// its own plane has no contact because of a rounded velocity.
#pragma once

#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/tissue.h"

namespace toothprep::reference {

struct Block {
  Vec3 size{8, 8, 8};  // mm
  double enamel = 2;   // mm, 0 .. size.y
};

struct Scene {
  std::vector<ProfilePiece> profile;  // the head's outline; pieces without `grinds` are skipped
  Block block;
  GrindingProperties enamel, dentin;
  double rotation_rate = 100;  // N, rev/s
  bool clockwise = true;
  double tolerance = 1e-9;  // relative, of the quadrature
};

// From the bur and the model's parameters (tissues, rotation rate, sense; the handpiece's droop and
// stall are not in here). Throws Error that names what is not positive, finite or in range.
Scene make_scene(const Bur& bur, const Block& block, const Parameters& parameters);

// The load as a linear map of the velocity, as long as the advancing half stays that of the
// direction it was computed for. It then is also the derivative of the load by the velocity.
struct Engagement {
  Mat3 drag = Mat3::Zero();    // N·s/mm, W: F = drag v (the B of Eq. 14)
  Vec3 torque = Vec3::Zero();  // N·s, W: T = torque · v
  PerTissue<Vec3> flow;        // mm², W: volume removed per time = flow[k] · v
  PerTissue<double> area{};    // mm², advancing contact
  Engagement() { flow.fill(Vec3::Zero()); }
};

struct Load {
  Vec3 force = Vec3::Zero();        // N on the bur, W
  double torque = 0;                // N·mm, >= 0
  PerTissue<double> area{};         // mm², advancing contact
  PerTissue<double> volume_rate{};  // mm³/s; u_k volume_rate[k] summed is 2 pi N torque
};

// `bur`: pose of the bur (tip; orientation takes B to W). Zero for a zero or non-finite velocity.
Engagement engagement(const Scene& scene, const Pose& bur, const Vec3& velocity);
Load load(const Engagement& engagement, const Vec3& velocity);
Load load(const Scene& scene, const Pose& bur, const Vec3& velocity);

// What the contact consists of: which tissues are ground, which planes cut which piece of the
// profile, in how many places its shape changes. Where this changes along a path the load has a
// kink, such as the square root with which a tissue is entered; integrators should stop there.
std::vector<int> contact_shape(const Scene& scene, const Pose& bur, const Vec3& velocity);

struct PathRow {
  double time = 0;  // s, not used by the integrals
  Pose bur;
  Vec3 velocity = Vec3::Zero();  // mm/s
};
// One load per row. Successive rows with the same contact (a plateau) are integrated once; the rest
// in parallel, with results that don't depend on the number of threads.
std::vector<Load> load_along(const Scene& scene, const std::vector<PathRow>& path);

}  // namespace toothprep::reference
