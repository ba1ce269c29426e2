#include "toothprep/tools/calibrate/force_basis.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <mutex>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/session.h"

namespace toothprep {
namespace {

constexpr double kShankElementSize = 0.4;  // mm
constexpr std::size_t kShankEvery = 10;    // steps

// The handle's turn from one sample to the next, rad/s, B. As the step of a session has it.
Vec3 turn_rate(const Quat& from, const Quat& to, double h) {
  if (from.coeffs() == to.coeffs() || from.angularDistance(to) == 0) return Vec3::Zero();
  Quat turn = from.conjugate() * to;
  if (turn.w() < 0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  if (!(sine > 1e-12)) return Vec3::Zero();
  return turn.vec() * (2 * std::atan2(sine, turn.w()) / sine / h);
}

// What the contact says of each law, put into the columns of its basis.
class LawColumns {
 public:
  LawColumns(const std::vector<UnitLaw>& laws, std::size_t samples, ForceBasis& basis)
      : basis_(basis), samples_(static_cast<Eigen::Index>(samples)) {
    for (const UnitLaw& law : laws) laws_.emplace_back(law.begin(), law.end());
    basis.by_law.resize(laws.size());
  }
  bool any() const { return !laws_.empty(); }
  PerTissue<TissueBasis> paper(const ContactSet& contact, const Vec3& v, const Vec3& omega,
                               double rate) const {
    return contact.nonlinear().basis(paper_, v, omega, rate);
  }
  void put(std::size_t i, const ContactSet& contact, const Quat& to_world, const Vec3& v,
           const Vec3& omega, double rate) {
    for (std::size_t l = 0; l < laws_.size(); ++l) {
      const auto parts = contact.nonlinear().basis(laws_[l], v, omega, rate);
      for (int k = 0; k < kTissueCount; ++k) {
        if (parts[k].torque == 0 && parts[k].normal.isZero(0)) continue;
        auto& columns = basis_.by_law[l][k];
        if (columns.cols() == 0) columns.setZero(6, samples_);
        const auto c = static_cast<Eigen::Index>(i);
        columns.col(c).head<3>() = to_world * parts[k].tangential / rate;
        columns.col(c).tail<3>() = to_world * parts[k].normal / rate;
      }
    }
  }

 private:
  ForceBasis& basis_;
  Eigen::Index samples_;
  std::vector<std::vector<GrindingLaw>> laws_;
  std::vector<GrindingLaw> paper_{kTissueCount, GrindingLaw({1, 1})};
};

}  // namespace

Vec3 force_at(const ForceBasis& basis, std::size_t i, const PerTissue<GrindingProperties>& tissue) {
  Vec3 force = Vec3::Zero();
  const auto c = static_cast<Eigen::Index>(i);
  for (int k = 0; k < kTissueCount; ++k)
    if (basis.touched(k)) {
      const auto& f = basis.tissue[k].force;
      const double u = tissue[k].specific_energy;
      force += u * f.col(c).head<3>() + u / tissue[k].force_ratio * f.col(c).tail<3>();
    }
  return force;
}

double torque_at(const ForceBasis& basis, std::size_t i,
                 const PerTissue<GrindingProperties>& tissue) {
  double torque = 0;
  for (int k = 0; k < kTissueCount; ++k)
    if (basis.touched(k)) torque += tissue[k].specific_energy * basis.tissue[k].torque[i];
  return torque;
}

ForceBasis force_basis(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                       const std::vector<HandleSample>& path, const SpindleRecord& spindle,
                       const std::function<void(double)>& progress,
                       const std::vector<UnitLaw>& laws) {
  if (path.size() < 2) throw Error("a recorded motion needs at least two samples");
  Parameters unit = parameters;
  for (GrindingProperties& k : unit.tissue) k = {1, 1};
  if (!laws.empty()) unit.tissue[0].up_cutting = 0.5;  // any law for which elements are kept
  unit.handpiece.model = HandpieceModel::kFixed;
  unit.handpiece.stall_torque = std::numeric_limits<double>::infinity();

  Workpiece workpiece(tooth);
  const auto engine = make_engine(bur, workpiece, unit, path.front().pose);
  const SurfaceElements shank = bur.shank_elements(kShankElementSize);
  const double h = unit.time_step;

  ForceBasis basis;
  basis.start = path.front().time;
  basis.step = h;
  basis.size = path.size();
  basis.rotation_rate = unit.handpiece.rotation_rate;
  basis.speed_recorded = !spindle.rate.empty();
  basis.area.assign(path.size(), 0);
  basis.removal.assign(path.size(), 0);
  basis.axial.assign(path.size(), 0);
  LawColumns by_law(laws, path.size(), basis);
  for (const double v : engine->clear(path.front().pose)) basis.initial_overlap += v;

  for (std::size_t i = 1; i < path.size(); ++i) {
    const Pose &before = path[i - 1].pose, &pose = path[i].pose;
    const double rate = basis.speed_recorded ? spindle.rate[i] : basis.rotation_rate;
    const bool stalled = (!spindle.stalled.empty() && spindle.stalled[i]) || !(rate > 0);
    if (!(path[i].buttons & kPedalButton) || stalled) {
      engine->pause(before);
      continue;
    }
    const Vec3 v = before.orientation.conjugate() * ((pose.position - before.position) / h);
    const Vec3 omega = unit.rotation_feed ? turn_rate(before.orientation, pose.orientation, h)
                                          : Vec3(Vec3::Zero());
    if (v.squaredNorm() > 0) basis.axial[i] = static_cast<float>(v.z() / v.norm());
    if (v.squaredNorm() > 0 || omega.squaredNorm() > 0) {
      engine->sample(before, v, omega);
      if (engine->contact().size() > 0) {
        const PerTissue<TissueBasis> parts = by_law.any()
                                                 ? by_law.paper(engine->contact(), v, omega, rate)
                                                 : engine->contact().basis(v, omega);
        if (by_law.any()) by_law.put(i, engine->contact(), before.orientation, v, omega, rate);
        for (int k = 0; k < kTissueCount; ++k) {
          if (parts[k].torque == 0 && parts[k].normal.isZero(0)) continue;
          TissueColumns& t = basis.tissue[k];
          if (!basis.touched(k)) {
            t.force.setZero(6, static_cast<Eigen::Index>(path.size()));
            t.torque.assign(path.size(), 0);
          }
          const auto c = static_cast<Eigen::Index>(i);
          t.force.col(c).head<3>() = before.orientation * parts[k].tangential / rate;
          t.force.col(c).tail<3>() = before.orientation * parts[k].normal / rate;
          t.torque[i] = parts[k].torque / rate;
          t.touched += h;
          basis.removal[i] += static_cast<float>(2 * units::kPi * parts[k].torque);
        }
        if (basis.removal[i] > 0)
          for (const double a : engine->contact().advancing_area(v, omega))
            basis.area[i] += static_cast<float>(a);
      }
    }
    engine->advance(pose);
    engine->carve();
    if (i % kShankEvery == 0 && area_in_tissue(shank, workpiece, pose) > 0)
      basis.shank_contact += h * kShankEvery;
    if (progress && i % 1024 == 0)
      progress(static_cast<double>(i) / static_cast<double>(path.size()));
  }
  engine->finish(path.back().pose);
  for (int k = 0; k < kTissueCount; ++k) basis.tissue[k].removed = engine->removed()[k];
  return basis;
}

std::vector<ForceBasis> force_bases(const Bur& bur, const LayeredTooth& tooth,
                                    const Parameters& parameters,
                                    const std::vector<RecordedMotion>& motions,
                                    const std::function<void(double)>& progress,
                                    const std::vector<UnitLaw>& laws) {
  std::vector<ForceBasis> bases(motions.size());
  double all = 0;
  for (const RecordedMotion& m : motions) all += static_cast<double>(m.path.size());
  std::vector<double> done(motions.size(), 0);
  std::mutex reporting;
  tbb::parallel_for(std::size_t{0}, motions.size(), [&](std::size_t r) {
    const auto& [path, spindle] = motions[r];
    bases[r] = force_basis(bur, tooth, parameters, path, spindle,
                           progress ? std::function<void(double)>([&, r](double part) {
                             const std::lock_guard lock(reporting);
                             done[r] = part * static_cast<double>(motions[r].path.size()) / all;
                             double sum = 0;
                             for (const double d : done) sum += d;
                             progress(sum);
                           })
                                    : std::function<void(double)>(),
                           laws);
  });
  return bases;
}

}  // namespace toothprep
