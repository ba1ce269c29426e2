// What the passes of a contact sample share: the bur's frame in index space, and a field around a
// point of the bur's surface. Internal to contact*.cpp.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "toothprep/step/grinding/advance_kernels.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/covered_part.h"

namespace toothprep {

// Keeps a division defined where the field is flat or meets an element face on, mm.
constexpr float kLeastExtent = 1e-6f;

// What was found stands for this part of the distance at which it could be different: a field's
// gradient can exceed 1 between voxels.
constexpr float kStands = 0.5f;

// What a sample ahead of the surface finds of the cut is taken back by this part of the reach. The
// rest, a hundredth of a voxel, keeps a bur that rests in what it has cut itself in touch with it.
constexpr float kTakenBack = 0.9f;

// The wall that a convex bur left stands out by at most this part of D² times the sum of its curvatures.
constexpr float kWallAtMost = 1.0f / 12;

// Where two surfaces meet the lattice rounds them by less than this (voxels).
constexpr float kRounded = 0.4f;

constexpr float kLeastShare = 1e-4f;  // of a piece: less is nothing
// Of a border in a piece, at least: keeps a division defined for one along an axis.
constexpr float kLeastSlant = 0.02f;

// The cell of an index coordinate beside the tip's voxel. Cutting towards zero is floor for what is
// positive, and vectorises with SSE2 alone. The offset costs up to 3e-4 voxel: so close to a border
// of two cells either serves, since the interpolant is continuous.
constexpr float kIndexOffset = 4096;  // voxels; a head is shorter
inline std::int32_t cell_of(float x) {
  return static_cast<std::int32_t>(x + kIndexOffset) - static_cast<std::int32_t>(kIndexOffset);
}

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
  // A vector of B (mm) in voxels.
  Eigen::Vector3f turned(float x, float y, float z) const {
    return {a[0] * x + a[1] * y + a[2] * z, a[3] * x + a[4] * y + a[5] * z,
            a[6] * x + a[7] * y + a[8] * z};
  }
  // A gradient per voxel, as a gradient in B per mm.
  FourSamples gradients(const FourSamples& s) const {
    return {s.value, a[0] * s.gx + a[3] * s.gy + a[6] * s.gz,
            a[1] * s.gx + a[4] * s.gy + a[7] * s.gz, a[2] * s.gx + a[5] * s.gy + a[8] * s.gz};
  }
};

struct ContactModel::Scan {
  const Workpiece& workpiece;
  const IndexFrame& frame;
  Eigen::Vector3f v, omega;  // mm/s, rad/s, B
  float speed;               // mm/s, of v
  float reach;               // mm
  bool turns;
  std::uint64_t cuts;               // number of the cut
  const SweepHistory* history;      // or null
  const StraightSweep* retraced;    // a part of it that the bur moves along again, or none
  SweepHistory::Number leads_here;  // the part on which the bur moves on, or 0
  Vec3 direction;                   // of v, B
  float straight = 0;  // mm: so far ahead walls may run along the way that goes on as it does
  Eigen::Vector3f turning =
      Eigen::Vector3f::Zero();  // rad/mm, B: by how much that way turns, as on an arc
  Eigen::Vector3f tangent = Eigen::Vector3f::Zero();  // of that arc here, B
  const AlongWay* farther = nullptr;  // where elements look for walls of other cuts, if it turns
  Eigen::Vector3f unit = Eigen::Vector3f::Zero();  // the same, voxels per mm

  // Whether straight parts of the way may tell what was cut.
  bool knows_parts() const { return history && !turns; }
  Eigen::Vector3f unit_of(const Eigen::Vector3f& u, float of_speed) const {
    const float per_speed = of_speed > 0 ? 1 / of_speed : 0;
    return frame.turned(u.x() * per_speed, u.y() * per_speed, u.z() * per_speed);
  }
  Eigen::Vector3f velocity_at(float x, float y, float z) const {
    return turns ? Eigen::Vector3f(v + omega.cross(Eigen::Vector3f(x, y, z))) : v;
  }
  // Air isn't carved, so ahead of where the tooth ends no cut tells of earlier slots: of so much way (mm) from a place
  // (voxels, from the tip's) the whole, half, a quarter or an eighth, the longest with a cut a little beyond it. On an
  // arc, too, that is looked for straight ahead.
  float known_way(const Eigen::Vector3f& from, const Eigen::Vector3f& along,
                  float way) const noexcept {
    constexpr int kHalvings = 3;
    constexpr float kCutBeyond = 3;  // voxels
    const float beyond = kCutBeyond * static_cast<float>(workpiece.voxel());
    for (int n = 0; n < kHalvings; ++n, way *= 0.5f) {
      const Eigen::Vector3f at = from + (way + beyond) * along;
      const std::int64_t brick = workpiece.cut().brick_index(frame.base.x() + cell_of(at.x()),
                                                             frame.base.y() + cell_of(at.y()),
                                                             frame.base.z() + cell_of(at.z()));
      if (brick >= 0 && !workpiece.air(static_cast<std::size_t>(brick))) return way;
    }
    return way;
  }
};

// A field at an index position, from the tip's voxel.
inline FieldSample field_at(const LevelSet& field, const Index3& base,
                            const Eigen::Vector3f& at) noexcept {
  const std::int32_t x = cell_of(at.x()), y = cell_of(at.y()), z = cell_of(at.z());
  float corners[8];
  cell_corners(field, base.x() + x, base.y() + y, base.z() + z, corners);
  return sample_cell(corners, at.x() - static_cast<float>(x), at.y() - static_cast<float>(y),
                     at.z() - static_cast<float>(z));
}

// The same of four positions, and what is left of these.
struct FourPlaces {
  Int4 x, y, z;
  Float4 fx, fy, fz;
  FourPlaces(Float4 ix, Float4 iy, Float4 iz) {
    constexpr auto kOffset = static_cast<std::int32_t>(kIndexOffset);
    x = truncated(ix + kIndexOffset) - kOffset;
    y = truncated(iy + kIndexOffset) - kOffset;
    z = truncated(iz + kIndexOffset) - kOffset;
    fx = ix - as_float(x), fy = iy - as_float(y), fz = iz - as_float(z);
  }
};

inline Float4 along4(const FourSamples& s, const Eigen::Vector3f& way) {
  return s.gx * way.x() + s.gy * way.y() + s.gz * way.z();
}

// A field's value at the surface from the sample that lies `ahead` (voxels) of it.
inline Float4 at_surface4(const FourSamples& s, const Eigen::Vector3f& ahead) {
  return s.value - s.gx * ahead.x() - s.gy * ahead.y() - s.gz * ahead.z();
}

// The share of an element that lies inside, from the field at its middle and half its range.
inline float share_inside(float value, float extent) {
  const float share = 0.5f - 0.5f * value / std::max(extent, kLeastExtent);
  return std::min(std::max(share, 0.0f), 1.0f);
}

// Of four pieces, in voxels, and how B lies there.
struct ContactModel::Place {
  const IndexFrame& frame;
  Float4 x, y, z;
  // Those beside them, by mm in B.
  FourPlaces beside(const Float4& dx, const Float4& dy, const Float4& dz) const {
    const float* a = frame.a;
    return {x + (a[0] * dx + a[1] * dy + a[2] * dz), y + (a[3] * dx + a[4] * dy + a[5] * dz),
            z + (a[6] * dx + a[7] * dy + a[8] * dz)};
  }
};

// A place farther along a path that bends as an arc. What earlier passes left on concentric arcs is round about the same
// centre: turned about it, B and what lies beside the bur meet there what they will meet here.
struct ContactModel::AlongWay {
  IndexFrame frame;       // B, turned
  Eigen::Matrix3f turn;   // of places from the tip, voxels
  Eigen::Vector3f shift;  // of the tip, voxels

  // `way`: mm; it turns by no more than half a radian over that.
  AlongWay(const Scan& scan, float way) : frame(scan.frame) {
    using Rows = Eigen::Matrix<float, 3, 3, Eigen::RowMajor>;
    const Eigen::Matrix3f to_index = Eigen::Map<const Rows>(scan.frame.a);
    const Eigen::Vector3f& t = scan.tangent;
    // Integrals of a turn, by series: no library's sine is in a result.
    const float square = scan.turning.squaredNorm() * way * way,
                sine = way * (1 - square / 6 * (1 - square / 20)),
                cosine = way * way / 2 * (1 - square / 12 * (1 - square / 30)),
                rest = way * way * way / 6 * (1 - square / 20);
    Eigen::Matrix3f cross;
    cross << 0, -scan.turning.z(), scan.turning.y(), scan.turning.z(), 0, -scan.turning.x(),
        -scan.turning.y(), scan.turning.x(), 0;
    const Eigen::Matrix3f in_bur =
        sine * cross + cosine * (cross * cross) + Eigen::Matrix3f::Identity();
    const float voxel = static_cast<float>(scan.workpiece.voxel());
    Eigen::Map<Rows>(frame.a) = to_index * in_bur;
    turn = voxel * voxel * (to_index * in_bur * to_index.transpose());
    shift = to_index * (way * t + cosine * (cross * t) + rest * (cross * (cross * t)));
  }
  // From places on the bur.
  Eigen::Vector3f of(const Eigen::Vector3f& x) const {
    const Eigen::Vector3f tip(frame.fx, frame.fy, frame.fz);
    return tip + shift + turn * (x - tip);
  }
  Place of(const Float4& x, const Float4& y, const Float4& z) const {
    const Float4 dx = x - frame.fx, dy = y - frame.fy, dz = z - frame.fz;
    return {frame, frame.fx + shift.x() + turn(0, 0) * dx + turn(0, 1) * dy + turn(0, 2) * dz,
            frame.fy + shift.y() + turn(1, 0) * dx + turn(1, 1) * dy + turn(1, 2) * dz,
            frame.fz + shift.z() + turn(2, 0) * dx + turn(2, 1) * dy + turn(2, 2) * dz};
  }
};

// See from_print().
struct ContactModel::FromPrint {
  Float4 advance, bend;
};

// What the cut is found to be at the places x, y (-1 .. 1) of four pieces: gradients in B, per mm.
struct ContactModel::AtBorder {
  Float4 x, y;
  FourSamples sample;
  void replace(const Int4& where, const AtBorder& by) {
    x = where ? by.x : x;
    y = where ? by.y : y;
    sample.replace(where, by.sample);
  }
};

// What was found of a piece stands until a share may have changed by this, and a whole sample in which it
// counts until one may have changed by that. More where the piece hardly advances: by what that makes where v·n is this
// part of the speed.
constexpr float kStays = 0.01f, kHolds = 0.1f, kHardlyAdvances = 0.1f, kLeastAdvance = 0.01f;

struct ContactModel::Lanes : Crossing {
  Eigen::Vector3f unit, ahead;  // of the motion, voxels per mm; of the samples, voxels
  float speed;                  // mm/s, of the element
  float curvature_along;
  Float4 curvature_around;
  float edge;                               // as of edge_
  Int4 at_edge;                             // -1: the piece lies at that edge
  Float4 ux, uy, uz;                        // velocity, mm/s, B
  Float4 advance;                           // v·n, mm/s
  Float4 ix, iy, iz;                        // index of the sample, from the tip's voxel
  Float4 fx, fy, fz;                        // its place in its cell
  KeptCells* cells;                         // these
  std::array<double, kPieces>* slots_from;  // as of Standing
  double* parts_from;  // mm of way, from which on parts of the way are looked for
  Int4 live;           // -1: may be in contact, 0: not
  Float4 share, x, y;  // as of CoveredPart
  Float4
      rise;  // of the cut's border along the motion, mm per mm; 0 where more than that border tells what is covered
  Float4 stays, holds;  // mm of way: until a share may have changed by kStays, and by kHolds
  Float4 moves;         // until the cut's border doesn't move on as it does
  Int4 by_sweeps{};     // -1: the share is what known sweeps leave
  Int4 by_rates{};      // -1: it changes by `per_way` (per mm of way), not with its border
  CoveredPart<Float4> per_way{};
  int tissue;  // that all of them lie in, or -1: as of_tissue has it
  CoveredPart<Float4> of_tissue[kTissueCount];

  // What lies on one side of a line as well, of what was found to be covered of piece p.
  CoveredPart<float> also_under(int p, const DividingLine& line) const {
    const CoveredPart<float> part = under_all(p, line);
    if (!by_slots[p]) return part;
    const CoveredPart<float> all = under_all(p, DividingLine::none());
    if (!(all.share > kLeastShare)) return {share[p], x[p], y[p]};
    return {share[p] * part.share / all.share, x[p] + part.x - all.x, y[p] + part.y - all.y};
  }
  void cover(const Int4& where, const CoveredPart<Float4>& part) {
    share = where ? part.share : share;
    x = where ? part.x : x;
    y = where ? part.y : y;
  }
  void note_crossing(const Int4& counts, const Float4& value, const Float4& range_along,
                     const Float4& range_around, const Float4& along_way, float moves_for = kHolds);
  void note_rate(const Int4& counts, const Float4& per_way_of_share);
  // Of which the shares are moved on, rather than left as they were found.
  Int4 are_moved() const { return (rise != 0) | by_rates; }
  Float4 more_way() const;
};

// Four pieces: half of each along its axes, and how they bend away from these (B, mm).
struct ContactModel::PieceAxes {
  Float4 along_x, along_y, along_z, around_x, around_y;
  Float4 bent_along_x, bent_along_y, bent_along_z, bent_around_x, bent_around_y;
  Float4 widening;  // of what they are around the axis, over half of them along the profile

  PieceAxes(const Pieces& pieces, int first, float curvature_along) {
    const float along = pieces.half_along[first];
    const Float4 around = load4(&pieces.half_around[first]);
    along_x = along * load4(&pieces.lx[first]), along_y = along * load4(&pieces.ly[first]);
    along_z = along * load4(&pieces.lz[first]);
    around_x = around * load4(&pieces.tx[first]), around_y = around * load4(&pieces.ty[first]);
    const float bend = -0.5f * curvature_along * along * along;
    bent_along_x = bend * load4(&pieces.nx[first]), bent_along_y = bend * load4(&pieces.ny[first]);
    bent_along_z = bend * load4(&pieces.nz[first]);
    const Float4 x = load4(&pieces.x[first]), y = load4(&pieces.y[first]);
    const Float4 per_square = 1 / (x * x + y * y),
                 per_radius = -0.5f * around * around * per_square;
    bent_around_x = per_radius * x, bent_around_y = per_radius * y;
    widening = (along_x * x + along_y * y) * per_square;
  }

  // By how much a field with gradient g (B, per mm) changes over half of a piece.
  Float4 along(const FourSamples& g) const {
    return g.gx * along_x + g.gy * along_y + g.gz * along_z;
  }
  Float4 around(const FourSamples& g) const { return g.gx * around_x + g.gy * around_y; }
  // And because of the bend.
  Float4 bent_along(const FourSamples& g) const {
    return g.gx * bent_along_x + g.gy * bent_along_y + g.gz * bent_along_z;
  }
  Float4 bent_around(const FourSamples& g) const {
    return g.gx * bent_around_x + g.gy * bent_around_y;
  }
};

// Of a field c + a x + b y + d x² + e y² + f x y over [-1, 1]²: the value in the middle of the one without d, e
// and f whose zero divides the piece alike. To second order: with x², y² and x y as they are on average along
// that line, as far as it lies in the piece.
inline Float4 straightened(const Float4& c, const Float4& a, const Float4& b, const Float4& d,
                           const Float4& e, const Float4& f) {
  const Float4 abs_a = magnitude(a), abs_b = magnitude(b), one = all4(1);
  const Float4 larger = greatest(greatest(abs_a, abs_b), all4(kLeastExtent));
  const Int4 along = abs_a > abs_b;
  // Towards the larger change u the field is 0 at -at; where it only comes near to 0, it does so there.
  const Float4 at =
      2 * c / (larger + square_root(greatest(larger * larger - 4 * c * (along ? d : e), Float4{})));
  const Float4 slant = greatest(least(abs_a, abs_b) / larger, all4(kLeastSlant));
  // The line is u = -at - slant v.
  const Float4 from = least(greatest((-1 - at) / slant, -one), one),
               to = least(greatest((1 - at) / slant, -one), one);
  const Float4 middle = 0.5f * (from + to), half = 0.5f * (to - from);
  const Float4 vv = middle * middle + (1.0f / 3) * half * half;
  const Float4 uu = least(at * at + slant * (2 * at * middle + slant * vv), one),
               uv = least(greatest(-at * middle - slant * vv, -one), one);
  return c + d * (along ? uu : vv) + e * (along ? vv : uu) +
         f * turned_where_negative(a, turned_where_negative(b, uv));
}

// Of those that hardly advance shares may change by so many times more.
inline Float4 ContactModel::Lanes::more_way() const {
  const Float4 little =
      least(greatest(advance, all4(kLeastAdvance * speed)), all4(kHardlyAdvances * speed));
  return kHardlyAdvances * speed / little;
}

// The same of shares that change by so much per mm of way.
inline void ContactModel::Lanes::note_rate(const Int4& counts, const Float4& per_way_of_share) {
  const Float4 per_change = more_way() / greatest(magnitude(per_way_of_share), all4(kLeastExtent));
  stays = counts ? least(stays, kStays * per_change) : stays;
  holds = counts ? least(holds, kHolds * per_change) : holds;
  moves = counts ? least(moves, kHolds * per_change) : moves;
}

// A field at the pieces of `counts`, with its value, half ranges over them and change along the way: the
// way that is left becomes no longer than until the share that it covers has changed. Where its zero
// lies outside of a piece the share changes when it gets there.
inline void ContactModel::Lanes::note_crossing(const Int4& counts, const Float4& value,
                                               const Float4& range_along,
                                               const Float4& range_around, const Float4& along_way,
                                               float moves_for) {
  const Float4 a = magnitude(range_along), b = magnitude(range_around);
  const Float4 comes = turned_where_negative(value, -along_way);
  const Float4 across = 2 * more_way() * greatest(a, b) /
                        greatest(magnitude(along_way), all4(kLeastExtent)),
               until = greatest((magnitude(value) - (a + b)) / greatest(comes, all4(kLeastExtent)),
                                Float4{});
  const Float4 stay = kStays * across + until, hold = kHolds * across + until,
               move = moves_for * across + until;
  stays = counts ? least(stays, stay) : stays;
  holds = counts ? least(holds, hold) : holds;
  moves = counts ? least(moves, move) : moves;
}

}  // namespace toothprep
