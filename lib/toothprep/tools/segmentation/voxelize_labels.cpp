#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/voxelize.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {

LayeredTooth voxelize_labels(const ImageVolume<std::uint16_t>& labels,
                             const std::map<std::uint16_t, Tissue>& tissues,
                             const VoxelizeOptions& options, VoxelizeReport* report) {
  const auto tell = [&](const char* stage, double done) {
    if (options.progress) options.progress(stage, done);
  };
  tell("finding the labels", 0);
  std::vector<std::uint8_t> tissue_of(65536, 0);
  for (const auto& [value, tissue] : tissues) tissue_of[value] = static_cast<std::uint8_t>(tissue);

  // What occurs, and where.
  std::map<std::uint16_t, std::size_t> count;
  std::vector<std::size_t> histogram(65536, 0);
  Index3 low = labels.size, high = Index3::Constant(-1);
  const std::uint16_t* value = labels.data.data();
  for (int k = 0; k < labels.size.z(); ++k)
    for (int j = 0; j < labels.size.y(); ++j) {
      int first = -1, last = -1;
      for (int i = 0; i < labels.size.x(); ++i, ++value) {
        ++histogram[*value];
        if (tissue_of[*value] == 0) continue;
        if (first < 0) first = i;
        last = i;
      }
      if (first < 0) continue;
      low = low.cwiseMin(Index3(first, j, k));
      high = high.cwiseMax(Index3(last, j, k));
    }
  std::string occurring;
  for (std::size_t v = 0; v < histogram.size() && occurring.size() < 80; ++v)
    if (histogram[v] > 0) occurring += (occurring.empty() ? "" : ", ") + std::to_string(v);
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir && histogram[named] == 0)
      throw Error("--labels: the value " + std::to_string(named) + " for " +
                  std::string(kTissueNames[static_cast<std::size_t>(tissue_index(tissue))]) +
                  " does not occur; the image holds " + occurring);
  if (high.x() < 0) throw Error("--labels: no tissue is named; the image holds " + occurring);

  const double blur = std::max(1.0, labels.spacing.maxCoeff() / options.voxel);
  const int margin = static_cast<int>(std::ceil(2 * blur)) + 4;
  const WorkBox box =
      box_around(labels, low.cast<double>(), high.cast<double>(), options.voxel, margin);
  const std::size_t n = box.voxels();

  // Share of each tissue in every output voxel: the mean of the labels' indicators, linear between
  // the labels' centres. (Counting the nearest label instead is a good deal faster, but where the
  // two voxel sizes are commensurable the points fall on borders, which shifts surfaces by a
  // quarter voxel.)
  tell("resampling", 0.1);
  std::array<Field, kTissueCount> share;
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir) share[static_cast<std::size_t>(tissue_index(tissue))].resize(n);
  const int points_per_axis =
      std::clamp(static_cast<int>(std::ceil(options.voxel / labels.spacing.minCoeff())), 1, 6);
  for_each_point_set(
      labels, box, points_per_axis,
      [&](std::size_t v, const Vec3& centre, const std::vector<Vec3>& points) {
        std::array<double, kTissueCount + 1> hits{};
        for (const Vec3& p : points) {
          const Vec3 x = centre + p;
          if (!(x.minCoeff() > -1) || !((labels.size.cast<double>() - x).minCoeff() > 0)) continue;
          const Index3 base = x.array().floor().cast<int>();
          const Vec3 f = x - base.cast<double>();
          std::array<std::uint8_t, 8> corner;
          for (int c = 0; c < 8; ++c) {
            const Index3 i = base + Index3(c & 1, c >> 1 & 1, c >> 2);
            corner[static_cast<std::size_t>(c)] =
                i.minCoeff() < 0 || (labels.size - i).minCoeff() <= 0
                    ? std::uint8_t{0}
                    : tissue_of[labels.at(i.x(), i.y(), i.z())];
          }
          if (std::all_of(corner.begin(), corner.end(), [&](auto t) { return t == corner[0]; })) {
            hits[corner[0]] += 1;
            continue;
          }
          for (int c = 0; c < 8; ++c)
            hits[corner[static_cast<std::size_t>(c)]] += ((c & 1) ? f.x() : 1 - f.x()) *
                                                         ((c & 2) ? f.y() : 1 - f.y()) *
                                                         ((c & 4) ? f.z() : 1 - f.z());
        }
        for (std::size_t t = 0; t < kTissueCount; ++t)
          if (!share[t].empty())
            share[t][v] = static_cast<float>(hits[t + 1] / static_cast<double>(points.size()));
      });

  // Labels are steps; smoothed over little more than a voxel their half-way surface is the one that
  // was segmented, without the steps.
  tell("smoothing", 0.3);
  Field sum(n, 0.0f);
  for (auto& field : share) {
    if (field.empty()) continue;
    smooth(box.size, field, 0.35 * blur);
    for (std::size_t v = 0; v < n; ++v) sum[v] += field[v];
  }
  // The largest share takes the place. Smoothing takes from thin layers (a lesion in a fissure) and
  // gives to what is around them, so shares get weights that restore each tissue's volume.
  std::array<double, kTissueCount> wanted{};  // output voxels
  for (const auto& [named, tissue] : tissues)
    if (tissue != Tissue::kAir)
      wanted[static_cast<std::size_t>(tissue_index(tissue))] +=
          static_cast<double>(histogram[named]) * (labels.spacing / options.voxel).prod();
  std::array<float, kTissueCount> weight;
  weight.fill(1.0f);
  // Positive where the tissue's weighted share is the largest.
  const auto lead = [&](std::size_t v, std::size_t tissue) {
    float others = 0;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (t != tissue && !share[t].empty()) others = std::max(others, weight[t] * share[t][v]);
    return weight[tissue] * share[tissue][v] - others;
  };
  // Volume (voxels) on the positive side of a field within a voxel, from its value and slope there.
  // (Counting voxels would do for large tissues, but a small one's count jumps as borders cross
  // centres.)
  const std::array<std::size_t, 3> stride = {1, static_cast<std::size_t>(box.size.x()),
                                             static_cast<std::size_t>(box.size.x()) * box.size.y()};
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
  constexpr int kPasses = 8;
  constexpr double kGoodEnough = 0.002;
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<std::array<double, kTissueCount>> by_plane(static_cast<std::size_t>(box.size.z()),
                                                           std::array<double, kTissueCount>{});
    box.for_each([&](int i, int j, int k, std::size_t v) {
      const Index3 index(i, j, k);
      if (sum[v] < 0.05f || index.minCoeff() == 0 ||
          (box.size - Index3::Ones() - index).minCoeff() == 0)
        return;
      const double solid = part_inside(v, [&](std::size_t u) { return sum[u] - 0.5; });
      if (solid > 0)
        for (std::size_t t = 0; t < kTissueCount; ++t)
          if (!share[t].empty() && share[t][v] > 0)
            by_plane[static_cast<std::size_t>(k)][t] +=
                solid * part_inside(v, [&](std::size_t u) { return lead(u, t); });
    });
    std::array<double, kTissueCount> found{};
    for (const auto& plane : by_plane)
      for (std::size_t t = 0; t < kTissueCount; ++t) found[t] += plane[t];
    bool done = true;
    for (std::size_t t = 0; t < kTissueCount; ++t) {
      if (!(found[t] > 0)) continue;
      const double ratio = wanted[t] / found[t];
      if (std::abs(ratio - 1) < kGoodEnough) continue;
      done = false;
      // A border moves by far less than the volume of what it bounds; hence the square.
      weight[t] = static_cast<float>(std::clamp(weight[t] * ratio * ratio, 0.5, 2.0));
    }
    if (done) break;
  }

  ToothFields fields;
  fields.label.assign(n, 0);
  for (std::size_t t = 0; t < 3; ++t)
    if (!share[t].empty()) fields.tissue[t].resize(n);
  box.for_each([&](int, int, int, std::size_t v) {
    std::size_t most = kTissueCount;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (!share[t].empty() && share[t][v] > 0 &&
          (most == kTissueCount || weight[t] * share[t][v] > weight[most] * share[most][v]))
        most = t;
    if (most < kTissueCount)
      fields.label[v] = static_cast<std::uint8_t>(tissue_at(static_cast<int>(most)));
    for (std::size_t t = 0; t < 3; ++t)
      if (!fields.tissue[t].empty())
        fields.tissue[t][v] = signed_as(t == most, lead(v, t) / (sum[v] + 1e-6f));
  });
  for (float& s : sum) s = signed_as(s > 0.5f, s - 0.5f);
  for (auto& field : share) Field().swap(field);
  fields.solid = std::move(sum);

  tell("measuring distances", 0.6);
  LayeredTooth tooth = tooth_of(box, std::move(fields));
  tell("done", 1);
  if (report) *report = {};
  return tooth;
}

}  // namespace toothprep
