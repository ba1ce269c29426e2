#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

struct Triangle {
  Vec3 a, ab, ac, normal;  // normal of length one, or zero for a triangle without area
  Vec3 low, high;
  Vec3 middle;    // of the ball around the triangle
  double radius;  // of that ball

  Triangle(const Vec3& a_, const Vec3& b, const Vec3& c)
      : a(a_), ab(b - a_), ac(c - a_), normal(ab.cross(ac)) {
    const double length = normal.norm();
    if (length > 0) normal /= length;
    low = a.cwiseMin(b).cwiseMin(c);
    high = a.cwiseMax(b).cwiseMax(c);
    middle = (a + b + c) / 3;
    radius = std::sqrt(std::max(
        {(a - middle).squaredNorm(), (b - middle).squaredNorm(), (c - middle).squaredNorm()}));
  }
};

// Squared distance of p to the nearest point of the triangle, by the region of the plane that p
// falls in (Ericson, Real-Time Collision Detection, 5.1.5).
double squared_distance(const Triangle& t, const Vec3& p) {
  const Vec3 ap = p - t.a;
  const double d1 = t.ab.dot(ap), d2 = t.ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.squaredNorm();
  const Vec3 bp = ap - t.ab;
  const double d3 = t.ab.dot(bp), d4 = t.ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.squaredNorm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - d1 / (d1 - d3) * t.ab).squaredNorm();
  const Vec3 cp = ap - t.ac;
  const double d5 = t.ab.dot(cp), d6 = t.ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.squaredNorm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - d2 / (d2 - d6) * t.ac).squaredNorm();
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return (bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (t.ac - t.ab)).squaredNorm();
  const double height = t.normal.dot(ap);
  return height * height;
}

// Triangles by brick: those within the band of some voxel of the brick, and perhaps a few more.
struct Bins {
  std::vector<std::size_t> start;
  std::vector<std::uint32_t> triangle;
};

Bins bins_of(const std::vector<Triangle>& triangles, const Lattice& lattice, const LevelSet& box) {
  const double half = 0.5 * lattice.voxel * (kBrickEdge - 1), band = kBandVoxels * lattice.voxel;
  const double reach = half * std::sqrt(3.0) + band, margin = band / lattice.voxel;
  const auto for_each_brick = [&](const Triangle& t, auto&& use) {
    const Index3 low = (lattice.to_index(t.low).array() - margin).ceil().cast<int>();
    const Index3 high = (lattice.to_index(t.high).array() + margin).floor().cast<int>();
    for (int x = low.x() >> 3; x <= high.x() >> 3; ++x)
      for (int y = low.y() >> 3; y <= high.y() >> 3; ++y)
        for (int z = low.z() >> 3; z <= high.z() >> 3; ++z) {
          const Index3 first = kBrickEdge * Index3(x, y, z);
          const std::int64_t b = box.brick_index(first.x(), first.y(), first.z());
          if (b < 0) continue;
          const Vec3 centre = lattice.to_world(first) + Vec3::Constant(half);
          if (squared_distance(t, centre) <= reach * reach) use(static_cast<std::size_t>(b));
        }
  };
  Bins bins;
  bins.start.assign(box.table_size() + 1, 0);
  for (const Triangle& t : triangles)
    for_each_brick(t, [&](std::size_t b) { ++bins.start[b + 1]; });
  for (std::size_t b = 0; b < box.table_size(); ++b) bins.start[b + 1] += bins.start[b];
  bins.triangle.resize(bins.start.back());
  std::vector<std::size_t> next(bins.start.begin(), bins.start.end() - 1);
  for (std::size_t k = 0; k < triangles.size(); ++k)
    for_each_brick(triangles[k], [&](std::size_t b) {
      bins.triangle[next[b]++] = static_cast<std::uint32_t>(k);
    });
  return bins;
}

// Unsigned distances (mm) of a brick's voxels to the triangles in its bin, at most the band.
void brick_distances(const std::vector<Triangle>& triangles, const Bins& bins, std::size_t brick,
                     const Lattice& lattice, const Index3& first, float* distance) {
  std::array<double, kBrickVoxels> nearest;
  nearest.fill(kBandVoxels * lattice.voxel);
  const Vec3 origin = lattice.to_world(first);
  for (std::size_t n = bins.start[brick]; n < bins.start[brick + 1]; ++n) {
    const Triangle& t = triangles[bins.triangle[n]];
    const Vec3 from = (t.low - origin) / lattice.voxel, to = (t.high - origin) / lattice.voxel;
    const Index3 low =
        (from.array() - kBandVoxels).ceil().max(0.0).min(double{kBrickEdge}).cast<int>();
    const Index3 high =
        (to.array() + kBandVoxels).floor().min(double{kBrickEdge - 1}).max(-1.0).cast<int>();
    const Vec3 to_middle = origin - t.middle;
    const double offset = t.normal.dot(origin - t.a);
    // Most voxels are found too far by the ball around the triangle or by its plane.
    const double farthest = kBandVoxels * lattice.voxel + t.radius;
    for (int x = low.x(); x <= high.x(); ++x)
      for (int y = low.y(); y <= high.y(); ++y) {
        const Vec3 row = lattice.voxel * Vec3(x, y, 0);
        const double across = (to_middle + row).head<2>().squaredNorm();
        if (across >= farthest * farthest) continue;
        const double row_offset = offset + t.normal.dot(row);
        double* nearest_in_row = &nearest[static_cast<std::size_t>(brick_offset(x, y, 0))];
        for (int z = low.z(); z <= high.z(); ++z) {
          double& best = nearest_in_row[z];
          const double up = lattice.voxel * z, along = to_middle.z() + up;
          const double reach = best + t.radius;
          if (across + along * along >= reach * reach) continue;
          if (std::abs(row_offset + t.normal.z() * up) >= best) continue;
          const double square = squared_distance(t, origin + Vec3(row.x(), row.y(), up));
          if (square < best * best) best = std::sqrt(square);
        }
      }
  }
  for (std::size_t v = 0; v < kBrickVoxels; ++v) distance[v] = static_cast<float>(nearest[v]);
}

// Where lines along z through the voxel centres cross a shell. Whether a line meets a triangle is
// decided edge by edge with the edge's ends in a fixed order, so both triangles of an edge agree
// whatever the rounding, and every line crosses a closed shell an even number of times.
class Crossings {
 public:
  Crossings(const Shell& shell, const Lattice& lattice, const LevelSet& box)
      : first_(kBrickEdge * box.first_brick()), count_(kBrickEdge * box.brick_counts()) {
    std::vector<std::pair<std::uint32_t, double>> hits;  // column, z
    for (const auto& t : shell.triangles) {
      const Vec3 &a = shell.points[t[0]], &b = shell.points[t[1]], &c = shell.points[t[2]];
      const Vec3 low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
      const Index3 from = lattice.to_index(low).array().floor().cast<int>();
      const Index3 to = lattice.to_index(high).array().ceil().cast<int>();
      const Vec3 normal = (b - a).cross(c - a);
      for (int i = from.x(); i <= to.x(); ++i)
        for (int j = from.y(); j <= to.y(); ++j) {
          const Vec3 p = lattice.to_world(Index3(i, j, 0));
          if (!(crosses(shell, t[0], t[1], p) ^ crosses(shell, t[1], t[2], p) ^
                crosses(shell, t[2], t[0], p)))
            continue;
          double z = a.z();
          if (normal.z() != 0)
            z -= (normal.x() * (p.x() - a.x()) + normal.y() * (p.y() - a.y())) / normal.z();
          hits.emplace_back(column(i, j), std::clamp(z, low.z(), high.z()));
        }
    }
    std::sort(hits.begin(), hits.end());
    start_.assign(static_cast<std::size_t>(count_.x()) * count_.y() + 1, 0);
    for (const auto& hit : hits) ++start_[hit.first + 1];
    for (std::size_t n = 1; n < start_.size(); ++n) start_[n] += start_[n - 1];
    z_.reserve(hits.size());
    for (const auto& hit : hits) z_.push_back(hit.second);
  }

  bool inside(int i, int j, double z) const {
    const std::uint32_t n = column(i, j);
    const auto begin = z_.begin() + static_cast<std::ptrdiff_t>(start_[n]);
    const auto end = z_.begin() + static_cast<std::ptrdiff_t>(start_[n + 1]);
    return (std::lower_bound(begin, end, z) - begin) % 2 != 0;
  }

 private:
  std::uint32_t column(int i, int j) const {
    return static_cast<std::uint32_t>(i - first_.x()) * static_cast<std::uint32_t>(count_.y()) +
           static_cast<std::uint32_t>(j - first_.y());
  }
  // Does the ray from p along +x, in the plane of x and y, cross the edge?
  static bool crosses(const Shell& shell, std::uint32_t u, std::uint32_t v, const Vec3& p) {
    const Vec3& a = shell.points[std::min(u, v)];
    const Vec3& b = shell.points[std::max(u, v)];
    if ((a.y() <= p.y()) == (b.y() <= p.y())) return false;
    const double side = (b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x());
    return (side > 0) == (b.y() > a.y());
  }

  Index3 first_, count_;
  std::vector<std::size_t> start_;
  std::vector<double> z_;
};

// Signed distance to one shell on the tooth's lattice, exact within the band.
LevelSet signed_distance(const Shell& shell, const Lattice& lattice, LevelSet grid) {
  std::vector<Triangle> triangles;
  triangles.reserve(shell.triangles.size());
  for (const auto& t : shell.triangles)
    triangles.emplace_back(shell.points[t[0]], shell.points[t[1]], shell.points[t[2]]);
  const Bins bins = bins_of(triangles, lattice, grid);
  const Crossings crossings(shell, lattice, grid);
  std::mutex insert;
  tbb::parallel_for(std::size_t{0}, grid.table_size(), [&](std::size_t b) {
    const Index3 first = grid.brick_origin(b);
    std::array<float, kBrickVoxels> phi;
    if (bins.start[b] == bins.start[b + 1]) {
      if (!crossings.inside(first.x(), first.y(), lattice.to_world(first).z())) return;
      phi.fill(-grid.background());
    } else {
      brick_distances(triangles, bins, b, lattice, first, phi.data());
      for (int x = 0; x < kBrickEdge; ++x)
        for (int y = 0; y < kBrickEdge; ++y)
          for (int z = 0; z < kBrickEdge; ++z) {
            const Index3 i = first + Index3(x, y, z);
            float& value = phi[static_cast<std::size_t>(brick_offset(x, y, z))];
            if (crossings.inside(i.x(), i.y(), lattice.to_world(i).z())) value = -value;
          }
    }
    const std::lock_guard lock(insert);
    grid.set_brick(b, phi.data());
  });
  return grid;
}

double interpolated(const LevelSet& grid, const Lattice& lattice, const Vec3& p) {
  const Vec3 x = lattice.to_index(p);
  const Index3 i = x.array().floor().cast<int>();
  const Vec3 f = x - i.cast<double>();
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const int dx = c & 1, dy = c >> 1 & 1, dz = c >> 2;
    sum += (dx ? f.x() : 1 - f.x()) * (dy ? f.y() : 1 - f.y()) * (dz ? f.z() : 1 - f.z()) *
           grid.value(i.x() + dx, i.y() + dy, i.z() + dz);
  }
  return sum;
}

// The parts of the shells that face the air.
class Exposed {
 public:
  Exposed(const std::vector<LevelSet>& distance, const Lattice& lattice)
      : distance_(distance), lattice_(lattice) {}

  void add(const Shell& shell, std::size_t own) {
    for (const auto& t : shell.triangles) {
      const std::array<Vec3, 3> corner{shell.points[t[0]], shell.points[t[1]], shell.points[t[2]]};
      const Triangle whole(corner[0], corner[1], corner[2]);
      if (distance_.size() == 1 || whole.normal.isZero()) {
        triangles.push_back(whole);
        continue;
      }
      const std::size_t before = triangles.size();
      if (cut(corner, whole.normal, own)) {  // exposed all over: keep it whole
        triangles.resize(before, whole);
        triangles.push_back(whole);
      }
    }
  }

  std::vector<Triangle> triangles;

 private:
  // Adds the exposed pieces; true if all of them are.
  bool cut(const std::array<Vec3, 3>& t, const Vec3& normal, std::size_t own) {
    int longest = 0;
    double square = 0;
    for (int k = 0; k < 3; ++k) {
      const double edge = (t[(k + 1) % 3] - t[k]).squaredNorm();
      if (edge > square) {
        square = edge;
        longest = k;
      }
    }
    if (square > lattice_.voxel * lattice_.voxel) {
      const Vec3 &a = t[longest], &b = t[(longest + 1) % 3], &c = t[(longest + 2) % 3];
      const Vec3 middle = 0.5 * (a + b);
      const bool left = cut({a, middle, c}, normal, own);
      const bool right = cut({middle, b, c}, normal, own);
      return left && right;
    }
    const Vec3 centre = (t[0] + t[1] + t[2]) / 3;
    if (covered(centre, normal, own)) return false;
    triangles.emplace_back(t[0], t[1], t[2]);
    return true;
  }
  bool covered(const Vec3& p, const Vec3& normal, std::size_t own) const {
    const double gap = 0.5 * lattice_.voxel;
    for (std::size_t s = 0; s < distance_.size(); ++s) {
      if (s == own) continue;
      for (const double step : {0.25 * gap, 0.5 * gap, gap})
        if (interpolated(distance_[s], lattice_, p + step * normal) < 0) return true;
    }
    return false;
  }

  const std::vector<LevelSet>& distance_;
  const Lattice& lattice_;
};

Vec3 gradient_direction(const LevelSet& grid, const Index3& i) {
  const auto at = [&](int x, int y, int z) {
    return static_cast<double>(grid.value(i.x() + x, i.y() + y, i.z() + z));
  };
  const Vec3 g(at(1, 0, 0) - at(-1, 0, 0), at(0, 1, 0) - at(0, -1, 0), at(0, 0, 1) - at(0, 0, -1));
  const double length = g.norm();
  return length > 0 ? Vec3(g / length) : Vec3::Zero();
}

// The order of who wins, innermost first.
constexpr std::array<Tissue, kTissueCount> kInnermostFirst = {Tissue::kPulp, Tissue::kDentin,
                                                              Tissue::kEnamel, Tissue::kOther};

struct ShellBox {
  Vec3 low, high;
};
ShellBox box_of(const Shell& shell) {
  ShellBox box{shell.points.at(0), shell.points.at(0)};
  for (const Vec3& p : shell.points) {
    box.low = box.low.cwiseMin(p);
    box.high = box.high.cwiseMax(p);
  }
  return box;
}

// The shells from the innermost out.
struct Nest {
  std::vector<const Shell*> shell;
  std::vector<Tissue> tissue;
  std::vector<ShellBox> box;
  ShellBox all;
};

Nest nest_of(const std::vector<TissueShell>& shells) {
  Nest nest;
  for (const Tissue t : kInnermostFirst)
    for (const TissueShell& s : shells)
      if (s.tissue == t) {
        if (!nest.tissue.empty() && nest.tissue.back() == t)
          throw Error("two shells of " + std::string(kTissueNames[tissue_index(t)]) +
                      " are given; one shell may have several parts");
        nest.shell.push_back(&s.shell);
        nest.tissue.push_back(t);
      }
  if (nest.shell.empty()) throw Error("a tooth needs at least one shell");
  for (const Shell* s : nest.shell) nest.box.push_back(box_of(*s));
  nest.all = nest.box[0];
  for (const ShellBox& b : nest.box) {
    nest.all.low = nest.all.low.cwiseMin(b.low);
    nest.all.high = nest.all.high.cwiseMax(b.high);
  }
  return nest;
}

// What the tooth stands on: voxel faces at multiples of the voxel size.
Lattice lattice_of(const Nest& nest, const ShellOptions& options) {
  const auto& [low, high] = nest.all;
  if (!(options.voxel > 0) ||
      low.cwiseAbs().cwiseMax(high.cwiseAbs()).maxCoeff() / options.voxel > 1e9)
    throw Error(
        "the shells lie too far from the frame's zero for voxels of this size; use a "
        "larger --voxel-mm");
  // Measured with a molar's shells, per voxel of the box: 4.5 bytes with one shell, 6.1 with three.
  // Twice as much is asked for, since solid tissue fills the boxes of other shapes better.
  const double bytes = 7.5 + 1.5 * static_cast<double>(nest.shell.size());
  constexpr double kSeconds = 2e-7;  // on two cores of 2.3 GHz
  const std::string work =
      announced_voxels(((high - low) / options.voxel).prod(), options.voxel, bytes, kSeconds);
  if (options.announce && !work.empty()) options.announce(work);
  Lattice lattice;
  lattice.voxel = options.voxel;
  lattice.origin = Vec3::Constant(0.5 * options.voxel);
  return lattice;
}

using Depths = std::array<float, kTissueCount>;  // signed distance to each shell at a voxel

// Where two shells touch (see the header) their border moves to the middle of the gap.
Depths without_gaps(const std::vector<LevelSet>& distance, const Index3& i, const Depths& drawn,
                    float gap, float band) {
  Depths phi = drawn;
  for (std::size_t s = 0; s < distance.size(); ++s)
    for (std::size_t t = s + 1; t < distance.size(); ++t) {
      const float sum = drawn[s] + drawn[t];
      if (sum <= 0 || sum >= gap || std::max(std::abs(drawn[s]), std::abs(drawn[t])) >= band)
        continue;
      if (gradient_direction(distance[s], i).dot(gradient_direction(distance[t], i)) > -0.5)
        continue;
      const float half = 0.5F * (drawn[s] - drawn[t]);
      phi[s] = half;
      phi[t] = -half;
    }
  return phi;
}

// The voxel belongs to the innermost shell around it. `outside`: distance to their union;
// `depth`: to its surface.
ToothSample sample_of(const std::vector<Tissue>& tissue, const Depths& phi, float outside,
                      float depth, float band) {
  ToothSample sample;
  sample.tissue.fill(band);
  float inner = band;  // union of the shells further in
  for (std::size_t s = 0; s < tissue.size(); ++s) {
    const float own = std::max(phi[s], -inner);
    if (tissue[s] != Tissue::kOther)
      sample.tissue[static_cast<std::size_t>(tissue_index(tissue[s]))] = own;
    if (phi[s] <= 0 && sample.label == Tissue::kAir) sample.label = tissue[s];
    inner = std::min(inner, phi[s]);
  }
  sample.solid = sample.label == Tissue::kAir ? std::max(outside, 0.0F) : -depth;
  return sample;
}

void add_notes(const Nest& nest, double voxel, const LayeredTooth& tooth,
               std::vector<std::string>& notes) {
  const auto& box = nest.box;
  for (std::size_t s = 0; s < box.size(); ++s) {
    bool touches = box.size() == 1;
    for (std::size_t t = 0; t < box.size() && !touches; ++t)
      touches = t != s && (box[s].low.array() <= box[t].high.array() + voxel).all() &&
                (box[t].low.array() <= box[s].high.array() + voxel).all();
    if (!touches)
      notes.push_back(nest.shell[s]->file +
                      ": touches none of the other shells; do they share a frame?");
  }
  const auto volumes = remaining_volumes_mm3(tooth);
  for (std::size_t s = 0; s < box.size(); ++s)
    if (!(volumes[static_cast<std::size_t>(tissue_index(nest.tissue[s]))] > 0))
      notes.push_back(nest.shell[s]->file +
                      ": nothing of it is left: it lies inside the shells further in, or is "
                      "thinner than a voxel");
}

}  // namespace

LayeredTooth voxelize_shells(const std::vector<TissueShell>& shells, const ShellOptions& options,
                             std::vector<std::string>* notes) {
  const auto report = [&](const char* stage, double done) {
    if (options.progress) options.progress(stage, done);
  };
  const Nest nest = nest_of(shells);
  const Lattice lattice = lattice_of(nest, options);
  constexpr int kMargin = 4;  // voxels: the band and one more
  const Index3 lower = lattice.to_index(nest.all.low).array().floor().cast<int>() - kMargin;
  const Index3 upper = lattice.to_index(nest.all.high).array().ceil().cast<int>() + kMargin;

  const LevelSet empty = make_empty_tooth(lattice, lower, upper).solid;
  std::vector<LevelSet> distance;
  const double parts = static_cast<double>(nest.shell.size()) + 1;
  for (const Shell* shell : nest.shell) {
    report("measuring distances", static_cast<double>(distance.size()) / parts);
    distance.push_back(signed_distance(*shell, lattice, empty));
  }
  report("joining the shells", (parts - 1) / parts);
  Exposed exposed(distance, lattice);
  for (std::size_t s = 0; s < nest.shell.size(); ++s) exposed.add(*nest.shell[s], s);
  const Bins bins = bins_of(exposed.triangles, lattice, empty);

  const auto gap = static_cast<float>(0.5 * options.voxel);
  const float band = empty.background();
  LayeredTooth tooth =
      build_tooth_by_brick(lattice, lower, upper, [&](const Index3& first, ToothSample* samples) {
        const auto b = static_cast<std::size_t>(empty.brick_index(first.x(), first.y(), first.z()));
        std::array<float, kBrickVoxels> depth;
        brick_distances(exposed.triangles, bins, b, lattice, first, depth.data());
        for (int v = 0; v < kBrickVoxels; ++v) {
          Depths drawn{};
          float outside = band;
          for (std::size_t s = 0; s < distance.size(); ++s) {
            drawn[s] = distance[s].brick(b)[v];
            outside = std::min(outside, drawn[s]);
          }
          const Index3 i = first + Index3(v >> 6, v >> 3 & 7, v & 7);
          const Depths phi = without_gaps(distance, i, drawn, gap, band);
          samples[v] =
              sample_of(nest.tissue, phi, outside, depth[static_cast<std::size_t>(v)], band);
        }
      });
  if (notes) add_notes(nest, options.voxel, tooth, *notes);
  report("done", 1);
  return tooth;
}

}  // namespace toothprep
