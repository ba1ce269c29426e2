// What the sensor should read, for given parameters, and how that changes with each of them.
//
//   y(t) = Q^T C(t)^T [ sum_k u_k T_k(t - tau) + w_k N_k(t - tau) + sum_j c_j S_j(t - tau) + g ] + b + d (t - t_mid)
//
//   symbol       here                     unit      frame
//   u_k          exp(x[2k])               N/mm²           specific grinding energy
//   w_k          exp(x[2k + 1])           N/mm²           u_k / alpha_k
//   T_k, N_k     ForceBasis               mm²       W     after the sensor's low-pass, if any
//   tau          x[kDelay]                s               delay of the force behind the motion
//   Q            x[kRotation .. + 3]      rad       sensor to its nominal frame, rotation vector
//   C            orientation of the bur   1         B to W for a sensor on the handpiece, else 1
//   g            x[kWeight .. + 3]        N         W     weight of the handpiece on its sensor
//   c_j          x[kShape + j]                                further parameters, if any (law_fit.h)
//   S_j          ForceBasis::shape        N per c_j W
//   tau_f        filter + x[kLowpass]     s               time constant of its low-pass
//   b, d         own[0 .. 3], [3 .. 6]    N, N/s    sensor, per recording
//
// Where u_k is tied (a tissue whose tangential part isn't identifiable), u_k = alpha0 w_k. T_k and N_k
// may also be those of a replay linearised about its parameters (coupled.h); the force then has a
// part that no parameter scales, and a tissue that isn't fitted is held where it is instead of left
// out.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/calibrate/force_basis.h"
#include "toothprep/tools/calibrate/recording.h"

namespace toothprep {

constexpr int kDelay = 2 * kTissueCount, kRotation = kDelay + 1, kWeight = kRotation + 3;  // places
constexpr int kLowpass = kWeight + 3;                                                      // place
constexpr int kShape = kLowpass + 1, kMostShapes = 3 * kTissueCount;                       // place
constexpr int kShared = kShape + kMostShapes;  // of all recordings
constexpr int kOwn = 6;                        // of each: bias, drift
constexpr int kColumns = kShared + kOwn;       // of the Jacobian of a sample

enum class TissueMode { kOff, kHeld, kTied, kFree };  // of a tissue's u and alpha in a fit
enum class RobustLoss { kNone, kHuber, kCauchy };     // on residuals

// One recording beside its basis, ready to be compared. References the basis.
struct ComparedRecording {
  std::string name;                   // of the recording
  const ForceBasis* basis = nullptr;  // of the same motion
  // Where there is a low-pass: the basis after it, and that by its time constant (per s).
  PerTissue<Eigen::Matrix<double, 6, Eigen::Dynamic>> filtered, slope;
  Eigen::Matrix3Xd filtered_offset, offset_slope;             // the same of the offset
  std::vector<Eigen::Matrix3Xd> filtered_shape, shape_slope;  // the same of each shape column
  std::vector<double> time;                                   // of the samples that count, s
  std::vector<Vec3> force;                                    // measured, N, sensor
  std::vector<Quat> frame;                                    // C; empty: none
  double middle = 0;                                          // t_mid
  double sigma = 1;                                           // N, noise per axis
  std::size_t stalled = 0;  // samples left out since the bur stood still

  [[nodiscard]] const Eigen::Matrix<double, 6, Eigen::Dynamic>& columns(int k) const {  // in use
    return filtered[k].cols() > 0 ? filtered[k] : basis->tissue[k].force;
  }
  [[nodiscard]] const Eigen::Matrix3Xd& shape(std::size_t j) const {  // in use
    return filtered_shape[j].cols() > 0 ? filtered_shape[j] : basis->shape[j];
  }
  [[nodiscard]] const Eigen::Matrix3Xd& offset() const {  // in use
    return filtered_offset.cols() > 0 ? filtered_offset : basis->offset;
  }
};

// Leaves out samples that lie within `margin` s of the motion's ends or of a stall, and unusable
// ones.
// `lowpass`: corner of the sensor's first-order low-pass, Hz; 0: none.
[[nodiscard]] ComparedRecording compare(const MeasuredRecording& recording, const ForceBasis& basis,
                                        double margin, double lowpass, bool on_handpiece);

// Puts a low-pass of this time constant (s; 0: none) between basis and sensor, with its slope if
// that is to be estimated.
void set_lowpass(ComparedRecording& recording, double time_constant, bool with_slope);

struct Chunk {                     // a run of samples
  int recording = 0;               // its number
  std::size_t begin = 0, end = 0;  // of its samples
};
// Pieces of about `length` s, none across a gap between recordings.
[[nodiscard]] std::vector<Chunk> chunks_of(const std::vector<ComparedRecording>& recordings,
                                           double length);

struct ModelState {                      // what the residuals depend on
  PerTissue<TissueMode> mode{};          // per tissue
  int shapes = 0;                        // further parameters, all of them free
  PerTissue<double> tied_ratio{};        // alpha0
  RobustLoss loss = RobustLoss::kHuber;  // on the residuals
  std::vector<int> columns;              // of the Jacobian that sums are wanted of; empty: all
  Eigen::Matrix<double, kShared, 1> shared = Eigen::Matrix<double, kShared, 1>::Zero();  // of all
  std::vector<Eigen::Matrix<double, kOwn, 1>> own;  // per recording
};

// The loss on a residual r in units of its standard deviation: rho(r), its derivative psi, and
// psi'.
struct LossAt {
  double rho, psi, slope;  // see above
};
[[nodiscard]] LossAt loss_at(RobustLoss loss, double r);  // r in standard deviations

// Beyond, a residual is taken for an outlier where it has to be in or out.
constexpr double kOutlierSigmas = 5;

// Sums over a chunk, J of the residuals r = (model - measured) / sigma by all kColumns.
enum class Weighting {
  kTransformed,  // sum f'^2 J J^T, f f' J, f^2 with f^2 = rho: what a least-squares solver needs
  kWeights,      // w = psi / r: w J J^T, w J r, w r^2
  kSlope,        // psi' J J^T, psi J, rho
  kInliers       // J J^T, J r, r^2 of the residuals within kOutlierSigmas only
};
struct NormalSums {  // over one chunk
  // H: J J^T.
  Eigen::Matrix<double, kColumns, kColumns> H = Eigen::Matrix<double, kColumns, kColumns>::Zero();
  Eigen::Matrix<double, kColumns, 1> g = Eigen::Matrix<double, kColumns, 1>::Zero();  // J r
  double cost = 0;                                                                    // sum of rho
  double weight = 0;     // of the residuals
  std::size_t rows = 0;  // residuals
};
// Every `stride`-th sample. With `shift`, the residuals are taken at r + J shift (the linearised
// step), the Jacobian stays.
[[nodiscard]] NormalSums normal_sums(const ComparedRecording& recording, const Chunk& chunk,
                                     const Eigen::Matrix<double, kShared, 1>& shared,
                                     const Eigen::Matrix<double, kOwn, 1>& own,
                                     const ModelState& state, Weighting weighting,
                                     std::size_t stride = 1,
                                     const Eigen::Matrix<double, kColumns, 1>* shift = nullptr);

// The same of several chunks, in parallel; in the order of the chunks.
[[nodiscard]] std::vector<NormalSums> normal_sums(const std::vector<ComparedRecording>& recordings,
                                                  const std::vector<Chunk>& chunks,
                                                  const ModelState& state, Weighting weighting,
                                                  std::size_t stride = 1);

// The model's force of one recording's samples, sensor frame, N; with `only_contact` without bias,
// drift and weight.
[[nodiscard]] std::vector<Vec3> modelled_force(const ComparedRecording& recording,
                                               const Eigen::Matrix<double, kOwn, 1>& own,
                                               const ModelState& state, bool only_contact = false);

}  // namespace toothprep
