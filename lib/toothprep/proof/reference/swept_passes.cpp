#include "toothprep/proof/reference/swept_passes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

constexpr int kLines = 12000;     // across the feed
constexpr int kFewLines = 1500;   // where a place is looked up: linear in between to 1e-6 mm
constexpr int kGoldenSteps = 40;  // to 4e-9 of the range
constexpr int kBisections = 34;   // to 6e-11 of it
constexpr double kGolden = 0.6180339887498949;
constexpr double kSure = 1e-6;  // mm: a distance beyond it has a sure sign, in spite of the above

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

// Whether f(least_of(f, low, high)) is below 0. The search ends where f, which is convex and no
// steeper than 1, leaves no doubt.
template <class F>
bool gets_below_zero(const F& f, double low, double high) {
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double fa = f(a), fb = f(b);
  for (int i = 0; i < kGoldenSteps; ++i) {
    const double less = std::min(fa, fb);
    if (less < -kSure) return true;
    if (less - (a - low) > kSure) return false;
    if (fa < fb) {
      high = b, b = a, fb = fa;
      a = high - kGolden * (high - low), fa = f(a);
    } else {
      low = a, a = b, fa = fb;
      b = low + kGolden * (high - low), fb = f(b);
    }
  }
  return f((low + high) / 2) < 0;
}

// The place between `inside` and `outside` where that changes.
template <class Within>
double border(const Within& within, double inside, double outside) {
  for (int i = 0; i < kBisections; ++i) {
    const double middle = (inside + outside) / 2;
    (within(middle) ? inside : outside) = middle;
  }
  return (inside + outside) / 2;
}

// The head's outline seen along x, with the tip at the origin: for each position across (z) the
// interval of heights (y).
class Outline {
 public:
  Outline(const Bur& bur, const Quat& orientation, int lines)
      : bur_(bur),
        to_bur_(orientation.toRotationMatrix().transpose()),
        reach_(std::hypot(bur.head_length(), bur.max_radius()) * 1.01),
        count_(lines),
        lines_(static_cast<std::size_t>(lines) + 1) {
    const int first = first_met(0, 1);
    const int last = first > count_ ? -1 : first_met(count_, -1);
    tbb::parallel_for(first, last + 1,
                      [&](int i) { lines_[static_cast<std::size_t>(i)] = heights(place(i)); });
    if (first > last) return;
    const auto met = [&](double z) { return !heights(z).empty(); };
    low_edge_ = border(met, place(first), place(first - 1));
    high_edge_ = border(met, place(last), place(last + 1));
    // As near to the edge as the heights are sure.
    at_low_edge_ = heights(low_edge_ + kSure);
    at_high_edge_ = heights(high_edge_ - kSure);
  }

  double reach() const { return reach_; }
  Interval at(double z) const {
    const double place = (z / reach_ + 1) / 2 * count_;
    if (!(place >= 0 && place < count_)) return {};
    if (!(z > low_edge_ && z < high_edge_)) return {};
    const auto i = static_cast<std::size_t>(place);
    Interval a = lines_[i], b = lines_[i + 1];
    double from = this->place(static_cast<int>(i)), to = this->place(static_cast<int>(i) + 1);
    if (a.empty()) a = at_low_edge_, from = low_edge_;
    if (b.empty()) b = at_high_edge_, to = high_edge_;
    const double t = (z - from) / (to - from);
    return {a.low + t * (b.low - a.low), a.high + t * (b.high - a.high)};
  }

 private:
  double place(int line) const { return reach_ * (2.0 * line / count_ - 1); }
  double distance(double x, double y, double z) const {
    const Vec3 p = to_bur_ * Vec3(x, y, z);
    return bur_.distance(std::hypot(p.x(), p.y()), p.z());
  }
  double depth(double y, double z) const {  // negative where the line along x meets the head
    const auto along = [&](double x) { return distance(x, y, z); };
    return along(least_of(along, -reach_, reach_));
  }
  double deepest(double z) const {
    return least_of([&](double y) { return depth(y, z); }, -reach_, reach_);
  }

  // Of the line across the feed at z that meets the head.
  Interval heights(double z) const {
    const double middle = deepest(z);
    if (!(depth(middle, z) < 0)) return {};
    const auto within = [&](double y) {
      return gets_below_zero([&](double x) { return distance(x, y, z); }, -reach_, reach_);
    };
    return {border(within, middle, -reach_), border(within, middle, reach_)};
  }

  // The first line from `line` on, in steps of +1 or -1, that may meet the head. As far as one is
  // away from it, those beside it can't.
  int first_met(int line, int step) const {
    while (line >= 0 && line <= count_) {
      const double z = place(line), away = depth(deepest(z), z);
      if (away < 0) break;
      line += step * std::max(1, static_cast<int>((away - kSure) / (2 * reach_ / count_)));
    }
    return line;
  }

  const Bur& bur_;
  Mat3 to_bur_;
  double reach_;
  int count_;
  std::vector<Interval> lines_;
  double low_edge_ = 0, high_edge_ = 0;  // between them the lines meet the head
  Interval at_low_edge_, at_high_edge_;
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

std::vector<PerTissue<double>> newly_swept_sections(const std::vector<StraightPass>& passes,
                                                    const Block& block) {
  std::vector<std::shared_ptr<const Outline>> outlines;  // by pass
  double first = std::numeric_limits<double>::infinity(), last = -first, reach = first;
  for (const StraightPass& p : passes) {
    const StraightPass* before = outlines.empty() ? nullptr : &p - 1;
    if (before && before->bur == p.bur && before->orientation.coeffs() == p.orientation.coeffs())
      outlines.push_back(outlines.back());
    else
      outlines.push_back(std::make_shared<Outline>(*p.bur, p.orientation, kLines));
    first = std::min(first, p.tip.z() - outlines.back()->reach());
    last = std::max(last, p.tip.z() + outlines.back()->reach());
    reach = std::min(reach, outlines.back()->reach());
  }
  first = std::max(first, -block.size.z() / 2);
  last = std::min(last, block.size.z() / 2);
  const auto lines = static_cast<int>(std::ceil((last - first) / reach * kLines));
  const double width = (last - first) / lines;
  std::vector<PerTissue<double>> area(passes.size(), PerTissue<double>{});
  for (int line = 0; line < lines; ++line) {
    const double z = first + (line + 0.5) * width;
    std::vector<Interval> swept;
    for (std::size_t pass = 0; pass < passes.size(); ++pass) {
      Interval own = outlines[pass]->at(z - passes[pass].tip.z());
      if (own.empty()) continue;
      own.low += passes[pass].tip.y(), own.high += passes[pass].tip.y();
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

std::vector<PerTissue<double>> newly_swept_sections(const Bur& bur, const Quat& orientation,
                                                    const std::vector<Vec3>& tips,
                                                    const Block& block) {
  std::vector<StraightPass> passes;
  for (const Vec3& tip : tips) passes.push_back({&bur, orientation, tip});
  return newly_swept_sections(passes, block);
}

std::vector<Load> loads_in_swept(const Scene& scene, const Bur& bur, const Quat& orientation,
                                 const std::vector<Vec3>& tips, const std::vector<double>& speeds,
                                 double size) {
  const Outline outline(bur, orientation, kFewLines);
  const SurfaceElements e = bur.elements(size, scene.clockwise);
  const Mat3 to_block = orientation.toRotationMatrix();
  const Vec3 half = scene.block.size / 2;
  const auto load_in = [&](std::size_t last) {
    Load load;
    for (std::size_t i = 0; i < e.size(); ++i) {
      const Vec3 n = to_block * Vec3(e.nx[i], e.ny[i], e.nz[i]);
      const double advance = speeds[last] * n.x();
      const Vec3 arm = to_block * Vec3(e.x[i], e.y[i], e.z[i]), at = tips[last] + arm;
      if (!(advance > 0) || at.y() > 0 || at.y() < -scene.block.size.y() ||
          std::abs(at.z()) > half.z())
        continue;
      bool swept = false;
      for (std::size_t pass = 0; !swept && pass < last; ++pass) {
        const Interval earlier = outline.at(at.z() - tips[pass].z());
        const double height = at.y() - tips[pass].y();
        swept = !earlier.empty() && height > earlier.low && height < earlier.high;
      }
      if (swept) continue;
      const bool enamel = at.y() >= -scene.block.enamel;
      const GrindingProperties& tissue = enamel ? scene.enamel : scene.dentin;
      const double power = tissue.specific_energy / (2 * units::kPi * scene.rotation_rate) *
                           advance * static_cast<double>(e.weight[i]);
      const Vec3 t = to_block * Vec3(e.tx[i], e.ty[i], 0);
      load.force += power * (t - n / tissue.force_ratio);
      load.torque += power * static_cast<double>(e.radius[i]);
      const int k = tissue_index(enamel ? Tissue::kEnamel : Tissue::kDentin);
      load.area[k] += static_cast<double>(e.area[i]);
      load.volume_rate[k] += advance * static_cast<double>(e.area[i]);
    }
    return load;
  };
  std::vector<Load> loads(tips.size());
  tbb::parallel_for(std::size_t{0}, loads.size(),
                    [&](std::size_t pass) { loads[pass] = load_in(pass); });
  return loads;
}

}  // namespace toothprep::reference
