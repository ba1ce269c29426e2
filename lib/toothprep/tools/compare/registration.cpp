#include "toothprep/tools/compare/registration.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

constexpr int kCoarseSamples = 4000;  // of the fixed surface
constexpr double kLeastScale = 0.02;  // mm, of Tukey's weights
constexpr double kTukey = 4.685;
constexpr double kLeastNormalProduct = 0.5;            // cos 60 degrees
constexpr double kStepTurn = 1e-6, kStepShift = 1e-5;  // rad, mm: converged

struct SurfaceSample {
  Vec3 point, normal;
};

// Area, centroid and second moments of area about it, exact for triangles.
struct Moments {
  double area = 0;
  Vec3 centroid = Vec3::Zero();
  Mat3 second = Mat3::Zero();  // of the unit area, mm²
};

Moments moments_of(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) throw Error("registration: a surface without triangles");
  const Vec3 about = mesh.vertices[mesh.triangles[0][0]].cast<double>();
  Moments m;
  Vec3 first = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[0]].cast<double>() - about,
               b = mesh.vertices[t[1]].cast<double>() - about,
               c = mesh.vertices[t[2]].cast<double>() - about;
    const double area = 0.5 * (b - a).cross(c - a).norm();
    const Vec3 sum = a + b + c;
    m.area += area;
    first += area / 3 * sum;
    second += area / 12 *
              (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose());
  }
  if (!(m.area > 0)) throw Error("registration: a surface without area");
  first /= m.area;
  m.centroid = about + first;
  m.second = second / m.area - first * first.transpose();
  return m;
}

// Points evenly spread over the area: equal steps along the running area of the triangles, places
// within a triangle by the R2 sequence (Roberts 2018).
std::vector<SurfaceSample> samples_of(const TriangleMesh& mesh, double area, int count) {
  std::vector<SurfaceSample> samples;
  samples.reserve(static_cast<std::size_t>(count));
  double running = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[0]].cast<double>(), ab = mesh.vertices[t[1]].cast<double>() - a,
               ac = mesh.vertices[t[2]].cast<double>() - a;
    const Vec3 normal = ab.cross(ac);
    running += 0.5 * normal.norm() / area * count;
    while (static_cast<double>(samples.size()) + 0.5 < running &&
           samples.size() < static_cast<std::size_t>(count)) {
      const auto n = static_cast<double>(samples.size() + 1);
      double u = std::fmod(n * 0.7548776662466927, 1.0), v = std::fmod(n * 0.5698402909980532, 1.0);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      samples.push_back({a + u * ab + v * ac, normal.normalized()});
    }
  }
  return samples;
}

Pose composed(const Pose& outer, const Pose& inner) {
  return {outer.to_world(inner.position), (outer.orientation * inner.orientation).normalized()};
}

// The nearest place of the fixed surface.
struct Foot {
  Vec3 point = Vec3::Zero(), normal = Vec3::UnitZ();
};
using FindFoot = std::function<Foot(const Vec3&)>;

// Nearest of a few thousand samples of a surface, by a balanced k-d tree in one array: as good as
// the surface while poses are wrong by more than the samples' spacing, and many times as fast for
// points far from it.
class SampleTree {
 public:
  explicit SampleTree(std::vector<SurfaceSample> samples) : samples_(std::move(samples)) {
    axis_.resize(samples_.size());
    build(0, samples_.size());
  }
  Foot nearest(const Vec3& x) const {
    std::size_t best = 0;
    double square = std::numeric_limits<double>::infinity();
    search(x, 0, samples_.size(), best, square);
    return {samples_[best].point, samples_[best].normal};
  }

 private:
  void build(std::size_t begin, std::size_t end) {
    if (end - begin < 2) return;
    Vec3 low = samples_[begin].point, high = low;
    for (std::size_t i = begin; i < end; ++i) {
      low = low.cwiseMin(samples_[i].point);
      high = high.cwiseMax(samples_[i].point);
    }
    int axis = 0;
    (high - low).maxCoeff(&axis);
    const std::size_t middle = (begin + end) / 2;
    const auto at = [&](std::size_t i) {
      return samples_.begin() + static_cast<std::ptrdiff_t>(i);
    };
    std::nth_element(at(begin), at(middle), at(end),
                     [axis](const SurfaceSample& a, const SurfaceSample& b) {
                       return a.point[axis] < b.point[axis];
                     });
    axis_[middle] = static_cast<std::uint8_t>(axis);
    build(begin, middle);
    build(middle + 1, end);
  }
  void search(const Vec3& x, std::size_t begin, std::size_t end, std::size_t& best,
              double& square) const {
    if (begin >= end) return;
    const std::size_t middle = (begin + end) / 2;
    const double here = (samples_[middle].point - x).squaredNorm();
    if (here < square) {
      square = here;
      best = middle;
    }
    if (end - begin == 1) return;
    const double beyond = x[axis_[middle]] - samples_[middle].point[axis_[middle]];
    const bool lower = beyond < 0;
    search(x, lower ? begin : middle + 1, lower ? middle : end, best, square);
    if (beyond * beyond < square)
      search(x, lower ? middle + 1 : begin, lower ? end : middle, best, square);
  }

  std::vector<SurfaceSample> samples_;
  std::vector<std::uint8_t> axis_;  // of the node in the middle of each range
};

struct Match {
  Vec3 offset = Vec3::Zero();  // from the nearest point to the moved one
  Vec3 at = Vec3::Zero();      // the moved point
  Vec3 normal = Vec3::Zero();  // of the fixed surface
  double distance = 0;
  bool same_side = false;  // the normals agree
};

class Fit {
 public:
  explicit Fit(FindFoot find_foot) : find_foot_(std::move(find_foot)) {}

  std::vector<Match> matches(const std::vector<SurfaceSample>& samples, const Pose& pose) const {
    std::vector<Match> all(samples.size());
    tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
      Match& m = all[i];
      m.at = pose.to_world(samples[i].point);
      const Foot foot = find_foot_(m.at);
      m.normal = foot.normal;
      m.offset = m.at - foot.point;
      m.distance = m.offset.norm();
      m.same_side = m.normal.dot(pose.orientation * samples[i].normal) > kLeastNormalProduct;
    });
    return all;
  }

  struct Step {
    Pose motion;
    double turn = 0, shift = 0;
    double stiffness_ratio = 0;  // weakest to strongest direction of the normal equations
  };

  static double weight(const Match& m, double scale) {
    if (!m.same_side || m.distance >= scale) return 0;
    const double q = 1 - m.distance * m.distance / (scale * scale);
    return q * q;
  }

  // One Gauss-Newton step about the weighted middle of the points; rotations are scaled by their
  // radius of gyration so that all six unknowns are lengths.
  static Step step(const std::vector<Match>& matches, double scale) {
    Vec3 middle = Vec3::Zero();
    double weights = 0, gyration = 0;
    for (const Match& m : matches) {
      const double w = weight(m, scale);
      weights += w;
      middle += w * m.at;
    }
    Step result;
    if (!(weights > 0)) return result;
    middle /= weights;
    for (const Match& m : matches) gyration += weight(m, scale) * (m.at - middle).squaredNorm();
    gyration = std::max(1e-6, std::sqrt(gyration / weights));
    Mat6 normal = Mat6::Zero();
    Vec6 right = Vec6::Zero();
    for (const Match& m : matches) {
      const double w = weight(m, scale);
      if (w == 0) continue;
      Vec6 row;
      row << (m.at - middle).cross(m.normal) / gyration, m.normal;
      normal += w * row * row.transpose();
      right -= w * row * m.normal.dot(m.offset);
    }
    const Eigen::SelfAdjointEigenSolver<Mat6> eigen(normal);
    const Vec6& stiffness = eigen.eigenvalues();
    result.stiffness_ratio = stiffness[0] / std::max(stiffness[5], 1e-300);
    // Directions that the surface does not hold (about the axis of a body of revolution) stay put.
    Vec6 solution = Vec6::Zero();
    for (int k = 0; k < 6; ++k)
      if (stiffness[k] > 1e-6 * stiffness[5])
        solution +=
            eigen.eigenvectors().col(k).dot(right) / stiffness[k] * eigen.eigenvectors().col(k);
    const Vec3 turn = solution.head<3>() / gyration;
    result.turn = turn.norm();
    result.shift = solution.tail<3>().norm();
    const Quat rotation = result.turn > 0 ? Quat(Eigen::AngleAxisd(result.turn, turn / result.turn))
                                          : Quat::Identity();
    result.motion.orientation = rotation;
    result.motion.position = middle + solution.tail<3>() - rotation * middle;
    return result;
  }

 private:
  FindFoot find_foot_;
};

double median_below(const std::vector<Match>& matches, double scale) {
  std::vector<double> d;
  for (const Match& m : matches)
    if (m.same_side && m.distance < scale) d.push_back(m.distance);
  return d.empty() ? scale : median(std::move(d));
}

struct Refined {
  Pose pose;
  double scale = 0, stiffness_ratio = 0;
  int iterations = 0;
  bool converged = false;
};

Refined refined(const Fit& fit, const std::vector<SurfaceSample>& samples, const Pose& start,
                double scale, double least_scale, int most_iterations) {
  Refined result{start, scale, 0, 0, false};
  for (; result.iterations < most_iterations && !result.converged; ++result.iterations) {
    const std::vector<Match> matches = fit.matches(samples, result.pose);
    const double wanted = kTukey * kSigmaOfMedian * median_below(matches, result.scale);
    const double next = std::max(least_scale, std::clamp(wanted, 0.7 * result.scale, result.scale));
    const bool settled = next > 0.999 * result.scale;
    result.scale = next;
    const Fit::Step step = Fit::step(matches, result.scale);
    result.pose = composed(step.motion, result.pose);
    result.stiffness_ratio = step.stiffness_ratio;
    result.converged = settled && step.turn < kStepTurn && step.shift < kStepShift;
  }
  return result;
}

// Mean over the points of a bell of the distance: high where much of the surface lies close.
double closeness(const std::vector<Match>& matches, double width) {
  double sum = 0;
  for (const Match& m : matches)
    if (m.same_side) sum += std::exp(-0.5 * m.distance * m.distance / (width * width));
  return sum / static_cast<double>(matches.size());
}

double share_within(const std::vector<Match>& matches, double distance) {
  const auto n = std::count_if(matches.begin(), matches.end(), [&](const Match& m) {
    return m.same_side && m.distance <= distance;
  });
  return static_cast<double>(n) / static_cast<double>(matches.size());
}

double angle_between(const Quat& a, const Quat& b) {
  return 2 * std::atan2((a.conjugate() * b).vec().norm(), std::abs((a.conjugate() * b).w()));
}

// Rotations that take the axes of one surface to those of the other; see the header.
std::vector<Quat> hypotheses(const Moments& moving, const Moments& fixed) {
  const auto axes_of = [](const Moments& m) {
    const Eigen::SelfAdjointEigenSolver<Mat3> eigen(m.second);
    Mat3 axes = eigen.eigenvectors();
    if (axes.determinant() < 0) axes.col(0) *= -1;
    return std::pair<Mat3, Vec3>(axes, eigen.eigenvalues());
  };
  const auto [from, spread] = axes_of(moving);
  const auto [to, fixed_spread] = axes_of(fixed);
  std::vector<Quat> all{Quat::Identity()};
  constexpr std::array<std::array<int, 3>, 6> kOrders = {
      {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}};
  for (const auto& order : kOrders)
    for (int signs = 0; signs < 8; ++signs) {
      Mat3 turned;
      for (int k = 0; k < 3; ++k) turned.col(k) = (signs >> k & 1 ? -1 : 1) * to.col(order[k]);
      if (turned.determinant() > 0) all.emplace_back(Mat3(turned * from.transpose()));
    }
  // The axis whose moment stands apart from the other two.
  const int lone = fixed_spread[2] - fixed_spread[1] > fixed_spread[1] - fixed_spread[0] ? 2 : 0;
  const int own = spread[2] - spread[1] > spread[1] - spread[0] ? 2 : 0;
  for (const double end : {1.0, -1.0})
    for (int twelfth = 0; twelfth < 12; ++twelfth)
      all.push_back(Quat(Eigen::AngleAxisd(twelfth * units::kPi / 6, Vec3(to.col(lone)))) *
                    Quat::FromTwoVectors(from.col(own), end * to.col(lone)));
  return all;
}

struct Candidate {
  Pose pose;
  double score = 0;
};

bool same_place(const Pose& a, const Pose& b, const Vec3& centroid, double degrees, double mm) {
  return angle_between(a.orientation, b.orientation) < units::from_degree(degrees) &&
         (a.to_world(centroid) - b.to_world(centroid)).norm() < mm;
}

// The best first, without those that stand where a better one does.
std::vector<Candidate> best_of(std::vector<Candidate> all, const Vec3& centroid, double degrees,
                               double mm,
                               std::size_t most = std::numeric_limits<std::size_t>::max()) {
  std::stable_sort(all.begin(), all.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<Candidate> best;
  for (const Candidate& c : all) {
    const bool known = std::any_of(best.begin(), best.end(), [&](const Candidate& b) {
      return same_place(b.pose, c.pose, centroid, degrees, mm);
    });
    if (!known) best.push_back(c);
    if (best.size() == most) break;
  }
  return best;
}

// A solid's surface laid on another one's: hypotheses on few points, fewer and better ones on more.
class Search {
 public:
  Search(const Solid& moving, const Solid& fixed, const RegistrationOptions& options)
      : moving_(moving),
        options_(options),
        from_(moments_of(moving.surface)),
        to_(moments_of(fixed.surface)),
        size_(std::sqrt(to_.second.trace())),
        tree_(fixed.surface),
        coarse_tree_(samples_of(fixed.surface, to_.area, kCoarseSamples)),
        coarse_([this](const Vec3& x) { return coarse_tree_.nearest(x); }),
        fit_([this](const Vec3& x) {
          const SurfacePoint nearest = tree_.nearest(x);
          return Foot{nearest.point, tree_.normal(nearest.triangle)};
        }) {}

  Search(const Search&) = delete;  // the feet refer to the trees
  Search& operator=(const Search&) = delete;

  const Fit& fit() const { return fit_; }
  const Vec3& centroid() const { return from_.centroid; }
  std::vector<SurfaceSample> samples(int count) const {
    return samples_of(moving_.surface, from_.area, count);
  }
  // How much a pose moves the tooth, mm.
  double amount(const Pose& p) const {
    return angle_between(p.orientation, Quat::Identity()) * size_ +
           (p.to_world(from_.centroid) - from_.centroid).norm();
  }

  // The best first.
  std::vector<Candidate> candidates() const {
    const auto few = samples(300);
    std::vector<Candidate> all = coarse_candidates(few);
    // Finer, on the surface itself: first to see which of them are worth it, then down to the
    // noise.
    for (Candidate& c : all) {
      c.pose = refined(fit_, few, c.pose, 0.7, 0.1, 10).pose;
      c.score = score(c.pose, few);
    }
    all = best_of(std::move(all), from_.centroid, 1, 0.1);
    constexpr double kHopeless = 0.4;
    std::erase_if(all,
                  [best = all[0].score](const Candidate& c) { return c.score < best - kHopeless; });
    const auto some = samples(kSomeSamples);
    for (Candidate& c : all) {
      c.pose = refined(fit_, some, c.pose, 0.2, kLeastScale, 20).pose;
      c.score = score(c.pose, some);
    }
    return best_of(std::move(all), from_.centroid, 1, 0.1);
  }

  static constexpr int kSomeSamples = 1000;

 private:
  // Many hypotheses, few points. Of equals those that move less come first.
  std::vector<Candidate> coarse_candidates(const std::vector<SurfaceSample>& few) const {
    std::vector<Candidate> all;
    for (const Quat& turn : hypotheses(from_, to_))
      all.push_back({{to_.centroid - turn * from_.centroid, turn}, 0});
    all.push_back({Pose{}, 0});
    for (Candidate& c : all) {
      c.pose = refined(coarse_, few, c.pose, 0.5 * size_, 0.5, 20).pose;
      c.score = closeness(coarse_.matches(few, c.pose), 0.3) -
                0.02 * std::min(1.0, amount(c.pose) / (units::kPi * size_));
    }
    return best_of(std::move(all), from_.centroid, 3, 0.3, 6);
  }
  double score(const Pose& pose, const std::vector<SurfaceSample>& at) const {
    const auto matches = fit_.matches(at, pose);
    return share_within(matches, options_.agree_mm) + share_within(matches, options_.sharp_mm);
  }

  const Solid& moving_;
  const RegistrationOptions& options_;
  Moments from_, to_;
  double size_;  // radius of gyration, mm
  TriangleTree tree_;
  SampleTree coarse_tree_;
  Fit coarse_, fit_;
};

void measure_residuals(const std::vector<Match>& matches, double scale,
                       SurfaceRegistration& result) {
  std::vector<double> inliers;
  double squares = 0;
  for (const Match& m : matches) {
    if (Fit::weight(m, scale) == 0) continue;
    inliers.push_back(m.distance);
    squares += std::pow(m.normal.dot(m.offset), 2);
  }
  result.inlier_share = static_cast<double>(inliers.size()) / static_cast<double>(matches.size());
  if (inliers.empty()) return;
  result.residual_rms_mm = std::sqrt(squares / static_cast<double>(inliers.size()));
  result.residual_p95_mm = quantile(std::move(inliers), 0.95);
}

// Notes of what is doubtful, from the share of the surface that agrees sharply on.
void note_doubts(const Refined& last, const std::vector<Candidate>& equal, double sharp,
                 const RegistrationOptions& options, SurfaceRegistration& result) {
  constexpr double kLoose = 0.6;
  if (sharp < kLoose * result.agreeing_share)
    result.notes.push_back(
        fmt::format("the fit is loose: {:.0f} % of the surface agrees within {:g} mm, but only "
                    "{:.0f} % within {:g} mm; is it the same tooth, of the same size?",
                    100 * result.agreeing_share, options.agree_mm, 100 * sharp, options.sharp_mm));
  if (!result.converged)
    result.notes.push_back(
        fmt::format("the registration had not settled after {} steps", result.iterations));
  if (equal.size() > 1) {
    double farthest = 0;
    for (const Candidate& c : equal)
      farthest = std::max(farthest, angle_between(c.pose.orientation, last.pose.orientation));
    result.notes.push_back(
        fmt::format("{} placements fit equally well (up to {:.0f} degrees apart): the shape does "
                    "not show which is right; the one that turns least was taken",
                    equal.size(), units::to_degree(farthest)));
  }
  if (last.stiffness_ratio < 1e-4)
    result.notes.push_back(
        "the shape leaves one direction open (it turns or slides along itself): the placement "
        "along it is a guess");
}

}  // namespace

SurfaceRegistration register_surfaces(const Solid& moving, const Solid& fixed,
                                      const RegistrationOptions& options) {
  const Search search(moving, fixed, options);
  const std::vector<Candidate> candidates = search.candidates();

  // Of those that fit equally well the one that turns least, then shifts least.
  constexpr double kEqual = 0.01;
  std::vector<Candidate> equal;
  for (const Candidate& c : candidates)
    if (c.score >= candidates[0].score - kEqual) equal.push_back(c);
  const Candidate chosen =
      *std::min_element(equal.begin(), equal.end(), [&](const Candidate& a, const Candidate& b) {
        return search.amount(a.pose) < search.amount(b.pose);
      });

  // A fit that can't match is found with fewer points: what follows only counts them.
  const bool hopeless = chosen.score < 1.7 * options.least_share_if_sharp;
  const auto many = search.samples(hopeless ? Search::kSomeSamples : options.points);
  const Refined last =
      refined(search.fit(), many, chosen.pose, 0.2, kLeastScale, options.most_iterations);
  SurfaceRegistration result;
  result.motion = last.pose;
  result.iterations = last.iterations;
  result.converged = last.converged;
  result.angle_deg = units::to_degree(angle_between(last.pose.orientation, Quat::Identity()));
  result.shift_mm = (last.pose.to_world(search.centroid()) - search.centroid()).norm();
  const auto matches = search.fit().matches(many, last.pose);
  measure_residuals(matches, last.scale, result);
  result.agreeing_share = share_within(matches, options.agree_mm);
  const double sharp = share_within(matches, options.sharp_mm);
  const bool fits = result.agreeing_share >= options.least_share ||
                    (result.agreeing_share >= options.least_share_if_sharp &&
                     sharp >= 0.7 * result.agreeing_share);
  if (!fits)
    throw InputError(moving.file, "",
                     fmt::format("the teeth don't match: only {:.0f} % of its surface agrees "
                                 "within {:g} mm with that of {}",
                                 100 * result.agreeing_share, options.agree_mm, fixed.file),
                     "are they of the same tooth?");
  note_doubts(last, equal, sharp, options, result);
  return result;
}

}  // namespace toothprep
