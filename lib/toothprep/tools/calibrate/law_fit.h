// Grinding laws beyond the paper's (step/grinding/grinding_law.h), fitted to the same recordings as
// u and alpha, and compared with one another.
//
// With the bur's motion imposed, contact and removal depend on no law, and with the exponents held
// the force is linear in u, u/alpha, p and mu p. So a fit goes in rounds: the force by the law and
// its derivatives by m, a and g are computed along the motion (one replay), fit.h finds u, u/alpha
// and the changes of m, a and g together with all that the sensor adds, and the law moves on, until
// nothing changes. Intervals are those of the last round's block bootstrap, of all parameters
// together.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/calibrate/fit.h"

namespace toothprep {

enum class
    LawKind {    // what of a law is fitted beside u and alpha, in each tissue that determines it
      kPaper,    // nothing
      kSize,     // m
      kRatio,    // m and a
      kRubbing,  // p and mu
      kSizeAndRubbing,  // m, p and mu
      kUpCutting        // g
    };
// All of them, the paper's first.
inline constexpr LawKind kLawKinds[] = {LawKind::kPaper,          LawKind::kSize,
                                        LawKind::kRatio,          LawKind::kRubbing,
                                        LawKind::kSizeAndRubbing, LawKind::kUpCutting};
// "paper", "size", "ratio", "rubbing", "size-rubbing", "up-cutting".
[[nodiscard]] const char* name_of(LawKind law);
// "all": every one. Throws Error for a name that is none.
[[nodiscard]] std::vector<LawKind> laws_named(const std::vector<std::string>& names);

struct LawParameter {        // of one tissue
  int tissue = 0;            // its index
  std::string name;          // "size_exponent", "ratio_exponent", "up_cutting",
                             // "rubbing_pressure_n_per_mm2", "rubbing_friction_n_per_mm2" (mu p)
  Estimate estimate;         // 1, or N/mm²
  bool identifiable = true;  // exponents and g to 0.15; p and mu p to 10 % of the force
};

// A law fitted to the recordings.
struct LawFit {
  LawKind law = LawKind::kPaper;         // which
  FitResult fit;                         // u and alpha are those at the reference chip
  std::vector<LawParameter> parameters;  // none of the paper's
  PerTissue<GrindingProperties> tissue;  // the law as fitted; what isn't measured is the start's
  int rounds = 0;                        // replays
  bool settled = true;                   // the rounds came to an end
  double criterion = 0;                  // see LawComparison
};

// Laws side by side. `criterion` is sum rho(r/sigma) over what is independent of the residuals r,
// plus twice the number of parameters, less the paper's: Akaike's with the fit's robust loss and
// the noise sigma of the law that leaves least. Independent is one residual per correlation time
// and axis. Below 0 the law explains more than its parameters cost.
struct LawComparison {
  double reference_chip = 0;               // h0, mm, that u and alpha of the laws are for
  std::vector<LawFit> laws;                // the paper's first
  std::size_t best = 0;                    // the selected one
  std::vector<std::string> like_the_best;  // names of laws that are not distinguishable from it
  std::string verdict;                     // a sentence
};

// The mean chip thickness of the motions, mm: removal rate over contact area and rotation rate.
[[nodiscard]] double mean_chip(const std::vector<ForceBasis>& bases);

// Fits each law to the recordings and compares them. `paper` is the fit by the paper's law of
// `bases` (force_basis.h), and `compare_with` makes recordings ready for other bases of the same
// motions. h0 is each tissue's reference_chip in `parameters`, or else the mean chip. Throws as
// fit() and force_bases() do.
using CompareWith = std::function<std::vector<ComparedRecording>(const std::vector<ForceBasis>&)>;
[[nodiscard]] LawComparison compare_laws(
    const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
    const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
    const CompareWith& compare_with, const FitResult& paper, const FitOptions& options,
    const std::vector<LawKind>& laws, const std::function<void(const std::string&)>& say = {});

// The comparison in lines of text.
[[nodiscard]] std::vector<std::string> describe(const LawComparison& comparison);

}  // namespace toothprep
