// How far places lie within a convex bur that stands, four at a time: by its faces and arcs, mitred around sharp edges as the
// distances are by which removal carves. Internal to this folder.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

class ConvexProfile {
 public:
  explicit ConvexProfile(const std::vector<ProfilePiece>& outline) noexcept {
    for (const ProfilePiece& piece : outline) {
      const auto f = [](double x) { return static_cast<float>(x); };
      const ProfilePoint from = point_on(piece, 0), to = point_on(piece, 1);
      if (count_ == kMost) return;
      Piece& p = pieces_[count_++];
      p.r = f(from.along_z), p.z = f(-from.along_r);
      p.reach = f(piece.r0 * from.along_z - piece.z0 * from.along_r);
      p.is_arc = piece.kind == ProfilePiece::Kind::kArc;
      if (!p.is_arc) continue;
      p.centre_r = f(piece.centre_r), p.centre_z = f(piece.centre_z);
      p.radius = f(std::hypot(piece.r0 - piece.centre_r, piece.z0 - piece.centre_z));
      p.to_r = f(to.along_z), p.to_z = f(-to.along_r);
    }
    set_end();
  }

  // As far from the axis as a flat end counts at a height z, mm: beyond that the face beside it is nearer. 0 if there is none.
  Float4 end_radius(const Float4& z) const { return greatest(end_ - narrows_ * z, Float4{}); }

  // Whether there is one, and whether it ends in a sharp edge.
  bool has_end() const { return end_ > 0; }
  bool has_sharp_end() const { return end_ > 0 && !pieces_[1].is_arc; }

  struct Sample {
    Float4 value, by_r, by_z;  // mm, negative outside; its gradient
  };
  // At distances r from the axis, z along it, mm.
  Sample at(const Float4& r, const Float4& z) const noexcept {
    Sample s{all4(1e3f), Float4{}, Float4{}};
    for (std::size_t i = 0; i < count_; ++i) {
      const Piece& p = pieces_[i];
      Float4 value, by_r, by_z;
      if (p.is_arc) {
        // Counter-clockwise from one normal to the other, by less than half a turn.
        const Float4 dr = r - p.centre_r, dz = z - p.centre_z;
        const Int4 behind = p.r * dz - p.z * dr < 0, before = dr * p.to_z - dz * p.to_r < 0;
        const Float4 far = square_root(dr * dr + dz * dz), per = 1 / greatest(far, all4(1e-9f));
        by_r = behind ? all4(-p.r) : before ? all4(-p.to_r) : -per * dr;
        by_z = behind ? all4(-p.z) : before ? all4(-p.to_z) : -per * dz;
        value = p.radius + by_r * dr + by_z * dz;
      } else {
        by_r = all4(-p.r), by_z = all4(-p.z);
        value = p.reach - p.r * r - p.z * z;
      }
      const Int4 nearer = value < s.value;
      s.value = least(value, s.value);
      s.by_r = nearer ? by_r : s.by_r;
      s.by_z = nearer ? by_z : s.by_z;
    }
    return s;
  }

 private:
  static constexpr std::size_t kMost = 16;
  struct Piece {
    float r, z, reach;  // a face: reach - r at_r - z at_z; of an arc: the normal where it begins
    bool is_arc;
    float centre_r, centre_z, radius, to_r, to_z;  // of an arc; the normal where it ends
  };
  void set_end() noexcept {
    if (count_ < 2 || pieces_[0].is_arc || !(pieces_[0].z < -kSquare)) return;
    const Piece& next = pieces_[1];
    const float along_r = -next.z, along_z = next.r;  // from the end on
    if (next.is_arc)
      end_ = next.centre_r;
    else if (along_z > 0)
      end_ = next.reach / along_z, narrows_ = (1 - along_r) / along_z;
  }

  static constexpr float kSquare = 0.9999f;  // of a flat end's normal
  std::array<Piece, kMost> pieces_{};
  std::size_t count_ = 0;
  float end_ = 0, narrows_ = 0;  // the end's radius, mm; so much less of it counts per height
};

}  // namespace toothprep
