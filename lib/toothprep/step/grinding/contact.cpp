#include "toothprep/step/grinding/contact.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

// Elements whose normal is up to this far behind the motion (sine of the angle) are sampled as
// well, so that the trial velocity may turn by as much without a new sample.
constexpr float kMarginSine = 0.15f;
// Elements in contact that lie this close in memory are computed in one run.
constexpr int kRunGap = 8;
// Keeps a division defined where the field is flat or meets an element face on, mm.
constexpr float kLeastExtent = 1e-6f;
constexpr double kMarginCosine = 0.99;  // a little inside sqrt(1 - 0.15²)

// The cell of an index coordinate beside the tip's voxel. Cutting towards zero is floor for what is
// positive, and vectorises with SSE2 alone. The offset costs up to 3e-4 voxel: so close to a border
// of two cells either serves, since the interpolant is continuous.
constexpr float kIndexOffset = 4096;  // voxels; a head is shorter
inline std::int32_t cell_of(float x) {
  return static_cast<std::int32_t>(x + kIndexOffset) - static_cast<std::int32_t>(kIndexOffset);
}

}  // namespace

// The tip's place in index space, split so that single precision suffices beside it.
struct ContactModel::IndexFrame {
  Index3 base;
  float fx, fy, fz;  // rest, [0, 1)
  float a[9];        // rotation / voxel, row by row

  IndexFrame(const Lattice& lattice, const Pose& pose) {
    const Vec3 tip = lattice.to_index(pose.position);
    const Vec3 whole = tip.array().floor();
    base = whole.cast<int>();
    fx = static_cast<float>(tip.x() - whole.x());
    fy = static_cast<float>(tip.y() - whole.y());
    fz = static_cast<float>(tip.z() - whole.z());
    const Mat3 rotation = pose.orientation.toRotationMatrix() / lattice.voxel;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) a[3 * i + j] = static_cast<float>(rotation(i, j));
  }
};

ContactModel::ContactModel(const Bur& bur, double element_size, bool clockwise,
                           const PerTissue<GrindingProperties>& tissue)
    : elements_(bur.elements(element_size, clockwise)), contact_(elements_.size(), tissue, false) {
  const std::size_t n = elements_.size();
  for (auto* array : {&mx_, &my_, &mz_, &chord_, &curvature_, &sag_, &fx_, &fy_, &fz_, &covered_})
    array->resize(n);
  for (auto* array : {&cell_x_, &cell_y_, &cell_z_, &candidates_}) array->resize(n);
  for (auto& array : corner_) array.resize(n);
  const SurfaceElements& e = elements_;
  for (std::size_t i = 0; i < n; ++i) {
    mx_[i] = e.y[i] * e.nz[i] - e.z[i] * e.ny[i];
    my_[i] = e.z[i] * e.nx[i] - e.x[i] * e.nz[i];
    mz_[i] = e.x[i] * e.ny[i] - e.y[i] * e.nx[i];
    curvature_[i] = e.curvature_along[i] + e.curvature_around[i];
    const float half_angle = e.curvature_along[i] * e.half_along[i];
    chord_[i] = half_angle == 0 ? 1 : std::sin(half_angle) / half_angle;
    sag_[i] = 0.5f * (e.curvature_along[i] * e.half_along[i] * e.half_along[i] +
                      e.curvature_around[i] * e.half_around[i] * e.half_around[i]);
  }
}

float ContactModel::coverage_at_skin(FieldSample s, int i, const float* a, float ox, float oy,
                                     float oz) const noexcept {
  const SurfaceElements& e = elements_;
  // Back from the reach to the surface.
  s.value -= s.gx * ox + s.gy * oy + s.gz * oz;
  const float half = e.half_along[i] + e.half_around[i];
  if (s.value >= half) return 0;
  if (s.value <= -half) return 1;
  const float gx = a[0] * s.gx + a[3] * s.gy + a[6] * s.gz;
  const float gy = a[1] * s.gx + a[4] * s.gy + a[7] * s.gz;
  const float gz = a[2] * s.gx + a[5] * s.gy + a[8] * s.gz;
  const float along = gx * e.lx[i] + gy * e.ly[i] + gz * e.lz[i];
  const float around = gx * e.tx[i] + gy * e.ty[i];
  const float normal = gx * e.nx[i] + gy * e.ny[i] + gz * e.nz[i];
  constexpr int kAround = 4, kAlong = 2;
  const float extent =
      std::abs(along) * e.half_along[i] / kAlong + std::abs(around) * e.half_around[i] / kAround;
  float covered = 0;
  for (int m = 0; m < kAround; ++m) {
    const float p = e.half_around[i] * (static_cast<float>(2 * m + 1) / kAround - 1);
    for (int n = 0; n < kAlong; ++n) {
      const float q = e.half_along[i] * (static_cast<float>(2 * n + 1) / kAlong - 1);
      const float sag = 0.5f * (e.curvature_around[i] * p * p + e.curvature_along[i] * q * q);
      const float value = s.value + around * p + along * q - normal * sag;
      covered += value >= extent ? 0 : value <= -extent ? 1 : 0.5f - 0.5f * value / extent;
    }
  }
  return covered / (kAround * kAlong);
}

// By the tissues' level sets; where a tissue without one occurs, by the trilinear blend of the
// labels.
void ContactModel::tissue_shares(const Workpiece& workpiece, std::size_t brick, const Index3& cell,
                                 float fx, float fy, float fz, int i, const float* a, float ox,
                                 float oy, float oz, PerTissue<float>& share) const noexcept {
  const LabelGrid& labels = workpiece.labels();
  if (labels.is_uniform(brick) && (cell.x() & 7) < 7 && (cell.y() & 7) < 7 && (cell.z() & 7) < 7) {
    const std::uint8_t label = labels.uniform_value(brick);
    if (label != 0) share[label - 1] = 1;
    return;
  }
  PerTissue<float> blend{};
  float total = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int ix = corner >> 2, iy = (corner >> 1) & 1, iz = corner & 1;
    const std::uint8_t label = labels.value(cell.x() + ix, cell.y() + iy, cell.z() + iz);
    if (label == 0) continue;
    const float w = (ix ? fx : 1 - fx) * (iy ? fy : 1 - fy) * (iz ? fz : 1 - fz);
    blend[label - 1] += w;
    total += w;
  }
  if (total <= 0) return;
  constexpr int kOther = tissue_index(Tissue::kOther);
  if (blend[kOther] == 0) {
    float sum = 0;
    for (int k = 0; k < kOther; ++k) {
      float corners[8];
      cell_corners(workpiece.tooth().remains[k], cell.x(), cell.y(), cell.z(), corners);
      share[k] = coverage_at_skin(sample_cell(corners, fx, fy, fz), i, a, ox, oy, oz);
      sum += share[k];
    }
    if (sum > 0) {
      for (int k = 0; k < kOther; ++k) share[k] /= sum;
      return;
    }
  }
  for (int k = 0; k < kTissueCount; ++k) share[k] = blend[k] / total;
}

void ContactModel::sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v,
                          const Vec3& omega, double reach) noexcept {
  const SurfaceElements& e = elements_;
  const IndexFrame f(workpiece.lattice(), pose);
  const double speed = v.norm();
  sampled_direction_ = speed > 0 ? Vec3(v / speed) : Vec3(Vec3::Zero());

  // Pass 1: the cell of every element's sample, and which elements are worth a look-up.
  const int candidates =
      omega.squaredNorm() > 0 ? locate_turning(f, v, omega, reach) : locate_straight(f, v, reach);

  // Pass 2: the cut at the corners of each cell that isn't all air.
  const LevelSet& cut = workpiece.cut();
  int near = 0;
  for (int c = 0; c < candidates; ++c) {
    const int i = candidates_[c];
    const int x = f.base.x() + cell_x_[i], y = f.base.y() + cell_y_[i], z = f.base.z() + cell_z_[i];
    const std::int64_t brick = cut.brick_index(x, y, z);
    if (brick < 0 || workpiece.air(static_cast<std::size_t>(brick))) continue;
    float corners[8];
    cell_corners(cut, x, y, z, corners);
    for (int k = 0; k < 8; ++k) corner_[k][i] = corners[k];
    candidates_[near++] = i;
  }

  // Pass 3: the share of each of them that the cut left. Runs of neighbours go together; the few
  // elements in between are computed and not used.
  const auto wall_per_curvature = static_cast<float>(workpiece.voxel() * workpiece.voxel() / 12);
  for (int c = 0; c < near;) {
    const int first = candidates_[c];
    int last = first;
    while (c < near && candidates_[c] - last <= kRunGap) last = candidates_[c++];
    cover(f.a, wall_per_curvature, first, last + 1);
  }

  // Pass 4: the tooth's own surface and the tissues, where there are several.
  const LevelSet& solid = workpiece.tooth().solid;
  contact_.clear();
  for (int c = 0; c < near; ++c) {
    const int i = candidates_[c];
    float covered = covered_[i];
    if (covered <= 0) continue;
    const Index3 cell = f.base + Index3(cell_x_[i], cell_y_[i], cell_z_[i]);
    const auto brick = static_cast<std::size_t>(cut.brick_index(cell.x(), cell.y(), cell.z()));
    const std::uint8_t only = workpiece.only_tissue(brick);

    PerTissue<float> share{};
    if (only != 0 && workpiece.deep(brick)) {
      share[only - 1] = covered;
      add_contact(i, share);
      continue;
    }
    // How far the sample lies ahead of the surface, in index space.
    const float* a = f.a;
    const float ox = static_cast<float>(cell_x_[i]) + fx_[i] - f.fx -
                     (a[0] * e.x[i] + a[1] * e.y[i] + a[2] * e.z[i]);
    const float oy = static_cast<float>(cell_y_[i]) + fy_[i] - f.fy -
                     (a[3] * e.x[i] + a[4] * e.y[i] + a[5] * e.z[i]);
    const float oz = static_cast<float>(cell_z_[i]) + fz_[i] - f.fz -
                     (a[6] * e.x[i] + a[7] * e.y[i] + a[8] * e.z[i]);
    if (!workpiece.deep(brick)) {
      float corners[8];
      cell_corners(solid, cell.x(), cell.y(), cell.z(), corners);
      covered *= coverage_at_skin(sample_cell(corners, fx_[i], fy_[i], fz_[i]), i, a, ox, oy, oz);
      if (covered <= 0) continue;
    }
    if (only != 0) {
      share[only - 1] = covered;
    } else {
      tissue_shares(workpiece, brick, cell, fx_[i], fy_[i], fz_[i], i, a, ox, oy, oz, share);
      for (float& k : share) k *= covered;
    }
    add_contact(i, share);
  }
}

void ContactModel::add_contact(int i, const PerTissue<float>& share) noexcept {
  const SurfaceElements& e = elements_;
  contact_.add({e.nx[i], e.ny[i], e.nz[i], mx_[i], my_[i], mz_[i], e.tx[i], e.ty[i], e.weight[i],
                chord_[i], e.radius[i], e.area[i]},
               share);
}

// Pass 1 with one velocity for all elements.
int ContactModel::locate_straight(const IndexFrame& f, const Vec3& v, double reach) noexcept {
  const SurfaceElements& e = elements_;
  const int n = static_cast<int>(e.size());
  const double speed = v.norm();
  const Eigen::Vector3f vf = v.cast<float>();
  const Eigen::Vector3f ahead =
      speed > 0 ? Eigen::Vector3f((v * (reach / speed)).cast<float>()) : Eigen::Vector3f::Zero();
  const float* a = f.a;
  const float bx = f.fx + a[0] * ahead.x() + a[1] * ahead.y() + a[2] * ahead.z();
  const float by = f.fy + a[3] * ahead.x() + a[4] * ahead.y() + a[5] * ahead.z();
  const float bz = f.fz + a[6] * ahead.x() + a[7] * ahead.y() + a[8] * ahead.z();
  const float *x = e.x.data(), *y = e.y.data(), *z = e.z.data();
  float *fx = fx_.data(), *fy = fy_.data(), *fz = fz_.data();
  std::int32_t *cx = cell_x_.data(), *cy = cell_y_.data(), *cz = cell_z_.data();
#pragma omp simd
  for (int i = 0; i < n; ++i) {
    const float ix = bx + a[0] * x[i] + a[1] * y[i] + a[2] * z[i];
    const float iy = by + a[3] * x[i] + a[4] * y[i] + a[5] * z[i];
    const float iz = bz + a[6] * x[i] + a[7] * y[i] + a[8] * z[i];
    const std::int32_t jx = cell_of(ix), jy = cell_of(iy), jz = cell_of(iz);
    cx[i] = jx, cy[i] = jy, cz[i] = jz;
    fx[i] = ix - static_cast<float>(jx);
    fy[i] = iy - static_cast<float>(jy);
    fz[i] = iz - static_cast<float>(jz);
  }
  const float threshold = -kMarginSine * static_cast<float>(speed);
  int candidates = 0;
  for (int i = 0; i < n; ++i) {
    candidates_[candidates] = i;
    candidates += e.nx[i] * vf.x() + e.ny[i] * vf.y() + e.nz[i] * vf.z() > threshold;
  }
  return candidates;
}

// Pass 1 with v(s) = v + omega x r(s).
int ContactModel::locate_turning(const IndexFrame& f, const Vec3& v, const Vec3& omega,
                                 double reach) noexcept {
  const SurfaceElements& e = elements_;
  const int n = static_cast<int>(e.size());
  const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
  const auto reach_f = static_cast<float>(reach);
  const float* a = f.a;
  int candidates = 0;
  for (int i = 0; i < n; ++i) {
    const float ux = vf.x() + of.y() * e.z[i] - of.z() * e.y[i];
    const float uy = vf.y() + of.z() * e.x[i] - of.x() * e.z[i];
    const float uz = vf.z() + of.x() * e.y[i] - of.y() * e.x[i];
    const float s = std::sqrt(ux * ux + uy * uy + uz * uz);
    const float k = s > 0 ? reach_f / s : 0;
    const float x = e.x[i] + k * ux, y = e.y[i] + k * uy, z = e.z[i] + k * uz;
    const float ix = f.fx + a[0] * x + a[1] * y + a[2] * z;
    const float iy = f.fy + a[3] * x + a[4] * y + a[5] * z;
    const float iz = f.fz + a[6] * x + a[7] * y + a[8] * z;
    cell_x_[i] = cell_of(ix), cell_y_[i] = cell_of(iy), cell_z_[i] = cell_of(iz);
    fx_[i] = ix - static_cast<float>(cell_x_[i]);
    fy_[i] = iy - static_cast<float>(cell_y_[i]);
    fz_[i] = iz - static_cast<float>(cell_z_[i]);
    candidates_[candidates] = i;
    candidates += e.nx[i] * ux + e.ny[i] * uy + e.nz[i] * uz > -kMarginSine * s;
  }
  return candidates;
}

// Pass 3: trilinear value of the cut, less the wall's interpolation error, against the element's
// extent along the field's gradient.
void ContactModel::cover(const float* a, float wall_per_curvature, int begin, int end) noexcept {
  const SurfaceElements& e = elements_;
  const float *c0 = corner_[0].data(), *c1 = corner_[1].data(), *c2 = corner_[2].data(),
              *c3 = corner_[3].data(), *c4 = corner_[4].data(), *c5 = corner_[5].data(),
              *c6 = corner_[6].data(), *c7 = corner_[7].data();
  const float *fx = fx_.data(), *fy = fy_.data(), *fz = fz_.data();
  const float *lx = e.lx.data(), *ly = e.ly.data(), *lz = e.lz.data();
  const float *tx = e.tx.data(), *ty = e.ty.data();
  const float *half_along = e.half_along.data(), *half_around = e.half_around.data();
  const float *curvature = curvature_.data(), *sag = sag_.data();
  float* covered = covered_.data();
#pragma omp simd
  for (int i = begin; i < end; ++i) {
    const FieldSample s =
        sample_cell(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], c6[i], c7[i], fx[i], fy[i], fz[i]);
    // Gradient in B (mm/mm): the columns of a are the axes of B in index space, over the voxel
    // size.
    const float gx = a[0] * s.gx + a[3] * s.gy + a[6] * s.gz;
    const float gy = a[1] * s.gx + a[4] * s.gy + a[7] * s.gz;
    const float gz = a[2] * s.gx + a[5] * s.gy + a[8] * s.gz;
    const float extent = std::abs(gx * lx[i] + gy * ly[i] + gz * lz[i]) * half_along[i] +
                         std::abs(gx * tx[i] + gy * ty[i]) * half_around[i] - sag[i];
    const float value = s.value + wall_per_curvature * curvature[i];
    const float share = 0.5f - 0.5f * value / (extent > kLeastExtent ? extent : kLeastExtent);
    const float at_least_0 = share > 0 ? share : 0;
    covered[i] = at_least_0 < 1 ? at_least_0 : 1;
  }
}

bool ContactModel::covers(const Vec3& v) const noexcept {
  const double speed = v.norm();
  return speed == 0 || v.dot(sampled_direction_) >= kMarginCosine * speed;
}

double shank_contact_area(const SurfaceElements& shank, const Workpiece& workpiece,
                          const Pose& pose) noexcept {
  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  const float* a = f.a;
  double area = 0;
  for (std::size_t i = 0; i < shank.size(); ++i) {
    // The nearest voxel will do for a report.
    const float x = f.fx + a[0] * shank.x[i] + a[1] * shank.y[i] + a[2] * shank.z[i];
    const float y = f.fy + a[3] * shank.x[i] + a[4] * shank.y[i] + a[5] * shank.z[i];
    const float z = f.fz + a[6] * shank.x[i] + a[7] * shank.y[i] + a[8] * shank.z[i];
    const Index3 v(f.base.x() + cell_of(x + 0.5f), f.base.y() + cell_of(y + 0.5f),
                   f.base.z() + cell_of(z + 0.5f));
    if (workpiece.tooth().solid.value(v.x(), v.y(), v.z()) < 0 &&
        workpiece.cut().value(v.x(), v.y(), v.z()) < 0)
      area += shank.area[i];
  }
  return area;
}

}  // namespace toothprep
