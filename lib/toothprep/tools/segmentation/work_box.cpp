#include "toothprep/tools/segmentation/work_box.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/segmentation/iso_distance.h"

namespace toothprep {
namespace {

// At the peak of the work, with a reserve (grey scans take 12); the time on two cores of 2.3 GHz.
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

float signed_as(bool positive, float value) {
  constexpr float kTiny = 0.01f;
  return positive ? std::max(value, kTiny) : std::min(value, -kTiny);
}

namespace {

// Some layers of bricks of a tooth, from the fields in as many planes and a band more on both sides.
class BrickLayers {
 public:
  BrickLayers(const WorkBox& box, const ToothFields& fields, int first, int last)
      : box_(box),
        fields_(fields),
        first_(first),
        size_(box.size.x(), box.size.y(), last - first),
        area_(static_cast<std::size_t>(box.size.x()) * static_cast<std::size_t>(box.size.y())) {
    distances_of(fields.solid, distance_[0]);
    near_solid_ = parts_of_rows([](std::size_t, float solid) { return solid < kBand; });
    for (std::size_t k = 0; k < 3; ++k)
      if (!fields.tissue[k].empty()) distances_of(fields.tissue[k], distance_[k + 1]);
  }

  // Level sets and labels of the brick from `at` (of the box) on.
  struct Brick {
    std::array<std::uint8_t, kBrickVoxels> label;
    std::array<std::array<float, kBrickVoxels>, 4> phi;  // mm
  };
  // False if all of it is air.
  bool fill(const Index3& at, Brick& brick) const {
    if (is_air(at)) return false;
    const auto mm = static_cast<float>(box_.lattice.voxel);
    // What is far away is at the band's very end: single precision's 3 * 0.12 is not 0.36.
    const auto band = static_cast<float>(kBandVoxels * box_.lattice.voxel);
    const auto distance = [&](float voxels) {
      return std::abs(voxels) < kBand ? std::clamp(voxels * mm, -band, band)
                                      : std::copysign(band, voxels);
    };
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = at + Index3(v >> 6, (v >> 3) & 7, v & 7);
      brick.label[v] = static_cast<std::uint8_t>(Tissue::kAir);
      for (auto& phi : brick.phi) phi[v] = band;
      if (i.minCoeff() < 0 || (box_.size - i).minCoeff() <= 0) continue;
      const std::size_t o = box_.offset(i.x(), i.y(), i.z() - first_);
      const float solid = distance(distance_[0][o]);
      brick.phi[0][v] = solid;
      for (std::size_t k = 1; k < 4; ++k)
        if (!distance_[k].empty()) brick.phi[k][v] = std::max(distance(distance_[k][o]), solid);
      if (solid < 0) brick.label[v] = fields_.label[o + static_cast<std::size_t>(first_) * area_];
    }
    return true;
  }

 private:
  bool is_air(const Index3& at) const {
    const auto within = [&](int x, int a) { return std::clamp(x, 0, box_.size[a]); };
    for (int z = within(at.z(), 2); z < within(at.z() + kBrickEdge, 2); ++z)
      for (int y = within(at.y(), 1); y < within(at.y() + kBrickEdge, 1); ++y) {
        const RowPart& part =
            near_solid_[static_cast<std::size_t>(z - first_) * static_cast<std::size_t>(size_.y()) +
                        static_cast<std::size_t>(y)];
        if (part.first < at.x() + kBrickEdge && at.x() < part.end && part.first < part.end)
          return false;
      }
    return true;
  }

  // Of each row what lies between the first and the last node for which wanted(node, solid's distance).
  template <class Wanted>
  std::vector<RowPart> parts_of_rows(const Wanted& wanted) const {
    const auto nx = static_cast<std::size_t>(size_.x());
    std::vector<RowPart> parts(distance_[0].size() / nx);
    for (std::size_t r = 0; r < parts.size(); ++r) {
      const auto is_wanted = [&](int i) {
        const std::size_t o = r * nx + static_cast<std::size_t>(i);
        return wanted(o, distance_[0][o]);
      };
      RowPart part{0, size_.x()};
      while (part.first < part.end && !is_wanted(part.first)) ++part.first;
      while (part.first < part.end && !is_wanted(part.end - 1)) --part.end;
      parts[r] = part;
    }
    return parts;
  }

  void distances_of(const SignedField& field, Field& distance) const {
    constexpr int kAround = static_cast<int>(kBandVoxels) + 1;
    const int low = std::max(0, first_ - kAround),
              high = std::min(box_.size.z(), first_ + size_.z() + kAround);
    Field planes(static_cast<std::size_t>(high - low) * area_);
    field.copy(static_cast<std::size_t>(low) * area_, planes.size(), planes.data());
    // A tissue's distance doesn't matter where the solid's is the larger for sure: beyond the solid's
    // band, and outside the solid where the tissue's field is inside.
    std::vector<RowPart> wanted;
    if (&field != &fields_.solid) {
      const float* own = planes.data() + static_cast<std::size_t>(first_ - low) * area_;
      wanted = parts_of_rows(
          [&](std::size_t o, float solid) { return solid < 0 || (solid < kBand && own[o] < 0); });
    }
    distance.resize(static_cast<std::size_t>(size_.z()) * area_);
    iso_distance_in(Index3(size_.x(), size_.y(), high - low), planes.data(), kBand, first_ - low,
                    first_ - low + size_.z(), distance.data(),
                    wanted.empty() ? nullptr : wanted.data());
  }

  const WorkBox& box_;
  const ToothFields& fields_;
  int first_;
  Index3 size_;
  std::size_t area_;
  std::vector<RowPart> near_solid_;
  std::array<Field, 4> distance_;  // voxels; the solid's, then the tissues'
};

}  // namespace

LayeredTooth tooth_of(const WorkBox& box, const ToothFields& fields) {
  LayeredTooth tooth =
      make_empty_tooth(box.lattice, box.lower, box.lower + box.size - Index3::Ones());
  const Index3 counts = tooth.solid.brick_counts();
  const Index3 first_voxel = tooth.solid.first_brick() * kBrickEdge - box.lower;  // of the box
  constexpr int kLayers = 2;
  std::mutex insert;
  tbb::parallel_for(0, (counts.z() + kLayers - 1) / kLayers, [&](int part) {
    const int z = part * kLayers, z_end = std::min(counts.z(), z + kLayers);
    const int first = std::max(0, first_voxel.z() + z * kBrickEdge),
              last = std::min(box.size.z(), first_voxel.z() + z_end * kBrickEdge);
    if (first >= last) return;  // beyond the box: air
    const BrickLayers layers(box, fields, first, last);
    BrickLayers::Brick brick;
    for (int b = 0; b < counts.x() * counts.y() * (z_end - z); ++b) {
      const Index3 at(b / (z_end - z) / counts.y(), b / (z_end - z) % counts.y(),
                      z + b % (z_end - z));
      if (!layers.fill(first_voxel + at * kBrickEdge, brick)) continue;  // as it is
      const std::size_t place =
          (static_cast<std::size_t>(at.x()) * counts.y() + at.y()) * counts.z() + at.z();
      // Which pool slot a brick gets depends on the order of threads; its values and place do not.
      const std::lock_guard lock(insert);
      tooth.tissue.set_brick(place, brick.label.data());
      tooth.solid.set_brick(place, brick.phi[0].data());
      for (std::size_t k = 0; k < 3; ++k)
        tooth.remains[k].set_brick(place, brick.phi[k + 1].data());
    }
  });
  return tooth;
}

}  // namespace toothprep
