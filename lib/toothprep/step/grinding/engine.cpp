#include "toothprep/step/grinding/engine.h"

#include <algorithm>
#include <array>
#include <span>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/removal.h"
#include "toothprep/step/grinding/voxel_engine.h"

namespace toothprep {
namespace {

constexpr double kReachVoxels = 0.1;  // contact is looked up this far ahead of the surface

class LevelsetEngine final : public GrindingEngine {
 public:
  LevelsetEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                 const Pose& pose)
      : workpiece_(workpiece),
        contact_(bur, element_size(bur, parameters), parameters.handpiece.clockwise,
                 parameters.tissue),
        removal_(bur, workpiece, pose) {}

  void sample(const Pose& pose, const Vec3& v, const Vec3& omega) noexcept override {
    const std::size_t count = removal_.ahead(pose, v, omega, uncut_);
    contact_.sample(workpiece_, pose, v, omega, kReachVoxels * workpiece_.voxel(),
                    removal_.cuts_made(), std::span(uncut_).first(count), &removal_.history());
  }
  bool covers(const Vec3& v) const noexcept override { return contact_.covers(v); }
  const ContactSet& contact() const noexcept override { return contact_.contact(); }
  PerTissue<double> clear(const Pose& pose) override { return removal_.clear(pose); }
  void advance(const Pose& pose) noexcept override { removal_.advance(pose); }
  void carve() noexcept override { removal_.carve(); }
  void pause(const Pose& pose) noexcept override { removal_.pause(pose); }
  void finish(const Pose& pose) noexcept override { removal_.finish(pose); }
  const PerTissue<double>& removed() const noexcept override { return removal_.removed(); }

 private:
  Workpiece& workpiece_;
  ContactModel contact_;
  Removal removal_;
  std::array<Pose, ContactModel::kMostBeen> uncut_;
};

}  // namespace

double element_size(const Bur& bur, const Parameters& parameters) {
  const double radius = bur.max_radius(), asked = parameters.element_size;
  if (!(asked > 0)) return std::min(kElementSize, radius / 8);
  if (asked > radius / 4)
    throw Error("engine.element_mm: " + std::to_string(asked) +
                " mm is more than a quarter of the radius of bur " + bur.name() + "; use at most " +
                std::to_string(radius / 4) + " mm");
  return asked;
}

std::unique_ptr<GrindingEngine> make_engine(const Bur& bur, Workpiece& workpiece,
                                            const Parameters& parameters, const Pose& pose) {
  if (bur.max_radius() < workpiece.voxel())
    throw Error("bur " + bur.name() + ": its diameter of " + std::to_string(2 * bur.max_radius()) +
                " mm is less than two voxels of the tooth (" + std::to_string(workpiece.voxel()) +
                " mm); voxelize the tooth finer");
  if (parameters.engine == EngineKind::kVoxel)
    return std::make_unique<VoxelEngine>(bur, workpiece, parameters, pose);
  return std::make_unique<LevelsetEngine>(bur, workpiece, parameters, pose);
}

}  // namespace toothprep
