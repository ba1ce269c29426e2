// The grinding law beyond the paper's: what an element's force is at a chip thickness.
//
// The paper's law (contact_set.h) is linear in the advance s = v·n: one energy u for every chip. In
// measurements u falls as chips become thicker (the size effect), a bur that is pressed too little
// rubs without cutting, and cutting with the feed takes less than cutting against it. With the chip
// thickness of one turn, h = s / N, an element of rim radius r and area ds = r dphi dl has
//
//   dF_t = [ u(h) (1 + g c) h / (2 pi r)  +  mu p phi(h) ] ds          N
//   dF_n = [ u(h) (1 + g c) h / (2 pi r) / alpha(h)  +  p phi(h) ] ds  N
//
//   u(h) = u0 (h/h0)^-m      alpha(h) = alpha0 (h/h0)^a      phi(h) = h / (h + h0/100)
//
// and a torque r dF_t. Cutting takes the power u(h) (1 + g c) s ds, rubbing 2 pi N r mu p phi ds.
//
//   symbol  GrindingProperties          unit
//   u0      specific_energy             N/mm²    at h0
//   alpha0  force_ratio                 1        at h0
//   h0      reference_chip              mm       per turn of the bur, whatever its teeth
//   m, a    size_exponent, ratio_exponent  1     1 - m > 0, so that more advance takes more force
//   p, mu   rubbing_pressure, _friction N/mm², 1 of the surface that advances into tissue
//   g       up_cutting                  1        c: cosine between the rim's motion and the feed; 1
//                                                where the rim goes with the feed (up-cutting)
//
// Chips thinner than h0/1000 have the u and alpha of that thickness, so that the force has a finite
// slope at rest. phi is 1 but for the thinnest chips: a bur pressed with less than p times its area
// creeps with chips of less than h0/100 instead of standing still. With m = a = p = g = 0 this is
// the paper's law.
//
// Sources: u = u0 (h/h0)^-m is the size effect of cutting (Kienzle's law with exponent 1 - m);
// cutting force plus edge force is Albrecht's (1960) and Altintas's (Manufacturing Automation,
// chapter 2).
#pragma once

#include <array>

#include "toothprep/step/core/parameters.h"

namespace toothprep {

// Elements side by side: what the law is asked for and what it answers. Places that aren't filled
// may hold anything.
struct LawBlock {
  static constexpr int kSize = 64;
  using Row = float[kSize];
  // Asked.
  Row advance;  // s, mm/s, > 0
  Row arm;      // r, mm
  Row along;    // c, -1 .. 1
  // Answered: the force along n_t and against n_n per advance and per dphi dl = ds / r, for
  // N = 1 rev/s (divide by N), in N/mm² as u / (2 pi) is in the paper's law.
  Row cutting;                         // of the tangential one, what cuts
  Row tangential, normal;              // force over advance
  Row tangential_slope, normal_slope;  // derivative of the force by the advance
};

class GrindingLaw {  // of one tissue
 public:
  explicit GrindingLaw(const GrindingProperties& tissue);
  // The law for the first `count` places at the rotation rate N, rev/s, > 0. The same bits on every
  // processor: powers are products of square roots and a short series.
  void evaluate(int count, double rotation_rate, LawBlock& block) const noexcept;

 private:
  // x^-e for exponents e of either sign, to single precision for x up to 1e6 times the smallest.
  class Power {
   public:
    explicit Power(double e);
    unsigned roots() const { return roots_; }
    float rest(float root_less_1) const noexcept;  // (1 + root_less_1)^f
    bool inverts() const { return inverts_; }

   private:
    unsigned roots_;                 // |e| in units of 1/64: which square roots are factors
    std::array<float, 7> binomial_;  // of the rest f of 64 |e|
    bool inverts_;
  };
  void powers(int count, float per_chip, const LawBlock& block, LawBlock::Row& size,
              LawBlock::Row& normal) const noexcept;

  Power size_, normal_;                    // of m and m + a
  float u_, u_over_alpha_;                 // over 2 pi
  float size_exponent_, normal_exponent_;  // m, m + a
  float chip_;                             // h0, mm; 1 where nothing refers to it
  float pressure_, friction_pressure_;     // p, mu p
  float up_cutting_;
};

}  // namespace toothprep
