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
// give the planes; in any case they have to explain the samples about the edge.
//
// Lengths in voxels, positions in voxel indices.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// A face of a cut near one cell: z = h(x, y), of second order, in a frame of its own.
struct CreaseFace {
  Vec3 origin;                        // near the cell
  std::array<Vec3, 3> axis;           // the third out of what was removed
  Eigen::Matrix<double, 6, 1> terms;  // of 1, x, y, x²/2, xy, y²/2

  double level(const Vec3& at) const;   // along the third axis from the face, positive outside
  Vec3 gradient(const Vec3& at) const;  // of the level
};

struct Crease {
  Vec3 at;                        // a point of the edge, or the corner
  Vec3 within;                    // the same, or the nearest point within the cell
  Vec3 into;                      // a unit vector, from there between the faces
  bool convex;                    // as an edge of what was removed
  std::vector<CreaseFace> faces;  // two or three
  std::vector<Vec3> normals;      // unit, of all faces of the cut that are near

  // Where the faces cross the lattice's edge from a voxel to the next along an axis, 0 to 1, or
  // nothing if they don't.
  std::optional<double> crossing(const Index3& from, int axis) const;
};

class CutSamples;
struct SamplePlane {  // of the cut, by one sample near it
  Vec3 normal, foot;  // unit, out of what was removed; the nearest point of the surface
  double weight;
};

// Finds the creases of the surface that passes through one cell, which reaches from a voxel to the
// next along each axis.
class CreaseFinder {
 public:
  CreaseFinder(const LevelSet& cut, double voxel, const Index3& cell);  // voxel in mm
  ~CreaseFinder();
  bool has_faces() const { return !wedges_.empty(); }  // two or more
  // The part of a crease that lies in the cell itself or in a neighbour.
  std::optional<Crease> in(const Index3& cell) const;
  // The point of a crease that is nearest to x, which isn't far from it.
  std::optional<Crease> near(const Vec3& x) const;

 private:
  struct Wedge {  // faces that explain the cell's samples
    std::vector<CreaseFace> faces;
    bool convex;
  };
  Crease crease_at(const Vec3& at, const std::vector<CreaseFace>& faces, bool convex) const;
  Index3 cell_;
  std::unique_ptr<CutSamples> samples_;
  std::array<std::vector<SamplePlane>, 2>
      planes_;  // of samples outside what was removed, and within
  std::vector<Wedge> wedges_;
  std::vector<Vec3> normals_;
};

}  // namespace toothprep
