#include "toothprep/proof/figures/coupled_cut.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/device/high_pass_rms.h"

namespace toothprep::figures {
namespace {

constexpr double kAround = 0.5;        // mm, of tissue around the cut
constexpr double kLoopSettling = 0.5;  // s, left out
constexpr double kAheadIn = 0.1;       // s
constexpr double kTail = 0.5;          // s, of the mean force
constexpr double kLoopDuration = 1.6;  // s
constexpr double kTransferWindow = 1;  // s: a whole number of periods
constexpr double kRoom = 2;            // times the way: a bur that is pulled faster for a while
constexpr double kSwing = 0.8;         // of the feed, all frequencies together

// All of one tissue, around a tip at the origin, for ways down to `low` of it.
LayeredTooth block_around(const CoupledCut& cut, const Vec3& low) {
  BlockOptions o;
  o.voxel = cut.voxel;
  const double top = cut.radius + kAround, length = cut.length;
  o.size = Vec3(2 * top + 2 * std::abs(low.x()), 2 * top - low.y(), length + kAround - low.z());
  o.enamel = cut.tissue == Tissue::kEnamel ? o.size.y() : 0;
  o.pose.position = Vec3(0, top, (length - kAround + low.z()) / 2);
  return make_block(o);
}

Bur bur_of(const CoupledCut& cut) {
  return make_bur(fmt::format("cylinder:D{}xL{}", 2 * cut.radius, cut.length), "");
}

// The handle ahead, F/k.
Vec3 lag_of(const CoupledCut& cut, double feed) {
  const reference::SteadyLoad load =
      reference::cylinder_side_feed(grinding_of(cut), cut.radius, cut.length, feed);
  const double side = cut.parameters.handpiece.clockwise ? 1 : -1;
  return -Vec3(side * load.across, load.against, 0) / cut.parameters.coupling.stiffness;
}

// Amplitudes of the rows' force along z at the frequencies, by least squares beside a cubic.
std::vector<double> amplitudes(const std::vector<double>& force, double h,
                               const std::vector<double>& frequencies) {
  const auto rows = static_cast<Eigen::Index>(force.size());
  const auto count = static_cast<Eigen::Index>(frequencies.size());
  Eigen::MatrixXd basis(rows, 4 + 2 * count);
  Eigen::VectorXd values(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const double t = static_cast<double>(i) * h;
    values[i] = force[static_cast<std::size_t>(i)];
    for (Eigen::Index k = 0; k < 4; ++k) basis(i, k) = std::pow(t, static_cast<double>(k));
    for (Eigen::Index k = 0; k < count; ++k) {
      const double phase = 2 * units::kPi * frequencies[static_cast<std::size_t>(k)] * t;
      basis(i, 4 + 2 * k) = std::cos(phase);
      basis(i, 5 + 2 * k) = std::sin(phase);
    }
  }
  const Eigen::VectorXd fit = basis.colPivHouseholderQr().solve(values);
  std::vector<double> sizes;
  for (Eigen::Index k = 0; k < count; ++k)
    sizes.push_back(std::hypot(fit[4 + 2 * k], fit[5 + 2 * k]));
  return sizes;
}

}  // namespace

reference::Grinding grinding_of(const CoupledCut& cut) {
  const GrindingProperties& t = cut.parameters.tissue[tissue_index(cut.tissue)];
  return {t.specific_energy, t.force_ratio, cut.parameters.handpiece.rotation_rate};
}

SteadyFeed steady_feed(const CoupledCut& cut, double feed, double duration) {
  SteadyFeed r;
  r.expected = lag_of(cut, feed);
  const double h = cut.parameters.time_step;
  const auto steps = static_cast<int>(std::lround(duration / h));
  const int settled = steps / 3;
  const Bur bur = bur_of(cut);
  const LayeredTooth tooth = block_around(cut, Vec3(0, -feed * duration, 0));
  Workpiece workpiece(tooth);
  HandleSample handle;
  Session session(bur, workpiece, cut.parameters, Drive::kCoupled, handle);
  Vec3 from = Vec3::Zero();
  for (int n = 1; n <= steps; ++n) {
    handle.time = n * h;
    handle.pose.position = r.expected - Vec3(0, feed * handle.time, 0);
    const StepRecord row = session.step(handle);
    if (n == settled) from = row.bur.position;
    r.lag = handle.pose.position - row.bur.position;
    if (n > settled) r.speed = (row.bur.position - from) / ((n - settled) * h);
  }
  return r;
}

std::vector<double> plunge(const CoupledCut& cut, Drive drive, double feed,
                           const std::vector<double>& frequencies) {
  const double h = cut.parameters.time_step;
  const auto lead = static_cast<int>(std::lround(kLoopSettling / h));
  const auto window = static_cast<int>(std::lround(kTransferWindow / h));
  const double way = feed * (kLoopSettling + kTransferWindow) * (1 + kSwing);
  const reference::SteadyLoad load = reference::flat_end_plunge(grinding_of(cut), cut.radius, feed);
  const double ahead =
      drive == Drive::kCoupled ? load.against / cut.parameters.coupling.stiffness : 0;
  const double share = kSwing / static_cast<double>(frequencies.size());
  const Bur bur = bur_of(cut);
  const LayeredTooth tooth = block_around(cut, Vec3(0, 0, -way));
  Workpiece workpiece(tooth);
  HandleSample handle;
  Session session(bur, workpiece, cut.parameters, drive, handle);
  std::vector<double> force;
  for (int n = 1; n <= lead + window; ++n) {
    handle.time = n * h;
    double z = -ahead - feed * handle.time;
    for (const double f : frequencies)
      z -= feed * share * std::sin(2 * units::kPi * f * handle.time) / (2 * units::kPi * f);
    handle.pose.position.z() = z;
    const StepRecord row = session.step(handle);
    if (n > lead) force.push_back(row.device_force.z());
  }
  return amplitudes(force, h, frequencies);
}

LayeredTooth loop_block(const CoupledCut& cut, double feed) {
  return block_around(cut, Vec3(0, -kRoom * feed * kLoopDuration, 0));
}

LoopCut loop_cut(const CoupledCut& cut, const LayeredTooth& block, Drive drive,
                 const PhantomModel& given, const HandModel& hand, double feed) {
  const double h = cut.parameters.time_step;
  PhantomModel device = given;
  device.rate = 1 / h;
  const auto steps = static_cast<std::size_t>(std::lround(kLoopDuration / h));
  const double k = cut.parameters.coupling.stiffness;
  const Vec3 lag = lag_of(cut, feed);
  Vec3 ahead = Vec3::Zero();
  if (drive == Drive::kCoupled) ahead = lag;
  if (hand.stiffness > 0) {
    ahead.y() -= device.friction / hand.stiffness;
    if (drive == Drive::kCoupled) ahead += k * lag / hand.stiffness;
  }
  std::vector<Vec3> intended;
  for (std::size_t n = 0; n <= steps; ++n) {
    const double time = static_cast<double>(n) * h;
    intended.emplace_back(std::min(1.0, time / kAheadIn) * ahead - Vec3(0, feed * time, 0));
  }
  const Bur bur = bur_of(cut);
  Workpiece workpiece(block);
  SimulatedPhantom phantom(device, hand, intended.front());
  HandleSample handle;
  Session session(bur, workpiece, cut.parameters, drive, handle);
  std::vector<double> at_bur;
  const ClosedLoopSeries s =
      run_closed_loop(phantom, intended, [&](std::size_t n, const Vec3& encoder) -> Vec3 {
        handle.time = static_cast<double>(n) * h;
        handle.pose.position = encoder;
        const StepRecord row = session.step(handle);
        if (handle.time >= kLoopSettling) at_bur.push_back(row.grinding_force.y());
        return row.device_force;
      });
  LoopCut r;
  r.felt = closed_loop_figures(s, device, -Vec3::UnitY(), kLoopSettling);
  r.at_bur = rms_above(at_bur, device.rate, kVibrationCorner);
  const auto tail = static_cast<std::size_t>(std::lround(kTail / h));
  for (std::size_t n = 1; n < s.force.size(); ++n) {
    if (s.time[n] > kLoopSettling) r.jump = std::max(r.jump, (s.force[n] - s.force[n - 1]).norm());
    if (n + tail >= s.force.size()) r.force += s.force[n].y() / static_cast<double>(tail);
  }
  const auto settled = static_cast<std::size_t>(std::lround(kLoopSettling / h));
  r.way = s.position[settled].y() - s.position.back().y();
  return r;
}

}  // namespace toothprep::figures
