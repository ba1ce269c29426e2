// What a convex bur takes that moves straight on without end, but not along its axis. The bur's distance from a place is
// convex along the way, and the greatest of those from its faces and arcs; so it is least where one of these has its least,
// or where two of them that meet in a sharp edge are equally far, one coming and the other going. All of these have a closed
// form, but for an arc around a ring (Newton's method, of a convex function from the side where its steps can't go too far).
#pragma once

#include <array>

#include "toothprep/step/grinding/convex_profile.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

class SweptOutline {
 public:
  // Of a bur that rises along its axis by so much per way square to it, more than 0. Whether it is known. `bur`: kept.
  bool set(const ConvexProfile& bur, float rise) noexcept;

  static constexpr float kUnknown = 1e3f;  // mm, no outline is as wide
  // At places: beside the plane of the bur's axis and its way, mm; and over its tip as the axis passes there, mm.
  struct Sample {
    Float4 value;       // mm within it, negative outside; kUnknown if rounding hid the nearest
    Float4 by_r, by_z;  // its gradient: from the bur's axis, and along it
    Float4 ahead, r;    // mm from that axis: along the way, square to the axis; and in all
  };                    // all as the bur is where it is deepest
  Sample at(const Float4& beside, const Float4& level) const noexcept;

 private:
  // Of a face that is deepest where it passes by: so far along the way, and from the axis, per distance beside it; its value
  // falls by so much. Others have none: the nearer the farther the bur goes.
  struct Passing {
    const ConvexProfile::Face* face = nullptr;
    float ahead, r, falls;
  };
  struct Round {
    const ConvexProfile::Arc* arc;
    Passing to;  // of the face that it ends in
  };
  struct Sharp {
    const ConvexProfile::Edge* edge;
    Passing below, above;  // of its faces
  };
  Passing passing(const ConvexProfile::Face& face) const noexcept;
  struct Nearest;
  Float4 ahead_of(const ConvexProfile::Arc& arc, const Float4& beside,
                  const Float4& level) const noexcept;
  void meet(const Round& round, const Float4& beside, const Float4& level,
            Nearest& nearest) const noexcept;
  void meet(const Sharp& sharp, const Float4& beside, const Float4& level,
            Nearest& nearest) const noexcept;

  static constexpr std::size_t kMostFaces = 24, kMostArcs = 8, kMostEdges = 16;
  float rise_ = 0;
  std::array<Passing, kMostFaces> passing_{};
  std::array<Round, kMostArcs> rounds_{};
  std::array<Sharp, kMostEdges> edges_{};
  std::size_t passing_count_ = 0, round_count_ = 0, edge_count_ = 0;
};

}  // namespace toothprep
