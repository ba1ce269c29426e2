// A tooth in a dense grid along a frame of its own, from which a bur takes away what it meets: what
// paths are planned and checked on. No forces: what lies inside the head is gone.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// A place near a surface, and how far it lies outside (inside: negative), mm.
struct SurfacePlace {
  Vec3 at = Vec3::Zero();  // mm, frame of the grid
  double outside = 0;      // mm
};

class ToothGrid {  // labels in a dense box
 public:
  // Of all that remains of the tooth, cells of `step` mm along the axes of `frame` (in W), and
  // `margin` mm of air around. Throws Error if nothing remains.
  ToothGrid(const LayeredTooth& tooth, const Pose& frame, double step, double margin = 0.5);

  const Pose& frame() const { return frame_; }  // in W
  double step() const { return step_; }         // mm, of a cell
  const Index3& size() const { return size_; }  // cells
  const Vec3& low() const { return low_; }      // mm: of cell 0's middle
  // Of a cell in the arrays that go with the grid.
  std::size_t index(int x, int y, int z) const {
    return (static_cast<std::size_t>(x) * size_.y() + y) * size_.z() + z;
  }
  // Whether the cell lies within.
  bool holds(const Index3& c) const {
    return (c.array() >= 0).all() && (c.array() < size_.array()).all();
  }
  Index3 cell(const Vec3& x) const {  // the nearest one; may lie outside
    return ((x - low_) / step_).array().round().matrix().cast<int>();
  }
  // A cell's middle, mm.
  Vec3 place(int x, int y, int z) const { return low_ + step_ * Vec3(x, y, z); }
  // The tissue of a cell.
  Tissue at(int x, int y, int z) const { return static_cast<Tissue>(tissue_[index(x, y, z)]); }
  Tissue at(const Vec3& x) const;  // air outside the grid
  // Of enamel, dentin and pulp, not of what is no tooth (`other`).
  static bool is_tooth(Tissue t) { return t != Tissue::kAir && t != Tissue::kOther; }

  // The surface of the tooth, of dentin and pulp together, of the pulp, or of what is no tooth.
  enum class Surface { kTooth, kDentin, kPulp, kOther };
  // Signed distance to it (mm; within the level sets' band) at a place of the frame.
  [[nodiscard]] double distance(Surface surface, const Vec3& x) const;
  // The cells inside it that touch its outside.
  [[nodiscard]] std::vector<SurfacePlace> surface(Surface surface) const;

  // Height of the topmost place inside `surface` over (x, y), mm; -infinity where there is none.
  [[nodiscard]] double height(Surface surface, double x, double y) const;

 private:
  const LayeredTooth& tooth_;
  Pose frame_;
  double step_;
  Index3 size_ = Index3::Zero();
  Vec3 low_ = Vec3::Zero();
  std::vector<std::uint8_t> tissue_;
};

// The surface of all bodies of `whole` but the one that is prepared, in the frame of a grid that was
// made of with_others_as_other(whole); empty where it lists no bodies.
[[nodiscard]] std::vector<SurfacePlace> surface_of_others(const ToothGrid& grid,
                                                          const LayeredTooth& whole);
// The name of the body that has the voxel at a place of W; empty for air or without a list.
[[nodiscard]] std::string body_at(const LayeredTooth& whole, const Vec3& world);

// Least distance of the head of a bur at `pose` (in the grid's frame) from a surface; negative: it
// reaches through. Infinity without places.
[[nodiscard]] double head_distance(const Bur& bur, const Pose& pose,
                                   const std::vector<SurfacePlace>& places, Vec3* where = nullptr);

// What a bur takes on its way.
class Milling {
 public:
  // Keeps references to both.
  Milling(const ToothGrid& grid, const Bur& bur) : grid_(grid), bur_(bur), gone_(count(grid)) {}

  struct Bite {                   // of one place or way
    PerTissue<double> removed{};  // mm³
    double shank = 0;             // mm³ of what is still there inside the shank
  };
  // The bur at a pose of the grid's frame.
  Bite at(const Pose& pose);
  // On a straight way, in steps of half a cell.
  Bite along(const Pose& from, const Pose& to);
  bool remains(int x, int y, int z) const {
    return grid_.at(x, y, z) != Tissue::kAir && !gone_[grid_.index(x, y, z)];
  }

 private:
  static std::size_t count(const ToothGrid& g) {
    return static_cast<std::size_t>(g.size().x()) * g.size().y() * g.size().z();
  }
  const ToothGrid& grid_;
  const Bur& bur_;
  std::vector<bool> gone_;
};

}  // namespace toothprep
