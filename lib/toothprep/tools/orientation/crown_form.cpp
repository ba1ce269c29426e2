#include "toothprep/tools/orientation/crown_form.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "toothprep/step/core/units.h"
#include "toothprep/tools/orientation/gaussian_mean.h"

namespace toothprep {
namespace {

constexpr double kNone = -1e30;
constexpr double kSmoothing = 0.025, kCusp = 0.025, kBasin = 0.015;  // of the width

// Heights over a square lattice across d; kNone where the tooth has none.
struct Heights {
  Vec3 a, b, d;
  int nx = 0, ny = 0;
  double x0 = 0, y0 = 0, step = 0;  // mm
  std::vector<double> h;

  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y) * nx + x; }
  int x_of(std::size_t n) const { return static_cast<int>(n) % nx; }
  int y_of(std::size_t n) const { return static_cast<int>(n) / nx; }
  Vec3 place(std::size_t n) const {
    return (x0 + step * (x_of(n) + 0.5)) * a + (y0 + step * (y_of(n) + 0.5)) * b + h[n] * d;
  }
};

Heights heights_along(const LabelBlock& block, const Vec3& d) {
  Heights map;
  map.d = d;
  map.a = d.unitOrthogonal();
  map.b = d.cross(map.a);
  map.step = 1.25 * block.step;
  std::vector<Vec3> cells;
  double x1 = -1e30, y1 = -1e30;
  map.x0 = map.y0 = 1e30;
  for (std::size_t n = 0; n < block.label.size(); ++n) {
    if (block.at(n) == Tissue::kAir || block.at(n) == Tissue::kOther) continue;
    const Vec3 x = block.place(n);
    cells.emplace_back(x.dot(map.a), x.dot(map.b), x.dot(d));
    map.x0 = std::min(map.x0, cells.back().x());
    map.y0 = std::min(map.y0, cells.back().y());
    x1 = std::max(x1, cells.back().x());
    y1 = std::max(y1, cells.back().y());
  }
  if (cells.empty()) return map;
  map.x0 -= 1.5 * map.step;
  map.y0 -= 1.5 * map.step;
  map.nx = static_cast<int>((x1 - map.x0) / map.step) + 3;
  map.ny = static_cast<int>((y1 - map.y0) / map.step) + 3;
  map.h.assign(static_cast<std::size_t>(map.nx) * map.ny, kNone);
  for (const Vec3& c : cells) {
    double& h = map.h[map.at(static_cast<int>((c.x() - map.x0) / map.step),
                             static_cast<int>((c.y() - map.y0) / map.step))];
    h = std::max(h, c.z());
  }
  return map;
}

struct Peak {
  std::size_t at = 0;
  double height = 0, prominence = 0;  // mm; the highest one's prominence is above the lowest place
};

// Peaks by their prominence: places are joined from the highest down, and where two meet the lower
// one ends. `height` of every place; `outside_ends`: what reaches a place without height ends there.
std::vector<Peak> find_peaks(const Heights& map, const std::vector<double>& height,
                             bool outside_ends) {
  std::vector<std::size_t> order;
  for (std::size_t n = 0; n < height.size(); ++n)
    if (height[n] != kNone) order.push_back(n);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t p, std::size_t q) { return height[p] > height[q]; });
  std::vector<Peak> peaks;
  constexpr std::size_t kNobody = static_cast<std::size_t>(-1);
  std::vector<std::size_t> owner(height.size(), kNobody);  // of a place: its peak's index
  std::vector<std::size_t> joined;                         // of a peak: the one that took it
  std::vector<bool> ended;
  const std::function<std::size_t(std::size_t)> root = [&](std::size_t p) {
    while (joined[p] != p) p = joined[p] = joined[joined[p]];
    return p;
  };
  const auto end = [&](std::size_t p, double at) {
    if (!ended[p]) peaks[p].prominence = peaks[p].height - at;
    ended[p] = true;
  };
  for (const std::size_t n : order) {
    std::size_t mine = kNobody;
    bool edge = false;
    for (int j = -1; j <= 1; ++j)
      for (int i = -1; i <= 1; ++i) {
        const int x = map.x_of(n) + i, y = map.y_of(n) + j;
        const bool inside = x >= 0 && y >= 0 && x < map.nx && y < map.ny;
        if (!inside || height[map.at(x, y)] == kNone) {
          edge = true;
          continue;
        }
        if (owner[map.at(x, y)] == kNobody) continue;
        const std::size_t other = root(owner[map.at(x, y)]);
        if (mine == kNobody || mine == other) {
          mine = other;
          continue;
        }
        const bool keep = peaks[mine].height >= peaks[other].height;
        const std::size_t winner = keep ? mine : other, loser = keep ? other : mine;
        if (outside_ends && ended[loser]) end(winner, height[n]);  // by way of the other, it spills
        end(loser, height[n]);
        joined[loser] = winner;
        mine = winner;
      }
    if (mine == kNobody) {
      mine = peaks.size();
      peaks.push_back({n, height[n], 0});
      joined.push_back(mine);
      ended.push_back(false);
    }
    owner[n] = mine;
    if (edge && outside_ends) end(mine, height[n]);
  }
  for (std::size_t p = 0; p < peaks.size(); ++p)
    if (root(p) == p) end(p, height[order.back()]);
  return peaks;
}

struct Outline {
  double area = 0, elongation = 1;
  double x = 0, y = 0;  // its middle, mm across d
};

Outline outline_of(const Heights& map, double above) {
  Outline outline;
  double count = 0;
  for (std::size_t n = 0; n < map.h.size(); ++n)
    if (map.h[n] > above) {
      ++count;
      outline.x += map.step * map.x_of(n);
      outline.y += map.step * map.y_of(n);
    }
  if (count == 0) return outline;
  outline.x /= count;
  outline.y /= count;
  Eigen::Matrix2d spread = Eigen::Matrix2d::Identity() * (map.step * map.step / 12);
  for (std::size_t n = 0; n < map.h.size(); ++n)
    if (map.h[n] > above) {
      const Eigen::Vector2d x(map.step * map.x_of(n) - outline.x,
                              map.step * map.y_of(n) - outline.y);
      spread += x * x.transpose() / count;
    }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(spread);
  outline.area = count * map.step * map.step;
  outline.elongation = std::sqrt(solver.eigenvalues()[1] / solver.eigenvalues()[0]);
  return outline;
}

std::optional<Vec3> central_fossa(const Heights& map, const Outline& outline, double width) {
  std::vector<double> upside_down(map.h.size(), kNone);
  for (std::size_t n = 0; n < map.h.size(); ++n)
    if (map.h[n] != kNone) upside_down[n] = -map.h[n];
  std::optional<Peak> best;
  for (const Peak& basin : find_peaks(map, upside_down, true)) {
    const double off = std::hypot(map.step * map.x_of(basin.at) - outline.x,
                                  map.step * map.y_of(basin.at) - outline.y);
    if (basin.prominence < kBasin * width || off > width / 3) continue;
    if (!best || basin.height > best->height) best = basin;
  }
  return best ? std::optional(map.place(best->at)) : std::nullopt;
}

CrownForm form_of(const Crown& crown, const Heights& map, double top, double neck) {
  const std::size_t cusps = crown.cusps.size();
  if (cusps >= 4 && cusps <= 6 && crown.fossa) return CrownForm::kMolar;
  if (cusps == 2 && crown.fossa) {  // on opposite sides of the fossa
    const auto flat = [&](const Vec3& x) { return Vec3(x - x.dot(map.d) * map.d); };
    const Vec3 p = flat(crown.cusps[0] - *crown.fossa), q = flat(crown.cusps[1] - *crown.fossa);
    if (p.dot(q) < -0.5 * p.norm() * q.norm()) return CrownForm::kPremolar;
  }
  const double edge = outline_of(map, top - 0.2 * (top - neck)).elongation;
  if (!crown.fossa && cusps <= 3 && edge > 2.5) return CrownForm::kIncisor;
  return CrownForm::kNotKnown;
}

}  // namespace

Crown describe_crown(const LabelBlock& block, const Vec3& d, std::optional<double> neck) {
  Crown crown;
  Heights map = heights_along(block, d);
  if (map.h.empty()) return crown;
  double top = *std::max_element(map.h.begin(), map.h.end());
  // Without a neck: what lies below the crown by more than its width isn't the crown's.
  const double width_all = std::sqrt(outline_of(map, kNone / 2).area);
  const double low = neck.value_or(top - 0.8 * width_all);
  for (double& h : map.h)
    if (h < low) h = kNone;
  const Outline outline = outline_of(map, kNone / 2);
  crown.width = std::sqrt(outline.area);
  crown.elongation = outline.elongation;
  map.h = gaussian_mean(map.h, map.nx, map.ny, map.step, kSmoothing * crown.width, kNone);
  top = *std::max_element(map.h.begin(), map.h.end());
  std::vector<Peak> tips;
  for (const Peak& peak : find_peaks(map, map.h, false))
    if (peak.prominence > kCusp * crown.width && peak.height > 0.5 * (low + top))
      tips.push_back(peak);
  std::stable_sort(tips.begin(), tips.end(),
                   [](const Peak& p, const Peak& q) { return p.height > q.height; });
  for (const Peak& tip : tips) crown.cusps.push_back(map.place(tip.at));
  crown.fossa = central_fossa(map, outline, crown.width);
  crown.form = form_of(crown, map, top, low);
  return crown;
}

}  // namespace toothprep
