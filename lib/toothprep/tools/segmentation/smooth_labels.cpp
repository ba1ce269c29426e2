#include "toothprep/tools/segmentation/smooth_labels.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toothprep/tools/segmentation/label_surface.h"

namespace toothprep {
namespace {

constexpr int kGrowth = 2;          // voxels by which tissues go on into the air
constexpr double kCoarser = 1.2;    // output voxels per label voxel from which means are taken
constexpr float kMostShift = 0.5f;  // label voxels

// The labels' box as tissues, with a border of air into which the tissues then grow, so that their
// interfaces have somewhere to go.
class TissueBox {
 public:
  TissueBox(const LabelTissues& anatomy, int border)
      : low_(anatomy.low - Index3::Constant(border)),
        size_(anatomy.high - anatomy.low + Index3::Constant(2 * border + 1)),
        tissue_(static_cast<std::size_t>(size_.cast<double>().prod()), 0) {
    const Index3 extent = anatomy.high - anatomy.low;
    tbb::parallel_for(0, extent.z() + 1, [&](int k) {
      for (int j = 0; j <= extent.y(); ++j) {
        const Index3 at = anatomy.low + Index3(0, j, k);
        const std::uint16_t* from =
            anatomy.labels.data.data() + anatomy.labels.offset(at.x(), at.y(), at.z());
        std::uint8_t* to = tissue_.data() + offset(border, j + border, k + border);
        for (int i = 0; i <= extent.x(); ++i) to[i] = anatomy.tissue_of[from[i]];
      }
    });
  }

  const Index3& low() const { return low_; }
  const Index3& size() const { return size_; }

  Sides solid_sides() const {
    Sides sides(tissue_.size());
    for (std::size_t v = 0; v < sides.size(); ++v) sides[v] = tissue_[v] != 0 ? kInside : 0;
    return sides;
  }

  // What was grown into the air is free to lie on either side.
  Sides tissue_sides(std::size_t tissue) const {
    Sides sides(tissue_.size());
    for (std::size_t v = 0; v < sides.size(); ++v) {
      const std::uint8_t here = tissue_[v] & kTissueBits;
      sides[v] = static_cast<std::uint8_t>((here == tissue + 1 ? kInside : 0) |
                                           (tissue_[v] == here && here != 0 ? 0 : kFree));
    }
    return sides;
  }

  // Air beside tissue takes the tissue that most of its neighbours are (of several the first).
  void grow() {
    const auto row = static_cast<std::ptrdiff_t>(size_.x()), plane = row * size_.y();
    const std::array<std::ptrdiff_t, 6> beside = {-plane, -row, -1, 1, row, plane};
    std::vector<std::uint8_t> grown;
    for (int n = 0; n < kGrowth; ++n) {
      grown = tissue_;
      tbb::parallel_for(1, size_.z() - 1, [&](int k) {
        for (std::ptrdiff_t v = k * plane + row; v < (k + 1) * plane - row; ++v) {
          if (tissue_[v] != 0) continue;
          std::array<int, kTissueCount + 1> count{};
          for (const std::ptrdiff_t d : beside) ++count[tissue_[v + d] & kTissueBits];
          const auto most = std::max_element(count.begin() + 1, count.end());
          if (*most > 0) grown[v] = static_cast<std::uint8_t>((most - count.begin()) | kGrown);
        }
      });
      tissue_.swap(grown);
    }
  }

 private:
  static constexpr std::uint8_t kTissueBits = 7, kGrown = 8;

  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * size_.y() + j) * size_.x() + i;
  }

  Index3 low_, size_;
  std::vector<std::uint8_t> tissue_;  // Tissue values
};

// A surface's values on the output lattice.
class Sampler {
 public:
  Sampler(const LabelTissues& anatomy, const TissueBox& tissues, const WorkBox& box)
      : frame_(anatomy.labels),
        low_(tissues.low()),
        last_(tissues.size().cast<double>() - Vec3::Constant(1.001)),
        box_(box),
        per_label_(box.lattice.voxel / frame_.spacing.minCoeff()) {}

  int points() const {
    return per_label_ > kCoarser ? std::min(static_cast<int>(std::ceil(per_label_)), 6) : 1;
  }

  Field sampled(const LabelSurface& surface, float outside) const {
    Field field(box_.voxels());
    const std::vector<std::uint8_t> close = close_to(surface);
    for_each_point_set(frame_, box_, points(),
                       [&](std::size_t v, const Vec3& centre, const std::vector<Vec3>& around) {
                         const Vec3 x = centre - low_.cast<double>();
                         if (!within(x))
                           field[v] = outside;
                         else if (around.size() == 1 || !close[v])
                           field[v] = surface.at(x);
                         else
                           field[v] = mean(surface, x, around);
                       });
    return field;
  }

 private:
  bool within(const Vec3& x) const { return x.minCoeff() >= 0 && (last_ - x).minCoeff() >= 0; }

  // Output voxels that may hold a piece of the surface, if they are averaged.
  std::vector<std::uint8_t> close_to(const LabelSurface& surface) const {
    if (points() == 1) return {};
    std::vector<std::uint8_t> close(box_.voxels(), 0);
    const Index3 size = (last_ + Vec3::Constant(1.5)).cast<int>();
    for (const std::size_t v : surface.band()) {
      const auto n = static_cast<std::ptrdiff_t>(v);
      const std::ptrdiff_t row = n / size.x(), plane = row / size.y();
      const Vec3 at(static_cast<double>(n % size.x()), static_cast<double>(row % size.y()),
                    static_cast<double>(plane));
      const Index3 i = box_.lattice.to_index(frame_.to_world(at + low_.cast<double>()))
                           .array()
                           .round()
                           .cast<int>()
                           .matrix() -
                       box_.lower;
      const Index3 from = (i - Index3::Ones()).cwiseMax(0),
                   to = (i + Index3::Ones()).cwiseMin(box_.size - Index3::Ones());
      for (int z = from.z(); z <= to.z(); ++z)
        for (int y = from.y(); y <= to.y(); ++y)
          for (int x = from.x(); x <= to.x(); ++x) close[box_.offset(x, y, z)] = 1;
    }
    return close;
  }

  // Of a voxel's part inside, with borders a label voxel wide on either side.
  float mean(const LabelSurface& surface, const Vec3& x, const std::vector<Vec3>& around) const {
    double sum = 0;
    for (const Vec3& p : around)
      if (within(x + p)) sum += std::clamp(surface.at(x + p), -1.0f, 1.0f);
    return static_cast<float>(sum / static_cast<double>(around.size()));
  }

  const ImageFrame& frame_;
  Index3 low_;
  Vec3 last_;
  const WorkBox& box_;
  double per_label_;
};

// The fields of all, and what is added to each.
struct Levels {
  const WorkBox& box;
  Field solid;
  std::array<Field, kTissueCount> part;  // empty: there is none
  float solid_shift = 0;
  std::array<float, kTissueCount> shift{};

  float solid_at(std::size_t v) const { return solid[v] + solid_shift; }
  float part_at(std::size_t v, std::size_t t) const { return part[t][v] + shift[t]; }
  // By how much the tissue's field is above all others'.
  float lead(std::size_t v, std::size_t tissue) const {
    std::optional<float> others;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (t != tissue && !part[t].empty()) others = std::max(others.value_or(-1e9f), part_at(v, t));
    return others ? part_at(v, tissue) - *others : 1.0f;
  }
  std::size_t largest(std::size_t v) const {
    std::size_t most = kTissueCount;
    for (std::size_t t = 0; t < kTissueCount; ++t)
      if (!part[t].empty() && (most == kTissueCount || part_at(v, t) > part_at(v, most))) most = t;
    return most;
  }
};

Levels levels_of(const LabelTissues& anatomy, const WorkBox& box) {
  const double per_label = box.lattice.voxel / anatomy.labels.spacing.minCoeff();
  const int reach = per_label > 1.5 && per_label <= kCoarser ? 2 : 1;
  TissueBox tissues(anatomy, LabelSurface::border(reach));
  const Sampler sampler(anatomy, tissues, box);
  const auto sampled = [&](Sides sides, float outside) {
    return sampler.sampled(LabelSurface(tissues.size(), std::move(sides), anatomy.labels.spacing,
                                        reach, 1 / per_label),
                           outside);
  };
  Levels levels{box, sampled(tissues.solid_sides(), -1.0f), {}, 0, {}};
  std::vector<std::size_t> present;
  for (std::size_t t = 0; t < kTissueCount; ++t)
    if (anatomy.volume_mm3[t] > 0) present.push_back(t);
  tissues.grow();
  if (present.size() == 1) levels.part[present[0]].assign(box.voxels(), 1.0f);
  if (present.size() == 2) {
    levels.part[present[0]] = sampled(tissues.tissue_sides(present[0]), -1.0f);
    levels.part[present[1]] = levels.part[present[0]];
    for (float& f : levels.part[present[1]]) f = -f;
  }
  if (present.size() > 2)
    for (const std::size_t t : present) levels.part[t] = sampled(tissues.tissue_sides(t), -1.0f);
  return levels;
}

// Volumes (output voxels), and how they change with a shift of the field.
struct Volumes {
  double solid = 0, solid_rate = 0;
  std::array<double, kTissueCount> tissue{}, rate{};
};

// The part of each voxel on the positive side of a field, from its value and slope there.
struct Part {
  double inside = 0, rate = 0;
};
template <class At>
Part part_inside(std::size_t v, const std::array<std::size_t, 3>& stride, const At& at) {
  const double here = at(v);
  double slope = 0;
  for (const std::size_t d : stride) {
    const double difference = 0.5 * (at(v + d) - at(v - d));
    slope += difference * difference;
  }
  slope = std::sqrt(slope);
  if (std::abs(here) >= 0.5 * slope) return {here > 0 ? 1.0 : 0.0, 0};
  return {0.5 + here / slope, 1 / slope};
}

Volumes volumes_of(const Levels& levels) {
  const Index3 size = levels.box.size;
  const std::array<std::size_t, 3> stride = {1, static_cast<std::size_t>(size.x()),
                                             static_cast<std::size_t>(size.x()) * size.y()};
  std::vector<Volumes> by_plane(static_cast<std::size_t>(size.z()));
  levels.box.for_each([&](int i, int j, int k, std::size_t v) {
    const Index3 index(i, j, k);
    if (index.minCoeff() == 0 || (size - Index3::Ones() - index).minCoeff() == 0) return;
    const Part solid =
        part_inside(v, stride, [&](std::size_t u) { return double{levels.solid_at(u)}; });
    if (!(solid.inside > 0)) return;
    Volumes& plane = by_plane[static_cast<std::size_t>(k)];
    plane.solid += solid.inside;
    plane.solid_rate += solid.rate;
    for (std::size_t t = 0; t < kTissueCount; ++t) {
      if (levels.part[t].empty()) continue;
      const Part tissue =
          part_inside(v, stride, [&](std::size_t u) { return double{levels.lead(u, t)}; });
      plane.tissue[t] += solid.inside * tissue.inside;
      plane.rate[t] += solid.inside * tissue.rate;
    }
  });
  Volumes all;
  for (const Volumes& plane : by_plane) {
    all.solid += plane.solid;
    all.solid_rate += plane.solid_rate;
    for (std::size_t t = 0; t < kTissueCount; ++t) {
      all.tissue[t] += plane.tissue[t];
      all.rate[t] += plane.rate[t];
    }
  }
  return all;
}

// `wanted`: output voxels.
void restore_volumes(const PerTissue<double>& wanted, Levels& levels) {
  constexpr int kPasses = 6;
  constexpr double kGoodEnough = 0.001;
  const double total = wanted[0] + wanted[1] + wanted[2] + wanted[3];
  const auto moved = [](float shift, double missing, double rate) {
    if (!(rate > 0)) return shift;
    return std::clamp(static_cast<float>(shift + missing / rate), -kMostShift, kMostShift);
  };
  for (int pass = 0; pass < kPasses; ++pass) {
    const Volumes found = volumes_of(levels);
    bool done = std::abs(found.solid / total - 1) < kGoodEnough;
    levels.solid_shift = moved(levels.solid_shift, total - found.solid, found.solid_rate);
    for (std::size_t t = 0; t < kTissueCount; ++t) {
      if (levels.part[t].empty()) continue;
      done = done && std::abs(found.tissue[t] / wanted[t] - 1) < kGoodEnough;
      // Half: what one side gains by its shift, the other gives by its own.
      levels.shift[t] = moved(levels.shift[t], 0.5 * (wanted[t] - found.tissue[t]), found.rate[t]);
    }
    if (done) return;
  }
}

}  // namespace

ToothFields smooth_label_fields(const LabelTissues& anatomy, const WorkBox& box) {
  Levels levels = levels_of(anatomy, box);
  PerTissue<double> wanted = anatomy.volume_mm3;
  for (double& volume : wanted) volume /= std::pow(box.lattice.voxel, 3);
  restore_volumes(wanted, levels);
  ToothFields fields;
  fields.label.resize(box.voxels());
  box.for_each([&](int, int, int, std::size_t v) {
    fields.label[v] = static_cast<std::uint8_t>(tissue_at(static_cast<int>(levels.largest(v))));
    const float solid = levels.solid_at(v);
    levels.solid[v] = signed_as(solid > 0, solid);
  });
  fields.solid = SignedField(box.size, levels.solid);
  Field values = std::move(levels.solid);
  for (std::size_t t = 0; t < 3; ++t) {
    if (levels.part[t].empty()) continue;
    box.for_each([&](int, int, int, std::size_t v) {
      values[v] = signed_as(t == levels.largest(v), levels.lead(v, t));
    });
    fields.tissue[t] = SignedField(box.size, values);
  }
  return fields;
}

}  // namespace toothprep
