// What a recorded motion says about the force before u and alpha are known.
//
// With the bur's motion imposed, contact and removal don't depend on u and alpha, and the force is
// linear in u_k and w_k = u_k / alpha_k (step/grinding/contact_set.h):
//
//   F(t) = 1/N · sum over tissues k of [u_k T_k(t) + w_k N_k(t)]
//
// so that one replay gives T_k and N_k for any values. With a recorded speed, N is N(t), and u
// itself is determined instead of u/N. A stalled bur removes nothing, and the force on it doesn't
// follow from its motion: samples that are said to be stalled have no force.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct TissueColumns {  // of one tissue, a column per sample
  // Rows 0-2 tangential (times u), 3-5 normal (times u/alpha): force on the bur in W, N per N/mm²,
  // at the rotation rate of the parameters. No columns at all if the tissue was never touched.
  Eigen::Matrix<double, 6, Eigen::Dynamic> force;
  std::vector<double> torque;  // N·mm per N/mm² of u
  double touched = 0;          // s
  double removed = 0;          // mm³
};

// What was recorded of the spindle, a value per sample of the motion; empty where nothing was.
struct SpindleRecord {
  std::vector<double> rate;   // N, rev/s; empty: the parameters' N throughout
  std::vector<char> stalled;  // empty: never
};

// A recorded motion at the step rate.
struct RecordedMotion {
  std::vector<HandleSample> path;  // at the step rate
  SpindleRecord spindle;           // a value per sample, or empty
};

// Sample i is the force of the step that ends at start + i * step.
struct ForceBasis {
  double start = 0, step = 0;   // s
  std::size_t size = 0;         // samples
  double rotation_rate = 0;     // N, rev/s, that u is for; with a recorded speed: of the parameters
  bool speed_recorded = false;  // the basis is divided by N(t)
  PerTissue<TissueColumns> tissue;  // per tissue
  // Force that no parameter scales, W, N: of a replay that was linearised (coupled.h). Else empty.
  Eigen::Matrix3Xd offset;
  // By the laws that were asked for beside the paper's, in their order: rows as above.
  std::vector<PerTissue<Eigen::Matrix<double, 6, Eigen::Dynamic>>> by_law;
  // W, N per unit of further parameters that the force is linear in (law_fit.h); not all of them
  // need columns.
  std::vector<Eigen::Matrix3Xd> shape;
  std::vector<float> area;     // advancing contact, mm²
  std::vector<float> removal;  // volume that contact removes per time, mm³/s
  std::vector<float> axial;    // cosine of feed and the bur's axis: -1 plunges, 0 feeds sideways
  double initial_overlap = 0;  // mm³, inside the bur at the first sample
  double shank_contact = 0;    // s, looked at every 10th step: the shank's force is not modelled

  bool touched(int k) const { return tissue[k].force.cols() > 0; }  // tissue index
};

// A law that a basis is asked for beside the paper's, per tissue: with u = alpha = 1, or with u = 0
// and p = mu = 1 (what rubs).
using UnitLaw = PerTissue<GrindingProperties>;

// The force on the bur at sample i for given u and alpha, W, N; and the spindle's torque, N·mm.
[[nodiscard]] Vec3 force_at(const ForceBasis& basis, std::size_t i,
                            const PerTissue<GrindingProperties>& tissue);
[[nodiscard]] double torque_at(const ForceBasis& basis, std::size_t i,
                               const PerTissue<GrindingProperties>& tissue);

// Runs `path` (samples at parameters.time_step) through `tooth`, which stays as it is. u, alpha,
// stall and coupling of `parameters` play no part. `progress` as in step/session/replay.h. Throws Error
// for fewer than two samples, and as make_engine() does. `laws`: by which ForceBasis::by_law is
// filled; they need a reference_chip.
ForceBasis force_basis(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                       const std::vector<HandleSample>& path, const SpindleRecord& spindle = {},
                       const std::function<void(double)>& progress = {},
                       const std::vector<UnitLaw>& laws = {});

// The same of several motions, in parallel; `progress` gets how many of their samples are done,
// from one thread at a time.
std::vector<ForceBasis> force_bases(const Bur& bur, const LayeredTooth& tooth,
                                    const Parameters& parameters,
                                    const std::vector<RecordedMotion>& motions,
                                    const std::function<void(double)>& progress = {},
                                    const std::vector<UnitLaw>& laws = {});

}  // namespace toothprep
