// How far places lie within a convex bur that stands, four at a time: by its faces and arcs, mitred around sharp edges as the
// distances are by which removal carves. Internal to this folder.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

class ConvexProfile {
 public:
  // A straight piece, or what touches an arc where it ends: by its unit normal, outwards.
  struct Face {
    float r, z, reach;  // a place lies reach - r at_r - z at_z within it, mm
    Float4 within(const Float4& at_r, const Float4& at_z) const {
      return reach - r * at_r - z * at_z;
    }
  };
  struct Arc {
    float centre_r, centre_z, radius;  // mm
    Face from, to;                     // counter-clockwise, by less than half a turn
  };
  // Where two faces meet, or what touches arcs there. Outwards it goes on by so much per distance.
  struct Edge {
    Face below, above;
    float r, z, out_r, out_z;
  };

  explicit ConvexProfile(const std::vector<ProfilePiece>& outline) {
    known_ = is_convex(outline);
    if (!known_) return;
    // Distances from a pointed tip aren't mitred.
    const Face tip = face_of(point_on(outline.front(), 0));
    if (tip.z > -kBlunt) arcs_.push_back({0, 0, 0, {0, -1, 0}, tip});
    const ProfilePiece* last = nullptr;
    for (const ProfilePiece& piece : outline) {
      const Face from = face_of(point_on(piece, 0)), to = face_of(point_on(piece, 1));
      if (last) add_edge(face_of(point_on(*last, 1)), from);
      last = &piece;
      add_face(from), add_face(to);
      if (piece.kind != ProfilePiece::Kind::kArc) continue;
      arcs_.push_back({f(piece.centre_r), f(piece.centre_z),
                       f(std::hypot(piece.r0 - piece.centre_r, piece.z0 - piece.centre_z)), from,
                       to});
      if (piece.centre_r > 0) add_edge(from, to);  // deeper than the arc's ring
    }
  }

  // Whether the bur is convex.
  bool is_known() const { return known_; }
  const std::vector<Face>& faces() const { return faces_; }
  const std::vector<Arc>& arcs() const { return arcs_; }
  const std::vector<Edge>& edges() const { return edges_; }

  struct Sample {
    Float4 value, by_r, by_z;  // mm, negative outside; its gradient
  };
  // At distances r from the axis, z along it, mm.
  Sample at(const Float4& r, const Float4& z) const noexcept {
    Sample s{all4(1e3f), Float4{}, Float4{}};
    for (const Face& face : faces_) {
      const Float4 value = face.within(r, z);
      const Int4 nearer = value < s.value;
      s.value = least(value, s.value);
      s.by_r = nearer ? all4(-face.r) : s.by_r;
      s.by_z = nearer ? all4(-face.z) : s.by_z;
    }
    for (const Arc& arc : arcs_) {
      const OfArc of(arc, r, z);
      const Int4 nearer = of.is_beside & (of.value < s.value);
      s.value = nearer ? of.value : s.value;
      s.by_r = nearer ? -of.r : s.by_r;
      s.by_z = nearer ? -of.z : s.by_z;
    }
    return s;
  }

  // An arc at places: whether it is beside them, how far these lie within its circle, and the normal towards them.
  struct OfArc {
    Float4 value, r, z;
    Int4 is_beside;
    OfArc(const Arc& arc, const Float4& at_r, const Float4& at_z) {
      const Float4 dr = at_r - arc.centre_r, dz = at_z - arc.centre_z,
                   far = square_root(dr * dr + dz * dz), per = 1 / greatest(far, all4(kNoRadius));
      is_beside = (arc.from.r * dz - arc.from.z * dr >= 0) & (dr * arc.to.z - dz * arc.to.r >= 0);
      value = arc.radius - far;
      r = per * dr, z = per * dz;
    }
  };

 private:
  static constexpr float kNoRadius = 1e-9f;  // mm
  static constexpr float kSame = 1e-5f;      // mm, or of a normal
  static constexpr float kBlunt = 0.9999f;   // of the normal where the bur begins
  static constexpr double kEdgeSine = 1e-3;
  struct Point {
    float r, z;  // mm
  };
  static float f(double x) { return static_cast<float>(x); }
  static Face face_of(const ProfilePoint& at) {
    return {f(at.along_z), f(-at.along_r), f(at.r * at.along_z - at.z * at.along_r)};
  }
  void add_face(const Face& face) {
    const auto is_same = [&](const Face& other) {
      return std::abs(face.r - other.r) < kSame && std::abs(face.z - other.z) < kSame &&
             std::abs(face.reach - other.reach) < kSame;
    };
    if (std::none_of(faces_.begin(), faces_.end(), is_same)) faces_.push_back(face);
  }
  void add_edge(const Face& below, const Face& above) {
    const double turn = double{below.r} * above.z - double{below.z} * above.r;
    const auto meet_at = [&](double a, double b) {  // a below.x, b above.x
      return Point{f((a * above.z - b * below.z) / turn), f((b * below.r - a * above.r) / turn)};
    };
    if (!(turn > kEdgeSine)) return;
    const Point at = meet_at(below.reach, above.reach), out = meet_at(1, 1);
    edges_.push_back({below, above, at.r, at.z, out.r, out.z});
  }

  bool known_ = false;
  std::vector<Face> faces_;
  std::vector<Arc> arcs_;
  std::vector<Edge> edges_;
};

}  // namespace toothprep
