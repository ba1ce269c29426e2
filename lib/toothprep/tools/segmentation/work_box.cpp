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
    for (std::size_t n = 0; n < 4; ++n)
      if (n == 0 || !fields.tissue[n - 1].empty())
        distance_[n].resize(static_cast<std::size_t>(size_.z()) * area_);
    iso_distance_in(box.size, {&fields.solid, distance_[0].data(), nullptr}, kBand, first, last);
    near_solid_ = whole_rows();
    shorten(near_solid_, [&](std::size_t o) { return distance_[0][o] < kBand; });
    find_tissues();
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
    brick.label.fill(static_cast<std::uint8_t>(Tissue::kAir));
    for (auto& phi : brick.phi) phi.fill(band);
    const Index3 from = (-at).cwiseMax(0), to = (box_.size - at).cwiseMin(kBrickEdge);
    for (int z = from.z(); z < to.z(); ++z)
      for (int y = from.y(); y < to.y(); ++y) {
        const std::size_t row = box_.offset(0, at.y() + y, at.z() + z - first_);
        const std::uint8_t* label =
            fields_.label.data() + row + static_cast<std::size_t>(first_) * area_;
        std::array<float, kBrickEdge> solid, phi;
        const auto place = [&](int x) { return static_cast<std::size_t>(x << 6 | y << 3 | z); };
        for (std::size_t n = 0; n < 4; ++n) {
          if (distance_[n].empty()) continue;
          const float* voxels = distance_[n].data() + row;
          for (int x = from.x(); x < to.x(); ++x) phi[x] = distance(voxels[at.x() + x]);
          if (n == 0) solid = phi;
          for (int x = from.x(); x < to.x(); ++x)
            brick.phi[n][place(x)] = std::max(phi[x], solid[x]);
        }
        for (int x = from.x(); x < to.x(); ++x)
          if (solid[x] < 0) brick.label[place(x)] = label[at.x() + x];
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

  std::vector<RowPart> whole_rows() const {
    return std::vector<RowPart>(distance_[0].size() / static_cast<std::size_t>(size_.x()),
                                {0, size_.x()});
  }
  // Of each part what lies between the first and the last node that is wanted.
  template <class Wanted>
  void shorten(std::vector<RowPart>& parts, const Wanted& wanted) const {
    for (std::size_t r = 0; r < parts.size(); ++r) {
      const std::size_t row = r * static_cast<std::size_t>(size_.x());
      const auto is_wanted = [&](int i) { return wanted(row + static_cast<std::size_t>(i)); };
      RowPart& part = parts[r];
      while (part.first < part.end && !is_wanted(part.first)) ++part.first;
      while (part.first < part.end && !is_wanted(part.end - 1)) --part.end;
    }
  }

  // The dentin's surface is for the most part enamel's and the pulp's from the other side. A tissue's
  // distance doesn't matter where the solid's is the larger for sure: beyond the solid's band, and outside the
  // solid where the tissue's field is inside.
  void find_tissues() {
    const std::size_t before = static_cast<std::size_t>(first_) * area_;
    std::vector<IsoField> tissues;  // dentin first
    std::array<std::vector<RowPart>, 3> wanted;
    for (const std::size_t t : {std::size_t{1}, std::size_t{0}, std::size_t{2}}) {
      const SignedField& own = fields_.tissue[t];
      if (own.empty()) continue;
      const SignedField& first = tissues.empty() ? own : *tissues.front().field;
      wanted[t] = near_solid_;
      shorten(wanted[t], [&](std::size_t o) {
        return distance_[0][o] < 0 ||
               (distance_[0][o] < kBand && (own[before + o] < 0 || first[before + o] < 0));
      });
      tissues.push_back({&own, distance_[t + 1].data(), wanted[t].data()});
    }
    if (tissues.empty()) return;
    const IsoField of = tissues.front();
    tissues.erase(tissues.begin());
    iso_distance_in(box_.size, of, kBand, first_, first_ + size_.z(), tissues);
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
      const Index3 at(b % counts.x(), b / counts.x() % counts.y(), z + b / counts.x() / counts.y());
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
