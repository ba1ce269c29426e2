// Contact of the level-set engine: which elements of the bur's surface touch tissue, and how much
// of each. The law that they follow stands in contact_set.h.
//
// An element is in contact where tissue is met a small reach ahead of the surface, along the element's
// own velocity: ahead of fresh tissue that is the same as along the normal, and in a slot that is
// passed again it stays in the void instead of touching the walls.
//
// An element that is engaged as a whole counts by two Gauss points along each curved direction. One
// that a surface crosses (of the tooth, of a cut, of the border of two tissues), or over which v·n
// changes its sign, is divided into kParts x kParts parts with a sample each, which count by the
// share of their extent inside: the plane through the sample, by the field's gradient. So the
// border of the contact is resolved to the parts' size and v·n is that of what is covered; with the
// element's own v·n the work of overlapping passes is several percent too high.
//
// The level set of the cut is the deepest of all cuts, and the bur's own last cut, a voxel or two
// behind it, can hide the wall of an earlier one from the sample at the surface. So an element
// counts as a whole only if a second sample, farther ahead, finds no wall either.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class ContactModel {
 public:
  // Parts of at most `element_size` mm; u and alpha per tissue (validated by the caller).
  ContactModel(const Bur& bur, double element_size, bool clockwise,
               const PerTissue<GrindingProperties>& tissue);

  // Finds the elements in contact for a bur at `pose` that moves with trial velocity v (mm/s, B,
  // not zero unless omega turns it) and turns with omega (rad/s, B). `reach` in mm. Elements that
  // face away from the motion by more than a margin of 8° are left out; see covers(). Allocates
  // nothing.
  void sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v, const Vec3& omega,
              double reach) noexcept;

  // Whether every element that advances with v was considered by the last sample(), as far as the
  // direction of v goes (omega is the handle's and doesn't change within a step).
  bool covers(const Vec3& v) const noexcept;

  // What the last sample() found.
  const ContactSet& contact() const { return contact_; }

  struct IndexFrame;

 private:
  // Points of the surface that stand for parts of elements: an array each, for loops over
  // neighbours, and beside it what a contact set takes.
  struct Parts {
    std::vector<float> x, y, z;                         // mm, B
    std::vector<float> nx, ny, nz, tx, ty, lx, ly, lz;  // as of SurfaceElements
    std::vector<ContactSet::Element> element;

    int size() const { return static_cast<int>(element.size()); }
  };
  // One sample under way.
  struct Scan;

  void add_part(std::size_t i, double around, double along, double share, Parts& to) const;

  // The passes of sample(); see there.
  int locate_straight(const IndexFrame& frame, const Vec3& v, double reach) noexcept;
  int locate_turning(const IndexFrame& frame, const Vec3& v, const Vec3& omega,
                     double reach) noexcept;
  void measure(const float* to_index, int begin, int end) noexcept;
  void settle(const Scan& scan, int i) noexcept;
  FieldSample field_at(const LevelSet& field, const Index3& cell, int i) const noexcept;
  // What is known of an element as a whole.
  struct Known {
    bool inside = false;    // of the tooth's surface
    std::uint8_t only = 0;  // the label of the one tissue that it lies in
  };
  void divide(const Scan& scan, int i, const Eigen::Vector3f& ahead, const Known& known,
              const Parts& parts, int first, int around, int along) noexcept;
  struct PartSamples;
  void locate_parts(const Scan& scan, const Eigen::Vector3f& ahead, const Parts& parts, int first,
                    PartSamples& s) const noexcept;
  enum class Advance { kNone, kPartly, kWhole };
  Advance advance_of(const Scan& scan, int i) const noexcept;
  bool hides_void(const Scan& scan, int i, const Eigen::Vector3f& ahead) const noexcept;

  SurfaceElements elements_;
  ContactSet contact_;

  // Of each element: the points that stand for it where it is engaged as a whole (two-point Gauss
  // rule along each curved direction), and its kParts x kParts parts for where it isn't.
  std::vector<std::int32_t> first_node_;  // and one past the last
  Parts nodes_, parts_, strips_;

  // Everything below is an array over the elements, so that the passes of a sample run in place and
  // side by side. Of a sample: the cell (voxel of its lower corner, from the tip's voxel) and the
  // place in it, the cut's values at its corners, the cut's value at the element and half its range
  // over the element.
  std::vector<std::int32_t> cell_x_, cell_y_, cell_z_;
  std::vector<float> fx_, fy_, fz_;
  std::array<std::vector<float>, 8> corner_;
  std::vector<float> value_, extent_, along_;
  std::vector<std::int32_t> candidates_;
  double look_ahead_;  // mm, see hides_void()
  Vec3 sampled_direction_ = Vec3::Zero();
};

// Area of the elements (of a shank, or a head) whose middle lies in tissue, mm², by the nearest voxel.
double area_in_tissue(const SurfaceElements& elements, const Workpiece& workpiece,
                      const Pose& pose) noexcept;

}  // namespace toothprep
