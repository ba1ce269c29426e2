#include "toothprep/proof/figures/equal_area_engine.h"

#include <cmath>

#include "toothprep/step/grinding/voxel_at.h"

namespace toothprep::figures {

EqualAreaEngine::EqualAreaEngine(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                                 const Pose& pose, int neighbours)
    : workpiece_(workpiece),
      removal_(bur, workpiece, parameters, pose),
      contact_(0, parameters.tissue, parameters.trailing_elements) {
  const double pitch = workpiece.voxel();
  const double turn = parameters.handpiece.clockwise ? 1 : -1;
  const int most = neighbours == 6 ? 1 : neighbours == 18 ? 2 : 3;  // steps along the axes
  const auto centre = [&](int i, int j, int k) {
    return Vec3(pitch * Vec3(i + 0.5, j + 0.5, k + 0.5));
  };
  const auto inside = [&](const Vec3& x) {
    return bur.distance(std::hypot(x.x(), x.y()), x.z()) < 0;
  };
  const int half = static_cast<int>(std::ceil(bur.max_radius() / pitch));
  const int height = static_cast<int>(std::ceil(bur.head_length() / pitch));
  const auto f = [](double x) { return static_cast<float>(x); };
  for (int i = -half; i < half; ++i)
    for (int j = -half; j < half; ++j)
      for (int k = 0; k < height; ++k) {
        const Vec3 at = centre(i, j, k);
        if (!inside(at)) continue;
        bool boundary = false;
        Vec3 normal = Vec3::Zero();
        for (int n = 0; n < 27; ++n) {
          const Index3 d(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
          if (n == 13 || inside(centre(i + d.x(), j + d.y(), k + d.z()))) continue;
          boundary = boundary || d.cwiseAbs().sum() <= most;
          normal += d.cast<double>().normalized();
        }
        if (!boundary || normal.norm() < 1e-9) continue;
        const Vec3 n = normal.normalized();
        const double arm = std::hypot(at.x(), at.y()), area = pitch * pitch;
        const Vec3 m = at.cross(n);
        cells_.push_back(
            {at,
             {f(n.x()), f(n.y()), f(n.z()), f(m.x()), f(m.y()), f(m.z()), f(-turn * at.y() / arm),
              f(turn * at.x() / arm), f(area / arm), f(arm), f(area)}});
      }
  contact_ = ContactSet(cells_.size(), parameters.tissue, parameters.trailing_elements);
}

void EqualAreaEngine::sample(const Pose& pose, const Vec3&, const Vec3&) noexcept {
  contact_.clear();
  const LabelGrid& labels = workpiece_.tooth().tissue;
  const LevelSet& cut = workpiece_.cut();
  const Vec3 tip = workpiece_.lattice().to_index(pose.position);
  const Mat3 rotation = pose.orientation.toRotationMatrix() / workpiece_.voxel();
  for (const Cell& cell : cells_) {
    const Vec3 at = tip + rotation * cell.centre + Vec3::Constant(0.5);
    if (!(at.cwiseAbs().maxCoeff() < 1e8)) continue;  // far outside; must not overflow
    const Index3 v = voxel_at(at);
    const std::uint8_t label = labels.value(v.x(), v.y(), v.z());
    if (label == 0 || cut.value(v.x(), v.y(), v.z()) > 0) continue;
    contact_.add(cell.element, label - 1, 1);
  }
}

}  // namespace toothprep::figures
