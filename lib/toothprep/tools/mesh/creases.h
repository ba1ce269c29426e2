// Line angles within a cut: where its floor meets its wall, or two passes of a bur leave a ridge.
//
// A cut's field is one number per voxel, so the surface that is interpolated from it bevels them.
// But the field holds more: each sample near a face knows that face's plane, by its distance and
// its gradient. From the samples on the side from which the edge is seen convex, the planes of both
// faces (or of three, at a corner) are taken and intersected.
//
//   convex edge of what was removed (floor and wall): cut = max of the planes
//   reentrant edge (a ridge left between passes):     cut = min of the planes
//
// Where samples on that side are few (a narrow bur's wall near its floor), those on the other side
// give the planes; in any case they have to explain the samples about the edge. Of several such
// explanations the one counts on whose faces the samples' feet lie, of equals that with fewer faces.
//
// Lengths in voxels, positions in voxel indices.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// How far vertices of the tooth's own surface stay from the cut, and those of the cut from that
// surface: nearer ones, or beyond it, are moved to a part of this, in their order.
constexpr double kClear = 0.1;
inline double cleared(double distance) {
  return kClear * (0.25 + 0.75 / (1 + 2 * (kClear - distance)));
}

// A face of a cut near one cell: z = h(x, y), of second order, in a frame of its own.
struct CreaseFace {
  Vec3 origin;                        // near the cell
  std::array<Vec3, 3> axis;           // the third out of what was removed
  Eigen::Matrix<double, 6, 1> terms;  // of 1, x, y, x²/2, xy, y²/2

  double level(const Vec3& at) const;    // along the third axis from the face, positive outside
  Vec3 gradient(const Vec3& at) const;   // of the level
  CreaseFace shifted(double way) const;  // along the third axis
};

// An edge of the surface near a crease.
struct EdgeAtCrease {
  double misfit;                  // of its ends from the faces that they are on
  bool crossed;                   // its ends are on different faces, and neither is on the crease
  std::array<bool, 2> on_crease;  // its ends
  double part;                    // of the way along it, where it is nearest to the crease
  Vec3 at;                        // that point of the crease, or the corner if that comes before it
  bool is_corner;
};

class CutSamples;
struct SamplePlane {  // of the cut, by one sample near it
  Vec3 normal, foot;  // unit, out of what was removed; the nearest point of the surface
  double weight;
};

// Of the faces of a level set that pass near a cell, by samples on both sides, the one that is the
// nearest to a point. Positions are relative to the cell.
std::optional<CreaseFace> face_near(const LevelSet& set, double voxel, const Index3& cell,
                                    const Vec3& at);

// Finds the creases of the surface that passes through one cell, which reaches from a voxel to the
// next along each axis. Positions are relative to it.
class CreaseFinder {
 public:
  CreaseFinder(const LevelSet& cut, double voxel, const Index3& cell);  // voxel in mm
  ~CreaseFinder();
  CreaseFinder(CreaseFinder&&) noexcept;
  bool has_faces() const { return !wedges_.empty(); }  // two or more
  // Where the faces cross the way from a to b, 0 to 1, or nothing if they don't.
  std::optional<double> crossing(const Vec3& a, const Vec3& b) const;
  // The point near x where a face of the cut crosses the tooth's.
  std::optional<Vec3> on_margin(const Vec3& x, const CreaseFace& tooth) const;
  // Where a point of the tooth's face x that was removed, or nearly, has to go to be beside the cut.
  std::optional<Vec3> out_of_cut(const Vec3& x, const CreaseFace& tooth) const;
  // Of an edge from u to v on the cut, or on the margin, if the tooth's face there is given.
  // Nothing if it isn't on the faces.
  std::optional<EdgeAtCrease> edge(const Vec3& u, const Vec3& v, const CreaseFace* tooth) const;
  // The corner of three faces near x.
  std::optional<Vec3> corner(const Vec3& x) const;
  // Whether a face of the cut looks in about this direction, out of what was removed.
  bool faces_towards(const Vec3& direction) const;

 private:
  struct Wedge {  // faces that explain the cell's samples
    std::vector<CreaseFace> faces;
    bool convex;
    double misfit;
    double misfit_of(const std::vector<SamplePlane>& planes) const;
    std::size_t face_at(const Vec3& x) const;  // on which of them is a point of the surface
    bool is_before(const Vec3& x, std::size_t face, double slack) const;
    Vec3 middle(const Vec3& x) const;  // direction between the faces' normals
  };
  std::optional<EdgeAtCrease> edge(const Wedge& wedge, const Vec3& u, const Vec3& v,
                                   const CreaseFace* tooth) const;
  std::unique_ptr<CutSamples> samples_;
  std::array<std::vector<SamplePlane>, 2>
      planes_;  // of samples outside what was removed, and within
  std::vector<Wedge> wedges_;
  std::vector<Vec3> normals_;  // unit, of all faces of the cut that are near
};

}  // namespace toothprep
