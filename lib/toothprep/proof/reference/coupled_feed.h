// The exact answer of the coupled drive: a bur that hangs on a virtual spring between it and the
// handle and is held back by the tissue it grinds, with negligible inertia:
//
//   k (P_H(t) - P) + b (v_H(t) - P') + F(P, P') = 0
//
//   symbol   unit       meaning
//   P_H, v_H mm, mm/s   handle: commanded position and velocity of the bur's tip, W
//   P, P'    mm, mm/s   the bur's tip, W; its orientation is the handle's, held constant here
//   k, b     N/mm, N·s/mm   virtual coupling (Wu, Wang, Wang and Zhang, Eq. 12)
//   F        N          grinding force of straight_feed.h, homogeneous of degree 1 in P'
//
// Valid where straight_feed.h is, which for a bur that yields sideways means: where its path turns
// with a radius of at least its own (stale_depth says how far a solution is from that), and where
// inertia is negligible: m / B and sqrt(m / k) far below the times of interest (8 g: 3 ms at
// k = 1 N/mm; a step of the same size damps what there is).
//
// Method. This is an implicit differential-algebraic equation: along directions in which nothing
// advances (a cylinder's own axis) F has no slope and P follows P_H algebraically, and at the first
// touch the drag B grows from zero, so that P' = B^-1 (...) is as stiff as one likes. Explicit
// methods (and solving for P' at all) fail there. It is integrated as it stands with the
// three-stage Radau IIA collocation (order 5, L-stable, Hairer and Wanner, Solving ODEs II, IV.5),
// Newton on the stages with the exact derivative dF/dP' = B, error control by halving steps, and
// steps that end where the contact changes its shape (contact_shape). Time runs as t = t_0 + tau³
// from the first touch t_0: there the solution has powers of t^(1/3) (a cylinder's contact grows as
// the square root of its depth), which are smooth in tau. The first touch is looked for every
// largest_step: a handle that grazes the block for less may be missed.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "toothprep/proof/reference/straight_feed.h"

namespace toothprep::reference {

struct HandleMotion {
  Vec3 position = Vec3::Zero();  // P_H, mm, W
  Vec3 velocity = Vec3::Zero();  // v_H, mm/s, W
};
using Handle = std::function<HandleMotion(double time)>;
// From `start` at time 0: with constant velocity, and with constant acceleration from rest.
Handle steady_handle(const Vec3& start, const Vec3& velocity);
Handle ramped_handle(const Vec3& start, const Vec3& acceleration);

struct CoupledFeed {
  Handle handle;
  Quat orientation = Quat::Identity();
  double stiffness = 1.0;                                         // k, N/mm, > 0
  double damping = 0.0;                                           // b, N·s/mm, >= 0
  double stall_torque = std::numeric_limits<double>::infinity();  // tau_s, N·mm
  std::vector<double> handle_breaks;  // s, where the handle's velocity jumps: steps end there
  double tolerance = 1e-10;           // mm, of P per step
  double largest_step = 0.02;         // s
};

struct CoupledRow {
  double time = 0;               // s
  Vec3 position = Vec3::Zero();  // P, mm
  Vec3 velocity = Vec3::Zero();  // P', mm/s
  Vec3 force = Vec3::Zero();     // grinding force on the bur, N: -k (P_H - P) - b (v_H - P')
  double torque = 0;             // N·mm; tau_s while stalled
  PerTissue<double> area{};      // mm², advancing contact
  bool stalled = false;
};

struct StallEvent {
  double time = 0;               // s
  Vec3 position = Vec3::Zero();  // mm, where the bur stands from then on
  Vec3 velocity = Vec3::Zero();  // mm/s, of the bur just before
  Vec3 force = Vec3::Zero();     // N, grinding force just before
};

struct CoupledResult {
  std::vector<CoupledRow> rows;   // one per time asked for
  std::optional<double> contact;  // s, first touch
  std::optional<StallEvent> stall;
  // s, when the bur broke through: where contact dwindles while the spring is stretched, P' grows
  // without bound, and without inertia the bur is at the handle at once. Rows from then on are
  // free.
  std::optional<double> break_through;
  // Largest rest of the equation of motion over the rows in contact, N, with the force integrated
  // anew at the row.
  double largest_residual = 0;
  int steps = 0;
};

// `times` in s, increasing. Before the first touch the bur is at the handle (P = P_H, no force),
// except that contact at times.front() starts with P = P_H there. Once T reaches tau_s the bur
// stands still, with F = -stalled_force; it isn't started again. Throws Error if an argument is out
// of range, or if there is no solution: the bur breaks through into more tissue.
CoupledResult coupled_feed(const Scene& scene, const CoupledFeed& feed,
                           const std::vector<double>& times);

// F_VC = k (P_H - P_stall) + b v_H, N: the coupling's force on a bur that stands still.
Vec3 stalled_force(const CoupledFeed& feed, const Vec3& stalled_position, double time);

// The coupling's force F_VC(t) for a constant drag B, a handle of constant velocity v, e(0) = 0 and
// b = 0:  F_VC(t) = -(I - exp(-k (-B)^-1 t)) B v. The grinding force is its negative. B is constant
// for a fully engaged cylinder or ball that feeds across its axis. Vectors of any one length, such
// as the two components across the axis (B must be invertible). Throws Error otherwise.
Eigen::VectorXd constant_drag_force(const Eigen::MatrixXd& drag, double stiffness,
                                    const Eigen::VectorXd& handle_velocity, double time);

// Largest depth, mm, by which advancing surface within the block lies in what the bur has swept
// on earlier rows: 0 where the solution is exact, small against the bur where it is good. Looks at
// every `stride`-th row, at about a hundred points of the surface. Rows must be dense enough that
// the bur moves much less than its radius between two of those looked at.
double stale_depth(const Scene& scene, const Bur& bur, const CoupledFeed& feed,
                   const std::vector<CoupledRow>& rows, std::size_t stride = 50);

}  // namespace toothprep::reference
