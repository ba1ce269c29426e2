#include "toothprep/step/grinding/nonlinear_contact.h"

#include <algorithm>

#include "toothprep/step/core/units.h"

namespace toothprep {

struct NonlinearContact::Motion {
  float vx, vy, vz, ox, oy, oz;
  float ux, uy;  // direction of the feed across the axis
  double rotation_rate;
  Motion(const Vec3& v, const Vec3& omega, double rate)
      : vx(static_cast<float>(v.x())),
        vy(static_cast<float>(v.y())),
        vz(static_cast<float>(v.z())),
        ox(static_cast<float>(omega.x())),
        oy(static_cast<float>(omega.y())),
        oz(static_cast<float>(omega.z())),
        rotation_rate(rate) {
    const double speed = v.norm(), per_speed = speed > 0 ? 1 / speed : 0;
    ux = static_cast<float>(v.x() * per_speed);
    uy = static_cast<float>(v.y() * per_speed);
  }
};

// Elements side by side, with what the law says of them; those that don't advance weigh nothing.
struct NonlinearContact::Block {
  int first = 0, count = 0;
  LawBlock::Row turn;    // omega·(r x n), mm/s
  LawBlock::Row weight;  // dphi dl, mm
  std::int32_t advancing = 0;
  LawBlock law;
};

NonlinearContact::NonlinearContact(std::size_t capacity,
                                   const PerTissue<GrindingProperties>& tissue) {
  for (Entries& e : entries_)
    for (auto* array :
         {&e.nx, &e.ny, &e.nz, &e.mx, &e.my, &e.mz, &e.tx, &e.ty, &e.weight, &e.arm, &e.area})
      array->resize(capacity);
  for (const GrindingProperties& t : tissue) law_.emplace_back(t);
}

void NonlinearContact::clear() noexcept {
  for (Entries& e : entries_) e.count = 0;
}

int NonlinearContact::size() const noexcept {
  int size = 0;
  for (const Entries& e : entries_) size += e.count;
  return size;
}

void NonlinearContact::add(const ContactElement& element, int tissue, float share) noexcept {
  Entries& e = entries_[static_cast<std::size_t>(tissue)];
  const auto i = static_cast<std::size_t>(e.count++);
  e.nx[i] = element.nx, e.ny[i] = element.ny, e.nz[i] = element.nz;
  e.mx[i] = element.mx, e.my[i] = element.my, e.mz[i] = element.mz;
  e.tx[i] = element.tx, e.ty[i] = element.ty;
  e.weight[i] = share * element.weight;
  e.arm[i] = element.arm;
  e.area[i] = share * element.area;
}

// Evaluates the law for up to LawBlock::kSize elements, beginning with `first`.
void NonlinearContact::gather(const Entries& e, const GrindingLaw& law, const Motion& m, int first,
                              Block& b) const noexcept {
  b.first = first;
  b.count = std::min(e.count - first, LawBlock::kSize);
  const float *nx = &e.nx[first], *ny = &e.ny[first], *nz = &e.nz[first];
  const float *mx = &e.mx[first], *my = &e.my[first], *mz = &e.mz[first];
  const float *tx = &e.tx[first], *ty = &e.ty[first];
  const float *weight = &e.weight[first], *arm = &e.arm[first];
  std::int32_t advancing = 0;
#pragma omp simd reduction(+ : advancing)
  for (int i = 0; i < b.count; ++i) {
    const float turn = mx[i] * m.ox + my[i] * m.oy + mz[i] * m.oz;
    const float s = nx[i] * m.vx + ny[i] * m.vy + nz[i] * m.vz + turn;
    b.turn[i] = turn;
    b.weight[i] = s > 0 ? weight[i] : 0;
    b.law.advance[i] = s > 0 ? s : 0;
    b.law.arm[i] = arm[i];
    b.law.along[i] = -(tx[i] * m.ux + ty[i] * m.uy);  // the rim moves against n_t
    advancing += s > 0 ? 1 : 0;
  }
  b.advancing = advancing;
  law.evaluate(b.count, m.rotation_rate, b.law);
}

// What one block adds to the response.
GrindingResponse NonlinearContact::response_of(const Entries& e, const Block& b,
                                               LinearForm how) const noexcept {
  const auto first = static_cast<std::size_t>(b.first);
  const float *nx = &e.nx[first], *ny = &e.ny[first], *nz = &e.nz[first];
  const float *tx = &e.tx[first], *ty = &e.ty[first], *arm = &e.arm[first];
  const bool slopes = how == LinearForm::kTangent;
  const float* along_t = slopes ? b.law.tangential_slope : b.law.tangential;
  const float* against_n = slopes ? b.law.normal_slope : b.law.normal;
  float b00 = 0, b01 = 0, b02 = 0, b10 = 0, b11 = 0, b12 = 0, b20 = 0, b21 = 0, b22 = 0;
  float t0 = 0, t1 = 0, t2 = 0, f0 = 0, f1 = 0, f2 = 0, torque = 0;
#pragma omp simd reduction(+ : b00, b01, b02, b10, b11, b12, b20, b21, b22, t0, t1, t2, f0, f1, f2, torque)
  for (int i = 0; i < b.count; ++i) {
    const float w = b.weight[i], s = b.law.advance[i];
    const float t = w * along_t[i], n = w * against_n[i], p = t * arm[i];
    const float x = t * tx[i] - n * nx[i], y = t * ty[i] - n * ny[i], z = -n * nz[i];
    // The force at s, less what the slope makes of the part of s that is the feed's.
    const float ft = w * s * b.law.tangential[i], fn = w * s * b.law.normal[i];
    const float feed = s - b.turn[i];
    b00 += x * nx[i], b01 += x * ny[i], b02 += x * nz[i];
    b10 += y * nx[i], b11 += y * ny[i], b12 += y * nz[i];
    b20 += z * nx[i], b21 += z * ny[i], b22 += z * nz[i];
    t0 += p * nx[i], t1 += p * ny[i], t2 += p * nz[i];
    f0 += ft * tx[i] - fn * nx[i] - feed * x;
    f1 += ft * ty[i] - fn * ny[i] - feed * y;
    f2 += -fn * nz[i] - feed * z;
    torque += ft * arm[i] - feed * p;
  }
  GrindingResponse r;
  r.B << b00, b01, b02, b10, b11, b12, b20, b21, b22;
  r.b = Vec3(t0, t1, t2);
  r.f0 = Vec3(f0, f1, f2);
  r.t0 = torque;
  return r;
}

GrindingResponse NonlinearContact::response(const Vec3& v, const Vec3& omega, double rotation_rate,
                                            LinearForm how) const noexcept {
  const Motion motion(v, omega, rotation_rate);
  GrindingResponse sum;
  Block b;
  for (std::size_t k = 0; k < entries_.size(); ++k) {
    const Entries& e = entries_[k];
    for (int first = 0; first < e.count; first += LawBlock::kSize) {
      gather(e, law_[k], motion, first, b);
      const GrindingResponse r = response_of(e, b, how);
      sum.B += r.B, sum.f0 += r.f0, sum.b += r.b, sum.t0 += r.t0;
      sum.set.count += b.advancing;
    }
  }
  return sum;
}

PerTissue<TissueBasis> NonlinearContact::basis(const std::vector<GrindingLaw>& law, const Vec3& v,
                                               const Vec3& omega,
                                               double rotation_rate) const noexcept {
  const Motion motion(v, omega, rotation_rate);
  PerTissue<TissueBasis> sum{};
  Block b;
  for (std::size_t k = 0; k < entries_.size(); ++k) {
    const Entries& e = entries_[k];
    for (int first = 0; first < e.count; first += LawBlock::kSize) {
      gather(e, law[k], motion, first, b);
      for (int j = 0; j < b.count; ++j) {
        const auto i = static_cast<std::size_t>(first + j);
        const double ws = double{b.weight[j]} * b.law.advance[j];
        sum[k].tangential += ws * b.law.tangential[j] * Vec3(e.tx[i], e.ty[i], 0);
        sum[k].normal -= ws * b.law.normal[j] * Vec3(e.nx[i], e.ny[i], e.nz[i]);
        sum[k].torque += ws * b.law.tangential[j] * e.arm[i];
      }
    }
  }
  return sum;
}

GrindingRates NonlinearContact::rates(const Vec3& v, const Vec3& omega,
                                      double rotation_rate) const noexcept {
  const Motion motion(v, omega, rotation_rate);
  GrindingRates rates;
  Block b;
  for (std::size_t k = 0; k < entries_.size(); ++k) {
    const Entries& e = entries_[k];
    for (int first = 0; first < e.count; first += LawBlock::kSize) {
      gather(e, law_[k], motion, first, b);
      for (int i = 0; i < b.count; ++i) {
        const double swept = double{b.weight[i]} * b.law.arm[i] * b.law.advance[i];
        rates.swept[k] += swept;
        rates.cut[k] += 2 * units::kPi * swept * b.law.cutting[i];
        rates.rubbed += 2 * units::kPi * swept * (b.law.tangential[i] - b.law.cutting[i]);
      }
    }
  }
  return rates;
}

PerTissue<double> NonlinearContact::advancing_area(const Vec3& v,
                                                   const Vec3& omega) const noexcept {
  const Motion m(v, omega, 1);
  PerTissue<double> area{};
  for (std::size_t k = 0; k < entries_.size(); ++k) {
    const Entries& e = entries_[k];
    for (std::size_t i = 0; i < static_cast<std::size_t>(e.count); ++i) {
      const float turn = e.mx[i] * m.ox + e.my[i] * m.oy + e.mz[i] * m.oz;
      const float s = e.nx[i] * m.vx + e.ny[i] * m.vy + e.nz[i] * m.vz + turn;
      area[k] += s > 0 ? e.area[i] : 0;
    }
  }
  return area;
}

}  // namespace toothprep
