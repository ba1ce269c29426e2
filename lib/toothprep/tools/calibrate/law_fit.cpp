#include "toothprep/tools/calibrate/law_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/calibrate/fit_solver.h"

namespace toothprep {
namespace {

constexpr int kMostRounds = 15;
constexpr double kLeastTouch = 0.2;                 // s: less of a tissue determines no law
constexpr double kLeastSigma = 1e-4;                // of the force, N, that residuals are judged by
constexpr double kSettledShare = 0.05;              // or of the standard deviation
constexpr double kSettled = 1e-3;                   // of exponents and g
constexpr double kLargestStep = 0.2;                // of exponents and g, in a round
constexpr double kDifference = 0.01;                // of exponents and g, for derivatives
constexpr double kLowest = -0.45, kHighest = 0.85;  // exponents, so that differences stay valid
constexpr double kLargestUpCutting = 0.9;
constexpr double kWorstShapeStd = 0.15;  // of exponents and g
constexpr double kWorstRubbing = 0.1;    // of the force
constexpr double kSameCriterion = 10;    // nearer than that are as good as each other

// A parameter of the law of one tissue: which field, and whether the force is linear in it.
struct Place {
  int tissue;
  double GrindingProperties::*field;  // of the exponents and g
  bool rubs, tangential;              // p or mu p instead
  std::string name;
};

std::vector<Place> places_of(LawKind law, const FitResult& paper) {
  std::vector<Place> places;
  for (int k = 0; k < kTissueCount; ++k) {
    // Whether the tissue is determined by the paper's law doesn't matter: that may not be its law.
    if (paper.tissue[static_cast<std::size_t>(k)].touched < kLeastTouch) continue;
    const auto shape = [&](double GrindingProperties::*field, const char* name) {
      places.push_back({k, field, false, false, name});
    };
    if (law == LawKind::kSize || law == LawKind::kRatio || law == LawKind::kSizeAndRubbing)
      shape(&GrindingProperties::size_exponent, "size_exponent");
    if (law == LawKind::kRatio) shape(&GrindingProperties::ratio_exponent, "ratio_exponent");
    if (law == LawKind::kUpCutting) shape(&GrindingProperties::up_cutting, "up_cutting");
    if (law == LawKind::kRubbing || law == LawKind::kSizeAndRubbing) {
      places.push_back({k, nullptr, true, false, "rubbing_pressure_n_per_mm2"});
      places.push_back({k, nullptr, true, true, "rubbing_friction_n_per_mm2"});
    }
  }
  return places;
}

// The law as it stands with u = alpha = 1; with the place's field of its tissue moved by `change`.
UnitLaw unit_law(const PerTissue<GrindingProperties>& tissue, const Place* moved = nullptr,
                 double change = 0) {
  UnitLaw unit = tissue;
  for (GrindingProperties& t : unit) {
    t.specific_energy = t.force_ratio = 1;
    t.rubbing_pressure = 0;
  }
  if (moved) unit[static_cast<std::size_t>(moved->tissue)].*(moved->field) += change;
  return unit;
}

UnitLaw rubbing_law(const PerTissue<GrindingProperties>& tissue) {
  UnitLaw unit = tissue;
  for (GrindingProperties& t : unit) {
    t.specific_energy = 0;
    t.rubbing_pressure = t.rubbing_friction = t.force_ratio = 1;
  }
  return unit;
}

// What a fit leaves of the recordings' forces, N.
std::vector<Vec3> residuals_of(std::vector<ComparedRecording> recordings, const FitResult& fit,
                               const FitOptions& options) {
  std::vector<Vec3> left;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    if (options.estimate_lowpass) set_lowpass(recordings[r], fit.lowpass.value, false);
    const auto modelled = modelled_force(recordings[r], fit.state.own[r], fit.state);
    for (std::size_t j = 0; j < modelled.size(); ++j)
      left.push_back(recordings[r].force[j] - modelled[j]);
  }
  return left;
}

double rms_of_force(const std::vector<ComparedRecording>& recordings) {
  double square = 0, count = 0;
  for (const ComparedRecording& r : recordings)
    for (const Vec3& f : r.force) square += f.squaredNorm(), count += 3;
  return std::sqrt(square / std::max(count, 1.0));
}

// A law under way.
class LawSearch {
 public:
  LawSearch(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
            const std::vector<RecordedMotion>& motions, const CompareWith& compare_with,
            const FitResult& paper, const FitOptions& options, LawKind law, double chip)
      : bur_(bur),
        tooth_(tooth),
        parameters_(parameters),
        motions_(motions),
        compare_with_(compare_with),
        options_(options),
        places_(places_of(law, paper)) {
    result_.law = law;
    result_.tissue = parameters.tissue;
    const auto fitted = modelled_tissue(paper);
    for (std::size_t k = 0; k < kTissueCount; ++k) {
      GrindingProperties& t = result_.tissue[k];
      const double own = parameters.tissue[k].reference_chip;
      if (fitted[k].specific_energy > 0)
        t = {fitted[k].specific_energy, fitted[k].force_ratio};
      else
        t = {t.specific_energy, t.force_ratio};
      t.reference_chip = own > 0 ? own : chip;
    }
  }

  LawFit found() {
    FitOptions quick = options_;
    quick.diagnose = false;
    quick.bootstrap = 50;
    quick.several_starts = false;  // the last fit has them
    // Far from its law most of the force may look like outliers, so all of it counts at first.
    const bool searches =
        std::any_of(places_.begin(), places_.end(), [](const Place& p) { return !p.rubs; });
    for (const RobustLoss loss : {RobustLoss::kNone, options_.loss}) {
      quick.loss = loss;
      result_.settled = !searches;
      while (!result_.settled && result_.rounds < kMostRounds) {
        const FitResult fit = fitted(quick);
        result_.settled = !take_shapes(fit);
        take_tissue(fit);
      }
    }
    result_.fit = fitted(options_);
    residuals_ = residuals_of(compare_with_(bases_), result_.fit, options_);
    describe_parameters();
    return std::move(result_);
  }
  const std::vector<Vec3>& residuals() const { return residuals_; }

 private:
  FitResult fitted(const FitOptions& options) {
    ++result_.rounds;
    std::vector<UnitLaw> laws = {unit_law(result_.tissue)};
    for (const Place& p : places_)
      if (!p.rubs)
        for (const double change : {kDifference, -kDifference})
          laws.push_back(unit_law(result_.tissue, &p, change));
    laws.push_back(rubbing_law(result_.tissue));
    bases_ = force_bases(bur_, tooth_, parameters_, motions_, {}, laws);
    for (ForceBasis& basis : bases_) put_columns(basis);
    return fit(compare_with_(bases_), options);
  }

  void put_columns(ForceBasis& basis) const {
    std::size_t next = 1;
    for (const Place& p : places_) {
      const auto k = static_cast<std::size_t>(p.tissue);
      Eigen::Matrix3Xd column;
      if (p.rubs) {
        const auto& rubbing = basis.by_law.back()[k];
        if (rubbing.cols() > 0)
          column = p.tangential ? rubbing.topRows<3>() : rubbing.bottomRows<3>();
      } else {
        const auto &above = basis.by_law[next][k], &below = basis.by_law[next + 1][k];
        const GrindingProperties& t = result_.tissue[k];
        if (above.cols() > 0)
          column = (t.specific_energy * (above - below).topRows<3>() +
                    t.specific_energy / t.force_ratio * (above - below).bottomRows<3>()) /
                   (2 * kDifference);
        next += 2;
      }
      basis.shape.push_back(std::move(column));
    }
    for (std::size_t k = 0; k < kTissueCount; ++k)
      if (basis.by_law.front()[k].cols() > 0)
        basis.tissue[k].force = std::move(basis.by_law.front()[k]);
    basis.by_law.clear();
  }

  // Whether an exponent or g changed by what matters beside its uncertainty.
  bool take_shapes(const FitResult& fit) {
    bool moved = false;
    for (std::size_t j = 0; j < places_.size(); ++j) {
      const Place& p = places_[j];
      if (p.rubs) continue;
      double& value = result_.tissue[static_cast<std::size_t>(p.tissue)].*(p.field);
      const double before = value;
      value += std::clamp(fit.shapes[j].value, -kLargestStep, kLargestStep);
      if (p.field == &GrindingProperties::up_cutting)
        value = std::clamp(value, -kLargestUpCutting, kLargestUpCutting);
      moved =
          moved || std::abs(value - before) > std::max(kSettled, kSettledShare * fit.shapes[j].std);
    }
    for (GrindingProperties& t : result_.tissue) {
      t.size_exponent = std::clamp(t.size_exponent, kLowest, kHighest);
      t.ratio_exponent =
          std::clamp(t.ratio_exponent, kLowest - t.size_exponent, kHighest - t.size_exponent);
    }
    return moved;
  }

  void take_tissue(const FitResult& fit) {
    const auto now = modelled_tissue(fit);
    for (std::size_t k = 0; k < kTissueCount; ++k)
      if (now[k].specific_energy > 0) {
        result_.tissue[k].specific_energy = now[k].specific_energy;
        result_.tissue[k].force_ratio = now[k].force_ratio;
      }
  }

  // The size of a column over that of the measured force.
  double size_of(std::size_t j) const {
    double column = 0, force = 0;
    for (const ForceBasis& basis : bases_) {
      column += basis.shape[j].squaredNorm();
      for (std::size_t k = 0; k < kTissueCount; ++k)
        if (basis.touched(static_cast<int>(k))) {
          const GrindingProperties& t = result_.tissue[k];
          force += (t.specific_energy * basis.tissue[k].force.topRows<3>() +
                    t.specific_energy / t.force_ratio * basis.tissue[k].force.bottomRows<3>())
                       .squaredNorm();
        }
    }
    return force > 0 ? std::sqrt(column / force) : 0;
  }

  void describe_parameters() {
    take_tissue(result_.fit);
    for (std::size_t j = 0; j < places_.size(); ++j) {
      const Place& p = places_[j];
      GrindingProperties& t = result_.tissue[static_cast<std::size_t>(p.tissue)];
      LawParameter parameter{p.tissue, p.name, result_.fit.shapes[j], true};
      Estimate& e = parameter.estimate;
      if (p.rubs) {
        parameter.identifiable = e.std * size_of(j) < kWorstRubbing;
        if (!p.tangential) t.rubbing_pressure = std::max(0.0, e.value);
        if (p.tangential && t.rubbing_pressure > 0)
          t.rubbing_friction = std::max(0.0, e.value) / t.rubbing_pressure;
      } else {
        const double at = t.*(p.field);
        e.value += at, e.low += at, e.high += at;
        parameter.identifiable = e.std < kWorstShapeStd;
      }
      result_.parameters.push_back(std::move(parameter));
    }
  }

  const Bur& bur_;
  const LayeredTooth& tooth_;
  const Parameters& parameters_;
  const std::vector<RecordedMotion>& motions_;
  const CompareWith& compare_with_;
  const FitOptions& options_;
  std::vector<Place> places_;
  std::vector<ForceBasis> bases_;
  std::vector<Vec3> residuals_;
  LawFit result_;
};

// The share of a residual that is independent of its neighbours: spacing by correlation time.
double independent_share(const std::vector<ForceBasis>& bases, const std::vector<LawFit>& laws,
                         std::size_t residuals) {
  double correlation = laws.front().fit.correlation_time, duration = 0;
  for (const LawFit& l : laws) correlation = std::min(correlation, l.fit.correlation_time);
  for (const ForceBasis& b : bases) duration += b.step * static_cast<double>(b.size);
  const double spacing = duration / static_cast<double>(residuals);
  return std::min(1.0, spacing / std::max(correlation, 1e-9));
}

double sigma_of(const std::vector<Vec3>& residuals) {
  std::vector<double> values;
  for (const Vec3& r : residuals)
    for (int a = 0; a < 3; ++a) values.push_back(r[a]);
  return robust_scale(std::move(values));
}

// By the noise of the law that leaves least.
void set_criteria(const std::vector<ForceBasis>& bases, const std::vector<std::vector<Vec3>>& left,
                  RobustLoss loss, double force, std::vector<LawFit>& laws) {
  double sigma = sigma_of(left.front());
  for (const auto& residuals : left) sigma = std::min(sigma, sigma_of(residuals));
  sigma = std::max(sigma, kLeastSigma * force);
  const double share = independent_share(bases, laws, left.front().size());
  for (std::size_t l = 0; l < laws.size(); ++l) {
    double cost = 0;
    for (const Vec3& r : left[l])
      for (int a = 0; a < 3; ++a) cost += loss_at(loss, r[a] / sigma).rho;
    laws[l].criterion = share * cost + 2 * static_cast<double>(laws[l].parameters.size());
  }
  const double paper = laws.front().criterion;
  for (LawFit& l : laws) l.criterion -= paper;
}

std::string parameter_text(const LawParameter& p) {
  return fmt::format("{} {} = {:.3g} +- {:.2g}{}", kTissueNames[static_cast<std::size_t>(p.tissue)],
                     p.name, p.estimate.value, p.estimate.std,
                     p.identifiable ? "" : " (not identifiable)");
}

// Selected is, of the laws whose criterion is about as low as the lowest, the one with the fewest
// parameters. A law that predicts worse than the paper's, left-out parts of the recordings, is not
// selected however well it fits: the criterion takes the residuals for noise, and errors of the
// recorded motion or speed are none.
void judge(LawComparison& c) {
  const double paper = c.laws.front().fit.validation_rms;
  const auto predicts = [&](const LawFit& l) { return !(l.fit.validation_rms > paper); };
  double least = 0;
  for (const LawFit& l : c.laws)
    if (predicts(l)) least = std::min(least, l.criterion);
  const auto about_as_good = [&](const LawFit& l) {
    return predicts(l) && l.criterion < least + kSameCriterion;
  };
  for (std::size_t i = 0; i < c.laws.size(); ++i) {
    const LawFit &own = c.laws[i], &so_far = c.laws[c.best];
    if (!about_as_good(own)) continue;
    if (!about_as_good(so_far) || own.parameters.size() < so_far.parameters.size() ||
        (own.parameters.size() == so_far.parameters.size() && own.criterion < so_far.criterion))
      c.best = i;
  }
  const LawFit& best = c.laws[c.best];
  std::vector<std::string> worse;
  for (const LawFit& l : c.laws) {
    if (l.law != best.law && about_as_good(l)) c.like_the_best.emplace_back(name_of(l.law));
    if (!predicts(l) && l.criterion < least - kSameCriterion) worse.emplace_back(name_of(l.law));
  }
  c.verdict =
      best.law == LawKind::kPaper
          ? "no law explains more than the paper's"
          : fmt::format("the law {} explains most: {:.3g} N rms predicted, the paper's {:.3g}",
                        name_of(best.law), best.fit.validation_rms,
                        c.laws.front().fit.validation_rms);
  if (!c.like_the_best.empty())
    c.verdict += fmt::format("; not distinguishable from it: {}", fmt::join(c.like_the_best, ", "));
  if (!worse.empty())
    c.verdict +=
        fmt::format("; fit better but predict worse than the paper's: {}", fmt::join(worse, ", "));
  if (!best.fit.constant_suffices)
    c.verdict += "; it does not suffice: parts of the recordings are off by more than 5 %";
}

}  // namespace

const char* name_of(LawKind law) {
  switch (law) {
    case LawKind::kPaper:
      return "paper";
    case LawKind::kSize:
      return "size";
    case LawKind::kRatio:
      return "ratio";
    case LawKind::kRubbing:
      return "rubbing";
    case LawKind::kSizeAndRubbing:
      return "size-rubbing";
    case LawKind::kUpCutting:
      return "up-cutting";
  }
  return "";
}

std::vector<LawKind> laws_named(const std::vector<std::string>& names) {
  std::vector<LawKind> laws;
  for (const std::string& name : names) {
    const auto* law = std::find_if(std::begin(kLawKinds), std::end(kLawKinds),
                                   [&](LawKind k) { return name == name_of(k); });
    if (name == "all")
      laws.insert(laws.end(), std::begin(kLawKinds), std::end(kLawKinds));
    else if (law != std::end(kLawKinds))
      laws.push_back(*law);
    else
      throw Error("law is paper, size, ratio, rubbing, size-rubbing, up-cutting or all, not '" +
                  name + "'");
  }
  return laws;
}

double mean_chip(const std::vector<ForceBasis>& bases) {
  double removal = 0, area = 0;
  for (const ForceBasis& b : bases)
    for (std::size_t i = 0; i < b.size; ++i) {
      removal += static_cast<double>(b.removal[i]) / b.rotation_rate;
      area += static_cast<double>(b.area[i]);
    }
  return area > 0 ? removal / area : 0;
}

LawComparison compare_laws(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                           const std::vector<RecordedMotion>& motions,
                           const std::vector<ForceBasis>& bases, const CompareWith& compare_with,
                           const FitResult& paper, const FitOptions& options,
                           const std::vector<LawKind>& laws,
                           const std::function<void(const std::string&)>& say) {
  LawComparison c;
  c.reference_chip = mean_chip(bases);
  LawFit first;
  first.fit = paper;
  first.tissue = modelled_tissue(paper);
  c.laws.push_back(std::move(first));
  const std::vector<ComparedRecording> recordings = compare_with(bases);
  std::vector<std::vector<Vec3>> left = {residuals_of(recordings, paper, options)};
  const double force = rms_of_force(recordings);
  for (const LawKind law : laws) {
    if (law == LawKind::kPaper) continue;
    LawSearch search(bur, tooth, parameters, motions, compare_with, paper, options, law,
                     c.reference_chip);
    c.laws.push_back(search.found());
    left.push_back(search.residuals());
    if (say) say(fmt::format("law {}: {} replays", name_of(law), c.laws.back().rounds));
  }
  set_criteria(bases, left, options.loss, force, c.laws);
  judge(c);
  return c;
}

std::vector<std::string> describe(const LawComparison& c) {
  std::vector<std::string> lines;
  for (const LawFit& l : c.laws) {
    std::string line =
        fmt::format("law {:<12} residuals {:.3g} N rms, predicted {:.3g}, criterion {:+.3g}",
                    name_of(l.law), l.fit.residual_rms, l.fit.validation_rms, l.criterion);
    for (const LawParameter& p : l.parameters) line += "; " + parameter_text(p);
    if (!l.settled) line += fmt::format("; did not settle in {} replays", l.rounds);
    if (!l.fit.constant_suffices) line += "; does not suffice";
    lines.push_back(line);
  }
  lines.push_back(c.verdict);
  return lines;
}

}  // namespace toothprep
