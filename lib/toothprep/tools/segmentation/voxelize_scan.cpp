#include <malloc.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/blurred_step.h"
#include "toothprep/tools/segmentation/cavity.h"
#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/metal_surface.h"
#include "toothprep/tools/segmentation/near_distance.h"
#include "toothprep/tools/segmentation/plausibility.h"
#include "toothprep/tools/segmentation/scan_survey.h"
#include "toothprep/tools/segmentation/surface_uncertainty.h"
#include "toothprep/tools/segmentation/thin_enamel.h"
#include "toothprep/tools/segmentation/tooth_fields.h"
#include "toothprep/tools/segmentation/voxelize.h"
#include "toothprep/tools/segmentation/wide_vectors.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {
namespace {

// trilinear() at the box's voxels where the scan's axes are those of the box: the scan's rows are
// interpolated along x once for all rows of the box between them.
Field resample_along_axes(const ImageVolume<float>& scan, const WorkBox& box, float outside) {
  struct OnAxis {
    std::size_t base;  // the scan's voxel below
    double share;      // on the way to the next
    bool in;           // the scan
  };
  std::array<std::vector<OnAxis>, 3> along;
  std::array<std::size_t, 3> lowest;
  const Mat3 to_index = scan.to_index();
  for (int a = 0; a < 3; ++a) {
    for (int i = 0; i < box.size[a]; ++i) {
      const double x = to_index(a, a) * (box.centre(Index3::Unit(a) * i)[a] - scan.origin[a]);
      const double within = std::clamp(x, 0.0, scan.size[a] - 1.0);
      const int base = std::min(static_cast<int>(within), scan.size[a] - 2);
      along[a].push_back({static_cast<std::size_t>(base), within - base,
                          x >= -0.5 && scan.size[a] - 0.5 - x >= 0});
    }
    lowest[a] = std::min(along[a].front().base, along[a].back().base);
  }
  const auto nx = static_cast<std::size_t>(box.size.x()),
             row = static_cast<std::size_t>(scan.size.x()),
             plane = row * static_cast<std::size_t>(scan.size.y());
  const std::size_t rows =
      std::max(along[1].front().base, along[1].back().base) + 2 - lowest[1];  // of the scan
  Field grey(box.voxels());
  tbb::parallel_for(0, box.size.z(), [&](int k) {
    const OnAxis& z = along[2][static_cast<std::size_t>(k)];
    std::array<std::vector<double>, 2> slices;
    for (std::size_t s = 0; s < 2; ++s) {
      slices[s].resize(rows * nx);
      for (std::size_t r = 0; r < rows; ++r) {
        const float* in = scan.data.data() + (z.base + s) * plane + (lowest[1] + r) * row;
        double* out = slices[s].data() + r * nx;
        for (std::size_t i = 0; i < nx; ++i) {
          const OnAxis& x = along[0][i];
          out[i] = in[x.base] + x.share * (in[x.base + 1] - in[x.base]);
        }
      }
    }
    with_wide_vectors([&] {
      for (int j = 0; j < box.size.y(); ++j) {
        const OnAxis& y = along[1][static_cast<std::size_t>(j)];
        float* out = grey.data() + box.offset(0, j, k);
        const std::size_t first = (y.base - lowest[1]) * nx;
        const double *a = slices[0].data() + first, *b = a + nx, *c = slices[1].data() + first,
                     *d = c + nx;
        const double share_y = y.share, share_z = z.share;
        for (std::size_t i = 0; i < nx; ++i) {
          const double ab = a[i] + share_y * (b[i] - a[i]), cd = c[i] + share_y * (d[i] - c[i]);
          out[i] = static_cast<float>(ab + share_z * (cd - ab));
        }
        for (std::size_t i = 0; i < nx; ++i)
          if (!(along[0][i].in && y.in && z.in)) out[i] = outside;
      }
    });
  });
  return grey;
}

// Greys on the box's lattice: linear between the scan's voxels, averaged over the output voxel
// where that is coarser; `outside` beyond the border of the scan's outermost voxels.
Field resample(const ImageVolume<float>& scan, const WorkBox& box, double outside) {
  const double ratio = box.lattice.voxel / scan.spacing.minCoeff();
  const int points_per_axis = ratio > 1.25 ? std::min(8, static_cast<int>(std::ceil(ratio))) : 1;
  if (points_per_axis == 1 && scan.to_index().isDiagonal(0))
    return resample_along_axes(scan, box, static_cast<float>(outside));
  Field grey(box.voxels());
  const Vec3 last = scan.size.cast<double>() - Vec3::Constant(0.5);
  for_each_point_set(scan, box, points_per_axis,
                     [&](std::size_t v, const Vec3& centre, const std::vector<Vec3>& points) {
                       double sum = 0;
                       for (const Vec3& p : points) {
                         const Vec3 x = centre + p;
                         const bool in = x.minCoeff() >= -0.5 && (last - x).minCoeff() >= 0;
                         sum += in ? trilinear(scan.size, scan.data, x) : outside;
                       }
                       grey[v] = static_cast<float>(sum / static_cast<double>(points.size()));
                     });
  return grey;
}

constexpr std::size_t kGreysOfNoise = 1000000;  // that noise is judged by

// Standard deviation of the surroundings' noise; 0 if there are too few of them.
double noise_of(const Field& grey, const GreyClasses& classes) {
  Field below;
  const std::size_t n = 1 + grey.size() / kGreysOfNoise;
  for (std::size_t v = 0; v < grey.size(); v += n)
    if (grey[v] < classes.threshold_dentin) below.push_back(grey[v]);
  if (below.size() < 100) return 0;
  const auto median = [](Field& values) {
    std::nth_element(values.begin(),
                     values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2];
  };
  const float centre = median(below);
  for (float& g : below) g = std::abs(g - centre);
  return 1.4826 * median(below);
}

// The smoothing (in output voxels) that brings noise down to a seventh of the half contrasts that
// decide.
double smoothing_for(double noise, const GreyClasses& classes, double blur) {
  const double contrast =
      0.5 * std::min(classes.dentin - classes.surroundings, classes.enamel - classes.dentin);
  for (const double sigma : {0.0, 0.5, 0.7, 0.9, 1.1}) {
    // White noise, smoothed in three dimensions.
    const double rest = sigma > 0 ? std::pow(2 * std::sqrt(M_PI) * sigma, -1.5) : 1;
    if (noise * rest <= 0.15 * contrast) return sigma * blur;
  }
  return 1.1 * blur;
}

// Islands of enamel in dentin and of dentin in enamel go to the tissue around them, as do the
// remains of a border's greys in narrow fissures; pieces of at least a twentieth of the largest
// stay.
// in_domain(first, end, out) writes ones where islands are sought.
template <class InDomain>
void clean_islands(const WorkBox& box, const InDomain& in_domain, const Cavity& cavity,
                   Mask& enamel) {
  Mask part(static_cast<std::size_t>(box.size.x()));  // of a row
  for (const bool of_enamel : {true, false}) {
    const MaskParts pieces = parts_of(box.size, [&](std::size_t row) {
      const std::size_t first = row * part.size();
      const std::uint8_t* of = enamel.data() + first;
      const std::uint8_t other = of_enamel ? 0 : 1;
      std::uint8_t* out = part.data();
      in_domain(first, first + part.size(), out);
      for (std::size_t i = 0, n = part.size(); i < n; ++i) out[i] &= of[i] ^ other;
      cavity.for_each(first, first + part.size(), [&](std::size_t v) { out[v - first] = 0; });
      return part.data();
    });
    pieces.for_each([&](std::size_t first, std::size_t end, std::size_t piece) {
      if (20 * pieces.voxels[piece] < pieces.voxels[0])
        std::fill(enamel.data() + first, enamel.data() + end, std::uint8_t{!of_enamel});
    });
  }
}

// What lies under the outer surface, for voxels around it.
struct UnderSurface {
  BandField
      plateau;  // grey of the tissue here, without the surroundings' share, where it isn't grey's
  BandField cover;  // how much the tissue under the surface is enamel, 0..1: where near_surface()
};

// Also that far outside, in voxels, so that interfaces between tissues run on through the surface.
constexpr double kReach = kBandVoxels + 1;

// The depth to which the surroundings shine through, and how far depths must be known, voxels.
double skin_depth(double blur) { return 3 * blur; }
double far_depth(double blur) { return std::max(skin_depth(blur), kReach) + 2 * blur; }
// Where the surface can be: on both sides of what was found at voxel accuracy.
bool near_surface(float depth, double blur) { return depth > -kReach && depth <= 1.5 * blur; }

// The grey that parts dentin and enamel at a depth below the surface (voxels). A layer of enamel
// that is little thicker than the blur doesn't reach enamel's grey: by half-way greys it would be
// lost below 1.5 scan voxels. So near the surface less is asked for, still more than noise makes
// after smoothing.
float enamel_border(const GreyClasses& classes, double depth, double blur) {
  constexpr double kAtSurface = 0.33, kHalfWay = 0.5;
  const double share =
      kAtSurface + (kHalfWay - kAtSurface) * std::clamp(depth / blur - 1, 0.0, 1.0);
  return static_cast<float>(classes.dentin + share * (classes.enamel - classes.dentin));
}

// Enamel that is too thin for enamel_border(): there the tissue's grey is what gives the fitted
// border, and the surface's threshold what the fitted layer has at its surface.
void apply_thin_enamel(const ThinEnamel& thin, const SurfaceDepth& depth,
                       const GreyClasses& classes, double sigma, double blur, UnderSurface& under) {
  const double slope = steepest(sigma);  // of a blurred border
  for (const ThinEnamel::Voxel& v : thin.voxels) {
    const double share = std::clamp(slope * v.above, -0.5, 0.5);
    under.plateau[v.at] = enamel_border(classes, depth[v.at], blur) +
                          static_cast<float>(share * (classes.enamel - classes.dentin));
    if (near_surface(depth[v.at], blur)) under.cover[v.at] = v.cover;
  }
}

// What greys along the surface's normals show.
struct AlongNormals {
  double sigma = 0;       // of the scan's blur, voxels
  bool measured = false;  // else that is what is usual
  ThinEnamel thin;        // applied to what lies under the surface
  MetalSurface metal;
};

// The cover, smoothed: a gradual transition at the cervix, also where thin enamel begins.
void smooth_cover(const WorkBox& box, const SurfaceDepth& depth, const Mask& chunks, double blur,
                  BandField& cover) {
  const std::size_t area = box.offset(0, 0, 1);
  const auto planes_of = [&](const auto& value) {
    return [&, value](int k, float* plane) {
      const std::size_t first = static_cast<std::size_t>(k) * area;
      std::fill(plane, plane + area, 0.0f);
      cover.for_each(first, first + area, [&](std::size_t v) { plane[v - first] = value(v); });
    };
  };
  BandField result(chunks);
  smooth_where(box.size, blur, result,
               planes_of([&](std::size_t v) { return near_surface(depth[v], blur) ? 1.0f : 0.0f; }),
               [&](std::size_t v, float weight) { result[v] = weight; });
  smooth_where(box.size, blur, result, planes_of([&](std::size_t v) { return cover[v]; }),
               [&](std::size_t v, float value) {
                 result[v] = result[v] > 1e-3f ? value / result[v] : 0.0f;
               });
  cover = std::move(result);
}

// Below the outer surface greys are mixed with the surroundings': over enamel they pass through
// dentin's, which by thresholds alone would put a layer of dentin on the enamel. So a voxel takes
// the brightest grey on its way inwards: that of the tissue underneath, since enamel is brighter
// and never under dentin. `depth` is the depth below the surface at voxel accuracy, `level` a field
// whose gradient points inwards.
UnderSurface look_under_surface(const WorkBox& box, const TrimmedField& grey,
                                const SurfaceDepth& depth, BandField level,
                                const GreyClasses& classes, double blur,
                                const AlongNormals& along) {
  constexpr double kRounding = 1e-4;
  const double skin = skin_depth(blur);
  const auto in_skin = [&](float d) { return d > -kReach && d < skin; };
  Mask chunks = depth.chunks_where(in_skin);
  for (const MetalSurface::Voxel& v : along.metal.voxels) chunks[v.at / BandField::kChunk] = 1;
  UnderSurface under{BandField(chunks), {}};
  chunks = depth.chunks_where([&](float d) { return near_surface(d, blur); });
  under.cover = BandField(chunks);

  const double step = 0.5 * blur;
  const double half_step = (0.5 + kRounding) * (classes.enamel - classes.dentin),
               all_enamel = classes.dentin + 2 * half_step;
  for_each_of(box, under.plateau, [&](int i, int j, int k, std::size_t v) {
    under.plateau[v] = grey[v];
    if (!in_skin(depth[v])) return;
    const Index3 index(i, j, k);
    const Vec3 inwards = inwards_at(box, level, index);
    const auto at_depth = [&](double s) {
      return trilinear(box.size, grey, index.cast<double>() + inwards * (s - depth[v]));
    };
    // As bright as this it is enamel, without a share of dentin: more makes no difference.
    const bool near = near_surface(depth[v], blur);
    const double enough = near ? all_enamel : enamel_border(classes, depth[v], blur) + half_step;
    float brightest = depth[v] >= 0 ? grey[v] : at_depth(0);
    for (double s = std::max<double>(depth[v], 0) + step;
         s < skin + 0.5 * step && brightest < enough; s += step)
      brightest = std::max(brightest, at_depth(s));
    under.plateau[v] = brightest;
    if (!near) return;
    for (double s = 0; s < depth[v] && brightest < enough; s += step)
      brightest = std::max(brightest, at_depth(s));
    under.cover[v] = static_cast<float>(
        std::clamp((brightest - classes.dentin) / (classes.enamel - classes.dentin), 0.0, 1.0));
  });

  level = BandField();
  apply_thin_enamel(along.thin, depth, classes, along.sigma, blur, under);
  smooth_cover(box, depth, chunks, blur, under.cover);
  return under;
}

// What of the metal's surface lies at a voxel, if any.
const MetalSurface::Voxel* metal_at(const MetalSurface& metal, std::size_t at) {
  const auto v = std::lower_bound(
      metal.voxels.begin(), metal.voxels.end(), at,
      [](const MetalSurface::Voxel& voxel, std::size_t place) { return voxel.at < place; });
  return v != metal.voxels.end() && v->at == at ? &*v : nullptr;
}

// How far a voxel lies below the metal's surface, as a share of the step there.
float below_metal(const MetalSurface::Voxel& v, double sigma, double most) {
  return signed_as(v.inside > 0,
                   static_cast<float>(std::clamp(steepest(sigma) * v.inside, -most, most)));
}

// Within the blur around metal the tissue's grey is the one beyond that.
void look_beyond_metal(const MetalSurface& metal, const SurfaceDepth& depth,
                       const GreyClasses& classes, double blur, UnderSurface& under) {
  for (const MetalSurface::Voxel& v : metal.voxels)
    under.plateau[v.at] = enamel_border(classes, depth[v.at], blur) +
                          static_cast<float>(v.outer - classes.threshold_enamel);
}

// Zero where the grey is half-way between the surroundings and the tissue underneath. Where air is
// beyond metal, the solid ends where the metal does.
SignedField solid_field(const WorkBox& box, const TrimmedField& grey, const SurfaceDepth& depth,
                        const Cavity& cavity, const UnderSurface& under, const AlongNormals& along,
                        const GreyClasses& classes, double blur) {
  const double over_dentin = classes.threshold_dentin;
  const double over_enamel = std::max(over_dentin, 0.5 * (classes.surroundings + classes.enamel));
  const double contrast = classes.dentin - classes.surroundings;
  const auto value_at = [&](std::size_t v) {
    const bool in_cavity = cavity.holds(v);
    const bool rough = depth[v] > 0;
    float value = rough ? 0.5f : -0.5f;
    if (near_surface(depth[v], blur)) {
      const double border = over_dentin + under.cover[v] * (over_enamel - over_dentin);
      value = static_cast<float>(std::clamp((grey[v] - border) / contrast, -1.0, 1.0));
    }
    // At an open apex the solid ends where the ball from the outside does.
    if (in_cavity)
      value = static_cast<float>(std::min(0.5, 0.5 * (cavity.from_outside[v] - cavity.ball)));
    return signed_as(rough && (value > 0 || in_cavity), value);
  };
  Mask solid(box.voxels());
  // Where all is deep inside or far outside, one voxel says it for all: a cavity is inside, too.
  depth.for_each_chunk([&](std::size_t first, std::size_t end, bool far) {
    if (far)
      std::fill(solid.data() + first, solid.data() + end,
                static_cast<std::uint8_t>(depth[first] > 0));
    else
      for (std::size_t v = first; v < end; ++v) solid[v] = value_at(v) > 0;
  });
  keep_largest_component(box.size, solid);
  fill_enclosed(box.size, solid);
  const auto ends_at_metal = [&](const MetalSurface::Voxel& v) {
    return v.outer < classes.threshold_dentin && depth[v.at] < skin_depth(blur);
  };
  for (const MetalSurface::Voxel& v : along.metal.voxels)
    if (ends_at_metal(v)) solid[v.at] = v.inside > 0;
  return SignedField(box.size, solid, 1, [&](std::size_t v) {
    const MetalSurface::Voxel* metal = metal_at(along.metal, v);
    return metal && ends_at_metal(*metal) ? below_metal(*metal, along.sigma, 1)
                                          : signed_as(solid[v], value_at(v));
  });
}

// The tissues against each other, by their greys without the surroundings' share; beside metal they
// end at its surface, between voxels.
void add_tissue_fields(const WorkBox& box, const TrimmedField& grey, const SurfaceDepth& depth,
                       const Cavity& cavity, const BandField& plateau, const AlongNormals& along,
                       const GreyClasses& classes, double blur, ToothFields& fields) {
  const auto above_border = [&](std::size_t v) {
    return (plateau.has(v) ? plateau[v] : grey[v]) - enamel_border(classes, depth[v], blur);
  };
  const auto in_domain = depth.above(-kReach);
  Mask metal = along.metal.metal;
  for (const MetalSurface::Voxel& v : along.metal.voxels) metal[v.at] = v.inside > 0;
  const bool has_pulp = !cavity.empty(), has_metal = !metal.empty();
  const auto in_pulp = [&](std::size_t v) { return cavity.holds(v); };
  const auto in_metal = [&](std::size_t v) { return has_metal && metal[v]; };
  Mask enamel(box.voxels());
  depth.for_each_chunk([&](std::size_t first, std::size_t end, bool far) {
    if (far && !in_domain(first)) return;
    if (far && !has_metal && !plateau.has(first)) {
      const float border = enamel_border(classes, depth[first], blur);
      const float* in = grey.at(first);
      for (std::size_t v = first; v < end; ++v) enamel[v] = in[v - first] > border;
    } else {
      for (std::size_t v = first; v < end; ++v)
        enamel[v] = in_domain(v) && !in_metal(v) && above_border(v) > 0;
    }
  });
  // First in the solid alone, where an island can't hide behind its connection through the outside.
  clean_islands(
      box,
      [&](std::size_t first, std::size_t end, std::uint8_t* out) {
        fields.solid.signs(first, static_cast<int>(end - first), out);
      },
      cavity, enamel);
  clean_islands(
      box,
      [&](std::size_t first, std::size_t end, std::uint8_t* out) {
        depth.above(-kReach, first, end, out);
      },
      cavity, enamel);

  // Potentials against dentin, whose own is zero.
  const auto scaled = [](double difference, double contrast) {
    return static_cast<float>(std::clamp(difference / contrast, -0.5, 0.5));
  };
  // From here on the tissues, of what is outside the solid as well.
  const auto code = [](Tissue t) { return static_cast<std::uint8_t>(t); };
  std::vector<std::uint8_t> label = std::move(enamel);
  box.for_each_row([&](int, int, std::size_t first, std::size_t end) {
    std::uint8_t* of = label.data();
    const std::uint8_t of_enamel = code(Tissue::kEnamel), of_dentin = code(Tissue::kDentin);
    for (std::size_t v = first; v < end; ++v) of[v] = of[v] ? of_enamel : of_dentin;
    cavity.for_each(first, end, [&](std::size_t v) { of[v] = code(Tissue::kPulp); });
    const std::uint8_t *in = metal.data(), of_metal = code(Tissue::kOther);
    for (std::size_t v = first; has_metal && v < end; ++v) of[v] = in[v] ? of_metal : of[v];
  });
  const auto of_enamel = [&](std::size_t v) {
    return signed_as(label[v] == code(Tissue::kEnamel),
                     scaled(above_border(v), classes.enamel - classes.dentin));
  };
  const auto of_pulp = [&](std::size_t v) {
    return signed_as(in_pulp(v), scaled(cavity.border - grey[v], classes.dentin - cavity.grey));
  };
  const auto field_of = [&](Tissue tissue, const auto& value) {
    return SignedField(box.size, label, code(tissue), [&](std::size_t v) {
      const float here = in_metal(v) ? -0.5f : value(v);
      const MetalSurface::Voxel* end = metal_at(along.metal, v);
      if (!end) return here;
      const float inside = below_metal(*end, along.sigma, 0.5);
      return inside > 0 ? -inside : std::min(here, -inside);
    });
  };
  fields.tissue[0] = field_of(
      Tissue::kEnamel, [&](std::size_t v) { return in_pulp(v) ? -of_pulp(v) : of_enamel(v); });
  fields.tissue[1] = field_of(Tissue::kDentin, [&](std::size_t v) {
    return has_pulp ? -std::max(of_enamel(v), of_pulp(v)) : -of_enamel(v);
  });
  if (has_pulp) fields.tissue[2] = field_of(Tissue::kPulp, of_pulp);
  box.for_each_row([&](int, int, std::size_t first, std::size_t end) {
    Mask solid(end - first);
    fields.solid.signs(first, box.size.x(), solid.data());
    const std::uint8_t *in = solid.data(), air = code(Tissue::kAir);
    std::uint8_t* of = label.data() + first;
    for (std::size_t i = 0, n = end - first; i < n; ++i) of[i] = in[i] ? of[i] : air;
  });
  fields.label = std::move(label);
}

// A scanner's range ends where many voxels have the very same highest value.
std::optional<double> clip_of(const ScanSurvey& seen, std::size_t scan_voxels) {
  if (static_cast<double>(seen.voxels_at_highest) > 1e-4 * static_cast<double>(scan_voxels) &&
      seen.values.size() >= kManyValues)
    return seen.highest;
  return {};
}

AlongNormals look_along_normals(const WorkBox& box, const ScanSurvey& seen, std::size_t scan_voxels,
                                const TrimmedField& grey, const SurfaceDepth& depth,
                                const BandField& level, const GreyClasses& classes, double blur,
                                bool thin_enamel) {
  AlongNormals result;
  thin_enamel = thin_enamel && classes.enamel_seen;
  if (!thin_enamel && !classes.threshold_metal) return result;
  const ImageVolume<float>& scan = *seen.greys;
  {
    SurfaceProfiles profiles =
        surface_profiles(box, scan, grey, depth, level, classes.threshold_dentin, blur);
    const std::optional<double> sigma = edge_sigma(profiles, classes, blur);
    constexpr double kUsual = 0.6;  // of the scan's voxel
    result.measured = sigma.has_value();
    result.sigma = sigma.value_or(kUsual * blur);
    if (sigma && thin_enamel) {
      const double noise = noise_of(scan.data, classes);
      result.thin = find_thin_enamel(box, std::move(profiles), depth, level, classes, *sigma, noise,
                                     blur, kReach);
    }
  }
  if (!classes.threshold_metal) return result;
  Mask domain(box.voxels());
  depth.above(-kReach, 0, domain.size(), domain.data());
  result.metal = find_metal_surface(box, scan, grey, domain, classes, clip_of(seen, scan_voxels),
                                    result.sigma, blur);
  return result;
}

// A segmentation read as greys would give a tooth all the same, of the wrong tissues.
void refuse_segmentation(std::vector<float> values) {
  // A flat image is said elsewhere; a scan of two or more greys has hundreds.
  if (values.size() < 2 || values.size() >= kManyValues) return;
  std::sort(values.begin(), values.end());
  std::string list;
  for (const float v : values) list += (list.empty() ? "" : ", ") + short_number(v);
  throw Error(
      "holds only the values " + list +
      ", which looks like a segmentation; name its labels with --labels, or give --thresholds");
}

VoxelRange voxels_in(const ImageFrame& scan, const WorkBox& box) {
  const double half = 0.5 * box.lattice.voxel;
  return voxels_around(scan, {box.centre(Index3::Zero()) - Vec3::Constant(half),
                              box.centre(box.size - Index3::Ones()) + Vec3::Constant(half)});
}

// Other teeth in the box give way to the surroundings, with the blur around them.
void remove_others(const WorkBox& box, const GreyClasses& classes, double blur, Field& grey) {
  if (classes.others.empty()) return;
  const std::size_t n = box.voxels();
  Mask bright(n), other(n);
  for (std::size_t v = 0; v < n; ++v) bright[v] = grey[v] >= classes.threshold_dentin;
  const MaskParts parts = parts_of(box.size, bright);
  // A component belongs to what most of it was found to be part of.
  const ImageFrame& means = classes.others_frame;
  const Mat3 to_index = means.to_index();
  std::vector<std::size_t> votes(parts.count(), 0);
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    for (std::size_t v = first; v < end; ++v) {
      const Vec3 at = to_index * (box.centre(index_of(box.size, v)) - means.origin);
      const Index3 m = at.array().round().cast<int>();
      if (m.minCoeff() < 0 || (means.size - m).minCoeff() <= 0) continue;
      votes[part] +=
          classes
              .others[(static_cast<std::size_t>(m.z()) * means.size.y() + m.y()) * means.size.x() +
                      m.x()];
    }
  });
  bool any = false;
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    if (2 * votes[part] <= parts.voxels[part]) return;
    any = true;
    std::fill(bright.data() + first, bright.data() + end, std::uint8_t{0});
    std::fill(other.data() + first, other.data() + end, std::uint8_t{1});
  });
  if (!any) return;
  const auto reach = static_cast<float>(2 * blur + 1);
  const int most = static_cast<int>(std::ceil(reach));
  const NearDistance to_other(box.size, other, most), to_tooth(box.size, bright, most);
  for (std::size_t v = 0; v < n; ++v)
    if (to_other[v] <= reach && to_other[v] < to_tooth[v])
      grey[v] = static_cast<float>(classes.surroundings);
}

// A one for each chunk that holds a voxel not farther along any axis than `reach` voxels from one at least as
// bright as `least`, or that lies between two such voxels along x.
Mask chunks_near_bright(const WorkBox& box, const Field& grey, float least, int reach) {
  std::vector<RowPart> rows(static_cast<std::size_t>(box.size.y()) *
                            static_cast<std::size_t>(box.size.z()));
  const auto row_of = [&](int j, int k) {
    return static_cast<std::size_t>(k) * static_cast<std::size_t>(box.size.y()) +
           static_cast<std::size_t>(j);
  };
  box.for_each_row([&](int j, int k, std::size_t first, std::size_t) {
    const float* values = grey.data() + first;
    RowPart part{0, box.size.x()};
    while (part.first < part.end && values[part.first] < least) ++part.first;
    while (part.first < part.end && values[part.end - 1] < least) --part.end;
    rows[row_of(j, k)] = part.first < part.end ? part : RowPart{box.size.x() + reach, -reach};
  });
  for (const int axis : {1, 2}) {
    const std::vector<RowPart> own = rows;
    for (int k = 0; k < box.size.z(); ++k)
      for (int j = 0; j < box.size.y(); ++j) {
        const int at = axis == 1 ? j : k;
        RowPart& part = rows[row_of(j, k)];
        for (int n = std::max(0, at - reach); n <= std::min(box.size[axis] - 1, at + reach); ++n) {
          const RowPart& other = own[axis == 1 ? row_of(n, k) : row_of(j, n)];
          part = {std::min(part.first, other.first), std::max(part.end, other.end)};
        }
      }
  }
  Mask chunks((grey.size() + BandField::kChunk - 1) / BandField::kChunk);
  for (int k = 0; k < box.size.z(); ++k)
    for (int j = 0; j < box.size.y(); ++j) {
      const RowPart& part = rows[row_of(j, k)];
      const int first = std::max(0, part.first - reach),
                end = std::min(box.size.x(), part.end + reach);
      if (first >= end) continue;
      const auto from = static_cast<std::ptrdiff_t>(box.offset(first, j, k) / BandField::kChunk),
                 to = static_cast<std::ptrdiff_t>(box.offset(end - 1, j, k) / BandField::kChunk);
      std::fill(chunks.begin() + from, chunks.begin() + to + 1, std::uint8_t{1});
    }
  return chunks;
}

// The scan's greys on the box's lattice, without other teeth, smoothed; from as far around the tooth as
// depths are known on those of the surroundings. `noise`: what is left of it.
TrimmedField greys_around_tooth(const WorkBox& box, const ImageVolume<float>& scan,
                                const GreyClasses& classes, double blur, double& noise) {
  Field grey = resample(scan, box, classes.surroundings);
  remove_others(box, classes, blur, grey);
  smooth(box.size, grey, smoothing_for(noise_of(grey, classes), classes, blur));
  noise = noise_of(grey, classes);
  const Mask chunks = chunks_near_bright(box, grey, not_below(classes.threshold_dentin),
                                         static_cast<int>(std::ceil(far_depth(blur))));
  return {chunks, grey, static_cast<float>(classes.surroundings)};
}

// The voxel in which surfaces are sought, mm: the tooth's, or as fine as the scan has something to say
// where the tooth's is much finer.
double working_voxel(const ImageFrame& scan, double voxel) {
  constexpr double kOfScan = 0.6, kMuch = 1.3;
  const double fine = kOfScan * scan.spacing.minCoeff();
  return fine > kMuch * voxel ? fine : voxel;
}

struct ToothBoxes {
  WorkBox work, tooth;  // surfaces are sought in the first, whose voxels aren't smaller
  double
      blur;  // width of the scan's borders, in voxels of the first: one of the scan, or of the box
  int margin;  // around the tooth, in voxels of the first
};

ToothBoxes boxes_around_tooth(const ImageFrame& scan, const GreyClasses& classes, double voxel,
                              const VoxelizeOptions& options) {
  const auto blur_of = [&](double mm) { return std::max(1.0, scan.spacing.maxCoeff() / mm); };
  const auto margin_of = [&](double mm) {
    return static_cast<int>(std::ceil(blur_of(mm))) + static_cast<int>(kReach);
  };
  const WorkBox tooth = box_around(scan, classes.box_min, classes.box_max, options.voxel,
                                   margin_of(options.voxel), options.announce, voxel);
  const WorkBox work = voxel == options.voxel ? tooth
                                              : box_around(scan, classes.box_min, classes.box_max,
                                                           voxel, margin_of(voxel));
  return {work, tooth, blur_of(voxel), margin_of(voxel)};
}

// To the system: what one thread freed another one's heap would not use. Of the C library's heap (the Python module's);
// the program's own gives memory back by itself.
void return_free_memory() { malloc_trim(0); }

std::string place(const Vec3& x) {
  return "(" + short_number(x.x()) + ", " + short_number(x.y()) + ", " + short_number(x.z()) + ")";
}

// What a person ought to look at.
void add_notes(const GreyClasses& classes, const ScanSurvey& seen, std::size_t scan_voxels,
               const WorkBox& box, const Cavity& cavity, const VoxelizeOptions& options,
               VoxelizeReport& report) {
  if (options.typical && classes.darkest > -200)
    report.notes.push_back("the scan's darkest grey is " + short_number(classes.darkest) +
                           ", where air has -1000 Hounsfield units: are these Hounsfield units? "
                           "(cone-beam CT has others)");
  if (classes.pieces.size() > 1) {
    std::string list;
    for (std::size_t p = 0; p < classes.pieces.size(); ++p)
      list += (p ? ", " : "") + std::to_string(p + 1) + ": " +
              short_number(classes.pieces[p].volume) + " mm3 at " + place(classes.pieces[p].centre);
    report.notes.push_back(std::to_string(classes.pieces.size()) + " pieces could be teeth (" +
                           list + "); number " + std::to_string(classes.chosen + 1) +
                           " was taken (--tooth chooses)");
  }
  if (options.thin_enamel && !classes.enamel_seen)
    report.notes.push_back("too little of the tooth is as bright as enamel (" +
                           short_number(classes.threshold_enamel) +
                           ") to know enamel's grey, so thin enamel was not sought");
  if (classes.touches_edge)
    report.notes.push_back(
        "the tooth reaches the border of the scan; it is cut off there by a flat face");
  if (classes.threshold_metal)
    report.notes.push_back("what is brighter than " + short_number(*classes.threshold_metal) +
                           " is too bright for enamel (metal, a filling?); it is labelled other, "
                           "and borders beside it are uncertain");
  if (clip_of(seen, scan_voxels) &&
      seen.highest > classes.enamel - 0.1 * (classes.enamel - classes.dentin))
    report.notes.push_back(std::to_string(seen.voxels_at_highest) +
                           " voxels have the scan's highest grey value " +
                           short_number(seen.highest) +
                           ", where it seems to be clipped: metal, or enamel beyond the scanner's "
                           "range; borders there are uncertain");
  if (cavity.empty()) {
    report.notes.push_back("no pulp cavity was found inside the dentin");
  } else {
    Mask pulp(static_cast<std::size_t>(box.size.x()));  // of a row
    const MaskParts parts = parts_of(box.size, [&](std::size_t row) {
      const std::size_t first = row * pulp.size();
      std::fill(pulp.begin(), pulp.end(), std::uint8_t{0});
      cavity.for_each(first, first + pulp.size(), [&](std::size_t v) { pulp[v - first] = 1; });
      return pulp.data();
    });
    const double voxel = std::pow(box.lattice.voxel, 3);
    std::size_t large = 0;
    std::string list;
    for (std::size_t p = 0; p < parts.count(); ++p)
      if (static_cast<double>(parts.voxels[p]) * voxel > 0.2 &&
          50 * parts.voxels[p] > parts.voxels[0]) {
        ++large;
        list += (list.empty() ? "" : ", ") +
                short_number(static_cast<double>(parts.voxels[p]) * voxel) + " mm3";
      }
    if (large > 1)
      report.notes.push_back("the pulp is in " + std::to_string(large) + " pieces (" + list +
                             "): canals that are finer than the scan, or caries or cracks");
  }
}

}  // namespace

LayeredTooth voxelize_scan(const ImageVolume<float>& scan, const VoxelizeOptions& options,
                           VoxelizeReport* report) {
  const auto source = source_of(scan);
  return voxelize_scan(*source, options, report);
}

LayeredTooth voxelize_scan(ScanSource& scan, const VoxelizeOptions& options,
                           VoxelizeReport* report) {
  const auto progress = [&](const char* stage, double done) {
    if (options.progress) options.progress(stage, done);
  };
  const ImageFrame& frame = scan.frame();
  const double voxel = working_voxel(frame, options.voxel);
  ScanSurvey seen = survey(scan, voxel, [&](double read) { progress("reading", 0.3 * read); });
  if (!options.thresholds && !options.typical) refuse_segmentation(seen.values);
  progress("finding the tooth", 0.3);
  const GreyClasses classes =
      find_grey_classes(std::move(seen.class_means), seen.class_block, frame.size,
                        {options.thresholds, options.typical, options.tooth, options.tooth_at});
  const ToothBoxes boxes = boxes_around_tooth(frame, classes, voxel, options);
  const WorkBox& box = boxes.work;
  const double blur = boxes.blur;

  progress("resampling", 0.35);
  if (!seen.greys)
    seen.greys = greys_of(scan, voxel, voxels_in(frame, box),
                          [&](double read) { progress("reading the tooth", 0.35 + 0.1 * read); });
  if (report) *report = {};
  double noise = 0;
  TrimmedField grey = greys_around_tooth(box, *seen.greys, classes, blur, noise);

  progress("finding the pulp", 0.5);
  Cavity cavity = find_cavity(box, grey, classes, blur, boxes.margin);

  // The solid to a voxel: the largest piece of tissue with its cavities.
  progress("finding the surface", 0.6);
  Mask rough(box.voxels());
  box.for_each_row([&, least = not_below(classes.threshold_dentin)](int, int, std::size_t first,
                                                                    std::size_t end) {
    std::uint8_t* out = rough.data();
    grey.not_below(least, first, end, out + first);
    cavity.for_each(first, end, [&](std::size_t v) { out[v] = 1; });
  });
  keep_largest_component(box.size, rough);
  fill_enclosed(box.size, rough);

  ToothFields fields;
  AlongNormals along;
  {
    SurfaceDepth depth(box.size, rough, static_cast<int>(std::ceil(far_depth(blur) + 0.5)));
    Mask().swap(rough);
    BandField level = inward_level(box, depth, kReach, std::max(skin_depth(blur), kReach), blur);
    depth.keep(kReach + 1, static_cast<float>(std::max(skin_depth(blur), kReach) + 1));
    return_free_memory();
    along = look_along_normals(box, seen, frame.voxels(), grey, depth, level, classes, blur,
                               options.thin_enamel);
    if (report && options.keep_greys) report->greys = std::move(*seen.greys);
    seen.greys.reset();
    return_free_memory();
    UnderSurface under =
        look_under_surface(box, grey, depth, std::move(level), classes, blur, along);
    look_beyond_metal(along.metal, depth, classes, blur, under);
    fields.solid = solid_field(box, grey, depth, cavity, under, along, classes, blur);
    under.cover = BandField();
    progress("separating the tissues", 0.7);
    add_tissue_fields(box, grey, depth, cavity, under.plateau, along, classes, blur, fields);
  }
  return_free_memory();
  if (!options.thresholds) {
    const std::string why = implausible_layers(layers_of(box, fields), classes);
    if (!why.empty()) throw Error(why);
  }
  SurfaceUncertainty uncertainty =
      surface_uncertainty(box, grey, noise, fields, classes, along.thin, blur);
  grey = TrimmedField();
  along.thin.voxels = std::vector<ThinEnamel::Voxel>();

  progress("measuring distances", 0.8);
  LayeredTooth tooth = tooth_of(box, fields, boxes.tooth);
  fields = {};
  return_free_memory();
  tooth.provenance["threshold_dentin"] = short_number(classes.threshold_dentin);
  tooth.provenance["threshold_enamel"] = short_number(classes.threshold_enamel);
  record_scan_half_widths(uncertainty.half_widths(), tooth.provenance);
  progress("done", 1);
  if (report) {
    report->threshold_dentin = classes.threshold_dentin;
    report->threshold_enamel = classes.threshold_enamel;
    report->surroundings = classes.surroundings;
    report->dentin = classes.dentin;
    report->enamel = classes.enamel;
    report->pulp = cavity.grey;
    report->thin_enamel_mm2 = along.thin.area * voxel * voxel;
    report->uncertainty = std::move(uncertainty);
    if (along.measured)
      report->blur_fwhm_mm = 2 * std::sqrt(2 * std::log(2.0)) * along.sigma * voxel;
    report->notes = scan.notes();
    add_notes(classes, seen, frame.voxels(), box, cavity, options, *report);
  }
  return tooth;
}

}  // namespace toothprep
