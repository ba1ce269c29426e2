#include "toothprep/proof/specimen/arch.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <optional>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

// Teeth stand along a chain from 37 over the midline to 47. Each has the direction t of the chain,
// horizontal, and the direction out of the arch, a quarter turn from it. Left of the midline t
// points to mesial, right of it to distal, so the teeth there are mirrored.
namespace toothprep {
namespace {

const Vec3 kAxis(6.1, 5.5, 17);  // of the form in molar.h, about which teeth are made smaller
constexpr double kMargin = 1.7;  // mm about a tooth's box: farther away the box serves
constexpr double kGumHeight = 11.0, kGumFoot = 3.0, kGumHalfWidth = 6.0;  // mm

struct Place {
  const char* name;
  bool molar;
  double scale;
  double turn_deg;  // of the chain from the tooth before
};
constexpr std::array<Place, 14> kPlaces = {{{"37", true, 0.97, 0},
                                            {"36", true, 1.0, 4},
                                            {"35", false, 1.0, 5},
                                            {"34", false, 0.98, 8},
                                            {"33", false, 0.95, 18},
                                            {"32", false, 0.78, 24},
                                            {"31", false, 0.74, 18},
                                            {"41", false, 0.74, 16},
                                            {"42", false, 0.78, 18},
                                            {"43", false, 0.95, 24},
                                            {"44", false, 0.98, 18},
                                            {"45", false, 1.0, 8},
                                            {"46", true, 1.0, 5},
                                            {"47", true, 0.97, 4}}};
constexpr int kPrepared = 1, kFirstOfRight = 7;

// A tooth of the chain where it stands.
struct Standing {
  int place = 0;
  Vec3 at, along, out;  // of its axis; unit, horizontal
  MolarOptions form;
  Box box;  // mm, in its own coordinates

  Vec3 to_form(const Vec3& x) const {
    const Vec3 d = (x - at) / kPlaces[static_cast<std::size_t>(place)].scale;
    const double side = place < kFirstOfRight ? -1 : 1;
    return kAxis + Vec3(d.dot(out), side * d.dot(along), d.z());
  }
  ToothSample sample(const Vec3& x) const {
    const auto scale = static_cast<float>(kPlaces[static_cast<std::size_t>(place)].scale);
    const Vec3 own = to_form(x);
    const double beyond = (own - own.cwiseMax(box.min).cwiseMin(box.max)).norm();
    ToothSample s;
    if (beyond > kMargin) {
      s.solid = scale * static_cast<float>(beyond);
      s.tissue.fill(s.solid);
      return s;
    }
    s = sample_variant(own, form);
    s.solid *= scale;
    for (float& tissue : s.tissue) tissue *= scale;
    return s;
  }
};

// The farthest place of a tooth along a line through `from`, mm, within `reach` either way; nothing
// if the line misses it. By the sign of the distance, which holds everywhere, and by its value
// right below the surface.
std::optional<double> outermost(const Standing& tooth, const Vec3& from, const Vec3& line,
                                double reach) {
  constexpr double kStep = 0.1;
  for (double t = reach; t > -reach; t -= kStep)
    if (const double d = tooth.sample(from + t * line).solid; d < 0) return t - d;
  return std::nullopt;
}

// How far two teeth are apart along `between`, where they are nearest, around a place.
double clearance(const Standing& a, const Standing& b, const Vec3& near, const Vec3& between) {
  constexpr double kStep = 0.15, kReach = 3;
  const Vec3 across(-between.y(), between.x(), 0);
  double least = 2 * kReach;
  for (int i = -16; i <= 16; ++i)
    for (int k = -20; k <= 20; ++k) {
      const Vec3 from = near + kStep * (i * across + Vec3(0, 0, k));
      const auto end = outermost(a, from, between, kReach),
                 begin = outermost(b, from, -between, kReach);
      if (end && begin) least = std::min(least, -*begin - *end);
    }
  return least;
}

Standing tooth_at(const ArchOptions& o, int place, const Vec3& at, const Vec3& along) {
  Standing s;
  s.place = place;
  s.at = at;
  s.along = along;
  s.out = Vec3(-along.y(), along.x(), 0);
  if (place == kPrepared)
    s.form = o.tooth;
  else
    s.form.premolar = !kPlaces[static_cast<std::size_t>(place)].molar;
  s.box = molar_bounds(s.form);
  return s;
}

// The tooth at `place` beside one that stands, `way` +1 along the chain or -1 against it.
Standing tooth_beside(const ArchOptions& o, const Standing& stands, int way) {
  const int place = stands.place + way;
  const int turned = way > 0 ? place : stands.place;
  const double turn = -way * units::from_degree(kPlaces[static_cast<std::size_t>(turned)].turn_deg);
  const auto about_z = [](double angle, const Vec3& v) {
    return Vec3(Eigen::AngleAxisd(angle, Vec3::UnitZ()) * v);
  };
  const Vec3 between = way * about_z(turn / 2, stands.along);
  const auto half = [](int p) {
    const Place& form = kPlaces[static_cast<std::size_t>(p)];
    return form.scale * (form.molar ? 5.3 : 3.55);
  };
  const Vec3 contact = stands.at + half(stands.place) * between - Vec3(0, 0, 1.5);
  const double apart = half(stands.place) + half(place) + o.gap;
  Standing next = tooth_at(o, place, stands.at + apart * between, about_z(turn, stands.along));
  next.at += (o.gap - clearance(stands, next, contact, between)) * between;
  return next;
}

std::vector<Standing> chain(const ArchOptions& o) {
  std::vector<Standing> teeth{tooth_at(o, kPrepared, kAxis, -Vec3::UnitY())};
  if (o.neighbours >= 1) teeth.push_back(tooth_beside(o, teeth[0], -1));
  for (int n = 2; n <= o.neighbours; ++n)
    teeth.push_back(tooth_beside(o, n == 2 ? teeth[0] : teeth.back(), 1));
  return teeth;
}

// Of the ridge about the roots: along the teeth's axes in the chain's order.
double distance_to_gum(const std::vector<Vec3>& axes, const Vec3& x) {
  const auto flat = [](const Vec3& v) { return Vec3(v.x(), v.y(), 0); };
  double least = flat(x - axes[0]).norm();
  for (std::size_t i = 1; i < axes.size(); ++i) {
    const Vec3 way = flat(axes[i] - axes[i - 1]), from = flat(x - axes[i - 1]);
    const double t = std::clamp(from.dot(way) / way.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (from - t * way).norm());
  }
  return std::max({least - kGumHalfWidth, x.z() - kGumHeight, kGumFoot - x.z()});
}

struct BodySample {
  ToothSample sample;
  std::uint8_t body = 0;
};

class Arch {
 public:
  explicit Arch(const ArchOptions& o) : teeth_(chain(o)), gum_(o.gum) {
    std::vector<const Standing*> order;
    for (const Standing& t : teeth_) order.push_back(&t);
    std::sort(order.begin(), order.end(),
              [](const Standing* a, const Standing* b) { return a->place < b->place; });
    for (const Standing* t : order) axes_.push_back(t->at);
  }

  BodySample at(const Vec3& x) const {
    BodySample found{teeth_[0].sample(x), 1};
    for (std::size_t t = 1; t < teeth_.size(); ++t) {
      const ToothSample s = teeth_[t].sample(x);
      for (std::size_t k = 0; k < s.tissue.size(); ++k)
        found.sample.tissue[k] = std::min(found.sample.tissue[k], s.tissue[k]);
      if (s.solid >= found.sample.solid) continue;
      found.sample.solid = s.solid;
      found.sample.label = s.label;
      found.body = static_cast<std::uint8_t>(t + 1);
    }
    if (!gum_) return found;
    const auto gum = static_cast<float>(distance_to_gum(axes_, x));
    if (found.sample.label == Tissue::kAir && gum < 0) {
      found.sample.label = Tissue::kOther;
      found.body = static_cast<std::uint8_t>(teeth_.size() + 1);
    }
    found.sample.solid = std::min(found.sample.solid, gum);
    return found;
  }

  std::vector<Body> list() const {
    std::vector<Body> bodies;
    for (const Standing& t : teeth_)
      bodies.push_back({kPlaces[static_cast<std::size_t>(t.place)].name,
                        t.place == kPrepared ? BodyKind::kTooth : BodyKind::kNeighbour});
    if (gum_) bodies.push_back({"gum", BodyKind::kGum});
    return bodies;
  }

  Box bounds() const {
    Box all{Vec3::Constant(1e30), Vec3::Constant(-1e30)};
    for (const Standing& t : teeth_) {
      const Box own = t.box;
      const double scale = kPlaces[static_cast<std::size_t>(t.place)].scale,
                   side = t.place < kFirstOfRight ? -1 : 1;
      for (int c = 0; c < 8; ++c) {
        const Vec3 d =
            scale * (Vec3((c & 1 ? own.max : own.min).x(), (c & 2 ? own.max : own.min).y(),
                          (c & 4 ? own.max : own.min).z()) -
                     kAxis);
        const Vec3 x = t.at + d.x() * t.out + side * d.y() * t.along + Vec3(0, 0, d.z());
        all.min = all.min.cwiseMin(x);
        all.max = all.max.cwiseMax(x);
      }
      if (!gum_) continue;
      const Vec3 wide(kGumHalfWidth + 0.1, kGumHalfWidth + 0.1, 0);
      all.min = all.min.cwiseMin(t.at - wide);
      all.max = all.max.cwiseMax(t.at + wide);
    }
    return all;
  }

 private:
  std::vector<Standing> teeth_;
  bool gum_;
  std::vector<Vec3> axes_;  // in the chain's order
};

// Away from a surface f/|grad f| is not a bound of the distance, hence a factor (molar.cpp).
constexpr double kSlopeCaution = 2.0;

bool far_from_surfaces(const ToothSample& s, double far) {
  return std::abs(s.solid) > far &&
         (s.solid > 0 || std::all_of(s.tissue.begin(), s.tissue.end(),
                                     [&](float d) { return std::abs(d) > far; }));
}

}  // namespace

LayeredTooth make_arch(const ArchOptions& o) {
  if (!(o.neighbours >= 0 && o.neighbours <= kMostNeighbours))
    throw Error(
        fmt::format("molar: {} neighbours are not within 0 to {}", o.neighbours, kMostNeighbours));
  if (!(o.gap >= 0.02 && o.gap <= 2))
    throw Error(fmt::format("molar: a gap of {:g} mm is not within 0.02 to 2 mm", o.gap));
  if (o.neighbours == 0 && !o.gum) return make_molar(o.tooth);
  check_molar_options(o.tooth);
  const Arch arch(o);
  const double voxel = o.tooth.voxel;
  const Lattice lattice{Vec3::Constant(voxel / 2), voxel};
  const Box box = arch.bounds();
  const Index3 lower = lattice.to_index(box.min).array().floor().matrix().cast<int>();
  const Index3 upper = lattice.to_index(box.max).array().ceil().matrix().cast<int>();
  const double half = voxel * (kBrickEdge - 1) / 2.0;
  const double far = kSlopeCaution * half * std::sqrt(3.0) + kBandVoxels * voxel;

  LabelGrid of = make_body_grid(make_empty_tooth(lattice, lower, upper).tissue, arch.list().size());
  std::mutex insert;
  LayeredTooth tooth =
      build_tooth_by_brick(lattice, lower, upper, [&](const Index3& first, ToothSample* samples) {
        std::array<std::uint8_t, kBrickVoxels> body;
        const BodySample middle = arch.at(lattice.to_world(first) + Vec3::Constant(half));
        if (far_from_surfaces(middle.sample, far)) {
          std::fill(samples, samples + kBrickVoxels, middle.sample);
          body.fill(middle.body);
        } else {
          for (int v = 0; v < kBrickVoxels; ++v) {
            const BodySample s =
                arch.at(lattice.to_world(first + Index3(v >> 6, (v >> 3) & 7, v & 7)));
            samples[v] = s.sample;
            body[static_cast<std::size_t>(v)] = s.body;
          }
        }
        const std::lock_guard lock(insert);
        of.set_brick(static_cast<std::size_t>(of.brick_index(first.x(), first.y(), first.z())),
                     body.data());
      });
  set_bodies(tooth, arch.list(), std::move(of));
  describe_molar(o.tooth, tooth);
  if (o.neighbours > 0) tooth.provenance["source"] += fmt::format(", {} neighbours", o.neighbours);
  if (o.gum) tooth.provenance["source"] += ", gum";
  return tooth;
}

}  // namespace toothprep
