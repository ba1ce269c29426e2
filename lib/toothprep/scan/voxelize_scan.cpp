#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/core/errors.h"
#include "toothprep/scan/cavity.h"
#include "toothprep/scan/dense_filters.h"
#include "toothprep/scan/grey_classes.h"
#include "toothprep/scan/voxelize.h"
#include "toothprep/scan/work_box.h"

namespace toothprep {
namespace {

// Noise of the surroundings, and the smoothing (in output voxels) that brings it down to a seventh
// of the half contrasts that decide.
double smoothing_for(const Field& grey, const GreyClasses& classes, double blur) {
  Field below;
  for (const float g : grey)
    if (g < classes.threshold_dentin) below.push_back(g);
  if (below.size() < 100) return 0;
  const auto median = [](Field& values) {
    std::nth_element(values.begin(),
                     values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
    return values[values.size() / 2];
  };
  const float centre = median(below);
  for (float& g : below) g = std::abs(g - centre);
  const double noise = 1.4826 * median(below);
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
void clean_islands(const WorkBox& box, const Mask& domain, const Mask& cavity, Mask& enamel) {
  Mask part(domain.size());
  for (const bool of_enamel : {true, false}) {
    for (std::size_t v = 0; v < part.size(); ++v)
      part[v] = domain[v] && (cavity.empty() || !cavity[v]) && (enamel[v] != 0) == of_enamel;
    const Components pieces = connected_components(box.size, part);
    for (std::size_t v = 0; v < part.size(); ++v)
      if (pieces.label[v] != 0 && 20 * pieces.voxels[pieces.label[v] - 1] < pieces.voxels[0])
        enamel[v] = !of_enamel;
  }
}

}  // namespace

LayeredTooth voxelize_scan(const ImageVolume<float>& scan, const VoxelizeOptions& options,
                           VoxelizeReport* report) {
  const auto tell = [&](const char* stage, double done) {
    if (options.progress) options.progress(stage, done);
  };
  tell("finding the tooth", 0);
  const GreyClasses classes = find_grey_classes(scan, options.thresholds);
  VoxelizeReport found;
  found.threshold_dentin = classes.threshold_dentin;
  found.threshold_enamel = classes.threshold_enamel;
  found.surroundings = classes.surroundings;
  found.dentin = classes.dentin;
  found.enamel = classes.enamel;
  if (classes.touches_edge)
    found.notes.push_back(
        "the tooth reaches the border of the scan; it is cut off there by a flat face");

  Lengths lengths;
  lengths.blur = std::max(1.0, scan.spacing.maxCoeff() / options.voxel);
  lengths.skin = 3 * lengths.blur;
  for (const double mm : {0.35, 0.5, 0.75, 1.0})
    lengths.canals.push_back(std::max(2 * lengths.blur, mm / options.voxel));
  const int margin = static_cast<int>(std::ceil(lengths.blur)) + 4;
  lengths.margin = margin;
  const WorkBox box = box_around(scan, classes.box_min, classes.box_max, options.voxel, margin);
  const std::size_t n = box.voxels();

  tell("resampling", 0.1);
  Field grey(n);
  {
    const double ratio = options.voxel / scan.spacing.minCoeff();
    const int points_per_axis = ratio > 1.25 ? std::min(8, static_cast<int>(std::ceil(ratio))) : 1;
    const auto outside = static_cast<float>(classes.surroundings);
    resample(scan, box, points_per_axis,
             [&](std::size_t v, const Vec3& centre, const std::vector<Vec3>& points) {
               double sum = 0;
               for (const Vec3& p : points) sum += trilinear(scan, centre + p, outside);
               grey[v] = static_cast<float>(sum / static_cast<double>(points.size()));
             });
  }
  smooth(box.size, grey, smoothing_for(grey, classes, lengths.blur));

  tell("finding the pulp", 0.3);
  const Cavity cavity = find_cavity(box, grey, classes, lengths);
  const bool has_pulp = !cavity.mask.empty();
  found.pulp = cavity.grey;
  if (!has_pulp) found.notes.push_back("no pulp cavity was found inside the dentin");

  // The solid to a voxel: the largest piece of tissue with its cavities.
  Mask rough(n);
  for (std::size_t v = 0; v < n; ++v)
    rough[v] = grey[v] >= classes.threshold_dentin || (has_pulp && cavity.mask[v]);
  keep_largest_component(box.size, rough);
  fill_enclosed(box.size, rough);
  const Field depth = depth_below_surface(box.size, rough);

  // Below the outer surface greys are mixed with the surroundings': over enamel they pass through
  // dentin's. There a voxel takes the brightest grey on its way inwards, which is that of the
  // tissue underneath.
  tell("finding the tissues", 0.5);
  const double reach =
      kBandVoxels + 1;    // also that far outside, so that interfaces run on through it
  Field plateau = grey;   // grey of the tissue here
  Field weight(n, 0.0f);  // 1 near the surface
  Field cover(n, 0.0f);   // how much the tissue under the surface is enamel, 0..1
  {
    Field level(n);
    const auto far = static_cast<float>(std::max(lengths.skin, reach) + 2 * lengths.blur);
    for (std::size_t v = 0; v < n; ++v) level[v] = std::clamp(depth[v], -far, far);
    smooth(box.size, level, std::max(1.0, 0.5 * lengths.blur));
    const double step = 0.5 * lengths.blur;
    box.for_each([&](int i, int j, int k, std::size_t v) {
      if (depth[v] <= -reach || depth[v] >= lengths.skin) return;
      const Index3 index(i, j, k);
      Vec3 inwards;
      for (int a = 0; a < 3; ++a) {
        Index3 p = index, q = index;
        p[a] = std::max(p[a] - 1, 0);
        q[a] = std::min(q[a] + 1, box.size[a] - 1);
        inwards[a] =
            level[box.offset(q.x(), q.y(), q.z())] - level[box.offset(p.x(), p.y(), p.z())];
      }
      if (inwards.squaredNorm() > 0) inwards.normalize();
      const auto at = [&](double s) {
        return trilinear(box, grey, index.cast<double>() + inwards * (s - depth[v]));
      };
      float brightest = depth[v] >= 0 ? grey[v] : at(0);
      for (double s = std::max<double>(depth[v], 0) + step; s < lengths.skin + 0.5 * step;
           s += step)
        brightest = std::max(brightest, at(s));
      plateau[v] = brightest;
      if (depth[v] > 1.5 * lengths.blur) return;
      for (double s = 0; s < depth[v]; s += step) brightest = std::max(brightest, at(s));
      weight[v] = 1;
      cover[v] = static_cast<float>(
          std::clamp((brightest - classes.dentin) / (classes.enamel - classes.dentin), 0.0, 1.0));
    });
  }

  // The outer surface lies at the grey half-way between the surroundings and the tissue underneath.
  smooth(box.size, cover, lengths.blur);
  {
    Field near = weight;
    smooth(box.size, near, lengths.blur);
    for (std::size_t v = 0; v < n; ++v) cover[v] = near[v] > 1e-3f ? cover[v] / near[v] : 0;
  }
  ToothFields fields;
  fields.solid.resize(n);
  const double over_enamel = 0.5 * (classes.surroundings + classes.enamel);
  const double contrast = classes.dentin - classes.surroundings;
  Mask solid(n);
  for (std::size_t v = 0; v < n; ++v) {
    const bool in_cavity = has_pulp && cavity.mask[v];
    const double border =
        classes.threshold_dentin + cover[v] * std::max(0.0, over_enamel - classes.threshold_dentin);
    float value = rough[v] ? 0.5f : -0.5f;
    if (weight[v] > 0)
      value = static_cast<float>(std::clamp((grey[v] - border) / contrast, -1.0, 1.0));
    // At an open apex the solid ends where the ball from outside does.
    if (in_cavity)
      value = static_cast<float>(std::min(0.5, 0.5 * (cavity.from_outside[v] - cavity.canal)));
    fields.solid[v] = signed_as(rough[v] && (value > 0 || in_cavity), value);
    solid[v] = fields.solid[v] > 0;
  }
  keep_largest_component(box.size, solid);
  fill_enclosed(box.size, solid);
  for (std::size_t v = 0; v < n; ++v) fields.solid[v] = signed_as(solid[v], fields.solid[v]);
  Mask().swap(rough);

  // Tissues, through the solid and its neighbourhood.
  tell("separating the tissues", 0.6);
  Mask domain(n), enamel(n);
  for (std::size_t v = 0; v < n; ++v) {
    domain[v] = depth[v] > -reach;
    enamel[v] = domain[v] && plateau[v] > classes.threshold_enamel;
  }
  // First in the solid alone, where an island can't hide behind its connection through the outside.
  clean_islands(box, solid, cavity.mask, enamel);
  clean_islands(box, domain, cavity.mask, enamel);
  fields.label.resize(n);
  for (auto& field : fields.tissue) field.resize(n);
  const double pulp_border = 0.5 * (cavity.grey + classes.dentin);
  const double pulp_contrast = std::max(1e-6 * contrast, classes.dentin - cavity.grey);
  for (std::size_t v = 0; v < n; ++v) {
    const bool pulp = has_pulp && cavity.mask[v];
    // Potentials against dentin, whose own is zero.
    const float e = signed_as(
        enamel[v] && !pulp, static_cast<float>(std::clamp((plateau[v] - classes.threshold_enamel) /
                                                              (classes.enamel - classes.dentin),
                                                          -0.5, 0.5)));
    const float p =
        signed_as(pulp, has_pulp ? static_cast<float>(std::clamp(
                                       (pulp_border - grey[v]) / pulp_contrast, -0.5, 0.5))
                                 : -0.5f);
    fields.tissue[0][v] = pulp ? -p : e;
    fields.tissue[2][v] = p;
    fields.tissue[1][v] = -std::max(e, p);
    fields.label[v] = static_cast<std::uint8_t>(pulp    ? Tissue::kPulp
                                                : e > 0 ? Tissue::kEnamel
                                                        : Tissue::kDentin);
  }
  for (Field* done : {&grey, &plateau, &weight, &cover}) Field().swap(*done);

  tell("measuring distances", 0.7);
  LayeredTooth tooth = tooth_of(box, std::move(fields));
  tooth.provenance["threshold_dentin"] = number(classes.threshold_dentin);
  tooth.provenance["threshold_enamel"] = number(classes.threshold_enamel);
  tell("done", 1);
  if (report) *report = std::move(found);
  return tooth;
}

}  // namespace toothprep
