// The two engines behind one interface: how the bur's surface meets tissue, and how tissue goes.
//
//   levelset   the bur's true surface against signed distance fields (contact.h, removal.h)
//   voxel      the paper's two layers of bur voxels (voxel_engine.h), for its curves and its errors
#pragma once

#include <memory>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class GrindingEngine {  // of one bur and one workpiece; states in words what the step needs
 public:
  virtual ~GrindingEngine() = default;

  // Contact. Finds the elements in contact for a bur at `pose` that moves with trial velocity v
  // (mm/s, B) and turns with omega (rad/s, B); not both zero.
  virtual void sample(const Pose& pose, const Vec3& v, const Vec3& omega) noexcept = 0;
  // Whether every element that advances with v was considered by the last sample().
  virtual bool covers(const Vec3& v) const noexcept = 0;
  // What the last sample() found.
  virtual const ContactSet& contact() const noexcept = 0;

  // Removal, due every voxel of way, or every 0.05 mm with finer voxels (Eq. 20 as a distance).
  // Removes at once whatever lies inside the bur at `pose`; returns the volume per tissue, mm³.
  virtual PerTissue<double> clear(const Pose& pose) = 0;
  // The bur has cut its way to `pose`.
  virtual void advance(const Pose& pose) noexcept = 0;
  // Removes of that what is due, or a share of it. Once a step.
  virtual void carve() noexcept = 0;
  // From `pose` on the bur moves without cutting (motor off, or stalled in direct drive). What was
  // due by then is removed when it turns again; what lies on the way in between is not.
  virtual void pause(const Pose& pose) noexcept = 0;
  // Removes everything that is due up to `pose`, or up to where it was paused.
  virtual void finish(const Pose& pose) noexcept = 0;
  // Removed so far per tissue, mm³ (without clear()).
  virtual const PerTissue<double>& removed() const noexcept = 0;
};

// Largest size of the pieces into which the border of the contact is divided, unless the parameters
// say otherwise: this, or an eighth of the bur's radius if that is less. README.md says how exact
// the work of a pass then is; the step's cost grows with 1/size.
constexpr double kElementSize = 0.075;  // mm

// The size in mm that `parameters` mean for this bur. Throws Error if it is above a quarter of the
// bur's radius.
double element_size(const Bur& bur, const Parameters& parameters);

// The engine that `parameters` name. Keeps references to bur and workpiece. Throws Error as
// element_size() does, or if the bur is too thin for the engine: two voxels across, and for the
// voxel engine a voxel beneath its surface.
std::unique_ptr<GrindingEngine> make_engine(const Bur& bur, Workpiece& workpiece,
                                            const Parameters& parameters, const Pose& pose);

}  // namespace toothprep
