#include "toothprep/tools/segmentation/work_box.h"

#include <fmt/format.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/segmentation/iso_distance.h"

namespace toothprep {
namespace {

// At the peak of the work, measured as 46 to 50 with grey scans; the time on two cores of 2.3 GHz.
constexpr double kBytesPerVoxel = 50, kSecondsPerVoxel = 4e-7;
constexpr auto kBand = static_cast<float>(kBandVoxels);

}  // namespace

std::string short_number(double value) { return fmt::format("{:.4g}", value); }

WorkBox box_around(const ImageFrame& image, const Vec3& index_min, const Vec3& index_max,
                   double voxel, int margin, const Announce& announce) {
  if (!(voxel > 0 && voxel <= 10))
    throw Error("voxel size must lie in (0, 10] mm, got " + short_number(voxel));
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner((c & 1) ? index_max.x() + 0.5 : index_min.x() - 0.5,
                      (c & 2) ? index_max.y() + 0.5 : index_min.y() - 0.5,
                      (c & 4) ? index_max.z() + 0.5 : index_min.z() - 0.5);
    low = low.cwiseMin(image.to_world(corner));
    high = high.cwiseMax(image.to_world(corner));
  }
  const Vec3 extent = high - low;
  const Vec3 count = extent / voxel + Vec3::Constant(2.0 * margin + 2);
  constexpr double kLargestTooth = 60;  // mm
  if (!(low / voxel).allFinite() || (low / voxel).cwiseAbs().maxCoeff() > 1e8)
    throw Error("the tooth lies " + short_number(low.cwiseAbs().maxCoeff()) +
                " mm from the frame's zero, too far for voxels of " + short_number(voxel) + " mm");
  try {
    const std::string work =
        announced_voxels(count.prod(), voxel, kBytesPerVoxel, kSecondsPerVoxel);
    if (announce && !work.empty()) announce(work);
  } catch (const Error& e) {
    throw Error("the tooth's box of " + short_number(extent.x()) + " x " +
                short_number(extent.y()) + " x " + short_number(extent.z()) +
                " mm is too large: " + e.what() +
                (extent.maxCoeff() > kLargestTooth
                     ? "; it is no tooth's size: give the scan's own voxel size with --spacing-mm"
                     : ""));
  }
  WorkBox box;
  box.lattice.voxel = voxel;
  box.lattice.origin = Vec3::Constant(0.5 * voxel);
  for (int a = 0; a < 3; ++a) {
    box.lower[a] = static_cast<int>(std::floor(low[a] / voxel - 0.5)) - margin;
    box.size[a] = static_cast<int>(std::ceil(high[a] / voxel - 0.5)) + margin - box.lower[a] + 1;
  }
  return box;
}

float trilinear(const Index3& size, const std::vector<float>& values, const Vec3& index) {
  Index3 base;
  Vec3 f;
  for (int a = 0; a < 3; ++a) {
    const double x = std::clamp(index[a], 0.0, size[a] - 1.0);
    base[a] = std::min(static_cast<int>(x), size[a] - 2);
    f[a] = x - base[a];
  }
  const std::size_t row = static_cast<std::size_t>(size.x()),
                    plane = row * static_cast<std::size_t>(size.y());
  const float* p = values.data() + static_cast<std::size_t>(base.z()) * plane +
                   static_cast<std::size_t>(base.y()) * row + static_cast<std::size_t>(base.x());
  const auto along_x = [&](std::size_t o) { return p[o] + f.x() * (p[o + 1] - p[o]); };
  const double a = along_x(0), b = along_x(row), c = along_x(plane), d = along_x(plane + row);
  const double ab = a + f.y() * (b - a), cd = c + f.y() * (d - c);
  return static_cast<float>(ab + f.z() * (cd - ab));
}

float signed_as(bool positive, float value) {
  constexpr float kTiny = 0.01f;
  return positive ? std::max(value, kTiny) : std::min(value, -kTiny);
}

LayeredTooth tooth_of(const WorkBox& box, ToothFields fields) {
  const auto mm = static_cast<float>(box.lattice.voxel);
  // What is far away is at the band's very end: single precision's 3 * 0.12 is not 0.36.
  const auto band = static_cast<float>(kBandVoxels * box.lattice.voxel);
  const auto distance = [&](float voxels) {
    return std::abs(voxels) < kBand ? voxels * mm : std::copysign(band, voxels);
  };
  const Field solid = iso_distance(box.size, fields.solid, kBand);
  Field().swap(fields.solid);
  std::array<Field, 3> tissue;
  for (std::size_t k = 0; k < 3; ++k) {
    if (fields.tissue[k].empty()) continue;
    tissue[k] = iso_distance(box.size, fields.tissue[k], kBand);
    Field().swap(fields.tissue[k]);
  }
  return build_tooth_by_brick(box.lattice, box.lower, box.lower + box.size - Index3::Ones(),
                              [&](const Index3& first, ToothSample* samples) {
                                for (int v = 0; v < kBrickVoxels; ++v) {
                                  ToothSample& s = samples[v];
                                  s.solid = band;
                                  s.tissue.fill(band);
                                  s.label = Tissue::kAir;
                                  const Index3 i =
                                      first + Index3(v >> 6, (v >> 3) & 7, v & 7) - box.lower;
                                  if (i.minCoeff() < 0 || (box.size - i).minCoeff() <= 0) continue;
                                  const std::size_t o = box.offset(i.x(), i.y(), i.z());
                                  s.solid = distance(solid[o]);
                                  for (std::size_t k = 0; k < 3; ++k)
                                    if (!tissue[k].empty()) s.tissue[k] = distance(tissue[k][o]);
                                  if (s.solid < 0) s.label = static_cast<Tissue>(fields.label[o]);
                                }
                              });
}

}  // namespace toothprep
