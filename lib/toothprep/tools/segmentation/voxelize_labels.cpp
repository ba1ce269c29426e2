#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/label_source.h"
#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/label_teeth.h"
#include "toothprep/tools/segmentation/smooth_labels.h"
#include "toothprep/tools/segmentation/tooth_fields.h"
#include "toothprep/tools/segmentation/voxelize.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {
namespace {

using TissueOf = std::vector<std::uint8_t>;  // by label value
using NamedLabels = std::map<std::uint16_t, Tissue>;

std::size_t place_of(Tissue tissue) { return static_cast<std::size_t>(tissue_index(tissue)); }

TissueOf tissue_by_value(const NamedLabels& tissues) {
  TissueOf tissue_of(65536, 0);
  for (const auto& [value, tissue] : tissues) tissue_of[value] = static_cast<std::uint8_t>(tissue);
  return tissue_of;
}

// What occurs, and where what is named lies.
struct LabelSurvey {
  std::vector<std::size_t> histogram = std::vector<std::size_t>(65536, 0);
  Index3 low, high = Index3::Constant(-1);
};

LabelSurvey survey_of(const ImageVolume<std::uint16_t>& labels, const TissueOf& tissue_of) {
  LabelSurvey seen;
  seen.low = labels.size;
  const std::uint16_t* value = labels.data.data();
  for (int k = 0; k < labels.size.z(); ++k)
    for (int j = 0; j < labels.size.y(); ++j) {
      int first = -1, last = -1;
      for (int i = 0; i < labels.size.x(); ++i, ++value) {
        ++seen.histogram[*value];
        if (tissue_of[*value] == 0) continue;
        if (first < 0) first = i;
        last = i;
      }
      if (first < 0) continue;
      seen.low = seen.low.cwiseMin(Index3(first, j, k));
      seen.high = seen.high.cwiseMax(Index3(last, j, k));
    }
  return seen;
}

void check_named(const LabelSurvey& seen, const NamedLabels& tissues) {
  std::string occurring;
  for (std::size_t v = 0; v < seen.histogram.size() && occurring.size() < 80; ++v)
    if (seen.histogram[v] > 0) occurring += (occurring.empty() ? "" : ", ") + std::to_string(v);
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir && seen.histogram[named] == 0)
      throw Error("--labels: the value " + std::to_string(named) + " for " +
                  std::string(kTissueNames[place_of(tissue)]) +
                  " does not occur; the image holds " + occurring);
  if (seen.high.x() < 0) throw Error("--labels: no tissue is named; the image holds " + occurring);
}

// By tissue value; 0 is air.
using Hits = std::array<double, kTissueCount + 1>;

// Adds how much of each tissue lies around a point of the labels: linear between their centres.
void add_hits(const ImageVolume<std::uint16_t>& labels, const TissueOf& tissue_of, const Vec3& x,
              Hits& hits) {
  if (!(x.minCoeff() > -1) || !((labels.size.cast<double>() - x).minCoeff() > 0)) return;
  const Index3 base = x.array().floor().cast<int>();
  const Vec3 f = x - base.cast<double>();
  std::array<std::uint8_t, 8> corner;
  for (int c = 0; c < 8; ++c) {
    const Index3 i = base + Index3(c & 1, c >> 1 & 1, c >> 2);
    corner[static_cast<std::size_t>(c)] = i.minCoeff() < 0 || (labels.size - i).minCoeff() <= 0
                                              ? std::uint8_t{0}
                                              : tissue_of[labels.at(i.x(), i.y(), i.z())];
  }
  if (std::all_of(corner.begin(), corner.end(), [&](auto t) { return t == corner[0]; })) {
    hits[corner[0]] += 1;
    return;
  }
  for (int c = 0; c < 8; ++c)
    hits[corner[static_cast<std::size_t>(c)]] += ((c & 1) ? f.x() : 1 - f.x()) *
                                                 ((c & 2) ? f.y() : 1 - f.y()) *
                                                 ((c & 4) ? f.z() : 1 - f.z());
}

// The tissues' shares of every output voxel, and the weights by which they compete for it.
struct Shares {
  const WorkBox& box;
  std::array<Field, kTissueCount> share;  // empty for a tissue that isn't named
  Field sum;                              // of all
  std::array<float, kTissueCount> weight;

  // Positive where the tissue's weighted share is the largest.
  float lead(std::size_t v, std::size_t tissue) const {
    float others = 0;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (t != tissue && !share[t].empty()) others = std::max(others, weight[t] * share[t][v]);
    return weight[tissue] * share[tissue][v] - others;
  }
  // The tissue with the largest; kTissueCount if there is none.
  std::size_t largest(std::size_t v) const {
    std::size_t most = kTissueCount;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (!share[t].empty() && share[t][v] > 0 &&
          (most == kTissueCount || weight[t] * share[t][v] > weight[most] * share[most][v]))
        most = t;
    return most;
  }
};

// Each tissue's share is the mean of its labels' indicator over the output voxel. (Counting the
// nearest label instead is a good deal faster, but where the two voxel sizes are commensurable the
// points fall on borders, which shifts surfaces by a quarter voxel.)
Shares sampled_shares(const ImageVolume<std::uint16_t>& labels, const NamedLabels& tissues,
                      const TissueOf& tissue_of, const WorkBox& box) {
  Shares shares{box, {}, {}, {}};
  shares.weight.fill(1.0f);
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir) shares.share[place_of(tissue)].resize(box.voxels());
  const int points_per_axis =
      std::clamp(static_cast<int>(std::ceil(box.lattice.voxel / labels.spacing.minCoeff())), 1, 6);
  for_each_point_set(labels, box, points_per_axis,
                     [&](std::size_t v, const Vec3& centre, const std::vector<Vec3>& points) {
                       Hits hits{};
                       for (const Vec3& p : points) add_hits(labels, tissue_of, centre + p, hits);
                       for (std::size_t t = 0; t < kTissueCount; ++t)
                         if (!shares.share[t].empty())
                           shares.share[t][v] =
                               static_cast<float>(hits[t + 1] / static_cast<double>(points.size()));
                     });
  return shares;
}

// Labels are steps; smoothed over little more than a voxel their half-way surface is the one that
// was segmented, without the steps.
void smooth_shares(Shares& shares, double blur) {
  shares.sum.assign(shares.box.voxels(), 0.0f);
  for (auto& field : shares.share) {
    if (field.empty()) continue;
    smooth(shares.box.size, field, 0.35 * blur);
    for (std::size_t v = 0; v < field.size(); ++v) shares.sum[v] += field[v];
  }
}

// Volume (voxels) of each tissue as the shares have it. Counting voxels would do for large tissues,
// but a small one's count jumps as borders cross centres: so it is the part of each voxel on the
// positive side of a field, from the field's value and slope there.
std::array<double, kTissueCount> volumes_of(const Shares& shares) {
  const Index3 size = shares.box.size;
  const std::array<std::size_t, 3> stride = {1, static_cast<std::size_t>(size.x()),
                                             static_cast<std::size_t>(size.x()) * size.y()};
  const auto part_inside = [&](std::size_t v, const auto& field) {
    const double here = field(v);
    double slope = 0;
    for (const std::size_t d : stride) {
      const double difference = 0.5 * (field(v + d) - field(v - d));
      slope += difference * difference;
    }
    slope = std::sqrt(slope);
    return std::abs(here) >= 0.5 * slope ? (here > 0 ? 1.0 : 0.0) : 0.5 + here / slope;
  };
  std::vector<std::array<double, kTissueCount>> by_plane(static_cast<std::size_t>(size.z()),
                                                         std::array<double, kTissueCount>{});
  shares.box.for_each([&](int i, int j, int k, std::size_t v) {
    const Index3 index(i, j, k);
    if (shares.sum[v] < 0.05f || index.minCoeff() == 0 ||
        (size - Index3::Ones() - index).minCoeff() == 0)
      return;
    const double solid = part_inside(v, [&](std::size_t u) { return shares.sum[u] - 0.5; });
    if (solid > 0)
      for (std::size_t t = 0; t < kTissueCount; ++t)
        if (!shares.share[t].empty() && shares.share[t][v] > 0)
          by_plane[static_cast<std::size_t>(k)][t] +=
              solid * part_inside(v, [&](std::size_t u) { return shares.lead(u, t); });
  });
  std::array<double, kTissueCount> found{};
  for (const auto& plane : by_plane)
    for (std::size_t t = 0; t < kTissueCount; ++t) found[t] += plane[t];
  return found;
}

// The largest share takes the place. Smoothing takes from thin layers (a lesion in a fissure) and
// gives to what is around them, so shares get weights that restore each tissue's volume (`wanted`,
// output voxels).
void restore_volumes(const std::array<double, kTissueCount>& wanted, Shares& shares) {
  constexpr int kPasses = 8;
  constexpr double kGoodEnough = 0.002;
  for (int pass = 0; pass < kPasses; ++pass) {
    const std::array<double, kTissueCount> found = volumes_of(shares);
    bool done = true;
    for (std::size_t t = 0; t < kTissueCount; ++t) {
      if (!(found[t] > 0)) continue;
      const double ratio = wanted[t] / found[t];
      if (std::abs(ratio - 1) < kGoodEnough) continue;
      done = false;
      // A border moves by far less than the volume of what it bounds; hence the square.
      shares.weight[t] = static_cast<float>(std::clamp(shares.weight[t] * ratio * ratio, 0.5, 2.0));
    }
    if (done) return;
  }
}

// Takes the shares' memory.
ToothFields fields_of(Shares shares) {
  const std::size_t n = shares.box.voxels();
  ToothFields fields;
  fields.label.assign(n, 0);
  shares.box.for_each([&](int, int, int, std::size_t v) {
    const std::size_t most = shares.largest(v);
    if (most < kTissueCount)
      fields.label[v] = static_cast<std::uint8_t>(tissue_at(static_cast<int>(most)));
  });
  Field values(n);
  for (std::size_t t = 0; t < 3; ++t) {
    if (shares.share[t].empty()) continue;
    shares.box.for_each([&](int, int, int, std::size_t v) {
      values[v] = signed_as(t == shares.largest(v), shares.lead(v, t) / (shares.sum[v] + 1e-6f));
    });
    fields.tissue[t] = SignedField(shares.box.size, values);
  }
  for (float& s : shares.sum) s = signed_as(s > 0.5f, s - 0.5f);
  fields.solid = SignedField(shares.box.size, shares.sum);
  return fields;
}

// The labels as they are: their steps rounded by a third of a voxel.
ToothFields stepped_fields(const ImageVolume<std::uint16_t>& labels, const NamedLabels& tissues,
                           const TissueOf& tissue_of, const WorkBox& box,
                           const PerTissue<double>& volume_mm3, double blur) {
  Shares shares = sampled_shares(labels, tissues, tissue_of, box);
  smooth_shares(shares, blur);
  std::array<double, kTissueCount> wanted{};  // output voxels
  for (std::size_t t = 0; t < kTissueCount; ++t)
    wanted[t] = volume_mm3[t] / std::pow(box.lattice.voxel, 3);
  restore_volumes(wanted, shares);
  return fields_of(std::move(shares));
}

}  // namespace

LayeredTooth voxelize_labels(const ImageVolume<std::uint16_t>& all, const NamedLabels& tissues,
                             const VoxelizeOptions& options, VoxelizeReport* report) {
  const auto progress = [&](const char* stage, double done) {
    if (options.progress) options.progress(stage, done);
  };
  progress("finding the labels", 0);
  const TissueOf tissue_of = tissue_by_value(tissues);
  LabelSurvey seen = survey_of(all, tissue_of);
  check_named(seen, tissues);
  ImageVolume<std::uint16_t> one;
  std::string note;
  if (options.one_tooth) {
    one = all;
    note = keep_one_tooth(one, tissue_of, options);
    seen = survey_of(one, tissue_of);
  }
  const ImageVolume<std::uint16_t>& labels = options.one_tooth ? one : all;
  const double blur = std::max(1.0, labels.spacing.maxCoeff() / options.voxel);
  const int margin = static_cast<int>(std::ceil(2 * blur)) + 4;
  const WorkBox box = box_around(labels, seen.low.cast<double>(), seen.high.cast<double>(),
                                 options.voxel, margin, options.announce);

  PerTissue<double> volume_mm3{};
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir)
      volume_mm3[place_of(tissue)] +=
          static_cast<double>(seen.histogram[named]) * labels.spacing.prod();
  progress(options.smooth_labels ? "smoothing" : "resampling", 0.1);
  const ToothFields fields =
      options.smooth_labels
          ? smooth_label_fields({labels, tissue_of, seen.low, seen.high, volume_mm3}, box)
          : stepped_fields(labels, tissues, tissue_of, box, volume_mm3, blur);

  progress("measuring distances", 0.6);
  LayeredTooth tooth = tooth_of(box, fields, box);
  record_labels({labels.spacing.maxCoeff(), options.smooth_labels}, tooth.provenance);
  progress("done", 1);
  if (report) *report = {};
  if (report && !note.empty()) report->notes = {note};
  return tooth;
}

}  // namespace toothprep
