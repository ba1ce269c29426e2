#include "toothprep/step/grinding/grinding_law.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr float kThinnest = 1e-3f;  // of h0: from there u doesn't grow
constexpr unsigned kRoots = 64;
constexpr float kPressedAt = 1e-2f;  // of h0: there half of the rubbing pressure is reached

}  // namespace

GrindingLaw::Power::Power(double e) : inverts_(e > 0) {
  const double in_64ths = kRoots * std::abs(e), whole = std::floor(in_64ths);
  roots_ = static_cast<unsigned>(whole);
  double coefficient = 1;
  for (std::size_t i = 0; i < binomial_.size(); ++i) {
    binomial_[i] = static_cast<float>(coefficient);
    const auto order = static_cast<double>(i);
    coefficient *= (in_64ths - whole - order) / (order + 1);
  }
}

float GrindingLaw::Power::rest(float root_less_1) const noexcept {
  float sum = binomial_.back();
  for (std::size_t i = binomial_.size() - 1; i-- > 0;) sum = sum * root_less_1 + binomial_[i];
  return sum;
}

GrindingLaw::GrindingLaw(const GrindingProperties& t)
    : size_(t.size_exponent), normal_(t.size_exponent + t.ratio_exponent) {
  const double u = t.specific_energy / (2 * units::kPi);
  u_ = static_cast<float>(u);
  u_over_alpha_ = static_cast<float>(u / t.force_ratio);
  size_exponent_ = static_cast<float>(t.size_exponent);
  normal_exponent_ = static_cast<float>(t.size_exponent + t.ratio_exponent);
  chip_ = t.reference_chip > 0 ? static_cast<float>(t.reference_chip) : 1;
  pressure_ = static_cast<float>(t.rubbing_pressure);
  friction_pressure_ = static_cast<float>(t.rubbing_friction * t.rubbing_pressure);
  up_cutting_ = static_cast<float>(t.up_cutting);
}

// (h/h0)^-m and (h/h0)^-(m + a): square roots down to the 64th one, and of what is left of the
// exponent the binomial series around 1, near which that root is.
void GrindingLaw::powers(int count, float per_chip, const LawBlock& block, LawBlock::Row& size,
                         LawBlock::Row& normal) const noexcept {
  LawBlock::Row root;
  for (int i = 0; i < count; ++i) {
    root[i] = std::max(block.advance[i] * per_chip, kThinnest);
    size[i] = normal[i] = 1;
  }
  for (unsigned part = kRoots / 2; part > 0; part /= 2) {
    for (int i = 0; i < count; ++i) root[i] = std::sqrt(root[i]);
    if (size_.roots() & part)
      for (int i = 0; i < count; ++i) size[i] *= root[i];
    if (normal_.roots() & part)
      for (int i = 0; i < count; ++i) normal[i] *= root[i];
  }
  for (int i = 0; i < count; ++i) {
    size[i] *= size_.rest(root[i] - 1);
    normal[i] *= normal_.rest(root[i] - 1);
  }
  if (size_.inverts())
    for (int i = 0; i < count; ++i) size[i] = 1 / size[i];
  if (normal_.inverts())
    for (int i = 0; i < count; ++i) normal[i] = 1 / normal[i];
}

void GrindingLaw::evaluate(int count, double rotation_rate, LawBlock& b) const noexcept {
  const auto rate = static_cast<float>(rotation_rate);
  const float per_chip = 1 / (rate * chip_), soft = kPressedAt * chip_;
  LawBlock::Row size, normal;
  powers(count, per_chip, b, size, normal);
  for (int i = 0; i < count; ++i) {
    const float chip = b.advance[i] / rate;
    const float direction = 1 + up_cutting_ * b.along[i];
    const float cut = u_ * size[i] * direction, push = u_over_alpha_ * normal[i] * direction;
    const float thick = b.advance[i] * per_chip > kThinnest ? 1 : 0;
    const float rub = b.arm[i] / (chip + soft), rub_slope = rub * soft / (chip + soft);
    b.cutting[i] = cut;
    b.tangential[i] = cut + friction_pressure_ * rub;
    b.normal[i] = push + pressure_ * rub;
    b.tangential_slope[i] = cut * (1 - thick * size_exponent_) + friction_pressure_ * rub_slope;
    b.normal_slope[i] = push * (1 - thick * normal_exponent_) + pressure_ * rub_slope;
  }
}

}  // namespace toothprep
