// The law at a chip thickness against its formulas in double precision, and the contact that uses it
// against the linear one.
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/grinding/grinding_law.h"

namespace toothprep {
namespace {

GrindingProperties tissue(double m, double a, double p = 0, double g = 0) {
  GrindingProperties t;
  t.specific_energy = 300, t.force_ratio = 0.4;
  t.size_exponent = m, t.ratio_exponent = a, t.reference_chip = 2e-4;
  t.rubbing_pressure = p, t.rubbing_friction = 0.3, t.up_cutting = g;
  return t;
}

// The force per dphi dl at the advance s, N = 1 rev/s in the factors as LawBlock has them.
struct Exact {
  double cutting, tangential, normal;
};
Exact exact(const GrindingProperties& t, double s, double rate, double arm, double along) {
  const double h = s / rate, x = std::max(h / t.reference_chip, 1e-3);
  const double u = t.specific_energy / (2 * units::kPi) * (1 + t.up_cutting * along);
  const double cut = u * std::pow(x, -t.size_exponent) * h;
  const double push = u / t.force_ratio * std::pow(x, -t.size_exponent - t.ratio_exponent) * h;
  const double rub = t.rubbing_pressure * h / (h + t.reference_chip / 100) * arm;
  return {cut, cut + t.rubbing_friction * rub, push + rub};
}

TEST(GrindingLaw, IsItsFormulaToSinglePrecision) {
  const double rate = 4000;
  LawBlock b;
  for (const auto& [m, a] : {std::pair{0.0, 0.0},
                             {0.3, 0.0},
                             {0.9, 0.0},
                             {-0.5, 0.2},
                             {0.5, -0.7},
                             {0.123456, 0.5},
                             {0.0, 0.4}})
    for (const double p : {0.0, 1.5})
      for (const double g : {0.0, -0.6}) {
        const GrindingProperties t = tissue(m, a, p, g);
        int count = 0;
        for (double s = 1e-6; count < LawBlock::kSize; s *= 1.35, ++count) {
          b.advance[count] = static_cast<float>(s);
          b.arm[count] = 0.2f + 0.01f * static_cast<float>(count);
          b.along[count] = static_cast<float>(std::cos(count));
        }
        GrindingLaw(t).evaluate(count, rate, b);
        for (int i = 0; i < count; ++i) {
          const double s = b.advance[i];
          const Exact e = exact(t, s, rate, b.arm[i], b.along[i]);
          EXPECT_NEAR(b.cutting[i] * s / rate / e.cutting, 1, 2e-5);
          EXPECT_NEAR(b.tangential[i] * s / rate / e.tangential, 1, 2e-5);
          EXPECT_NEAR(b.normal[i] * s / rate / e.normal, 1, 2e-5) << m << " " << a << " " << s;
        }
      }
}

TEST(GrindingLaw, SlopesAreTheFormulasDerivatives) {
  const double rate = 100;
  LawBlock b;
  const GrindingProperties t = tissue(0.4, -0.2, 0.8, 0.5);
  int count = 0;
  for (double s = 1e-7; count < 40; s *= 1.9, ++count)
    b.advance[count] = static_cast<float>(s), b.arm[count] = 0.5f, b.along[count] = 0.3f;
  GrindingLaw(t).evaluate(count, rate, b);
  for (int i = 0; i < count; ++i) {
    const double s = b.advance[i], d = 1e-4 * s;
    if (std::abs(s / rate / t.reference_chip - 1e-3) < 1e-3 * 0.01) continue;  // the kink
    const Exact low = exact(t, s - d, rate, 0.5, b.along[i]),
                high = exact(t, s + d, rate, 0.5, b.along[i]);
    EXPECT_NEAR(b.tangential_slope[i] / rate * 2 * d / (high.tangential - low.tangential), 1, 1e-3);
    EXPECT_NEAR(b.normal_slope[i] / rate * 2 * d / (high.normal - low.normal), 1, 1e-3) << s;
  }
}

ContactElement element(int i) {
  const auto angle = static_cast<float>(0.37 * i);
  ContactElement e{};
  e.nx = std::cos(angle) * 0.8f, e.ny = std::sin(angle) * 0.8f, e.nz = -0.6f;
  e.tx = -std::sin(angle), e.ty = std::cos(angle);
  e.mx = 0.1f * e.ny, e.my = 0.3f - e.nx, e.mz = 0.2f;
  e.weight = 0.01f, e.arm = 0.5f, e.area = 0.005f;
  return e;
}

TEST(NonlinearContact, WithThePapersLawIsTheLinearContact) {
  PerTissue<GrindingProperties> law{};
  law[0] = {300, 0.25}, law[1] = {100, 0.4};
  ContactSet linear(200, law, false);
  NonlinearContact other(200, law);
  for (int i = 0; i < 150; ++i) {
    for (const auto& [tissue, share] : {std::pair(0, 0.7f), {1, 0.3f}}) {
      if (tissue == 1 && i % 3 != 0) continue;
      linear.add(element(i), tissue, share);
      other.add(element(i), tissue, share);
    }
  }
  const Vec3 v(0.3, -0.8, 0.2), omega(0.1, 0.4, -0.3);
  const GrindingResponse a = linear.response(v, omega, 123);
  for (const LinearForm form : {LinearForm::kSecant, LinearForm::kTangent}) {
    const GrindingResponse b = other.response(v, omega, 123, form);
    EXPECT_LT((a.B - b.B).norm(), 1e-5 * a.B.norm());
    EXPECT_LT((a.f0 - b.f0).norm(), 1e-5 * a.f0.norm());
    EXPECT_LT((a.b - b.b).norm(), 1e-5 * a.b.norm());
    EXPECT_NEAR(a.t0, b.t0, 1e-5 * std::abs(a.t0));
  }
  const PerTissue<double> la = linear.advancing_area(v, omega), lb = other.advancing_area(v, omega);
  EXPECT_NEAR(la[0], lb[0], 1e-6);
  EXPECT_NEAR(la[1], lb[1], 1e-6);
}

TEST(NonlinearContact, SecantAndTangentAgreeAtTheVelocityAndTheTangentBeyondIt) {
  PerTissue<GrindingProperties> law{};
  for (GrindingProperties& t : law) t = tissue(0.4, 0.2, 0.5);
  NonlinearContact contact(100, law);
  for (int i = 0; i < 100; ++i) contact.add(element(i), i % 2, 1);
  const Vec3 v(0.3, -0.8, 0.2), omega(0.1, 0.4, -0.3);
  const GrindingResponse s = contact.response(v, omega, 50, LinearForm::kSecant);
  const GrindingResponse t = contact.response(v, omega, 50, LinearForm::kTangent);
  const Vec3 force = s.B * v + s.f0;
  EXPECT_LT((t.B * v + t.f0 - force).norm(), 1e-6 * force.norm());
  EXPECT_NEAR(t.b.dot(v) + t.t0, s.b.dot(v) + s.t0, 1e-6 * (s.b.dot(v) + s.t0));
  const Vec3 near = 1.001 * v;
  const GrindingResponse exact_near = contact.response(near, omega, 50, LinearForm::kSecant);
  const Vec3 change = exact_near.B * near + exact_near.f0 - force;
  EXPECT_LT((t.B * near + t.f0 - force - change).norm(), 0.01 * change.norm());
}

TEST(NonlinearContact, PowersOfTheRatesAreThatOfTheTorque) {
  PerTissue<GrindingProperties> law{};
  for (GrindingProperties& t : law) t = tissue(0.4, 0.2, 0.5, 0.3);
  NonlinearContact contact(100, law);
  for (int i = 0; i < 100; ++i) contact.add(element(i), i % 2, 0.8f);
  const Vec3 v(0.3, -0.8, 0.2), omega(0.1, 0.4, -0.3);
  const double rate = 50;
  const GrindingResponse r = contact.response(v, omega, rate, LinearForm::kSecant);
  const GrindingRates rates = contact.rates(v, omega, rate);
  const double torque = (r.b.dot(v) + r.t0) / rate;
  EXPECT_NEAR((rates.cut[0] + rates.cut[1] + rates.rubbed) / (2 * units::kPi * rate * torque), 1,
              1e-5);
  EXPECT_GT(rates.rubbed, 0);
  EXPECT_GT(rates.swept[0], 0);
}

}  // namespace
}  // namespace toothprep
