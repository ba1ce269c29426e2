#include "toothprep/proof/reference/swept_passes.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

constexpr int kLines = 12000;     // across the feed
constexpr int kFewLines = 1500;   // where a place is looked up: linear in between to 1e-6 mm
constexpr int kGoldenSteps = 40;  // to 4e-9 of the range
constexpr int kBisections = 34;   // to 6e-11 of it
constexpr double kGolden = 0.6180339887498949;

struct Interval {
  double low = 1, high = 0;
  bool empty() const { return low >= high; }
};

// Where the convex function f is least within [low, high].
template <class F>
double least_of(const F& f, double low, double high) {
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double fa = f(a), fb = f(b);
  for (int i = 0; i < kGoldenSteps; ++i) {
    if (fa < fb) {
      high = b, b = a, fb = fa;
      a = high - kGolden * (high - low), fa = f(a);
    } else {
      low = a, a = b, fa = fb;
      b = low + kGolden * (high - low), fb = f(b);
    }
  }
  return (low + high) / 2;
}

// Where f changes its sign between `inside` (f < 0) and `outside`.
template <class F>
double sign_change(const F& f, double inside, double outside) {
  for (int i = 0; i < kBisections; ++i) {
    const double middle = (inside + outside) / 2;
    (f(middle) < 0 ? inside : outside) = middle;
  }
  return (inside + outside) / 2;
}

// The head's outline seen along x, with the tip at the origin: for each position across (z) the
// interval of heights (y).
class Outline {
 public:
  Outline(const Bur& bur, const Quat& orientation, int lines)
      : reach_(std::hypot(bur.head_length(), bur.max_radius()) * 1.01), count_(lines) {
    const Mat3 to_bur = orientation.toRotationMatrix().transpose();
    lines_.resize(static_cast<std::size_t>(count_) + 1);
    for (int i = 0; i <= count_; ++i) {
      const double z = reach_ * (2.0 * i / count_ - 1);
      const auto depth = [&](double y) {
        const auto distance = [&](double x) {
          const Vec3 p = to_bur * Vec3(x, y, z);
          return bur.distance(std::hypot(p.x(), p.y()), p.z());
        };
        return distance(least_of(distance, -reach_, reach_));
      };
      const double middle = least_of(depth, -reach_, reach_);
      if (depth(middle) < 0)
        lines_[static_cast<std::size_t>(i)] = {sign_change(depth, middle, -reach_),
                                               sign_change(depth, middle, reach_)};
    }
  }

  double reach() const { return reach_; }
  Interval at(double z) const {
    const double place = (z / reach_ + 1) / 2 * count_;
    if (!(place >= 0 && place < count_)) return {};
    const auto i = static_cast<std::size_t>(place);
    const Interval &a = lines_[i], &b = lines_[i + 1];
    if (a.empty() || b.empty()) return {};
    const double t = place - static_cast<double>(i);
    return {a.low + t * (b.low - a.low), a.high + t * (b.high - a.high)};
  }

 private:
  double reach_;
  int count_;
  std::vector<Interval> lines_;
};

void take_away(std::vector<Interval>& from, const Interval& part) {
  std::vector<Interval> rest;
  for (const Interval& i : from)
    for (const Interval& piece : {Interval{i.low, std::min(i.high, part.low)},
                                  Interval{std::max(i.low, part.high), i.high}})
      if (!piece.empty()) rest.push_back(piece);
  from = std::move(rest);
}

}  // namespace

std::vector<PerTissue<double>> newly_swept_sections(const Bur& bur, const Quat& orientation,
                                                    const std::vector<Vec3>& tips,
                                                    const Block& block) {
  const Outline outline(bur, orientation, kLines);
  double first = std::numeric_limits<double>::infinity(), last = -first;
  for (const Vec3& tip : tips) {
    first = std::min(first, tip.z() - outline.reach());
    last = std::max(last, tip.z() + outline.reach());
  }
  first = std::max(first, -block.size.z() / 2);
  last = std::min(last, block.size.z() / 2);
  const auto lines = static_cast<int>(std::ceil((last - first) / outline.reach() * kLines));
  const double width = (last - first) / lines;
  std::vector<PerTissue<double>> area(tips.size(), PerTissue<double>{});
  for (int line = 0; line < lines; ++line) {
    const double z = first + (line + 0.5) * width;
    std::vector<Interval> swept;
    for (std::size_t pass = 0; pass < tips.size(); ++pass) {
      Interval own = outline.at(z - tips[pass].z());
      if (own.empty()) continue;
      own.low += tips[pass].y(), own.high += tips[pass].y();
      std::vector<Interval> fresh = {own};
      for (const Interval& earlier : swept) take_away(fresh, earlier);
      for (const Interval& i : fresh) {
        const auto within = [&](double low, double high) {
          return std::max(0.0, std::min(i.high, high) - std::max(i.low, low)) * width;
        };
        area[pass][tissue_index(Tissue::kEnamel)] += within(-block.enamel, 0);
        area[pass][tissue_index(Tissue::kDentin)] += within(-block.size.y(), -block.enamel);
      }
      swept.push_back(own);
    }
  }
  return area;
}

Load load_in_swept(const Scene& scene, const Bur& bur, const Quat& orientation,
                   const std::vector<Vec3>& tips, double speed, double size) {
  const Outline outline(bur, orientation, kFewLines);
  const SurfaceElements e = bur.elements(size, scene.clockwise);
  const Mat3 to_block = orientation.toRotationMatrix();
  const Vec3 half = scene.block.size / 2;
  Load load;
  for (std::size_t i = 0; i < e.size(); ++i) {
    const Vec3 n = to_block * Vec3(e.nx[i], e.ny[i], e.nz[i]);
    const double advance = speed * n.x();
    const Vec3 arm = to_block * Vec3(e.x[i], e.y[i], e.z[i]), at = tips.back() + arm;
    if (!(advance > 0) || at.y() > 0 || at.y() < -scene.block.size.y() ||
        std::abs(at.z()) > half.z())
      continue;
    bool swept = false;
    for (std::size_t pass = 0; !swept && pass + 1 < tips.size(); ++pass) {
      const Interval earlier = outline.at(at.z() - tips[pass].z());
      const double height = at.y() - tips[pass].y();
      swept = !earlier.empty() && height > earlier.low && height < earlier.high;
    }
    if (swept) continue;
    const bool enamel = at.y() >= -scene.block.enamel;
    const GrindingProperties& tissue = enamel ? scene.enamel : scene.dentin;
    const double power = tissue.specific_energy / (2 * units::kPi * scene.rotation_rate) * advance *
                         static_cast<double>(e.weight[i]);
    const Vec3 t = to_block * Vec3(e.tx[i], e.ty[i], 0);
    load.force += power * (t - n / tissue.force_ratio);
    load.torque += power * static_cast<double>(e.radius[i]);
    const int k = tissue_index(enamel ? Tissue::kEnamel : Tissue::kDentin);
    load.area[k] += static_cast<double>(e.area[i]);
    load.volume_rate[k] += advance * static_cast<double>(e.area[i]);
  }
  return load;
}

}  // namespace toothprep::reference
