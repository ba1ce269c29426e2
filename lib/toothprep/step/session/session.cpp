#include "toothprep/step/session/session.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/body_contact.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/split_step.h"
#include "toothprep/step/session/stages.h"

namespace toothprep {
namespace {

constexpr double kShankElementSize = 0.4;  // mm
constexpr double kHeadElementSize = 0.2;   // mm
constexpr double kAlmost = 1 - 1e-6;
constexpr double kRounding = 1e-5;  // of volumes and areas that are added up in single precision

}  // namespace

// The model, which is constant, the state between two steps, and the engine with its tissue.
class Session::Work {
 public:
  Work(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
       const HandleSample& first);
  StepRecord step(const HandleSample& next) noexcept;
  StepRecord stand(const HandleSample& rejected) noexcept;
  StepRecord step_part(const HandleSample& handle, double h) noexcept;
  void count_work(const StepPart& part, double h) noexcept;
  int parts_of_step() noexcept;
  void count(const StepRecord& row) noexcept;
  void find_bodies(const HandleSample& from, StepRecord& row) const noexcept;
  void count_bodies(const StepRecord& row) noexcept;
  void count_removed_of_bodies(const StepRecord& row) noexcept;
  bool clear_of_tissue() const noexcept;
  void finish(StepRecord& last) noexcept;

  Workpiece& workpiece_;
  StepModel model_;
  AreaInTissue shank_area_;
  std::unique_ptr<GrindingEngine> engine_;
  int most_parts_;  // of a step that is split
  BurState state_;
  Vec3 velocity_before_ = Vec3::Zero();  // mm/s, W: a step ago
  StepRecord initial_;
  SessionTotals totals_;
  // Of a tooth with several bodies; what had been removed of each before.
  std::optional<BodyContact> body_contact_;
  std::vector<double> removed_before_;
};

Session::Work::Work(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                    const HandleSample& first)
    : workpiece_(workpiece),
      model_{parameters, drive, bur.shank_elements(kShankElementSize),
             bur.elements(kHeadElementSize)},
      shank_area_(model_.shank),
      most_parts_(most_parts(bur.elements(kPiecesAcross * element_size(bur, parameters)).size(),
                             parameters.time_step)) {
  if (!first.pose.position.allFinite() || !first.pose.orientation.coeffs().allFinite())
    throw Error("the first handle pose is not finite");
  engine_ = make_engine(bur, workpiece, parameters, first.pose);
  totals_.initial_overlap = engine_->clear(first.pose);
  if (const WorkpieceBodies* bodies = workpiece.bodies()) {
    body_contact_.emplace(bur);
    removed_before_ = bodies->removed();
    totals_.bodies.resize(bodies->count());
  }
  state_.pose = first.pose;
  state_.handle = first;
  if (first.buttons & kPedalButton) state_.rotation_rate = parameters.handpiece.rotation_rate;
  initial_.handle = first;
  initial_.bur = first.pose;
}

StepRecord Session::Work::step(const HandleSample& next) noexcept {
  if (next.rejected) return stand(next);
  const HandleSample from = state_.handle;
  const Vec3 start = state_.pose.position;
  const int parts = parts_of_step();
  SplitStepRow whole;
  for (int part = 1; part <= parts; ++part)
    whole.add(
        step_part(handle_between(from, next, part, parts), model_.parameters.time_step / parts));
  engine_->carve();
  StepRecord row = whole.row(start, model_.parameters.time_step);
  row.removed_volume = engine_->removed();
  row.shank_contact_area = shank_area_.at(workpiece_, state_.pose);
  if (body_contact_) find_bodies(from, row);
  count(row);
  return row;
}

// Whose the contact is. In a stall it is that of the velocity that the stall was judged on.
void Session::Work::find_bodies(const HandleSample& from, StepRecord& row) const noexcept {
  double total = 0;
  for (const double area : row.contact_area) total += area;
  const Quat turn = row.handle.pose.orientation * from.pose.orientation.conjugate();
  const Vec3 omega =
      std::copysign(2, turn.w()) * turn.vec() / model_.parameters.time_step;  // of a small turn
  row.other_bodies =
      body_contact_->areas(workpiece_, state_.pose, state_.judged_velocity, omega, total);
}

StepRecord Session::Work::stand(const HandleSample& rejected) noexcept {
  ++totals_.rejected_steps;
  state_.velocity.setZero();
  velocity_before_.setZero();
  state_.judged_velocity.setZero();
  StepRecord row;
  row.handle = rejected;
  row.bur = state_.pose;
  row.removed_volume = engine_->removed();
  return row;
}

// The method, one stage a line (stages.h).
StepRecord Session::Work::step_part(const HandleSample& handle, double h) noexcept {
  const bool was_stalled = state_.stalled;

  StepPart part = sense(model_, state_, handle, h);
  find_contact(model_, *engine_, part);
  find_trial(model_, *engine_, part);
  judge_stall(model_, state_, *engine_, part);
  integrate(model_, part, state_);
  remove_tissue(model_, part, state_, *engine_);
  StepRecord row = record(model_, part, state_, *engine_);

  totals_.torque_work += row.power * h;
  if (row.power > 0 && !engine_->contact().is_linear()) count_work(part, h);
  totals_.stall_onsets += row.stalled && !was_stalled;
  return row;
}

void Session::Work::count_work(const StepPart& part, double h) noexcept {
  const Trial& trial = part.trial;
  const GrindingRates rates =
      engine_->contact().rates(trial.velocity, part.omega, trial.rotation_rate);
  for (int k = 0; k < kTissueCount; ++k) {
    totals_.cutting_work[k] += rates.cut[k] * h;
    totals_.swept[k] += rates.swept[k] * h;
  }
  totals_.rubbing_work += rates.rubbed * h;
  totals_.unsettled_steps += trial.settled ? 0 : 1;
}

int Session::Work::parts_of_step() noexcept {
  if (model_.drive == Drive::kDirect) return 1;
  // Where it turns back it is slow for a moment, and the spring takes it along within the step.
  const Vec3 goes_on = 2 * state_.velocity - velocity_before_;
  velocity_before_ = state_.velocity;
  const double way = std::max(state_.velocity.norm(), goes_on.norm()) *
                     model_.parameters.time_step / workpiece_.voxel();
  const int wanted = wanted_parts(way);
  totals_.split_steps += wanted > 1;
  totals_.split_steps_cut_short += wanted > most_parts_;
  return std::min(wanted, most_parts_);
}

void Session::Work::count(const StepRecord& row) noexcept {
  totals_.removed = engine_->removed();
  totals_.stalled_steps += row.stalled;
  totals_.shank_contact_steps += row.shank_contact_area > 0;
  const bool touches = row.stalled || row.torque > 0 || row.grinding_force.squaredNorm() > 0;
  totals_.contact_steps += touches;
  const double way = row.bur_velocity.norm() * model_.parameters.time_step;
  totals_.way_without_contact = touches ? 0 : totals_.way_without_contact + way;
  if (model_.drive == Drive::kLoad)
    totals_.unbalanced_steps +=
        touches && row.bur_velocity.norm() > kAlmost * model_.parameters.load.max_speed;
  else
    totals_.largest_lag =
        std::max(totals_.largest_lag, (row.handle.pose.position - row.bur.position).norm());
  totals_.peak_device_force = std::max(totals_.peak_device_force, row.device_force.norm());
  if (body_contact_) count_bodies(row);
}

void Session::Work::count_removed_of_bodies(const StepRecord& row) noexcept {
  const WorkpieceBodies& bodies = *workpiece_.bodies();
  double all = 0, others = 0;
  for (const double volume : row.removed_volume) all += volume;
  for (std::size_t b = 0; b < totals_.bodies.size(); ++b) {
    totals_.bodies[b].removed = bodies.removed()[b] - removed_before_[b];
    others += totals_.bodies[b].removed;
  }
  // The rest is the tooth's; what is less than the sums' rounding is nothing.
  totals_.bodies[bodies.worked()].removed = all - others > kRounding * all ? all - others : 0;
  for (BodyTotals& body : totals_.bodies)
    if (body.removed > 0 && !body.first_removal) body.first_removal = row.handle.time;
}

void Session::Work::count_bodies(const StepRecord& row) noexcept {
  count_removed_of_bodies(row);
  double area = 0;
  for (const double of_tissue : row.contact_area) area += of_tissue;
  const double all = area;
  for (const BodyArea& other : row.other_bodies) {
    if (other.body != 0) ++totals_.bodies[other.body - 1u].contact_steps;
    area -= other.area;
  }
  totals_.bodies[workpiece_.bodies()->worked()].contact_steps += area > kRounding * all;
  if (!(row.shank_contact_area > 0)) return;
  const std::uint64_t touched = BodyContact::touched_by(model_.shank, workpiece_, state_.pose);
  for (std::size_t b = 0; b < totals_.bodies.size(); ++b)
    totals_.bodies[b].shank_contact_steps += static_cast<long>(touched >> b & 1u);
}

bool Session::Work::clear_of_tissue() const noexcept {
  return area_in_tissue(model_.head, workpiece_, state_.pose) == 0;
}

void Session::Work::finish(StepRecord& last) noexcept {
  engine_->finish(state_.pose);
  totals_.removed = engine_->removed();
  last.removed_volume = engine_->removed();
  if (body_contact_) count_removed_of_bodies(last);
}

double energy_of_removal(const Parameters& parameters, const SessionTotals& totals,
                         const PerTissue<double>& ground) {
  double energy = totals.rubbing_work;
  for (int k = 0; k < kTissueCount; ++k) {
    const bool by_chips = !is_linear(parameters) && totals.swept[k] > 0;
    const double u =
        by_chips ? totals.cutting_work[k] / totals.swept[k] : parameters.tissue[k].specific_energy;
    energy += u * ground[k];
  }
  return energy;
}

Session::Session(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                 const HandleSample& first)
    : work_(std::make_unique<Work>(bur, workpiece, parameters, drive, first)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;

const StepRecord& Session::initial() const noexcept { return work_->initial_; }
StepRecord Session::step(const HandleSample& next) noexcept { return work_->step(next); }
void Session::finish(StepRecord& last) noexcept { work_->finish(last); }
bool Session::clear_of_tissue() const noexcept { return work_->clear_of_tissue(); }
const SessionTotals& Session::totals() const noexcept { return work_->totals_; }

}  // namespace toothprep
