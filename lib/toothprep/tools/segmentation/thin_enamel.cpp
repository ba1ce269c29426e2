#include "toothprep/tools/segmentation/thin_enamel.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/tools/segmentation/blurred_step.h"

namespace toothprep {
namespace {

constexpr double kThinnest = 0.6;      // scan voxels
constexpr double kStandardErrors = 3;  // of noise
constexpr double kLeastOvershoot =
    0.1;                             // above the dentin below, of the step from dentin to enamel
constexpr double kSameTissue = 0.3;  // likewise: the profile's inner end is dentin
constexpr double kInnerFrom = 3, kInnerTo = 4.5;  // where that end is, in `blur`

enum class Layer : std::uint8_t { kNone, kThin, kOther };  // other: thick enamel, not to be judged

struct Place {
  Layer layer = Layer::kOther;
  double surface = 0, thickness = 0;  // s, t of the header, voxels
  double cover = 0;                   // see ThinEnamel::Voxel
  double overshoot = 0;               // of the step
  bool bright = false;                // enamel by its grey alone
};

double step_slope(double z) { return std::exp(-0.5 * z * z) / std::sqrt(2 * M_PI); }

struct Fit {
  double surface = 0, thickness = 0, thickness_error = 0;  // voxels; one standard deviation
};

// Gauss and Newton from a layer of one scan voxel; the thickness stays positive. `sample_error`: that
// of one sample, if all of them were independent.
Fit fit_layer(const SurfaceProfiles& profiles, std::size_t p, double outer, double enamel,
              double inner, double sigma, double blur, double sample_error) {
  Fit fit{0, blur, 0};
  const float* grey = profiles.of(p);
  double ss = 0, st = 0, tt = 0;
  for (int iteration = 0; iteration < 12; ++iteration) {
    double rs = 0, rt = 0;
    ss = st = tt = 0;
    for (int i = 0; i < profiles.samples; ++i) {
      const double x = profiles.x(i);
      if (x < -2 * blur || x > kInnerFrom * blur) continue;
      const double a = (x - fit.surface) / sigma, b = (x - fit.surface - fit.thickness) / sigma;
      const double r = grey[i] - (outer + (enamel - outer) * blurred_step(a) -
                                  (enamel - inner) * blurred_step(b));
      const double by_t = (enamel - inner) * step_slope(b) / sigma,
                   by_s = by_t - (enamel - outer) * step_slope(a) / sigma;
      ss += by_s * by_s, st += by_s * by_t, tt += by_t * by_t;
      rs += by_s * r, rt += by_t * r;
    }
    const double determinant = ss * tt - st * st;
    if (!(determinant > 1e-12 * ss * tt)) return {0, 0, blur};
    const double ds = (tt * rs - st * rt) / determinant, dt = (ss * rt - st * rs) / determinant;
    const double most = 0.5 * blur;
    fit.surface += std::clamp(ds, -most, most);
    fit.thickness = std::max(fit.thickness + std::clamp(dt, -most, most), 0.05 * blur);
    if (std::abs(ds) + std::abs(dt) < 1e-3 * blur) break;
  }
  fit.thickness_error = sample_error * std::sqrt(ss / (ss * tt - st * st));
  return fit;
}

// What can be said before a fit: of one tissue, or brighter than the dentin further in.
void look(const SurfaceProfiles& profiles, std::size_t p, const GreyClasses& classes, double blur,
          Place& place) {
  const double step = classes.enamel - classes.dentin;
  double brightest = classes.surroundings;
  for (int s = profiles.before; profiles.x(s) <= kInnerFrom * blur; ++s)
    brightest = std::max<double>(brightest, profiles.of(p)[s]);
  place.bright = brightest > classes.dentin + 0.5 * step;
  const double inner = profiles.mean(p, kInnerFrom * blur, kInnerTo * blur),
               outer = profiles.mean(p, -3 * blur, -2 * blur);
  if (std::abs(inner - classes.dentin) > kSameTissue * step ||
      std::abs(outer - classes.surroundings) > 0.2 * (classes.dentin - classes.surroundings))
    return;
  place.layer = Layer::kNone;
  place.overshoot = std::max(brightest - inner, 0.0) / step;
}

// How far the profiles of bare dentin overshoot, with 3 standard deviations: from the lower part of
// their distribution, where no enamel is.
double overshoot_of_dentin(const std::vector<Place>& places) {
  constexpr double kThirdOfStep = 0.33;  // what surely has enamel
  std::vector<double> overshoots;
  for (const Place& p : places)
    if (p.layer == Layer::kNone && p.overshoot < kThirdOfStep) overshoots.push_back(p.overshoot);
  if (overshoots.size() < 200 || 10 * overshoots.size() < places.size()) return 0;
  const auto quantile = [&](double q) {
    const auto at = overshoots.begin() +
                    static_cast<std::ptrdiff_t>(q * static_cast<double>(overshoots.size()));
    std::nth_element(overshoots.begin(), at, overshoots.end());
    return *at;
  };
  // Of a normal distribution the tenth and third tenth lie 1.282 and 0.524 sigma below the middle.
  const double low = quantile(0.1), upper = quantile(0.3);
  const double sigma = (upper - low) / (1.282 - 0.524);
  return upper + (0.524 + kStandardErrors) * sigma;
}

std::vector<Place> judge_places(const SurfaceProfiles& profiles, const GreyClasses& classes,
                                double sigma, double noise, double blur) {
  std::vector<Place> places(profiles.count());
  tbb::parallel_for(std::size_t{0}, places.size(),
                    [&](std::size_t p) { look(profiles, p, classes, blur, places[p]); });
  const double least = std::max(kLeastOvershoot, overshoot_of_dentin(places));
  // A profile averages the noise of the scan voxels within 1.5 voxels along the surface, half of them
  // counted for their overlap; across, its samples are a quarter of a voxel apart.
  const double sample_error =
      noise * std::sqrt(1 / (0.5 * M_PI * 1.5 * 1.5)) * std::sqrt(blur / profiles.step);
  tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t p) {
    Place& place = places[p];
    if (place.layer != Layer::kNone || place.overshoot < least) return;
    const Fit fit =
        fit_layer(profiles, p, profiles.mean(p, -3 * blur, -2 * blur), classes.enamel,
                  profiles.mean(p, kInnerFrom * blur, kInnerTo * blur), sigma, blur, sample_error);
    if (fit.thickness < std::max(kThinnest * blur, kStandardErrors * fit.thickness_error)) return;
    place.layer = Layer::kThin;
    place.surface = fit.surface;
    place.thickness = fit.thickness;
    place.cover = std::erf(place.thickness / (sigma * M_SQRT2));
  });
  return places;
}

// Thin enamel is where enamel runs out: what no enamel is beside is something else, such as a rim of
// denser dentin.
void keep_beside_enamel(const SurfaceProfiles& profiles, std::vector<Place>& places) {
  std::vector<std::size_t> kept;
  std::vector<std::uint8_t> reached(places.size());
  for (std::size_t p = 0; p < places.size(); ++p)
    if (places[p].bright) kept.push_back(p), reached[p] = 1;
  while (!kept.empty()) {
    const Index3 at = profiles.voxel[kept.back()];
    kept.pop_back();
    profiles.for_each_around(at, [&](std::size_t p) {
      if (reached[p] || places[p].layer != Layer::kThin) return;
      reached[p] = 1;
      kept.push_back(p);
    });
  }
  for (std::size_t p = 0; p < places.size(); ++p)
    if (!reached[p] && places[p].layer == Layer::kThin) places[p].layer = Layer::kNone;
}

// The mean over the places around a voxel's foot on the surface, if most of them have thin enamel.
bool layer_around(const SurfaceProfiles& profiles, const std::vector<Place>& places, const Vec3& at,
                  const Vec3& foot, ThinEnamel::Voxel& voxel) {
  double above = 0, cover = 0;
  int thin = 0, all = 0;
  profiles.for_each_around(foot.array().round().cast<int>(), [&](std::size_t p) {
    ++all;
    if (places[p].layer != Layer::kThin) return;
    ++thin;
    const double depth = (at - profiles.voxel[p].cast<double>()).dot(profiles.inwards[p]) -
                         profiles.zero[p] - places[p].surface;
    above += places[p].thickness - depth;
    cover += places[p].cover;
  });
  if (2 * thin <= all) return false;
  voxel.above = static_cast<float>(above / thin);
  voxel.cover = static_cast<float>(cover / thin);
  return true;
}

// Blocks of voxels of which some lie within a distance of thin enamel.
class NearThinEnamel {
 public:
  NearThinEnamel(const SurfaceProfiles& profiles, const std::vector<Place>& places, int reach)
      : blocks_((profiles.size + Index3::Constant(kBlock - 1)) / kBlock),
        near_(static_cast<std::size_t>(blocks_.prod())) {
    for (std::size_t p = 0; p < places.size(); ++p) {
      if (places[p].layer != Layer::kThin) continue;
      const Index3 low = (profiles.voxel[p].array() - reach).max(0) / kBlock,
                   high = ((profiles.voxel[p].array() + reach) / kBlock).min(blocks_.array() - 1);
      for (int z = low.z(); z <= high.z(); ++z)
        for (int y = low.y(); y <= high.y(); ++y)
          std::fill_n(near_.data() + place(low.x(), y, z), high.x() - low.x() + 1, std::uint8_t{1});
    }
  }
  bool operator()(int i, int j, int k) const {
    return near_[place(i / kBlock, j / kBlock, k / kBlock)] != 0;
  }

 private:
  static constexpr int kBlock = 8;
  std::size_t place(int x, int y, int z) const {
    return (static_cast<std::size_t>(z) * blocks_.y() + y) * blocks_.x() + x;
  }
  Index3 blocks_;
  Mask near_;
};

}  // namespace

ThinEnamel find_thin_enamel(const WorkBox& box, SurfaceProfiles profiles, const SurfaceDepth& depth,
                            const BandField& level, const GreyClasses& classes, double sigma,
                            double noise, double blur, double outside) {
  std::vector<Place> places = judge_places(profiles, classes, sigma, noise, blur);
  std::vector<float>().swap(profiles.grey);
  keep_beside_enamel(profiles, places);
  ThinEnamel result;
  bool any = false;
  for (std::size_t p = 0; p < places.size(); ++p) {
    if (places[p].layer != Layer::kThin) continue;
    any = true;
    // A voxel's share of a surface that leans by its largest component.
    result.area += 1 / profiles.inwards[p].cwiseAbs().maxCoeff();
  }
  if (!any) return result;
  const double inside = kInnerFrom * blur;
  // From a voxel to its foot, and to the neighbours of the voxel that holds it.
  const NearThinEnamel near(profiles, places,
                            static_cast<int>(std::ceil(std::max(inside, outside) + 2)));
  std::vector<std::vector<ThinEnamel::Voxel>> planes(static_cast<std::size_t>(box.size.z()));
  for_each_of(box, level, [&](int i, int j, int k, std::size_t v) {
    if (!near(i, j, k) || depth[v] <= -outside || depth[v] >= inside) return;
    const Index3 index(i, j, k);
    const Vec3 inwards = inwards_at(box, level, index), at = index.cast<double>();
    ThinEnamel::Voxel voxel;
    voxel.at = v;
    if (layer_around(profiles, places, at, at - (depth[v] - 0.5) * inwards, voxel))
      planes[static_cast<std::size_t>(k)].push_back(voxel);
  });
  std::size_t count = 0;
  for (const auto& plane : planes) count += plane.size();
  result.voxels.reserve(count);
  for (auto& plane : planes) {
    result.voxels.insert(result.voxels.end(), plane.begin(), plane.end());
    std::vector<ThinEnamel::Voxel>().swap(plane);
  }
  return result;
}

}  // namespace toothprep
