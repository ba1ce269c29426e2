#include "toothprep/proof/reference/straight_feed.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/gauss_kronrod.hpp>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>

#include "toothprep/proof/reference/profile_breaks.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using units::kPi;
using Kronrod = boost::math::quadrature::gauss_kronrod<double, 31>;

constexpr double kAdvancing = 1e-9;  // a circle whose v·n / |v| stays below doesn't advance
constexpr int kLayers = 2;           // enamel, dentin
constexpr std::size_t kFaces = 6;
constexpr int kDeepest = 14;  // bisections of one part

// ---- What the contact is bounded by, in B.

enum class Layers { kEnamelOnly, kDentinOnly, kBoth };

// All that the integrals depend on: two rows with equal situations have equal loads per velocity.
struct Situation {
  bool touches = false;
  Vec3 direction = Vec3::Zero();  // of the feed, unit, in B
  std::vector<HalfSpace> faces;   // those faces of the block that cut the head
  HalfSpace enamel;               // valid if layers is kBoth
  Layers layers = Layers::kEnamelOnly;
  Mat3 to_world = Mat3::Identity();
};

struct Range {
  double low, high;
};

// a·x over the torus-like box {r <= r_max, z_min <= z <= z_max} that holds the piece.
Range range_of(const HalfSpace& h, const ProfileBounds& b) {
  const double z0 = h.a.z() * b.z_min, z1 = h.a.z() * b.z_max;
  return {-h.across * b.r_max + std::min(z0, z1), h.across * b.r_max + std::max(z0, z1)};
}

ProfileBounds grinding_bounds(const Scene& scene) {
  ProfileBounds all{0, 0, 1e30, -1e30};
  for (const ProfilePiece& piece : scene.profile) {
    if (!piece.grinds) continue;
    const ProfileBounds b = bounds_of(piece);
    all.r_max = std::max(all.r_max, b.r_max);
    all.z_min = std::min(all.z_min, b.z_min);
    all.z_max = std::max(all.z_max, b.z_max);
  }
  return all;
}

Situation situation_of(const Scene& scene, const ProfileBounds& bounds, const Pose& bur,
                       const Vec3& velocity) {
  Situation out;
  const double speed = velocity.norm();
  if (!(speed > 0) || !std::isfinite(speed) || !bur.position.allFinite()) return out;
  out.to_world = bur.orientation.toRotationMatrix();
  const Mat3 to_bur = out.to_world.transpose();
  out.direction = to_bur * (velocity / speed);

  const auto half_space = [&](const Vec3& normal, double offset) {
    return HalfSpace(to_bur * normal, offset - normal.dot(bur.position));
  };
  const Vec3& size = scene.block.size;
  const std::array<HalfSpace, kFaces> faces = {half_space(Vec3::UnitX(), size.x() / 2),
                                               half_space(-Vec3::UnitX(), size.x() / 2),
                                               half_space(Vec3::UnitY(), 0),
                                               half_space(-Vec3::UnitY(), size.y()),
                                               half_space(Vec3::UnitZ(), size.z() / 2),
                                               half_space(-Vec3::UnitZ(), size.z() / 2)};
  for (const HalfSpace& face : faces) {
    const Range range = range_of(face, bounds);
    if (range.low >= face.d) return out;
    if (range.high > face.d) out.faces.push_back(face);
  }
  out.touches = true;
  const HalfSpace enamel = half_space(-Vec3::UnitY(), scene.block.enamel);
  const Range range = range_of(enamel, bounds);
  if (range.high <= enamel.d) {
    out.layers = Layers::kEnamelOnly;
  } else if (range.low >= enamel.d) {
    out.layers = Layers::kDentinOnly;
  } else {
    out.layers = Layers::kBoth;
    out.enamel = enamel;
  }
  return out;
}

// Equal but for rounding. Contact angles grow with the square root of the distance past a tangency,
// so planes are compared to the last bits; the direction only chooses the advancing half.
bool same(const HalfSpace& a, const HalfSpace& b) {
  return a.a == b.a && std::abs(a.d - b.d) <= 1e-14;
}
bool same(const Situation& a, const Situation& b) {
  if (a.touches != b.touches) return false;
  if (!a.touches) return true;
  if (a.layers != b.layers || a.faces.size() != b.faces.size() || a.to_world != b.to_world ||
      (a.direction - b.direction).cwiseAbs().maxCoeff() > 1e-10 ||
      (a.layers == Layers::kBoth && !same(a.enamel, b.enamel)))
    return false;
  for (std::size_t i = 0; i < a.faces.size(); ++i)
    if (!same(a.faces[i], b.faces[i])) return false;
  return true;
}

// ---- One circle of revolution: closed integrals over phi.

// Takes away the angles nearer than `half` to `centre`.
struct Cut {
  double centre, half;
};

double turned(double angle) {  // to -pi .. pi
  return angle - 2 * kPi * std::floor((angle + kPi) / (2 * kPi));
}
bool outside(const Cut& cut, double phi) { return std::abs(turned(phi - cut.centre)) >= cut.half; }

// How a half space sees the circle (r, z).
enum class Side { kInside, kOutside, kAcross };
Side side_of(const HalfSpace& h, double r, double z, Cut& cut) {
  const double size = h.across * r, room = h.d - h.a.z() * z;
  if (size <= room) return Side::kInside;
  if (-size >= room) return Side::kOutside;
  // cos(phi - h.phi) > room / size is outside; the arc cosine without loss near its ends.
  cut = {h.phi, std::atan2(std::sqrt((size - room) * (size + room)), room)};
  return Side::kAcross;
}

struct Moments {  // of 1, cos, sin, cos², cos sin, sin² over the angles of one tissue
  double one = 0, c = 0, s = 0, cc = 0, cs = 0, ss = 0;
};

// Integrands per tissue, all to be integrated over l. n = (nr cos, nr sin, nz).
struct Sums {
  static constexpr int kPerLayer = 15;
  enum {
    kNnCC,
    kNnCS,
    kNnSS,
    kNnC,
    kNnS,
    kNn1,
    kTnCC,
    kTnCS,
    kTnSS,
    kTnC,
    kTnS,
    kFlowC,
    kFlowS,
    kFlow1,
    kArea
  };
  std::array<double, kPerLayer * kLayers> v{};

  Sums() = default;
  Sums(double value) { v.fill(value); }  // NOLINT: boost's quadrature starts its sums with 0
  Sums& operator+=(const Sums& o) {
    for (std::size_t i = 0; i < v.size(); ++i) v[i] += o.v[i];
    return *this;
  }
  friend Sums operator+(Sums a, const Sums& b) { return a += b; }
  friend Sums operator-(Sums a, const Sums& b) {
    for (std::size_t i = 0; i < a.v.size(); ++i) a.v[i] -= b.v[i];
    return a;
  }
  friend Sums operator*(Sums a, double f) {
    for (double& x : a.v) x *= f;
    return a;
  }
  friend Sums operator*(double f, const Sums& a) { return a * f; }
  friend Sums operator-(const Sums& a) { return a * -1.0; }
  friend double abs(const Sums& a) {
    double most = 0;
    for (const double x : a.v) most = std::max(most, std::abs(x));
    return most;
  }
};

Sums circle(const Situation& situation, const ProfilePoint& p) {
  Sums out;
  std::array<Cut, kFaces + 1> cuts;
  std::size_t count = 0;
  for (const HalfSpace& face : situation.faces) {
    const Side side = side_of(face, p.r, p.z, cuts[count]);
    if (side == Side::kOutside) return out;
    if (side == Side::kAcross) ++count;
  }
  const double nr = p.along_z, nz = -p.along_r;
  const Vec3& v = situation.direction;
  {  // The part that doesn't advance: -v·n <= 0 is the half space to keep.
    const double size = std::abs(nr) * v.head<2>().norm(), room = nz * v.z();
    if (size + room <= kAdvancing) return out;
    if (size > room)
      cuts[count++] = {std::atan2(-nr * v.y(), -nr * v.x()),
                       std::atan2(std::sqrt((size - room) * (size + room)), room)};
  }
  Cut dentin{};
  Side enamel = situation.layers == Layers::kEnamelOnly ? Side::kInside : Side::kOutside;
  if (situation.layers == Layers::kBoth) enamel = side_of(situation.enamel, p.r, p.z, dentin);

  std::array<double, 2 * (kFaces + 2)> ends;
  std::size_t n = 0;
  for (std::size_t i = 0; i < count; ++i) {
    ends[n++] = turned(cuts[i].centre - cuts[i].half);
    ends[n++] = turned(cuts[i].centre + cuts[i].half);
  }
  if (enamel == Side::kAcross) {
    ends[n++] = turned(dentin.centre - dentin.half);
    ends[n++] = turned(dentin.centre + dentin.half);
  }
  if (n == 0) ends[n++] = 0;
  std::sort(ends.begin(), ends.begin() + static_cast<std::ptrdiff_t>(n));

  std::array<Moments, kLayers> moments;
  for (std::size_t i = 0; i < n; ++i) {
    const double from = ends[i], to = i + 1 < n ? ends[i + 1] : ends[0] + 2 * kPi;
    const double middle = (from + to) / 2;
    if (!(to > from)) continue;
    bool kept = true;
    for (std::size_t c = 0; c < count && kept; ++c) kept = outside(cuts[c], middle);
    if (!kept) continue;
    const bool in_enamel =
        enamel == Side::kAcross ? outside(dentin, middle) : enamel == Side::kInside;
    // Differences by the sum and half the width: no cancellation on short arcs.
    const double half = (to - from) / 2, cm = std::cos(middle), sm = std::sin(middle);
    const double sh = std::sin(half), s2 = std::sin(2 * half) / 2;
    const double c2m = cm * cm - sm * sm, s2m = 2 * sm * cm;
    Moments& m = moments[in_enamel ? 0 : 1];
    m.one += 2 * half;
    m.c += 2 * cm * sh;
    m.s += 2 * sm * sh;
    m.cc += half + c2m * s2;
    m.ss += half - c2m * s2;
    m.cs += s2m * s2;
  }
  for (int k = 0; k < kLayers; ++k) {
    const Moments& m = moments[static_cast<std::size_t>(k)];
    double* o = out.v.data() + k * Sums::kPerLayer;
    o[Sums::kNnCC] = nr * nr * m.cc;
    o[Sums::kNnCS] = nr * nr * m.cs;
    o[Sums::kNnSS] = nr * nr * m.ss;
    o[Sums::kNnC] = nr * nz * m.c;
    o[Sums::kNnS] = nr * nz * m.s;
    o[Sums::kNn1] = nz * nz * m.one;
    o[Sums::kTnCC] = nr * m.cc;
    o[Sums::kTnCS] = nr * m.cs;
    o[Sums::kTnSS] = nr * m.ss;
    o[Sums::kTnC] = nz * m.c;
    o[Sums::kTnS] = nz * m.s;
    o[Sums::kFlowC] = p.r * nr * m.c;
    o[Sums::kFlowS] = p.r * nr * m.s;
    o[Sums::kFlow1] = p.r * nz * m.one;
    o[Sums::kArea] = p.r * m.one;
  }
  return out;
}

// ---- Along the profile.

// Adaptive by bisection; the error estimate of one panel is Boost's |Kronrod - Gauss|. Boost's own
// recursion has no absolute tolerance: near the first touch, where all is rounding, it would
// bisect to the bottom.
template <class F>
Sums adaptive(const F& f, double from, double to, double relative, double absolute, int depth) {
  double error = 0;
  const auto unit = [&](double x) { return f((from + to) / 2 + x * (to - from) / 2); };
  const double half = (to - from) / 2;
  const Sums value = half * Kronrod::integrate(unit, -1.0, 1.0, 0, relative, &error);
  if (depth == 0 || half * error <= std::max(relative * abs(value), absolute)) return value;
  const double middle = (from + to) / 2;
  return adaptive(f, from, middle, relative, absolute / 2, depth - 1) +
         adaptive(f, middle, to, relative, absolute / 2, depth - 1);
}

// The planes that cut one piece of the profile; nothing if a face keeps it out of the block.
std::optional<std::vector<HalfSpace>> cutting_planes(const Situation& situation,
                                                     const ProfilePiece& piece) {
  const ProfileBounds bounds = bounds_of(piece);
  std::vector<HalfSpace> cutting;
  for (const HalfSpace& face : situation.faces) {
    const Range range = range_of(face, bounds);
    if (range.low >= face.d) return std::nullopt;
    if (range.high > face.d) cutting.push_back(face);
  }
  if (situation.layers == Layers::kBoth) {
    const Range range = range_of(situation.enamel, bounds);
    if (range.low < situation.enamel.d && range.high > situation.enamel.d)
      cutting.push_back(situation.enamel);
  }
  return cutting;
}

// Whether no place of a cone or cylinder advances: its normals have one slope.
bool stays_behind(const ProfilePiece& piece, const Vec3& direction) {
  if (piece.kind != ProfilePiece::Kind::kLine) return false;
  const ProfilePoint p = point_on(piece, 0);
  return std::abs(p.along_z) * direction.head<2>().norm() - p.along_r * direction.z() <= kAdvancing;
}

// Whether all circles between two breaks are alike: on a cylinder that only planes along or across
// its axis cut.
bool all_circles_alike(const ProfilePiece& piece, const std::vector<HalfSpace>& cutting) {
  return piece.kind == ProfilePiece::Kind::kLine && piece.r0 == piece.r1 &&
         std::all_of(cutting.begin(), cutting.end(),
                     [](const HalfSpace& h) { return h.a.z() == 0 || h.across == 0; });
}

Sums along_profile(const Scene& scene, const Situation& situation) {
  Sums sum;
  for (const ProfilePiece& piece : scene.profile) {
    if (!piece.grinds || stays_behind(piece, situation.direction)) continue;
    const auto cutting = cutting_planes(situation, piece);
    if (!cutting) continue;
    const double length = length_of(piece);
    const bool alike = all_circles_alike(piece, *cutting);
    // What is below a thousandth of the piece's own full contact needs no more digits.
    const double absolute = scene.tolerance * 1e-3 * length;
    const std::vector<double> breaks = contact_breaks(piece, *cutting, situation.direction);
    for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
      const double mean = (breaks[i] + breaks[i + 1]) / 2, half = (breaks[i + 1] - breaks[i]) / 2;
      if (alike) {
        sum += 2 * half * length * circle(situation, point_on(piece, mean));
        continue;
      }
      const auto integrand = [&](double theta) {
        const double weight = half * length * std::sin(theta);
        return weight * circle(situation, point_on(piece, mean - half * std::cos(theta)));
      };
      sum += adaptive(integrand, 0, kPi, scene.tolerance, absolute, kDeepest);
    }
  }
  return sum;
}

Engagement engagement(const Scene& scene, const Situation& situation) {
  Engagement out;
  if (!situation.touches) return out;
  const Sums sums = along_profile(scene, situation);
  const double sense = scene.clockwise ? 1 : -1;
  const std::array<const GrindingProperties*, kLayers> law = {&scene.enamel, &scene.dentin};
  Mat3 drag = Mat3::Zero();
  for (std::size_t k = 0; k < kLayers; ++k) {
    const double* s = sums.v.data() + k * Sums::kPerLayer;
    const double factor = law[k]->specific_energy / (2 * kPi * scene.rotation_rate);
    Mat3 normal, tangent;
    normal << s[Sums::kNnCC], s[Sums::kNnCS], s[Sums::kNnC],  //
        s[Sums::kNnCS], s[Sums::kNnSS], s[Sums::kNnS],        //
        s[Sums::kNnC], s[Sums::kNnS], s[Sums::kNn1];
    tangent << -s[Sums::kTnCS], -s[Sums::kTnSS], -s[Sums::kTnS],  //
        s[Sums::kTnCC], s[Sums::kTnCS], s[Sums::kTnC],            //
        0, 0, 0;
    drag += factor * (sense * tangent - normal / law[k]->force_ratio);
    const Vec3 flow = situation.to_world * Vec3(s[Sums::kFlowC], s[Sums::kFlowS], s[Sums::kFlow1]);
    out.torque += factor * flow;
    out.flow[k] = flow;
    out.area[k] = s[Sums::kArea];
  }
  out.drag = situation.to_world * drag * situation.to_world.transpose();
  return out;
}

void require(bool good, const std::string& condition) {
  if (!good) throw Error("reference scene: " + condition);
}

}  // namespace

static_assert(tissue_index(Tissue::kEnamel) == 0 && tissue_index(Tissue::kDentin) == 1);

Scene make_scene(const Bur& bur, const Block& block, const Parameters& parameters) {
  validate(parameters);
  require(is_linear(parameters), "the law must be the paper's");
  require(block.size.allFinite() && block.size.minCoeff() > 0,
          "the block's size must be positive and finite");
  require(
      block.enamel >= 0 && block.enamel <= block.size.y(),
      fmt::format("enamel must lie between 0 and the block's height of {:g} mm", block.size.y()));
  Scene scene;
  scene.profile = bur.profile();
  scene.block = block;
  scene.enamel = parameters.tissue[tissue_index(Tissue::kEnamel)];
  scene.dentin = parameters.tissue[tissue_index(Tissue::kDentin)];
  scene.rotation_rate = parameters.handpiece.rotation_rate;
  scene.clockwise = parameters.handpiece.clockwise;
  return scene;
}

Engagement engagement(const Scene& scene, const Pose& bur, const Vec3& velocity) {
  return engagement(scene, situation_of(scene, grinding_bounds(scene), bur, velocity));
}

Load load(const Engagement& e, const Vec3& velocity) {
  Load out;
  if (!velocity.allFinite()) return out;
  out.force = e.drag * velocity;
  out.torque = e.torque.dot(velocity);
  out.area = e.area;
  for (std::size_t k = 0; k < e.flow.size(); ++k) out.volume_rate[k] = e.flow[k].dot(velocity);
  return out;
}

Load load(const Scene& scene, const Pose& bur, const Vec3& velocity) {
  return load(engagement(scene, bur, velocity), velocity);
}

std::vector<int> contact_shape(const Scene& scene, const Pose& bur, const Vec3& velocity) {
  const Situation situation = situation_of(scene, grinding_bounds(scene), bur, velocity);
  const Engagement e = engagement(scene, situation);
  std::vector<int> shape = {e.area[0] > 0, e.area[1] > 0, static_cast<int>(situation.layers),
                            static_cast<int>(situation.faces.size())};
  if (!situation.touches) return shape;
  for (const ProfilePiece& piece : scene.profile) {
    if (!piece.grinds) continue;
    const auto cutting = cutting_planes(situation, piece);
    shape.push_back(cutting ? static_cast<int>(cutting->size()) : -1);
    if (cutting)
      shape.push_back(
          static_cast<int>(contact_breaks(piece, *cutting, situation.direction).size()));
  }
  return shape;
}

std::vector<Load> load_along(const Scene& scene, const std::vector<PathRow>& path) {
  // Runs of equal situations are compared with their first row, so that rounding can't creep.
  const ProfileBounds bounds = grinding_bounds(scene);
  std::vector<Situation> distinct;
  std::vector<std::size_t> which(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    Situation s = situation_of(scene, bounds, path[i].bur, path[i].velocity);
    if (distinct.empty() || !same(distinct.back(), s)) distinct.push_back(std::move(s));
    which[i] = distinct.size() - 1;
  }
  std::vector<Engagement> solved(distinct.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, distinct.size(), 16),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t i = range.begin(); i < range.end(); ++i)
                        solved[i] = engagement(scene, distinct[i]);
                    });
  std::vector<Load> out(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) out[i] = load(solved[which[i]], path[i].velocity);
  return out;
}

}  // namespace toothprep::reference
