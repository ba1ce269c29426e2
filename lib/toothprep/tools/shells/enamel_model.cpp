#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/triangle_tree.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {
namespace {

constexpr double kFullShare = 0.5;  // of the crown's height: from there on enamel is full

TriangleMesh scanned_surface(const SoundShell& sound) {
  TriangleMesh mesh;
  for (const Vec3& p : sound.shell.points) mesh.vertices.push_back(p.cast<float>());
  for (std::size_t t = 0; t < sound.shell.triangles.size(); ++t)
    if (!sound.added[t]) mesh.triangles.push_back(sound.shell.triangles[t]);
  return mesh;
}

// The enamel's thickness below a point of the surface.
class Thickness {
 public:
  Thickness(const SoundShell& sound, double full) : full_(full), sides_(sound.open_sides) {
    for (const OpenSide& side : sides_) {
      double height = 0;
      for (const Vec3& p : sound.shell.points) height = std::max(height, above(side, p));
      height_.push_back(height);
    }
  }
  double at(const Vec3& p) const {
    double share = 1;
    for (std::size_t s = 0; s < sides_.size(); ++s)
      share = std::min(share, std::max(0.0, above(sides_[s], p)) / (kFullShare * height_[s]));
    return full_ * share;
  }

 private:
  static double above(const OpenSide& side, const Vec3& p) {
    return -side.outward.dot(p - side.centre);
  }
  double full_;
  std::vector<OpenSide> sides_;
  std::vector<double> height_;
};

}  // namespace

LayeredTooth enamel_model(const SoundShell& sound, double thickness_mm, const ShellOptions& options,
                          std::vector<std::string>& notes) {
  LayeredTooth solid = voxelize_shells({{Tissue::kDentin, sound.shell}}, options, &notes);
  const TriangleTree tree(scanned_surface(sound));
  const Thickness thickness(sound, thickness_mm);
  const auto band = static_cast<float>(solid.band());
  const Index3 lower = kBrickEdge * solid.solid.first_brick();
  const Index3 upper = lower + kBrickEdge * solid.solid.brick_counts() - Index3::Ones();
  LayeredTooth tooth = build_tooth_by_brick(
      solid.lattice, lower, upper, [&](const Index3& first, ToothSample* samples) {
        for (int v = 0; v < kBrickVoxels; ++v) {
          const Index3 i = first + Index3(v >> 6, v >> 3 & 7, v & 7);
          ToothSample& sample = samples[v];
          sample.solid = solid.solid.value(i.x(), i.y(), i.z());
          sample.tissue.fill(band);
          if (sample.solid >= band) continue;
          const SurfacePoint near = tree.nearest(solid.lattice.to_world(i));
          const auto into_dentin = static_cast<float>(std::clamp<double>(
              (sample.solid < 0 ? near.distance : -near.distance) - thickness.at(near.point), -band,
              band));
          sample.tissue[0] = std::max(sample.solid, into_dentin);
          sample.tissue[1] = std::max(sample.solid, -into_dentin);
          if (sample.solid <= 0) sample.label = into_dentin < 0 ? Tissue::kEnamel : Tissue::kDentin;
        }
      });
  tooth.provenance = solid.provenance;
  notes.push_back(fmt::format(
      "enamel and dentin are a model, not measured: enamel {:.3g} mm thick{}; no pulp, so that its "
      "opening can't be noticed",
      thickness_mm,
      sound.open_sides.empty() ? " everywhere, on a root too"
                               : ", thinning out over the lower half of the crown's height"));
  return tooth;
}

}  // namespace toothprep
