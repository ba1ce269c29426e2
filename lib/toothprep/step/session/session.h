// One session: a bur, a tooth, the parameters, and the step that turns a commanded pose into forces
// and removal. Replay and live drive the same step.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

// Drive `load`: a bur that has gone this far without contact has run off, mm.
constexpr double kMostWayWithoutContact = 5;

// What was done to one body of a tooth that has several (tooth/tooth_bodies.h).
struct BodyTotals {
  long contact_steps = 0;               // in which the head met it, advancing
  long shank_contact_steps = 0;         // in which the shank met it
  double removed = 0;                   // mm³
  std::optional<double> first_removal;  // s, the end of the step since which some of it is missing
};

// The energy audit and what else a session counts.
struct SessionTotals {
  double torque_work = 0;  // N·mm = mJ: integral of 2 pi N T_z over the steps that turn
  // Of a law that isn't linear, whose energy per volume differs from chip to chip; 0 of the paper's.
  PerTissue<double> cutting_work{};     // mJ, of the torque's: what cut the tissue
  PerTissue<double> swept{};            // mm³, that the elements advanced through meanwhile
  double rubbing_work = 0;              // mJ, of the torque's: what rubbed
  long unsettled_steps = 0;             // in which force and velocity didn't come to agree
  PerTissue<double> removed{};          // mm³
  PerTissue<double> initial_overlap{};  // mm³, inside the bur at the first sample; not in `removed`
  long stalled_steps = 0;               // in which any part stalled
  long stall_onsets = 0;                // steps that began a stall
  long contact_steps = 0;               // in which tissue was met
  long rejected_steps = 0;              // not made, since the handle's reading was rejected
  long shank_contact_steps = 0;         // in which the shank met tissue
  long split_steps = 0;                 // that went in parts, since the bur was fast
  long split_steps_cut_short = 0;  // of these: in fewer parts than wanted, to keep the time budget
  double largest_lag = 0;          // mm, bur behind the handle; not of the drive `load`
  long unbalanced_steps = 0;       // drive `load`: at its largest speed although in contact
  double way_without_contact = 0;  // mm, of the bur since it last met tissue
  double peak_device_force = 0;    // N
  // Of each body, by its place in the list; empty if the tooth has no others.
  std::vector<BodyTotals> bodies;
};

// What the removal of `ground` (mm³) takes by the law, mJ: u_k V_k summed, with u_k the mean over the
// chips of these totals where the law isn't linear, and what rubbed meanwhile.
[[nodiscard]] double energy_of_removal(const Parameters& parameters, const SessionTotals& totals,
                                       const PerTissue<double>& ground);

class Session {  // for one thread at a time; several run side by side
 public:
  // Keeps references to bur and workpiece, which must outlive it. `parameters` must be valid
  // (core/parameters.h). Tissue inside the bur at `first` is removed. Throws Error if the bur is
  // too thin for the engine (less than two voxels across), if parameters.element_size is above a
  // quarter of its radius, or if `first` isn't finite.
  Session(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
          const HandleSample& first);
  ~Session();                   // bur and workpiece stay
  Session(Session&&) noexcept;  // what is left behind can only be destroyed
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Row 0: the initial state with zero forces.
  [[nodiscard]] const StepRecord& initial() const noexcept;

  // One step of parameters.time_step that ends with the handle at `next`. Allocates nothing. If
  // `next` is rejected, no step is made: the row has the bur where it was, at rest, without forces,
  // and the next step goes on from the last handle that was not rejected.
  StepRecord step(const HandleSample& next) noexcept;

  // Removes what is still due and brings the volumes of the last record up to date.
  void finish(StepRecord& last) noexcept;

  // Whether no part of the head's surface lies in tissue, to a voxel.
  [[nodiscard]] bool clear_of_tissue() const noexcept;

  [[nodiscard]] const SessionTotals& totals() const noexcept;  // so far

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

}  // namespace toothprep
