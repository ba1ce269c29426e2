#include "toothprep/tools/preparation_paths/crown_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/orientation/gaussian_mean.h"

namespace toothprep {
namespace {

constexpr double kNone = -std::numeric_limits<double>::infinity();
constexpr double kSurfaceSmoothing = 0.2;                 // mm
constexpr double kApart = 0.1, kReach = 6, kAside = 1.5;  // mm: of the ways that are compared
constexpr double kAround = 0.9;                           // mm: what a groove is seen against
constexpr double kGroove = 0.4, kCrest = 0.05;  // mm: of a distinct groove; beyond it none
constexpr double kPit = 0.5;                    // mm, radius: wider than a pit of a fissure
constexpr double kBeside = 0.6;                 // mm: so far from the middle a way may pass it
constexpr double kTurn = 0.12;                  // what a step to the next lane costs

}  // namespace

double length_of(const std::vector<Vec2>& line) {
  double sum = 0;
  for (std::size_t i = 1; i < line.size(); ++i) sum += (line[i] - line[i - 1]).norm();
  return sum;
}

double CrownMap::height(const std::vector<double>& map, const Vec2& p) const {
  const double u = (p.x() - x0) / step, v = (p.y() - y0) / step;
  const int x = static_cast<int>(std::floor(u)), y = static_cast<int>(std::floor(v));
  if (x < 0 || y < 0 || x + 1 >= nx || y + 1 >= ny) return kNone;
  const double a = u - x, b = v - y;
  const double h = (1 - b) * ((1 - a) * map[at(x, y)] + a * map[at(x + 1, y)]) +
                   b * ((1 - a) * map[at(x, y + 1)] + a * map[at(x + 1, y + 1)]);
  return std::isfinite(h) ? h : kNone;  // 0 times -infinity is no number
}

CrownMap crown_map(const ToothGrid& grid) {
  CrownMap map;
  map.x0 = grid.low().x();
  map.y0 = grid.low().y();
  map.step = grid.step();
  map.nx = grid.size().x();
  map.ny = grid.size().y();
  for (int y = 0; y < map.ny; ++y)
    for (int x = 0; x < map.nx; ++x) {
      const Vec2 p = map.place(x, y);
      map.surface.push_back(grid.height(ToothGrid::Surface::kTooth, p.x(), p.y()));
      map.dentin.push_back(grid.height(ToothGrid::Surface::kDentin, p.x(), p.y()));
    }
  return map;
}

std::vector<double> smoothed(const CrownMap& map, const std::vector<double>& heights,
                             double sigma) {
  return gaussian_mean(heights, map.nx, map.ny, map.step, sigma, kNone);
}

std::vector<double> distance_to_outline(const ToothGrid& grid, const CrownMap& map, double z) {
  std::vector<double> distance(map.surface.size(), 0);
  const int level = grid.cell({map.x0, map.y0, z}).z();
  if (level < 0 || level >= grid.size().z()) return distance;
  // Air that the edge of the grid leads to: a pit or a pulp that the plane cuts is no outline.
  std::vector<char> outside(map.surface.size(), 0);
  std::vector<std::pair<int, int>> reached;
  const auto reach = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= map.nx || y >= map.ny || outside[map.at(x, y)] != 0 ||
        ToothGrid::is_tooth(grid.at(x, y, level)))
      return;
    outside[map.at(x, y)] = 1;
    reached.emplace_back(x, y);
  };
  for (int x = 0; x < map.nx; ++x)
    for (const int y : {0, map.ny - 1}) reach(x, y);
  for (int y = 0; y < map.ny; ++y)
    for (const int x : {0, map.nx - 1}) reach(x, y);
  for (std::size_t n = 0; n < reached.size(); ++n) {
    const auto [x, y] = reached[n];
    for (const int d : {-1, 1}) {
      reach(x + d, y);
      reach(x, y + d);
    }
  }
  const auto inside = [&](int x, int y) { return outside[map.at(x, y)] == 0; };
  std::vector<Vec2> border;  // cells of that air beside the tooth
  for (int y = 1; y + 1 < map.ny; ++y)
    for (int x = 1; x + 1 < map.nx; ++x)
      if (!inside(x, y) &&
          (inside(x - 1, y) || inside(x + 1, y) || inside(x, y - 1) || inside(x, y + 1)))
        border.push_back(map.place(x, y));
  for (int y = 0; y < map.ny; ++y)
    for (int x = 0; x < map.nx; ++x) {
      if (!inside(x, y)) continue;
      double least = std::numeric_limits<double>::infinity();
      for (const Vec2& b : border) least = std::min(least, (b - map.place(x, y)).squaredNorm());
      distance[map.at(x, y)] = std::sqrt(least) - 0.5 * map.step;
    }
  return distance;
}

namespace {

struct Terrain {
  const CrownMap& map;
  std::vector<double> surface, inside;  // smoothed heights; distance to the outline
  std::vector<double> valley;           // height against the surroundings: negative in a groove
  Vec2 middle;
  double fossa = 0, relief = 0, from_outline = 0;

  double rise() const { return std::max(0.6, 0.45 * relief); }
  // Whether a cavity may go on there: between the ridges, on no slope up to a cusp.
  bool passable(const Vec2& p) const {
    return map.height(inside, p) >= from_outline && map.height(surface, p) != kNone &&
           map.height(surface, p) - fossa < rise() && map.height(valley, p) < kCrest;
  }
};

// The best way along `direction` through the middle: both halves begin beside the middle and go on,
// lane by lane, over places that are allowed, as far and as low in the groove as these lead.
class BestWay {
 public:
  BestWay(const Terrain& terrain, const Vec2& direction)
      : terrain_(terrain), along_(direction), aside_(-direction.y(), direction.x()) {}

  // Empty where no place beside the middle is allowed.
  [[nodiscard]] std::vector<Vec2> find() const {
    const Half ahead = half(+1), behind = half(-1);
    int start = -1;
    double most = 0;
    for (int j = 0; j < kLanes; ++j) {
      if (std::abs(offset(j)) > kBeside || !ahead.gain[0][j]) continue;
      const double both = *ahead.gain[0][j] + *behind.gain[0][j] - *gain(place(0, j), j);
      if (start >= 0 && both <= most) continue;
      start = j;
      most = both;
    }
    if (start < 0) return {};
    std::vector<Vec2> way = followed(behind, -1, start);
    std::reverse(way.begin(), way.end());
    way.pop_back();  // the start
    const std::vector<Vec2> rest = followed(ahead, +1, start);
    way.insert(way.end(), rest.begin(), rest.end());
    return way;
  }

 private:
  static constexpr int kSteps = static_cast<int>(kReach / kApart) + 1;
  static constexpr int kLanes = 2 * static_cast<int>(kAside / kApart) + 1;
  template <class T>
  using Grid = std::vector<std::array<T, kLanes>>;
  struct Half {
    Grid<std::optional<double>> gain{
        kSteps};             // of the best way from here outwards; none: not allowed
    Grid<int> next{kSteps};  // lane of the next step; -1 at the end
  };

  static double offset(int j) {
    constexpr int kMiddle = kLanes / 2;
    return (j - kMiddle) * kApart;
  }
  [[nodiscard]] Vec2 place(int i, int j) const {
    return terrain_.middle + i * kApart * along_ + offset(j) * aside_;
  }
  // What a step there adds: more than nothing wherever it is allowed, most low in a groove.
  [[nodiscard]] std::optional<double> gain(const Vec2& p, int j) const {
    if (!terrain_.passable(p)) return std::nullopt;
    const double groove = std::min(1.0, -terrain_.map.height(terrain_.valley, p) / kGroove);
    const double climb = std::max(0.0, terrain_.map.height(terrain_.surface, p) - terrain_.fossa);
    const double off = offset(j) / kAside;
    return 0.5 + groove - climb / 3 - 0.1 * off * off;
  }
  [[nodiscard]] Half half(int sense) const {
    Half h;
    for (int i = kSteps - 1; i >= 0; --i)
      for (int j = 0; j < kLanes; ++j) {
        int& next = h.next[static_cast<std::size_t>(i)][j] = -1;
        auto& gained = h.gain[static_cast<std::size_t>(i)][j] = gain(place(sense * i, j), j);
        if (!gained || i + 1 == kSteps) continue;
        double most = 0;
        for (int k = std::max(0, j - 1); k <= std::min(kLanes - 1, j + 1); ++k) {
          const auto& after = h.gain[static_cast<std::size_t>(i) + 1][k];
          if (!after || *after - (k == j ? 0 : kTurn) <= most) continue;
          most = *after - (k == j ? 0 : kTurn);
          next = k;
        }
        *gained += most;
      }
    return h;
  }
  [[nodiscard]] std::vector<Vec2> followed(const Half& h, int sense, int j) const {
    std::vector<Vec2> way;
    for (int i = 0; j >= 0; j = h.next[static_cast<std::size_t>(i++)][j])
      way.push_back(place(sense * i, j));
    return way;
  }

  const Terrain& terrain_;
  Vec2 along_, aside_;
};

// How far it runs in a groove, less what it climbs.
double merit(const Terrain& t, const std::vector<Vec2>& way) {
  double sum = 0;
  for (const Vec2& p : way)
    sum += std::clamp(-t.map.height(t.valley, p) / (0.5 * kGroove), 0.0, 1.0) -
           0.5 * std::clamp((t.map.height(t.surface, p) - t.fossa) / t.rise(), 0.0, 1.0);
  return kApart * sum;
}

void smooth(std::vector<Vec2>& line, double sigma) {
  const std::vector<Vec2> was = line;
  const int n = static_cast<int>(line.size()), reach = static_cast<int>(2.5 * sigma / kApart);
  for (int i = 0; i < n; ++i) {
    const int r = std::min({reach, i, n - 1 - i});  // the ends stay
    Vec2 sum = Vec2::Zero();
    double weights = 0;
    for (int k = -r; k <= r; ++k) {
      const double off = k * kApart / sigma, w = std::exp(-0.5 * off * off);
      sum += w * was[static_cast<std::size_t>(i + k)];
      weights += w;
    }
    line[static_cast<std::size_t>(i)] = sum / weights;
  }
}

Vec2 lowest_in_the_middle(const Terrain& t) {
  const double most = *std::max_element(t.inside.begin(), t.inside.end());
  Vec2 best = Vec2::Zero();
  double least = std::numeric_limits<double>::infinity();
  for (int y = 0; y < t.map.ny; ++y)
    for (int x = 0; x < t.map.nx; ++x) {
      const std::size_t n = t.map.at(x, y);
      if (t.inside[n] < 0.6 * most || t.surface[n] >= least || t.surface[n] == kNone) continue;
      least = t.surface[n];
      best = t.map.place(x, y);
    }
  return best;
}

// The median around a place, so that a pit just there doesn't count.
double usual_height(const Terrain& t, const Vec2& place) {
  std::vector<double> heights;
  for (double y = -kPit; y <= kPit; y += t.map.step)
    for (double x = -kPit; x <= kPit; x += t.map.step) {
      const double h = t.map.height(t.surface, place + Vec2(x, y));
      if (h != kNone && std::hypot(x, y) <= kPit) heights.push_back(h);
    }
  if (heights.empty()) throw Error("nothing of the tooth is seen where its fossa should be");
  return median(std::move(heights));
}

Terrain terrain_of(const ToothGrid& grid, const CrownMap& map, const FissureSearch& search) {
  Terrain t{map, smoothed(map, map.surface, kSurfaceSmoothing), {}, {}, Vec2::Zero()};
  t.valley = smoothed(map, map.surface, kAround);
  for (std::size_t n = 0; n < t.valley.size(); ++n)
    if (t.surface[n] != kNone) t.valley[n] = t.surface[n] - t.valley[n];
  std::vector<double> heights;
  for (const double h : t.surface)
    if (h != kNone) heights.push_back(h);
  std::sort(heights.begin(), heights.end());
  if (heights.empty()) throw Error("nothing of the tooth is seen from the occlusal side");
  const double top = heights[heights.size() * 99 / 100];
  t.inside = distance_to_outline(
      grid, map, search.middle ? map.height(t.surface, *search.middle) - 0.5 : top - 2.5);
  t.middle = search.middle.value_or(lowest_in_the_middle(t));
  t.fossa = usual_height(t, t.middle);
  t.relief = std::max(0.0, top - t.fossa);
  t.from_outline = search.from_outline;
  return t;
}

void shorten(std::vector<Vec2>& line, const Vec2& middle, double longest) {
  while (length_of(line) > longest && line.size() > 2)
    if ((line.front() - middle).norm() > (line.back() - middle).norm())
      line.erase(line.begin());
    else
      line.pop_back();
}

}  // namespace

Fissure find_fissure(const ToothGrid& grid, const CrownMap& map, const FissureSearch& search) {
  const Terrain t = terrain_of(grid, map, search);
  Fissure fissure;
  fissure.fossa = t.fossa;
  fissure.relief = t.relief;
  constexpr int kDirections = 36;
  std::vector<double> merits(kDirections, -1);
  int best = -1;
  for (int k = 0; k < kDirections; ++k) {
    const double angle = k * units::kPi / kDirections;
    const Vec2 d(std::cos(angle), std::sin(angle));
    if (search.along && std::abs(d.dot(search.along->normalized())) < std::cos(units::kPi / 6))
      continue;
    const std::vector<Vec2> way = BestWay(t, d).find();
    // Mesial as given is right to some 15°: further off a groove has to be the longer.
    const double off =
        search.along ? std::acos(std::min(1.0, std::abs(d.dot(search.along->normalized())))) : 0;
    merits[static_cast<std::size_t>(k)] = std::min(merit(t, way), search.longest) - 4 * off * off;
    if (best < 0 || merits[static_cast<std::size_t>(k)] > merits[static_cast<std::size_t>(best)])
      best = k;
  }
  const double angle = best * units::kPi / kDirections;
  fissure.direction = {std::cos(angle), std::sin(angle)};
  if (search.along && fissure.direction.dot(*search.along) < 0) fissure.direction *= -1;
  if (!search.along) {
    double across = 0;
    for (int k = kDirections / 3; k <= 2 * kDirections / 3; ++k)
      across = std::max(across, merits[static_cast<std::size_t>((best + k) % kDirections)]);
    if (across > 0.8 * merits[static_cast<std::size_t>(best)])
      throw Error(
          "the crown doesn't show which way its main fissure runs: give the mesial direction by "
          "toothprep orient --mesial");
  }
  fissure.points = BestWay(t, fissure.direction).find();
  smooth(fissure.points, 0.6);
  shorten(fissure.points, t.middle, search.longest);
  if (length_of(fissure.points) < 1.5)
    throw Error("no fissure of 1.5 mm or more was found between the marginal ridges");
  return fissure;
}

std::vector<Vec2> shifted(const std::vector<Vec2>& line, double offset) {
  std::vector<Vec2> result;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const std::size_t a = i >= 3 ? i - 3 : 0, b = std::min(line.size() - 1, i + 3);
    const Vec2 d = (line[b] - line[a]).normalized();
    result.push_back(line[i] + offset * Vec2(-d.y(), d.x()));
  }
  return result;
}

}  // namespace toothprep
