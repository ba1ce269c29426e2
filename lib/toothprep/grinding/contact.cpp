#include "toothprep/grinding/contact.h"

#include <algorithm>
#include <cmath>

#include "toothprep/core/units.h"

namespace toothprep {
namespace {

// Elements whose normal is up to this far behind the motion (sine of the angle) are sampled as
// well, so that the trial velocity may turn by as much without a new sample.
constexpr float kMarginSine = 0.35f;
constexpr double kMarginCosine = 0.94;  // a little inside sqrt(1 - 0.35²)

int floor_to_int(float x) {
  const int i = static_cast<int>(x);
  return i - (x < static_cast<float>(i));
}

// The tip's place in index space, split so that single precision suffices beside it.
struct IndexFrame {
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

}  // namespace

ContactModel::ContactModel(const Bur& bur, double element_size, bool clockwise,
                           const PerTissue<GrindingProperties>& tissue)
    : elements_(bur.elements(element_size, clockwise)) {
  const std::size_t n = elements_.size();
  for (int k = 0; k < kTissueCount; ++k) {
    const double ct = tissue[k].specific_energy / (2 * units::kPi);
    ct_[k] = static_cast<float>(ct);
    cn_[k] = static_cast<float>(ct / tissue[k].force_ratio);
  }
  for (auto* array : {&mx_, &my_, &mz_, &lx_, &ly_, &lz_, &nx_, &ny_, &nz_, &cmx_, &cmy_, &cmz_,
                      &qx_, &qy_, &qz_, &p_})
    array->resize(n);
  for (auto& array : area_) array.resize(n);
  candidates_.resize(n);
  const SurfaceElements& e = elements_;
  for (std::size_t i = 0; i < n; ++i) {
    mx_[i] = e.y[i] * e.nz[i] - e.z[i] * e.ny[i];
    my_[i] = e.z[i] * e.nx[i] - e.x[i] * e.nz[i];
    mz_[i] = e.x[i] * e.ny[i] - e.y[i] * e.nx[i];
  }
}

void ContactModel::sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v,
                          const Vec3& omega, double reach) noexcept {
  const SurfaceElements& e = elements_;
  const int n = static_cast<int>(e.size());
  const IndexFrame f(workpiece.lattice(), pose);
  const auto vx = static_cast<float>(v.x()), vy = static_cast<float>(v.y()),
             vz = static_cast<float>(v.z());
  const auto ox = static_cast<float>(omega.x()), oy = static_cast<float>(omega.y()),
             oz = static_cast<float>(omega.z());
  const bool turning = omega.squaredNorm() > 0;
  const auto reach_f = static_cast<float>(reach);
  const double speed = v.norm();
  sampled_direction_ = speed > 0 ? Vec3(v / speed) : Vec3(Vec3::Zero());

  // Pass 1: index coordinates of every element's sample, and which elements are worth a look-up.
  const float advance_x = speed > 0 ? reach_f * static_cast<float>(v.x() / speed) : 0;
  const float advance_y = speed > 0 ? reach_f * static_cast<float>(v.y() / speed) : 0;
  const float advance_z = speed > 0 ? reach_f * static_cast<float>(v.z() / speed) : 0;
  const float* a = f.a;
  int candidates = 0;
  if (!turning) {
    const float threshold = -kMarginSine * static_cast<float>(speed);
#pragma omp simd
    for (int i = 0; i < n; ++i) {
      const float x = e.x[i] + advance_x, y = e.y[i] + advance_y, z = e.z[i] + advance_z;
      lx_[i] = f.fx + a[0] * x + a[1] * y + a[2] * z;
      ly_[i] = f.fy + a[3] * x + a[4] * y + a[5] * z;
      lz_[i] = f.fz + a[6] * x + a[7] * y + a[8] * z;
    }
    for (int i = 0; i < n; ++i) {
      candidates_[candidates] = i;
      candidates += (e.nx[i] * vx + e.ny[i] * vy + e.nz[i] * vz) > threshold;
    }
  } else {
    for (int i = 0; i < n; ++i) {
      const float ux = vx + oy * e.z[i] - oz * e.y[i];
      const float uy = vy + oz * e.x[i] - ox * e.z[i];
      const float uz = vz + ox * e.y[i] - oy * e.x[i];
      const float s = std::sqrt(ux * ux + uy * uy + uz * uz);
      const float k = s > 0 ? reach_f / s : 0;
      const float x = e.x[i] + k * ux, y = e.y[i] + k * uy, z = e.z[i] + k * uz;
      lx_[i] = f.fx + a[0] * x + a[1] * y + a[2] * z;
      ly_[i] = f.fy + a[3] * x + a[4] * y + a[5] * z;
      lz_[i] = f.fz + a[6] * x + a[7] * y + a[8] * z;
      candidates_[candidates] = i;
      candidates += (e.nx[i] * ux + e.ny[i] * uy + e.nz[i] * uz) > -kMarginSine * s;
    }
  }

  // Pass 2: look-ups. The field's values are mm, its gradient mm per voxel.
  const LevelSet& solid = workpiece.solid();
  const LabelGrid& labels = workpiece.labels();
  count_ = 0;
  for (int c = 0; c < candidates; ++c) {
    const int i = candidates_[c];
    const int cx = floor_to_int(lx_[i]), cy = floor_to_int(ly_[i]), cz = floor_to_int(lz_[i]);
    const float fx = lx_[i] - static_cast<float>(cx), fy = ly_[i] - static_cast<float>(cy),
                fz = lz_[i] - static_cast<float>(cz);
    const int x = f.base.x() + cx, y = f.base.y() + cy, z = f.base.z() + cz;
    const FieldSample s = sample_cell(solid, x, y, z, fx, fy, fz);
    const float half = e.half_along[i] + e.half_around[i];
    if (s.value >= half) continue;
    float coverage = 1;
    if (s.value > -half) {
      // Gradient in B (mm/mm): the columns of a are the axes of B in index space, over the voxel
      // size.
      const float gx = a[0] * s.gx + a[3] * s.gy + a[6] * s.gz;
      const float gy = a[1] * s.gx + a[4] * s.gy + a[7] * s.gz;
      const float gz = a[2] * s.gx + a[5] * s.gy + a[8] * s.gz;
      const float extent = std::abs(gx * e.lx[i] + gy * e.ly[i] + gz * e.lz[i]) * e.half_along[i] +
                           std::abs(gx * e.tx[i] + gy * e.ty[i]) * e.half_around[i];
      if (s.value >= extent) continue;
      if (s.value > -extent) coverage = 0.5f - 0.5f * s.value / extent;
    }

    // Shares of the tissues: one label for most elements, a trilinear blend at borders.
    PerTissue<float> share{};
    const std::int64_t b = labels.brick_index(x, y, z);
    const bool one_brick = (x & 7) < 7 && (y & 7) < 7 && (z & 7) < 7;
    if (b >= 0 && one_brick && labels.is_uniform(static_cast<std::size_t>(b))) {
      const std::uint8_t label = labels.uniform_value(static_cast<std::size_t>(b));
      if (label == 0) continue;
      share[label - 1] = coverage;
    } else {
      float total = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const int ix = corner >> 2, iy = (corner >> 1) & 1, iz = corner & 1;
        const std::uint8_t label = labels.value(x + ix, y + iy, z + iz);
        if (label == 0) continue;
        const float w = (ix ? fx : 1 - fx) * (iy ? fy : 1 - fy) * (iz ? fz : 1 - fz);
        share[label - 1] += w;
        total += w;
      }
      if (total <= 0) continue;
      for (float& w : share) w *= coverage / total;
    }

    float t = 0, nn = 0;
    for (int k = 0; k < kTissueCount; ++k) {
      t += share[k] * ct_[k];
      nn += share[k] * cn_[k];
      area_[k][count_] = share[k] * e.area[i];
    }
    t *= e.weight[i];
    nn *= e.weight[i];
    nx_[count_] = e.nx[i];
    ny_[count_] = e.ny[i];
    nz_[count_] = e.nz[i];
    cmx_[count_] = mx_[i];
    cmy_[count_] = my_[i];
    cmz_[count_] = mz_[i];
    qx_[count_] = t * e.tx[i] - nn * e.nx[i];
    qy_[count_] = t * e.ty[i] - nn * e.ny[i];
    qz_[count_] = -nn * e.nz[i];
    p_[count_] = t * e.radius[i];
    ++count_;
  }
}

bool ContactModel::covers(const Vec3& v) const noexcept {
  const double speed = v.norm();
  return speed == 0 || v.dot(sampled_direction_) >= kMarginCosine * speed;
}

GrindingResponse ContactModel::response(const Vec3& v, const Vec3& omega) const noexcept {
  const auto vx = static_cast<float>(v.x()), vy = static_cast<float>(v.y()),
             vz = static_cast<float>(v.z());
  const auto ox = static_cast<float>(omega.x()), oy = static_cast<float>(omega.y()),
             oz = static_cast<float>(omega.z());
  float b00 = 0, b01 = 0, b02 = 0, b10 = 0, b11 = 0, b12 = 0, b20 = 0, b21 = 0, b22 = 0;
  float t0 = 0, t1 = 0, t2 = 0;
  std::int32_t advancing = 0, places = 0;
  const int n = count_;
  const float *nx = nx_.data(), *ny = ny_.data(), *nz = nz_.data();
  const float *mx = cmx_.data(), *my = cmy_.data(), *mz = cmz_.data();
  const float *qx = qx_.data(), *qy = qy_.data(), *qz = qz_.data(), *p = p_.data();
#pragma omp simd reduction(+ : b00, b01, b02, b10, b11, b12, b20, b21, b22, t0, t1, t2, advancing, \
                               places)
  for (int i = 0; i < n; ++i) {
    const float s = nx[i] * vx + ny[i] * vy + nz[i] * vz + mx[i] * ox + my[i] * oy + mz[i] * oz;
    const bool advances = s > 0;
    const float x = advances ? qx[i] : 0, y = advances ? qy[i] : 0, z = advances ? qz[i] : 0;
    const float torque = advances ? p[i] : 0;
    b00 += x * nx[i], b01 += x * ny[i], b02 += x * nz[i];
    b10 += y * nx[i], b11 += y * ny[i], b12 += y * nz[i];
    b20 += z * nx[i], b21 += z * ny[i], b22 += z * nz[i];
    t0 += torque * nx[i], t1 += torque * ny[i], t2 += torque * nz[i];
    advancing += advances ? 1 : 0;
    places += advances ? i : 0;
  }
  GrindingResponse r;
  r.B << b00, b01, b02, b10, b11, b12, b20, b21, b22;
  r.b = Vec3(t0, t1, t2);
  r.advancing = advancing;
  r.signature = places;
  if (omega.squaredNorm() > 0) {
    float f0 = 0, f1 = 0, f2 = 0, torque0 = 0;
#pragma omp simd reduction(+ : f0, f1, f2, torque0)
    for (int i = 0; i < n; ++i) {
      const float turn = mx[i] * ox + my[i] * oy + mz[i] * oz;
      const float s = nx[i] * vx + ny[i] * vy + nz[i] * vz + turn;
      const float w = s > 0 ? turn : 0;
      f0 += w * qx[i], f1 += w * qy[i], f2 += w * qz[i];
      torque0 += w * p[i];
    }
    r.f0 = Vec3(f0, f1, f2);
    r.t0 = torque0;
  }
  return r;
}

PerTissue<double> ContactModel::advancing_area(const Vec3& v, const Vec3& omega) const noexcept {
  const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
  PerTissue<float> sum{};
  for (int i = 0; i < count_; ++i) {
    const float s = nx_[i] * vf.x() + ny_[i] * vf.y() + nz_[i] * vf.z() + cmx_[i] * of.x() +
                    cmy_[i] * of.y() + cmz_[i] * of.z();
    for (int k = 0; k < kTissueCount; ++k) sum[k] += s > 0 ? area_[k][i] : 0;
  }
  PerTissue<double> area{};
  for (int k = 0; k < kTissueCount; ++k) area[k] = sum[k];
  return area;
}

bool ContactModel::any_advances(const Vec3& v, const Vec3& omega) const noexcept {
  return response(v, omega).advancing > 0;
}

double shank_contact_area(const SurfaceElements& shank, const Workpiece& workpiece,
                          const Pose& pose) noexcept {
  const IndexFrame f(workpiece.lattice(), pose);
  const float* a = f.a;
  double area = 0;
  for (std::size_t i = 0; i < shank.size(); ++i) {
    const float x = f.fx + a[0] * shank.x[i] + a[1] * shank.y[i] + a[2] * shank.z[i];
    const float y = f.fy + a[3] * shank.x[i] + a[4] * shank.y[i] + a[5] * shank.z[i];
    const float z = f.fz + a[6] * shank.x[i] + a[7] * shank.y[i] + a[8] * shank.z[i];
    const int cx = floor_to_int(x), cy = floor_to_int(y), cz = floor_to_int(z);
    const FieldSample s = sample_cell(workpiece.solid(), f.base.x() + cx, f.base.y() + cy,
                                      f.base.z() + cz, x - static_cast<float>(cx),
                                      y - static_cast<float>(cy), z - static_cast<float>(cz));
    if (s.value < 0) area += shank.area[i];
  }
  return area;
}

}  // namespace toothprep
