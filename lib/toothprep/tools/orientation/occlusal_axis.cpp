#include "toothprep/tools/orientation/occlusal_axis.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kDegree = units::from_degree(1);
constexpr double kMostUncertain = 20;  // degrees: beyond, an axis isn't known
constexpr double kLeastUncertain = 3;  // degrees
constexpr double kLeastEnamel = 0.02;  // share of the tooth's volume
constexpr int kAround = 48;            // places of the neck
constexpr double kStandCone = 27;      // degrees

using Points = std::vector<Vec3>;

double angle_deg(const Vec3& a, const Vec3& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) / kDegree;
}

// The tooth's cells by what they say.
struct Cloud {
  Points tooth, enamel, skin, border;  // skin: enamel beside air; border: beside air and dentin
  Vec3 enamel_middle = Vec3::Zero(), dentin_middle = Vec3::Zero();
  double step = 0;  // mm

  explicit Cloud(const LabelBlock& block) : step(block.step) {
    std::size_t dentin = 0;
    for (std::size_t n = 0; n < block.label.size(); ++n) {
      const Tissue tissue = block.at(n);
      if (tissue == Tissue::kAir || tissue == Tissue::kOther) continue;
      const Vec3 x = block.place(n);
      tooth.push_back(x);
      if (tissue != Tissue::kEnamel) {
        dentin_middle += x;
        ++dentin;
        continue;
      }
      enamel.push_back(x);
      enamel_middle += x;
      if (!block.beside(n, Tissue::kAir)) continue;
      skin.push_back(x);
      if (block.beside(n, Tissue::kDentin)) border.push_back(x);
    }
    enamel_middle /= static_cast<double>(std::max<std::size_t>(1, enamel.size()));
    dentin_middle /= static_cast<double>(std::max<std::size_t>(1, dentin));
  }
};

struct Fit {
  FramePlane plane;
  double rms = 0;  // mm, of the points kept
};

// The plane through points, without those that lie off by more than 2.5 robust sigmas; its normal
// to the side of `d`.
Fit fit_plane(const Points& points, const Vec3& d, double least_sigma) {
  Fit fit;
  std::vector<bool> kept(points.size(), true);
  for (int round = 0; round < 4; ++round) {
    Vec3 middle = Vec3::Zero();
    double count = 0;
    for (std::size_t n = 0; n < points.size(); ++n)
      if (kept[n]) {
        middle += points[n];
        ++count;
      }
    middle /= count;
    Mat3 spread = Mat3::Zero();
    for (std::size_t n = 0; n < points.size(); ++n)
      if (kept[n]) spread += (points[n] - middle) * (points[n] - middle).transpose();
    Vec3 normal = Eigen::SelfAdjointEigenSolver<Mat3>(spread).eigenvectors().col(0);
    if (normal.dot(d) < 0) normal = -normal;
    fit = {{middle, normal}, 0};
    std::vector<double> off;
    double square = 0;
    for (std::size_t n = 0; n < points.size(); ++n)
      if (kept[n]) {
        off.push_back(std::abs((points[n] - middle).dot(normal)));
        square += off.back() * off.back();
      }
    fit.rms = std::sqrt(square / count);
    std::nth_element(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2),
                     off.end());
    const double limit = 2.5 * std::max(1.48 * off[off.size() / 2], least_sigma);
    for (std::size_t n = 0; n < points.size(); ++n)
      kept[n] = std::abs((points[n] - middle).dot(normal)) < limit;
  }
  return fit;
}

// The lower border of the enamel, seen along d: the mean of the lowest third of the border in each
// direction around.
Points lowest_border(const Cloud& cloud, const Vec3& d) {
  const Vec3 a = d.unitOrthogonal(), b = d.cross(a);
  std::array<std::vector<std::pair<double, std::size_t>>, kAround> around;
  for (std::size_t n = 0; n < cloud.border.size(); ++n) {
    const Vec3 x = cloud.border[n] - cloud.enamel_middle;
    const double turn = std::atan2(x.dot(b), x.dot(a)) / (2 * units::kPi) + 0.5;
    around[static_cast<std::size_t>(turn * kAround) % kAround].emplace_back(x.dot(d), n);
  }
  Points line;
  for (auto& places : around) {
    if (places.empty()) continue;
    std::sort(places.begin(), places.end());
    const std::size_t count = (places.size() + 2) / 3;
    Vec3 sum = Vec3::Zero();
    for (std::size_t n = 0; n < count; ++n) sum += cloud.border[places[n].second];
    line.push_back(sum / static_cast<double>(count));
  }
  return line;
}

struct Neck {
  Points line;
  FramePlane plane;
  bool flat = false;  // as a cut is
};

std::optional<Neck> find_neck(const Cloud& cloud, Vec3 d, bool turn) {
  Neck neck;
  for (int round = 0; round < 4; ++round) {
    neck.line = lowest_border(cloud, d);
    if (neck.line.size() < 0.6 * kAround) return {};
    const Fit fit = fit_plane(neck.line, d, cloud.step / 2);
    neck.plane = fit.plane;
    neck.flat = fit.rms < 0.4 * cloud.step;
    if (!turn || neck.plane.normal.dot(d) < 0.5) break;
    d = neck.plane.normal;
  }
  return neck;
}

// How far the cloud reaches from `from` along n, mm. The points go by fours, none of which waits for another's.
double reach(const Points& points, const Vec3& from, const Vec3& n) {
  constexpr std::size_t kTogether = 4;
  std::array<double, kTogether> most;
  most.fill(-std::numeric_limits<double>::infinity());
  std::size_t p = 0;
  for (; p + kTogether <= points.size(); p += kTogether)
    for (std::size_t k = 0; k < kTogether; ++k) most[k] = std::max(most[k], n.dot(points[p + k]));
  for (; p < points.size(); ++p) most[0] = std::max(most[0], n.dot(points[p]));
  return *std::max_element(most.begin(), most.end()) - n.dot(from);
}

// The plane on which the crown stands upside down: of the directions around d the one along which
// it reaches least beyond its middle.
std::optional<FramePlane> find_stand(const Cloud& cloud, const Vec3& d) {
  Vec3 best = d;
  double least = reach(cloud.skin, cloud.enamel_middle, d);
  for (double step = 3; step > 0.1; step /= 5) {
    const Vec3 centre = best, a = centre.unitOrthogonal(), b = centre.cross(a);
    const int rings = step == 3 ? 10 : 7;
    for (int ring = 1; ring <= rings; ++ring)
      for (int k = 0; k < 6 * ring; ++k) {
        const double off = ring * step * kDegree, turn = units::kPi / 3 * k / ring;
        const Vec3 n =
            std::cos(off) * centre + std::sin(off) * (std::cos(turn) * a + std::sin(turn) * b);
        const double height = reach(cloud.skin, cloud.enamel_middle, n);
        if (height < least) {
          least = height;
          best = n;
        }
      }
  }
  if (angle_deg(best, d) > kStandCone) return {};
  return FramePlane{cloud.enamel_middle + least * best, best};
}

// Principal axis of the tooth to the side of d; nothing where it isn't slender.
std::optional<Vec3> find_long_axis(const Cloud& cloud, const Vec3& d) {
  Vec3 middle = Vec3::Zero();
  for (const Vec3& x : cloud.tooth) middle += x;
  middle /= static_cast<double>(cloud.tooth.size());
  Mat3 spread = Mat3::Zero();
  for (const Vec3& x : cloud.tooth) spread += (x - middle) * (x - middle).transpose();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(spread);
  if (solver.eigenvalues()[2] < 1.5 * solver.eigenvalues()[1]) return {};
  const Vec3 axis = solver.eigenvectors().col(2);
  return axis.dot(d) < 0 ? Vec3(-axis) : axis;
}

// How much further the tooth reaches beyond its enamel at the root's end than at the crown's, as a
// share of its length; single stray cells don't count.
double beyond_enamel(const Cloud& cloud, const Vec3& d) {
  const auto heights = [&](const Points& points) {
    std::vector<double> h;
    h.reserve(points.size());
    for (const Vec3& x : points) h.push_back(x.dot(d));
    const auto cut = static_cast<std::ptrdiff_t>(h.size() / 50);
    const auto low = h.begin() + cut, high = h.end() - 1 - cut;
    std::nth_element(h.begin(), low, h.end());
    if (low < high) std::nth_element(low + 1, high, h.end());
    return std::pair(*low, *high);
  };
  const auto [low, high] = heights(cloud.tooth);
  const auto [enamel_low, enamel_high] = heights(cloud.enamel);
  return ((enamel_low - low) - (high - enamel_high)) / (high - low);
}

// Share of the outline along d in which enamel lies in front, from above less that from below.
double enamel_in_front(const LabelBlock& block, const Vec3& d) {
  const Vec3 a = d.unitOrthogonal(), b = d.cross(a);
  struct Column {
    double low = 1e30, high = -1e30;
    bool low_enamel = false, high_enamel = false;
  };
  std::map<std::pair<int, int>, Column> columns;
  const double width = 1.5 * block.step;
  for (std::size_t n = 0; n < block.label.size(); ++n) {
    const Tissue tissue = block.at(n);
    if (tissue == Tissue::kAir || tissue == Tissue::kOther) continue;
    const Vec3 x = block.place(n);
    Column& column = columns[{static_cast<int>(std::floor(x.dot(a) / width)),
                              static_cast<int>(std::floor(x.dot(b) / width))}];
    const double h = x.dot(d);
    if (h > column.high) {
      column.high = h;
      column.high_enamel = tissue == Tissue::kEnamel;
    }
    if (h < column.low) {
      column.low = h;
      column.low_enamel = tissue == Tissue::kEnamel;
    }
  }
  double above = 0, below = 0;
  for (const auto& [at, column] : columns) {
    above += column.high_enamel;
    below += column.low_enamel;
  }
  return (above - below) / static_cast<double>(columns.size());
}

struct Estimate {
  Vec3 direction;
  double weight;
};

FrameAxis mean_of(const std::vector<Estimate>& estimates) {
  Vec3 sum = Vec3::Zero();
  double weights = 0, scatter = 0;
  for (const Estimate& e : estimates) {
    sum += e.weight * e.direction;
    weights += e.weight;
  }
  const Vec3 mean = sum.normalized();
  for (const Estimate& e : estimates)
    scatter += e.weight * std::pow(angle_deg(e.direction, mean), 2);
  const double error =
      estimates.size() < 2
          ? 90
          : std::sqrt(scatter / weights / (static_cast<double>(estimates.size()) - 1));
  return {mean, std::max(kLeastUncertain, 2 * error), AxisSource::kEstimated};
}

// Sign and uncertainty that allow the direction to be used; otherwise why not.
std::optional<std::string> objection(const LabelBlock& block, const Cloud& cloud,
                                     const FrameAxis& axis, double beyond) {
  if (beyond < 0.2 && (beyond < -0.1 || enamel_in_front(block, axis.direction) < 0.25))
    return "the enamel doesn't show where the crown ends";
  if (axis.uncertainty_deg > kMostUncertain)
    return fmt::format("neck, cusps and enamel disagree on it by {:.0f} degrees",
                       axis.uncertainty_deg);
  if (cloud.enamel.size() < 200) return "there are too few voxels of enamel";
  return {};
}

std::optional<std::string> not_one_tooth(const LabelBlock& block, const Cloud& cloud) {
  if (cloud.tooth.empty()) return "no voxel is labelled enamel, dentin or pulp";
  const double enamel = static_cast<double>(cloud.enamel.size());
  if (enamel < kLeastEnamel * static_cast<double>(cloud.tooth.size()))
    return "there is no enamel to find the crown by";
  if (cloud.enamel.size() == cloud.tooth.size())
    return "there is no dentin to find the root's side by";
  const std::vector<std::size_t> pieces = dentin_pieces(block);
  if (pieces.size() > 1 && static_cast<double>(pieces[1]) > 0.2 * static_cast<double>(pieces[0]))
    return "there is more than one tooth: the dentin is in several pieces of similar size";
  if ((cloud.enamel_middle - cloud.dentin_middle).norm() < cloud.step / 2)
    return "enamel and dentin have the same middle";
  return {};
}

void estimate(const LabelBlock& block, const Cloud& cloud, OcclusalAxis& result) {
  const Vec3 cap = (cloud.enamel_middle - cloud.dentin_middle).normalized();
  Vec3 d = cap;
  double beyond = 0;
  for (int round = 0; round < 3; ++round) {
    std::vector<Estimate> estimates = {{cap, 1}};
    beyond = beyond_enamel(cloud, d);
    const auto neck = find_neck(cloud, d, true);
    result.cervical.reset();
    result.cervical_line.clear();
    if (neck && angle_deg(neck->plane.normal, d) < 60) {
      const bool cut = neck->flat && beyond < 0.1;
      estimates.push_back({neck->plane.normal, cut ? 0.5 : 2});
      if (!cut) {
        result.cervical = neck->plane;
        result.cervical_line = neck->line;
      }
    }
    result.occlusal_plane = find_stand(cloud, mean_of(estimates).direction);
    if (result.occlusal_plane) estimates.push_back({result.occlusal_plane->normal, 1});
    const auto slender = find_long_axis(cloud, d);
    result.long_axis = {};
    if (slender && beyond > 0.2) {
      result.long_axis = {*slender, kLeastUncertain + angle_deg(*slender, cap) / 2,
                          AxisSource::kEstimated};
      if (angle_deg(*slender, d) < 30) estimates.push_back({*slender, 0.5});
    }
    result.occlusal = mean_of(estimates);
    d = result.occlusal.direction;
  }
  if (const auto why = objection(block, cloud, result.occlusal, beyond)) {
    const std::vector<std::string> notes = {"the occlusal direction is not known: " + *why};
    result = {};
    result.notes = notes;
  }
}

}  // namespace

OcclusalAxis find_occlusal_axis(const LabelBlock& block, const std::optional<Vec3>& given) {
  OcclusalAxis result;
  const Cloud cloud(block);
  if (const auto why = not_one_tooth(block, cloud))
    result.notes.push_back("the occlusal direction is not known from the form: " + *why);
  else
    estimate(block, cloud, result);
  if (!given) return result;
  if (result.occlusal.known()) {
    const double off = angle_deg(result.occlusal.direction, *given);
    if (off > 30 && off > 2 * result.occlusal.uncertainty_deg)
      result.notes.push_back(fmt::format(
          "the occlusal direction given is {:.0f} degrees off what enamel and roots say", off));
  } else {
    result.notes.clear();
  }
  result.occlusal = {*given, 0, AxisSource::kGiven};
  if (result.long_axis.known() && result.long_axis.direction.dot(*given) < 0)
    result.long_axis.direction = -result.long_axis.direction;
  result.cervical.reset();
  result.cervical_line.clear();
  if (const auto neck = find_neck(cloud, *given, false)) {
    result.cervical = neck->plane;
    result.cervical_line = neck->line;
  }
  if (!cloud.skin.empty()) result.occlusal_plane = find_stand(cloud, *given);
  return result;
}

}  // namespace toothprep
