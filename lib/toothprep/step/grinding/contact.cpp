#include "toothprep/step/grinding/contact.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

// Elements whose normal is up to this far behind the motion (sine of the angle) are sampled as
// well, so that the trial velocity may turn by as much without a new sample.
constexpr float kMarginSine = 0.15f;
// Elements in contact that lie this close in memory are computed in one run.
constexpr int kRunGap = 8;
// An element that isn't engaged as a whole is divided into kParts x kParts.
constexpr int kParts = 4;
// A field's range over an element is taken this much larger before it counts as engaged as a whole.
constexpr float kSlack = 1.1f;
// Elements look for the walls of other cuts this part of their size ahead.
constexpr double kLookAhead = 0.8;
// Where the cut's range along a straight profile is below this part of the element's half width,
// the element is divided around the axis alone.
constexpr float kAlongWall = 0.1f;
constexpr float kRounding = 1e-6f;  // of the speed
// Interpolated on the lattice, the wall that a convex bur left stands out by D²/12 times its
// curvature on average. A swept wall is curved across the sweep only, and where two cuts meet the
// interpolant errs to the other side: a third of the sum of the bur's curvatures is least biased.
constexpr float kWall = 1.0f / 36;
// Keeps a division defined where the field is flat or meets an element face on, mm.
constexpr float kLeastExtent = 1e-6f;
constexpr double kMarginCosine = 0.99;  // a little inside sqrt(1 - 0.15²)

// The cell of an index coordinate beside the tip's voxel. Cutting towards zero is floor for what is
// positive, and vectorises with SSE2 alone. The offset costs up to 3e-4 voxel: so close to a border
// of two cells either serves, since the interpolant is continuous.
constexpr float kIndexOffset = 4096;  // voxels; a head is shorter
inline std::int32_t cell_of(float x) {
  return static_cast<std::int32_t>(x + kIndexOffset) - static_cast<std::int32_t>(kIndexOffset);
}

inline float at_surface(const FieldSample& s, const Eigen::Vector3f& ahead) {
  return s.value - s.gx * ahead.x() - s.gy * ahead.y() - s.gz * ahead.z();
}

// How far the element's rim lies behind its tangent plane, mm.
inline float sag_of(const SurfaceElements& e, int i) {
  return 0.5f * (e.curvature_along[i] * e.half_along[i] * e.half_along[i] +
                 e.curvature_around[i] * e.half_around[i] * e.half_around[i]);
}

}  // namespace

// The tip's place in index space, split so that single precision suffices beside it.
struct ContactModel::IndexFrame {
  Index3 base;
  float fx, fy, fz;  // rest, [0, 1)
  float a[9];        // rotation / voxel, row by row

  IndexFrame(const Lattice& lattice, const Pose& pose) {
    const Vec3 tip = lattice.to_index(pose.position);
    const Vec3 whole = tip.array().floor();
    base = whole.cast<int>();
    fx = static_cast<float>(tip.x() - whole.x());
    fy = static_cast<float>(tip.y() - whole.y());
    fz = static_cast<float>(tip.z() - whole.z());
    const Mat3 rotation = pose.orientation.toRotationMatrix() / lattice.voxel;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) a[3 * i + j] = static_cast<float>(rotation(i, j));
  }
};

struct ContactModel::Scan {
  const Workpiece& workpiece;
  const IndexFrame& frame;
  Eigen::Vector3f v, omega;  // mm/s, rad/s, B
  float speed;               // mm/s, of v
  float reach;               // mm
  bool turns;

  Eigen::Vector3f velocity_at(float x, float y, float z) const {
    return turns ? Eigen::Vector3f(v + omega.cross(Eigen::Vector3f(x, y, z))) : v;
  }
  float speed_of(const Eigen::Vector3f& u) const { return turns ? u.norm() : speed; }
};

namespace {

// The axes of an element or a part in index space, scaled by half its extents: what the field's
// gradient is multiplied by to get half its range.
struct HalfAxes {
  Eigen::Vector3f along, around;

  HalfAxes(const float* a, const Eigen::Vector3f& l, const Eigen::Vector3f& t, float half_along,
           float half_around) {
    const auto turned = [a](const Eigen::Vector3f& x, float half) -> Eigen::Vector3f {
      return half * Eigen::Vector3f(a[0] * x.x() + a[1] * x.y() + a[2] * x.z(),
                                    a[3] * x.x() + a[4] * x.y() + a[5] * x.z(),
                                    a[6] * x.x() + a[7] * x.y() + a[8] * x.z());
    };
    along = turned(l, half_along);
    around = turned(t, half_around);
  }
  HalfAxes(const float* a, const SurfaceElements& e, int i)
      : HalfAxes(a, Eigen::Vector3f(e.lx[i], e.ly[i], e.lz[i]),
                 Eigen::Vector3f(e.tx[i], e.ty[i], 0), e.half_along[i], e.half_around[i]) {}
  float extent(const FieldSample& s) const {
    return std::abs(s.gx * along.x() + s.gy * along.y() + s.gz * along.z()) +
           std::abs(s.gx * around.x() + s.gy * around.y() + s.gz * around.z());
  }
};

// The share of an element that lies inside, from the field at its middle and half its range.
float share_inside(float value, float extent) {
  const float share = 0.5f - 0.5f * value / std::max(extent, kLeastExtent);
  return std::min(std::max(share, 0.0f), 1.0f);
}

// How a place is shared among the tissues; adds up to 1, or to 0 in air. By the tissues' level
// sets; where a tissue without one occurs, by the trilinear blend of the labels.
void tissue_shares(const Workpiece& workpiece, std::size_t brick, const Index3& cell, float fx,
                   float fy, float fz, const Eigen::Vector3f& ahead, const HalfAxes& axes,
                   PerTissue<float>& share) noexcept {
  const LabelGrid& labels = workpiece.labels();
  if (labels.is_uniform(brick) && (cell.x() & 7) < 7 && (cell.y() & 7) < 7 && (cell.z() & 7) < 7) {
    const std::uint8_t label = labels.uniform_value(brick);
    if (label != 0) share[label - 1] = 1;
    return;
  }
  PerTissue<float> blend{};
  float total = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int ix = corner >> 2, iy = (corner >> 1) & 1, iz = corner & 1;
    const std::uint8_t label = labels.value(cell.x() + ix, cell.y() + iy, cell.z() + iz);
    if (label == 0) continue;
    const float w = (ix ? fx : 1 - fx) * (iy ? fy : 1 - fy) * (iz ? fz : 1 - fz);
    blend[label - 1] += w;
    total += w;
  }
  if (total <= 0) return;
  constexpr int kOther = tissue_index(Tissue::kOther);
  if (blend[kOther] == 0) {
    float sum = 0;
    for (int k = 0; k < kOther; ++k) {
      float corners[8];
      cell_corners(workpiece.tooth().remains[k], cell.x(), cell.y(), cell.z(), corners);
      const FieldSample s = sample_cell(corners, fx, fy, fz);
      share[k] = share_inside(at_surface(s, ahead), axes.extent(s));
      sum += share[k];
    }
    if (sum > 0) {
      for (int k = 0; k < kOther; ++k) share[k] /= sum;
      return;
    }
  }
  for (int k = 0; k < kTissueCount; ++k) share[k] = blend[k] / total;
}

}  // namespace

ContactModel::ContactModel(const Bur& bur, double element_size, bool clockwise,
                           const PerTissue<GrindingProperties>& tissue)
    : elements_(bur.elements(kParts * element_size, clockwise)),
      contact_(kParts * kParts * elements_.size(), tissue, false),
      look_ahead_(kLookAhead * kParts * element_size) {
  const std::size_t n = elements_.size();
  for (auto* array : {&fx_, &fy_, &fz_, &value_, &extent_, &along_}) array->resize(n);
  for (auto* array : {&cell_x_, &cell_y_, &cell_z_, &candidates_}) array->resize(n);
  for (auto& array : corner_) array.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    first_node_.push_back(nodes_.size());
    const bool curved = elements_.curvature_along[i] != 0;
    const double gauss = 1 / std::sqrt(3.0);
    for (const double around : {-gauss, gauss}) {
      if (!curved) add_part(i, around, 0, 0.5, nodes_);
      if (!curved) continue;
      add_part(i, around, -gauss, 0.25, nodes_);
      add_part(i, around, gauss, 0.25, nodes_);
    }
    for (int p = 0; p < kParts; ++p)
      add_part(i, (2 * p + 1.0) / kParts - 1, 0, 1.0 / kParts, strips_);
    for (int p = 0; p < kParts; ++p)
      for (int q = 0; q < kParts; ++q)
        add_part(i, (2 * p + 1.0) / kParts - 1, (2 * q + 1.0) / kParts - 1, 1.0 / (kParts * kParts),
                 parts_);
  }
  first_node_.push_back(nodes_.size());
}

// The point of element i at the given places (-1 .. 1) around the axis and along the profile, with
// a share of the element's weight.
void ContactModel::add_part(std::size_t i, double around, double along, double share,
                            Parts& to) const {
  const SurfaceElements& e = elements_;
  const double curvature = e.curvature_along[i], way = along * e.half_along[i];
  const double turn = around * e.half_around[i] / e.radius[i];
  const Vec3 l(e.lx[i], e.ly[i], e.lz[i]);
  Vec3 x(e.x[i], e.y[i], e.z[i]), n(e.nx[i], e.ny[i], e.nz[i]), t(e.tx[i], e.ty[i], 0);
  if (curvature == 0) {
    x += way * l;
  } else {
    const Vec3 turned = std::cos(curvature * way) * n + std::sin(curvature * way) * l;
    x += (turned - n) / curvature;
    n = turned;
  }
  const Mat3 about_axis = Eigen::AngleAxisd(turn, Vec3::UnitZ()).toRotationMatrix();
  x = about_axis * x;
  n = about_axis * n;
  t = about_axis * t;
  const Vec3 m = x.cross(n);
  const double weight = share * e.weight[i], radius = std::hypot(x.x(), x.y());
  const Vec3 up = n.cross(t);  // along the profile
  const auto f = [](double value) { return static_cast<float>(value); };
  to.x.push_back(f(x.x())), to.y.push_back(f(x.y())), to.z.push_back(f(x.z()));
  to.nx.push_back(f(n.x())), to.ny.push_back(f(n.y())), to.nz.push_back(f(n.z()));
  to.tx.push_back(f(t.x())), to.ty.push_back(f(t.y()));
  to.lx.push_back(f(up.x())), to.ly.push_back(f(up.y())), to.lz.push_back(f(up.z()));
  to.element.push_back({f(n.x()), f(n.y()), f(n.z()), f(m.x()), f(m.y()), f(m.z()), f(t.x()),
                        f(t.y()), f(weight), f(radius), f(weight * radius)});
}

void ContactModel::sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v,
                          const Vec3& omega, double reach) noexcept {
  const IndexFrame f(workpiece.lattice(), pose);
  const double speed = v.norm();
  sampled_direction_ = speed > 0 ? Vec3(v / speed) : Vec3(Vec3::Zero());

  // Pass 1: the cell of every element's sample, and which elements are worth a look-up.
  const int candidates =
      omega.squaredNorm() > 0 ? locate_turning(f, v, omega, reach) : locate_straight(f, v, reach);

  // Pass 2: the cut at the corners of each cell that isn't all air.
  const LevelSet& cut = workpiece.cut();
  int near = 0;
  for (int c = 0; c < candidates; ++c) {
    const int i = candidates_[c];
    const int x = f.base.x() + cell_x_[i], y = f.base.y() + cell_y_[i], z = f.base.z() + cell_z_[i];
    const std::int64_t brick = cut.brick_index(x, y, z);
    if (brick < 0 || workpiece.air(static_cast<std::size_t>(brick))) continue;
    float corners[8];
    cell_corners(cut, x, y, z, corners);
    for (int k = 0; k < 8; ++k) corner_[k][i] = corners[k];
    candidates_[near++] = i;
  }

  // Pass 3: the cut at each of them. Runs of neighbours go together; the few elements in between
  // are computed and not used.
  for (int c = 0; c < near;) {
    const int first = candidates_[c];
    int last = first;
    while (c < near && candidates_[c] - last <= kRunGap) last = candidates_[c++];
    measure(f.a, first, last + 1);
  }

  // Pass 4: what is engaged, as a whole or part by part.
  Scan scan{workpiece,
            f,
            v.cast<float>(),
            omega.cast<float>(),
            static_cast<float>(speed),
            static_cast<float>(reach),
            omega.squaredNorm() > 0};
  contact_.clear();
  for (int c = 0; c < near; ++c) settle(scan, candidates_[c]);
}

// Element i: in the void or in air, engaged as a whole in one tissue, or divided.
void ContactModel::settle(const Scan& scan, int i) noexcept {
  if (value_[i] >= extent_[i]) return;
  const SurfaceElements& e = elements_;
  const Workpiece& workpiece = scan.workpiece;
  const IndexFrame& f = scan.frame;
  const Index3 cell = f.base + Index3(cell_x_[i], cell_y_[i], cell_z_[i]);
  // How far the sample lies ahead of the surface, in index space.
  const float* a = f.a;
  const Eigen::Vector3f ahead(static_cast<float>(cell_x_[i]) + fx_[i] - f.fx -
                                  (a[0] * e.x[i] + a[1] * e.y[i] + a[2] * e.z[i]),
                              static_cast<float>(cell_y_[i]) + fy_[i] - f.fy -
                                  (a[3] * e.x[i] + a[4] * e.y[i] + a[5] * e.z[i]),
                              static_cast<float>(cell_z_[i]) + fz_[i] - f.fz -
                                  (a[6] * e.x[i] + a[7] * e.y[i] + a[8] * e.z[i]));
  const Advance advance = advance_of(scan, i);
  const bool whole = value_[i] <= -extent_[i] && advance == Advance::kWhole;
  Known known;
  const auto divided = [&] {
    // What can only advance once the motion turns has no force yet.
    if (advance == Advance::kNone)
      divide(scan, i, ahead, known, nodes_, first_node_[i], 2, e.curvature_along[i] == 0 ? 1 : 2);
    else
      divide(scan, i, ahead, known, parts_, i * kParts * kParts, kParts, kParts);
  };
  // A brick's flags are those of all cells that start in it or in its upper neighbours: taken at
  // the element's lower corner they hold for all of it.
  const auto margin = static_cast<int>(std::ceil(std::max(e.half_along[i], e.half_around[i]) /
                                                 static_cast<float>(workpiece.voxel())));
  const std::int64_t lower =
      workpiece.cut().brick_index(cell.x() - margin, cell.y() - margin, cell.z() - margin);
  const auto brick = static_cast<std::size_t>(lower);
  known.only = lower < 0 ? 0 : workpiece.only_tissue(brick);
  known.inside = lower >= 0 && workpiece.deep(brick);
  if (!known.inside) {
    const FieldSample s = field_at(workpiece.tooth().solid, cell, i);
    const float value = at_surface(s, ahead);
    const float extent = kSlack * HalfAxes(a, e, i).extent(s) + sag_of(e, i);
    if (value >= extent) return;
    if (value > -extent) return divided();
    known.inside = true;
  }
  for (int k = 0; known.only == 0 && k < tissue_index(Tissue::kOther); ++k) {
    const FieldSample s = field_at(workpiece.tooth().remains[k], cell, i);
    if (at_surface(s, ahead) <= -(kSlack * HalfAxes(a, e, i).extent(s) + sag_of(e, i)))
      known.only = static_cast<std::uint8_t>(k + 1);
  }
  if (known.only == 0) return divided();
  if (advance == Advance::kNone || (whole && !hides_void(scan, i, ahead))) {
    const float share = whole ? 1 : share_inside(value_[i], extent_[i]);
    for (std::int32_t n = first_node_[i]; n < first_node_[i + 1]; ++n)
      contact_.add(nodes_.element[n], known.only - 1, share);
    return;
  }
  // A wall along a straight profile needs no division along it.
  if (e.curvature_along[i] == 0 && along_[i] < kAlongWall * e.half_around[i])
    return divide(scan, i, ahead, known, strips_, i * kParts, kParts, 1);
  divided();
}

// A field at the sample of element i, in `cell`.
FieldSample ContactModel::field_at(const LevelSet& field, const Index3& cell,
                                   int i) const noexcept {
  float corners[8];
  cell_corners(field, cell.x(), cell.y(), cell.z(), corners);
  return sample_cell(corners, fx_[i], fy_[i], fz_[i]);
}

// Whether v·n is positive on element i as a whole, or anywhere.
ContactModel::Advance ContactModel::advance_of(const Scan& scan, int i) const noexcept {
  const SurfaceElements& e = elements_;
  const Eigen::Vector3f u = scan.velocity_at(e.x[i], e.y[i], e.z[i]);
  const float n = u.x() * e.nx[i] + u.y() * e.ny[i] + u.z() * e.nz[i];
  const float t = u.x() * e.tx[i] + u.y() * e.ty[i];
  const float l = u.x() * e.lx[i] + u.y() * e.ly[i] + u.z() * e.lz[i];
  const float range = std::abs(t * e.curvature_around[i] * e.half_around[i]) +
                      std::abs(l * e.curvature_along[i] * e.half_along[i]);
  return n + range <= kRounding * scan.speed_of(u) ? Advance::kNone
         : n >= range                              ? Advance::kWhole
                                                   : Advance::kPartly;
}

// The bur's own last cut lies so close behind its surface that it hides the wall of another cut from
// the field's one sample. Farther ahead it doesn't. Only of elements with value_ < 0; a distance
// changes by no more than the way, so where the nearest wall is farther than a corner there is none.
bool ContactModel::hides_void(const Scan& scan, int i,
                              const Eigen::Vector3f& ahead) const noexcept {
  const float half_along = elements_.half_along[i], half_around = elements_.half_around[i];
  if (value_[i] * value_[i] > half_along * half_along + half_around * half_around) return false;
  const IndexFrame& f = scan.frame;
  const float farther = static_cast<float>(look_ahead_) / scan.reach - 1;
  const float ix = static_cast<float>(cell_x_[i]) + fx_[i] + farther * ahead.x();
  const float iy = static_cast<float>(cell_y_[i]) + fy_[i] + farther * ahead.y();
  const float iz = static_cast<float>(cell_z_[i]) + fz_[i] + farther * ahead.z();
  const std::int32_t jx = cell_of(ix), jy = cell_of(iy), jz = cell_of(iz);
  float corners[8];
  cell_corners(scan.workpiece.cut(), f.base.x() + jx, f.base.y() + jy, f.base.z() + jz, corners);
  const FieldSample s = sample_cell(corners, ix - static_cast<float>(jx),
                                    iy - static_cast<float>(jy), iz - static_cast<float>(jz));
  return s.value > -kSlack * HalfAxes(f.a, elements_, i).extent(s);
}

// The samples of an element's parts.
struct ContactModel::PartSamples {
  static constexpr int kMost = kParts * kParts;
  int count;
  std::int32_t x[kMost], y[kMost], z[kMost];  // cell, from the tip's voxel
  float fx[kMost], fy[kMost], fz[kMost];      // place in it
  float advance[kMost];                       // v·n less the margin, mm/s
  float corner[8][kMost];
  float covered[kMost];
};

void ContactModel::locate_parts(const Scan& scan, const Eigen::Vector3f& ahead, const Parts& parts,
                                int first, PartSamples& s) const noexcept {
  const IndexFrame& f = scan.frame;
  const float* a = f.a;
  const float bx = f.fx + ahead.x(), by = f.fy + ahead.y(), bz = f.fz + ahead.z();
  const float *x = &parts.x[first], *y = &parts.y[first], *z = &parts.z[first];
  const float *nx = &parts.nx[first], *ny = &parts.ny[first], *nz = &parts.nz[first];
  const float vx = scan.v.x(), vy = scan.v.y(), vz = scan.v.z();
  const float least = kMarginSine * scan.speed;
  const int n = s.count;
#pragma omp simd
  for (int p = 0; p < n; ++p) {
    const float ix = bx + a[0] * x[p] + a[1] * y[p] + a[2] * z[p];
    const float iy = by + a[3] * x[p] + a[4] * y[p] + a[5] * z[p];
    const float iz = bz + a[6] * x[p] + a[7] * y[p] + a[8] * z[p];
    const std::int32_t jx = cell_of(ix), jy = cell_of(iy), jz = cell_of(iz);
    s.x[p] = jx, s.y[p] = jy, s.z[p] = jz;
    s.fx[p] = ix - static_cast<float>(jx);
    s.fy[p] = iy - static_cast<float>(jy);
    s.fz[p] = iz - static_cast<float>(jz);
    s.advance[p] = vx * nx[p] + vy * ny[p] + vz * nz[p] + least;
  }
  if (!scan.turns) return;
  for (int p = 0; p < n; ++p) {
    const Eigen::Vector3f u = scan.velocity_at(x[p], y[p], z[p]);
    s.advance[p] = u.x() * nx[p] + u.y() * ny[p] + u.z() * nz[p] + kMarginSine * u.norm();
  }
}

// Element i part by part.
void ContactModel::divide(const Scan& scan, int i, const Eigen::Vector3f& ahead, const Known& known,
                          const Parts& parts, int first, int around, int along) noexcept {
  const Workpiece& workpiece = scan.workpiece;
  const LevelSet& cut = workpiece.cut();
  const IndexFrame& f = scan.frame;
  const float* a = f.a;
  const float half_along = elements_.half_along[i] / static_cast<float>(along),
              half_around = elements_.half_around[i] / static_cast<float>(around);
  // The part is convex: its rim lies behind its tangent plane by the sag, on average a third of it.
  const float sag = sag_of(elements_, i) / static_cast<float>(kParts * kParts);
  const auto wall = kWall * static_cast<float>(workpiece.voxel() * workpiece.voxel()) *
                    (elements_.curvature_along[i] + elements_.curvature_around[i]);
  PartSamples s;
  s.count = around * along;
  locate_parts(scan, ahead, parts, first, s);

  int live = 0;
  std::int64_t brick[PartSamples::kMost];
  int last = -1;  // the part that was looked up last: neighbours share cells
  for (int p = 0; p < s.count; ++p) {
    brick[p] = -1;
    for (auto& corner : s.corner) corner[p] = 0;
    if (s.advance[p] < 0) continue;
    const int x = f.base.x() + s.x[p], y = f.base.y() + s.y[p], z = f.base.z() + s.z[p];
    if (last >= 0 && s.x[p] == s.x[last] && s.y[p] == s.y[last] && s.z[p] == s.z[last]) {
      brick[p] = brick[last];
      for (auto& corner : s.corner) corner[p] = corner[last];
    } else {
      const std::int64_t b = cut.brick_index(x, y, z);
      if (b < 0 || workpiece.air(static_cast<std::size_t>(b))) continue;
      brick[p] = b;
      float corners[8];
      cell_corners(cut, x, y, z, corners);
      for (int k = 0; k < 8; ++k) s.corner[k][p] = corners[k];
      last = p;
    }
    ++live;
  }
  if (live == 0) return;

  const float *lx = &parts.lx[first], *ly = &parts.ly[first], *lz = &parts.lz[first];
  const float *tx = &parts.tx[first], *ty = &parts.ty[first];
  const int n = s.count;
#pragma omp simd
  for (int p = 0; p < n; ++p) {
    const FieldSample c =
        sample_cell(s.corner[0][p], s.corner[1][p], s.corner[2][p], s.corner[3][p], s.corner[4][p],
                    s.corner[5][p], s.corner[6][p], s.corner[7][p], s.fx[p], s.fy[p], s.fz[p]);
    const float gx = a[0] * c.gx + a[3] * c.gy + a[6] * c.gz;
    const float gy = a[1] * c.gx + a[4] * c.gy + a[7] * c.gz;
    const float gz = a[2] * c.gx + a[5] * c.gy + a[8] * c.gz;
    const float extent = std::abs(gx * lx[p] + gy * ly[p] + gz * lz[p]) * half_along +
                         std::abs(gx * tx[p] + gy * ty[p]) * half_around;
    s.covered[p] = share_inside(c.value + wall + sag / 3, extent - 2 * sag / 3);
  }

  for (int p = 0; p < n; ++p) {
    float covered = s.covered[p];
    if (brick[p] < 0 || covered <= 0) continue;
    const auto b = static_cast<std::size_t>(brick[p]);
    const bool inside = known.inside || workpiece.deep(b);
    const std::uint8_t only = known.only != 0 ? known.only : workpiece.only_tissue(b);
    const ContactSet::Element& e = parts.element[first + p];
    if (only != 0 && inside) {
      contact_.add(e, only - 1, covered);
      continue;
    }
    const Index3 cell = f.base + Index3(s.x[p], s.y[p], s.z[p]);
    const HalfAxes axes(a, Eigen::Vector3f(lx[p], ly[p], lz[p]), Eigen::Vector3f(tx[p], ty[p], 0),
                        half_along, half_around);
    if (!inside) {
      float corners[8];
      cell_corners(workpiece.tooth().solid, cell.x(), cell.y(), cell.z(), corners);
      const FieldSample solid = sample_cell(corners, s.fx[p], s.fy[p], s.fz[p]);
      covered *= share_inside(at_surface(solid, ahead), axes.extent(solid));
      if (covered <= 0) continue;
    }
    if (only != 0) {
      contact_.add(e, only - 1, covered);
      continue;
    }
    PerTissue<float> share{};
    tissue_shares(workpiece, b, cell, s.fx[p], s.fy[p], s.fz[p], ahead, axes, share);
    for (float& k : share) k *= covered;
    contact_.add(e, share);
  }
}

// Pass 1 with one velocity for all elements.
int ContactModel::locate_straight(const IndexFrame& f, const Vec3& v, double reach) noexcept {
  const SurfaceElements& e = elements_;
  const int n = static_cast<int>(e.size());
  const double speed = v.norm();
  const Eigen::Vector3f vf = v.cast<float>();
  const Eigen::Vector3f ahead =
      speed > 0 ? Eigen::Vector3f((v * (reach / speed)).cast<float>()) : Eigen::Vector3f::Zero();
  const float* a = f.a;
  const float bx = f.fx + a[0] * ahead.x() + a[1] * ahead.y() + a[2] * ahead.z();
  const float by = f.fy + a[3] * ahead.x() + a[4] * ahead.y() + a[5] * ahead.z();
  const float bz = f.fz + a[6] * ahead.x() + a[7] * ahead.y() + a[8] * ahead.z();
  const float *x = e.x.data(), *y = e.y.data(), *z = e.z.data();
  float *fx = fx_.data(), *fy = fy_.data(), *fz = fz_.data();
  std::int32_t *cx = cell_x_.data(), *cy = cell_y_.data(), *cz = cell_z_.data();
#pragma omp simd
  for (int i = 0; i < n; ++i) {
    const float ix = bx + a[0] * x[i] + a[1] * y[i] + a[2] * z[i];
    const float iy = by + a[3] * x[i] + a[4] * y[i] + a[5] * z[i];
    const float iz = bz + a[6] * x[i] + a[7] * y[i] + a[8] * z[i];
    const std::int32_t jx = cell_of(ix), jy = cell_of(iy), jz = cell_of(iz);
    cx[i] = jx, cy[i] = jy, cz[i] = jz;
    fx[i] = ix - static_cast<float>(jx);
    fy[i] = iy - static_cast<float>(jy);
    fz[i] = iz - static_cast<float>(jz);
  }
  const float threshold = -kMarginSine * static_cast<float>(speed);
  int candidates = 0;
  for (int i = 0; i < n; ++i) {
    candidates_[candidates] = i;
    candidates += e.nx[i] * vf.x() + e.ny[i] * vf.y() + e.nz[i] * vf.z() > threshold;
  }
  return candidates;
}

// Pass 1 with v(s) = v + omega x r(s).
int ContactModel::locate_turning(const IndexFrame& f, const Vec3& v, const Vec3& omega,
                                 double reach) noexcept {
  const SurfaceElements& e = elements_;
  const int n = static_cast<int>(e.size());
  const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
  const auto reach_f = static_cast<float>(reach);
  const float* a = f.a;
  int candidates = 0;
  for (int i = 0; i < n; ++i) {
    const float ux = vf.x() + of.y() * e.z[i] - of.z() * e.y[i];
    const float uy = vf.y() + of.z() * e.x[i] - of.x() * e.z[i];
    const float uz = vf.z() + of.x() * e.y[i] - of.y() * e.x[i];
    const float s = std::sqrt(ux * ux + uy * uy + uz * uz);
    const float k = s > 0 ? reach_f / s : 0;
    const float x = e.x[i] + k * ux, y = e.y[i] + k * uy, z = e.z[i] + k * uz;
    const float ix = f.fx + a[0] * x + a[1] * y + a[2] * z;
    const float iy = f.fy + a[3] * x + a[4] * y + a[5] * z;
    const float iz = f.fz + a[6] * x + a[7] * y + a[8] * z;
    cell_x_[i] = cell_of(ix), cell_y_[i] = cell_of(iy), cell_z_[i] = cell_of(iz);
    fx_[i] = ix - static_cast<float>(cell_x_[i]);
    fy_[i] = iy - static_cast<float>(cell_y_[i]);
    fz_[i] = iz - static_cast<float>(cell_z_[i]);
    candidates_[candidates] = i;
    candidates += e.nx[i] * ux + e.ny[i] * uy + e.nz[i] * uz > -kMarginSine * s;
  }
  return candidates;
}

// Pass 3: trilinear value of the cut, and half its range over the element by its gradient.
void ContactModel::measure(const float* a, int begin, int end) noexcept {
  const SurfaceElements& e = elements_;
  const float *c0 = corner_[0].data(), *c1 = corner_[1].data(), *c2 = corner_[2].data(),
              *c3 = corner_[3].data(), *c4 = corner_[4].data(), *c5 = corner_[5].data(),
              *c6 = corner_[6].data(), *c7 = corner_[7].data();
  const float *fx = fx_.data(), *fy = fy_.data(), *fz = fz_.data();
  const float *lx = e.lx.data(), *ly = e.ly.data(), *lz = e.lz.data();
  const float *tx = e.tx.data(), *ty = e.ty.data();
  const float *half_along = e.half_along.data(), *half_around = e.half_around.data();
  float *value = value_.data(), *extent = extent_.data(), *along = along_.data();
#pragma omp simd
  for (int i = begin; i < end; ++i) {
    const FieldSample s =
        sample_cell(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], c6[i], c7[i], fx[i], fy[i], fz[i]);
    // Gradient in B (mm/mm): the columns of a are the axes of B in index space, over the voxel
    // size.
    const float gx = a[0] * s.gx + a[3] * s.gy + a[6] * s.gz;
    const float gy = a[1] * s.gx + a[4] * s.gy + a[7] * s.gz;
    const float gz = a[2] * s.gx + a[5] * s.gy + a[8] * s.gz;
    value[i] = s.value;
    along[i] = std::abs(gx * lx[i] + gy * ly[i] + gz * lz[i]) * half_along[i];
    extent[i] = kSlack * (along[i] + std::abs(gx * tx[i] + gy * ty[i]) * half_around[i]);
  }
}

bool ContactModel::covers(const Vec3& v) const noexcept {
  const double speed = v.norm();
  return speed == 0 || v.dot(sampled_direction_) >= kMarginCosine * speed;
}

double area_in_tissue(const SurfaceElements& elements, const Workpiece& workpiece,
                      const Pose& pose) noexcept {
  const ContactModel::IndexFrame f(workpiece.lattice(), pose);
  const float* a = f.a;
  double area = 0;
  for (std::size_t i = 0; i < elements.size(); ++i) {
    // The nearest voxel will do for a report.
    const float x = f.fx + a[0] * elements.x[i] + a[1] * elements.y[i] + a[2] * elements.z[i];
    const float y = f.fy + a[3] * elements.x[i] + a[4] * elements.y[i] + a[5] * elements.z[i];
    const float z = f.fz + a[6] * elements.x[i] + a[7] * elements.y[i] + a[8] * elements.z[i];
    const Index3 v(f.base.x() + cell_of(x + 0.5f), f.base.y() + cell_of(y + 0.5f),
                   f.base.z() + cell_of(z + 0.5f));
    if (workpiece.tooth().solid.value(v.x(), v.y(), v.z()) < 0 &&
        workpiece.cut().value(v.x(), v.y(), v.z()) < 0)
      area += elements.area[i];
  }
  return area;
}

}  // namespace toothprep
