#include "toothprep/tools/segmentation/cavity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

namespace toothprep {
namespace {

constexpr double kPulpShare = 0.004;  // of the tooth's voxels: less is no pulp chamber
double smallest_cavity(double blur) { return 8 * std::pow(blur, 3); }  // voxels

// What surrounds a cavity, and what could be one.
struct Walls {
  double grey = 0;  // at least that bright
  // 1 in the largest piece of it, 2 in what that closes off from the outside.
  Mask place;
  std::size_t voxels = 0;  // of that piece

  bool wall(std::size_t v) const { return place[v] == 1; }
  bool closed(std::size_t v) const { return place[v] == 2; }
};

Walls walls_of(const WorkBox& box, const TrimmedField& grey, const GreyClasses& classes) {
  const std::size_t n = box.voxels();
  Walls walls;
  walls.grey = std::max(classes.threshold_dentin,
                        classes.dentin - 0.4 * (classes.dentin - classes.below_dentin));
  walls.place.resize(n);
  box.for_each_row(
      [&, least = not_below(walls.grey)](int, int, std::size_t first, std::size_t end) {
        grey.not_below(least, first, end, walls.place.data() + first);
      });
  keep_largest_component(box.size, walls.place);
  for (std::size_t v = 0; v < n; ++v) walls.voxels += walls.place[v];
  fill_enclosed(box.size, walls.place, 2);
  return walls;
}

// How far (voxels) a voxel is from where a ball's centre comes in from the outside; little beyond the
// ball's radius all is at infinity. Beyond the box all is outside.
struct FromOutside {
  Index3 size = Index3::Zero();
  NearDistance in_box;  // to such places in the box
  double beyond = 0;    // from the box's outermost voxels to such places beyond, voxels

  float at(const Index3& index, std::size_t v) const {
    const int to_edge = std::min(index.minCoeff(), (size - Index3::Ones() - index).minCoeff());
    return std::min(in_box[v], static_cast<float>(to_edge + beyond));
  }
  // Ones where it is more than `radius`, in a row along x whose first voxel is v.
  void farther(double radius, int j, int k, std::size_t v, std::uint8_t* out) const {
    int least = 0;  // to the edge
    while (!(static_cast<float>(least + beyond) > radius)) ++least;
    const int nx = size.x();
    std::fill(out, out + nx, std::uint8_t{0});
    if (std::min({j, k, size.y() - 1 - j, size.z() - 1 - k}) < least) return;
    const auto far = in_box.beyond(radius);
    for (int i = least; i < nx - least; ++i) out[i] = far(v + static_cast<std::size_t>(i));
  }
};

// How far it is to where a ball of this radius (voxels), which fits where it is beyond that from the walls,
// comes in from the outside. Beyond the box all is outside: there the centre is free at the ball's radius
// from the tooth, which is `margin` voxels away.
FromOutside from_outside_for(const WorkBox& box, const NearDistance& to_wall, double ball,
                             double margin) {
  const auto nx = static_cast<std::size_t>(box.size.x()),
             ny = static_cast<std::size_t>(box.size.y());
  Mask scratch(nx);
  const MaskParts balls = parts_of(box.size, [&, far = to_wall.beyond(ball)](std::size_t row) {
    const auto fits = far;
    std::uint8_t* out = scratch.data();
    for (std::size_t i = 0, first = row * nx; i < nx; ++i) out[i] = fits(first + i);
    return scratch.data();
  });
  const auto coming_in = [&](int j, int k, std::uint8_t* out) {
    const std::size_t row = static_cast<std::size_t>(k) * ny + static_cast<std::size_t>(j);
    std::fill(out, out + nx, std::uint8_t{0});
    balls.for_each_in_row(row, [&](std::size_t first, std::size_t end, std::size_t part) {
      if (balls.at_edge[part])
        std::fill(out + (first - row * nx), out + (end - row * nx), std::uint8_t{1});
    });
    return out;
  };
  return {box.size, NearDistance(box.size, coming_in, static_cast<int>(std::ceil(ball)) + 2),
          std::max(0.0, ball - margin)};
}

// Dark parts that the ball can't reach from outside.
struct Parts {
  MaskParts parts;
  std::vector<std::uint8_t> keep;  // per part: it is a cavity
  std::size_t kept_voxels = 0;

  // work(v) for every voxel of a cavity.
  template <class Work>
  void for_each_kept(const Work& work) const {
    parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
      if (keep[part])
        for (std::size_t v = first; v < end; ++v) work(v);
    });
  }
};

// How much of a part's surface is wall, and how much of that dentin, in faces.
struct PartWalls {
  std::size_t all = 0, dentin = 0;
};

std::vector<PartWalls> walls_around(const WorkBox& box, const TrimmedField& grey,
                                    const GreyClasses& classes, const Walls& walls,
                                    const MaskParts& parts) {
  std::vector<PartWalls> around(parts.count());
  const std::array<std::ptrdiff_t, 3> stride = {
      1, box.size.x(), static_cast<std::ptrdiff_t>(box.size.x()) * box.size.y()};
  parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    for (std::size_t v = first; v < end; ++v) {
      const Index3 index = index_of(box.size, v);
      for (int a = 0; a < 3; ++a)
        for (const int side : {-1, 1}) {
          if (index[a] + side < 0 || index[a] + side >= box.size[a]) continue;
          const auto o =
              static_cast<std::size_t>(static_cast<std::ptrdiff_t>(v) + side * stride[a]);
          if (!walls.wall(o)) continue;
          ++around[part].all;
          around[part].dentin += grey[o] < classes.threshold_enamel;
        }
    }
  });
  return around;
}

// A part is a cavity if a ball fits or it is closed, it is no speck, and dentin makes up its walls.
Parts cavities_among(const WorkBox& box, const TrimmedField& grey, const GreyClasses& classes,
                     const Walls& walls, const NearDistance& to_wall,
                     const FromOutside& from_outside, double ball, double blur) {
  Parts found;
  Mask candidate(static_cast<std::size_t>(box.size.x()));  // of a row
  found.parts = parts_of(box.size, [&](std::size_t row) {
    const int j = static_cast<int>(row) % box.size.y(), k = static_cast<int>(row) / box.size.y();
    const std::size_t first = box.offset(0, j, k);
    std::uint8_t* out = candidate.data();
    from_outside.farther(ball + 0.5, j, k, first, out);
    const std::uint8_t* place = walls.place.data() + first;
    for (std::size_t i = 0, n = candidate.size(); i < n; ++i) out[i] &= place[i] != 1;
    return candidate.data();
  });
  found.keep.assign(found.parts.count(), 0);
  const auto ball_fits = to_wall.beyond(ball);
  found.parts.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    for (std::size_t v = first; v < end && !found.keep[part]; ++v)
      found.keep[part] = ball_fits(v) || walls.closed(v);
  });
  const std::vector<PartWalls> around = walls_around(box, grey, classes, walls, found.parts);
  for (std::size_t part = 0; part < found.parts.count(); ++part) {
    found.keep[part] = found.keep[part] &&
                       static_cast<double>(found.parts.voxels[part]) >= smallest_cavity(blur) &&
                       2 * around[part].dentin >= around[part].all;
    if (found.keep[part]) found.kept_voxels += found.parts.voxels[part];
  }
  return found;
}

// The median grey where the walls' blur doesn't reach, if there is such a place.
double typical_grey(const TrimmedField& grey, const Parts& found, const NearDistance& to_wall,
                    double blur) {
  Field core;
  for (double deep = 3 * blur; core.size() < 30 && deep > 0.1; deep *= 0.7) {
    core.clear();
    found.for_each_kept([&](std::size_t v) {
      if (to_wall[v] >= deep) core.push_back(grey[v]);
    });
  }
  std::nth_element(core.begin(), core.begin() + static_cast<std::ptrdiff_t>(core.size() / 2),
                   core.end());
  return core[core.size() / 2];
}

// The cavity's voxels, up to its half-way border, which may lie beyond the parts (bright pulp) or within
// (dark pulp). False if nothing is left.
bool fill_cavity(const WorkBox& box, const TrimmedField& grey, const Parts& found, double wall_grey,
                 const FromOutside& from_outside, double blur, Cavity& cavity) {
  Mask kept(box.voxels());
  found.for_each_kept([&](std::size_t v) { kept[v] = 1; });
  const NearDistance to_kept = cavity.border > wall_grey
                                   ? NearDistance(box.size, kept, static_cast<int>(std::ceil(blur)))
                                   : NearDistance();
  box.for_each_row(
      [&, border = not_below(cavity.border)](int j, int k, std::size_t first, std::size_t end) {
        std::uint8_t* in = kept.data();
        if (!to_kept.empty()) {
          const auto far = to_kept.beyond(blur);
          for (std::size_t v = first; v < end; ++v) in[v] = !far(v);
        }
        if (!std::memchr(in + first, 1, end - first)) return;
        Mask farther(end - first);
        from_outside.farther(cavity.ball + 0.5, j, k, first, farther.data());
        for (std::size_t v = first; v < end; ++v)
          in[v] = in[v] && farther[v - first] && grey[v] < border;
      });
  const MaskParts pieces = parts_of(box.size, kept);
  bool any = false;
  pieces.for_each([&](std::size_t first, std::size_t end, std::size_t part) {
    const bool stays = static_cast<double>(pieces.voxels[part]) >= smallest_cavity(blur);
    if (!stays) std::fill(kept.data() + first, kept.data() + end, std::uint8_t{0});
    any = any || stays;
  });
  cavity.from_outside =
      BandField(chunks_where(box.voxels(), [&](std::size_t v) { return kept[v] != 0; }));
  for_each_of(box, cavity.from_outside, [&](int i, int j, int k, std::size_t v) {
    if (kept[v]) cavity.from_outside[v] = from_outside.at(Index3(i, j, k), v);
  });
  return any;
}

}  // namespace

Cavity find_cavity(const WorkBox& box, const TrimmedField& grey, const GreyClasses& classes,
                   double blur, double margin) {
  Walls walls = walls_of(box, grey, classes);
  Cavity cavity;
  Parts found;
  NearDistance to_wall;
  FromOutside from_outside;
  for (const double radius : {0.35, 0.5, 0.75, 1.0}) {  // mm
    const double ball = std::max(2 * blur, radius / box.lattice.voxel);
    if (ball + 2 > NearDistance::kMostReach) break;
    cavity.ball = ball;
    from_outside = {};
    to_wall = {};  // before there is another one
    to_wall = NearDistance(box.size, walls.place,
                           static_cast<int>(std::ceil(std::max(cavity.ball, 3 * blur))) + 1);
    from_outside = from_outside_for(box, to_wall, cavity.ball, margin);
    found = cavities_among(box, grey, classes, walls, to_wall, from_outside, cavity.ball, blur);
    if (static_cast<double>(found.kept_voxels) > kPulpShare * static_cast<double>(walls.voxels))
      break;
  }
  if (found.kept_voxels == 0) return {};
  cavity.grey = typical_grey(grey, found, to_wall, blur);
  cavity.border = 0.5 * (cavity.grey + classes.dentin);
  to_wall = NearDistance();
  Mask().swap(walls.place);
  return fill_cavity(box, grey, found, walls.grey, from_outside, blur, cavity) ? cavity : Cavity{};
}

}  // namespace toothprep
