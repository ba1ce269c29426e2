// What a convex bur takes that moves straight on, seen along the motion: a convex figure, known by the lines that touch it.
// How far a place lies within it is how far it lies from the nearest of these. Around sharp edges distances are mitred, as
// those are by which removal carves (Bur::mitred_distances): an edge's lines count the less the farther it goes with the
// distance.
#pragma once

#include <array>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

class SweptOutline {
 public:
  // Across the motion: beside the bur's axis, along it; and along the motion. Unit vectors, B.
  struct Axes {
    Vec3 beside, up, along;
  };

  // Of a bur that moves along a unit vector (B), not along its axis.
  static Axes axes_of(const Vec3& along) noexcept;
  // Of a bur that moves along a unit vector (B). Whether there is an outline: along its axis there is none.
  bool draw(const std::vector<ProfilePiece>& outline, const Vec3& along) noexcept;
  const Axes& axes() const { return axes_; }

  struct Sample {
    Float4 value;       // mm within it, negative outside
    Float4 by_l, by_h;  // its gradient
    Float4 from, to;    // mm along the motion, from the tip: from where to where the bur touches it
  };
  // At places (mm, by the axes, from the tip's path).
  Sample at(const Float4& l, const Float4& h) const noexcept;

 private:
  struct Direction;
  struct View;
  struct Line {
    float l, h, reach;  // the value is reach - l |at_l| - h at_h
    // Where the bur touches it, along its motion, mm; by so much more per value within it.
    float touches, moves;
    // Whether the lines before and behind it touch the same arc or edge: between them it bends evenly.
    bool has_before, has_after;
    std::int32_t face;  // that it touches, or that begins there; or -1
  };
  // The line of its number. At a place l, h that is nearest to it the bur touches so much further on per |l| and per h, not
  // below `low` nor above `high`; if it is the end of the bur, as far around that as the disc of this radius is wide there,
  // which narrows with the value.
  struct Face {
    const ProfilePiece* of;
    float by_l, by_h, low, high, radius, narrows;
  };
  // `stretch`: of distances from an edge.
  void add(const Direction& normal, double reach, double stretch, double touches,
           double moves) noexcept;
  // A face's line; those of the sharp edge between two pieces of the profile, and of an arc. `last`, `next`: the pieces
  // around these, or null.
  void add_face(const View& view, const ProfilePiece& face, const ProfilePiece* next) noexcept;
  void add_edge(const View& view, const ProfilePoint& before, const ProfilePoint& from,
                const ProfilePiece* last, const ProfilePiece* next) noexcept;
  void add_arc(const View& view, const ProfilePiece& arc, const ProfilePiece* last,
               const ProfilePiece* next) noexcept;
  // The lines from this number on, of one edge or arc, with each other and with the faces around them.
  void join(std::size_t begin, const ProfilePiece* last, const ProfilePiece* next) noexcept;
  // The number of a face's line, or -1.
  std::int32_t line_of(const ProfilePiece* face) const noexcept;
  // What the lines say together at places of the nearest of them and its neighbours.
  void bend(const Float4& beside, const Float4& h, const Int4& nearest, Sample& s) const noexcept;

  static constexpr std::size_t kMostLines = 96, kMostFaces = 8;
  std::array<Line, kMostLines + 1> lines_{};
  std::array<Face, kMostFaces> faces_{};
  std::size_t face_count_ = 0;
  std::size_t count_ = 0;
  Axes axes_;
};

}  // namespace toothprep
