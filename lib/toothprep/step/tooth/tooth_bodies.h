// Several bodies on one lattice: the tooth that is worked on, its neighbours, the gum.
//
// Tissues say what a voxel is made of, bodies whose it is: a neighbour has enamel, dentin and pulp
// of its own and grinds like any tooth. The solid and the tissues' level sets are of all bodies
// together, so the cost of a step doesn't depend on how many there are.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toothprep/step/tooth/brick_grid.h"

namespace toothprep {

// What a body is to the work.
enum class BodyKind : std::uint8_t {
  kTooth,      // the one that is prepared
  kNeighbour,  // another tooth: not to be touched
  kGum         // soft tissue or its stand-in: not to be touched
};
constexpr std::array<std::string_view, 3> kBodyKindNames = {"tooth", "neighbour",
                                                            "gum"};  // in that order

// A tooth or the gum, of several on one lattice.
struct Body {
  std::string name;                  // "36": printable ASCII without blanks and , : = . "
  BodyKind kind = BodyKind::kTooth;  // what it is to the work
  bool operator==(const Body&) const = default;  // name and kind
};

constexpr std::size_t kMostBodies = 64;  // of a tooth file

// The bodies of a lattice, and which voxels are whose.
struct ToothBodies {
  std::vector<Body> list;  // one of them is the tooth that is prepared
  // Of each voxel with a tissue 1 + the place in the list of its body. Air within two voxels of a
  // surface has the number of the nearest body, air beyond has 0 or that of its brick: so bricks
  // that hold one body take no storage. It covers the same bricks as the tooth's other grids.
  BrickGrid<std::uint8_t> of;

  std::size_t worked() const;  // the place of the tooth that is prepared
};

// Throws Error if a list has not 1 to 64 bodies with names of their own, or not one tooth.
void check_bodies(const std::vector<Body>& list);

// The list as files have it, "36:tooth,37:neighbour,gum:gum", and back. Throws Error as
// check_bodies(), or if an entry isn't NAME:KIND.
[[nodiscard]] std::string bodies_text(const std::vector<Body>& list);
[[nodiscard]] std::vector<Body> parse_bodies(const std::string& text);

// A grid for so many bodies on the bricks of `like`, 0 throughout.
[[nodiscard]] BrickGrid<std::uint8_t> make_body_grid(const BrickGrid<std::uint8_t>& like,
                                                     std::size_t bodies);

struct LayeredTooth;

// Gives the tooth a list, and a grid that need only be right where there is a tissue: what it says
// of air is found anew. Throws Error as check_bodies(), or if a voxel with a tissue has no body of
// the list.
void set_bodies(LayeredTooth& tooth, std::vector<Body> list, BrickGrid<std::uint8_t> of);

// What remains of each body, mm³.
[[nodiscard]] std::vector<double> body_volumes_mm3(const LayeredTooth& tooth);

// The tooth with the label `other` on all but the tooth that is prepared, and without the list: how
// measuring, planning and placing see it. Without a list the tooth as it is.
[[nodiscard]] LayeredTooth with_others_as_other(LayeredTooth tooth);

}  // namespace toothprep
