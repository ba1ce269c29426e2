// Greys along the normals of a surface (the tooth's, metal's), averaged along the surface, and what they
// say about the scan: how wide its blur is.
//
// Lengths are in voxels of the box unless said; x along a normal grows inwards and is zero where the
// grey passes a border.
#pragma once

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/near_distance.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {

// A field whose gradient points inwards, from the depth below the surface at voxel accuracy; for voxels
// up to `outside` and `inside` from it. `blur` is the scan's voxel; the depth is known by twice that
// beyond both.
BandField inward_level(const WorkBox& box, const SurfaceDepth& depth, double outside, double inside,
                       double blur);
// Its unit gradient; zero where it has none.
Vec3 inwards_at(const WorkBox& box, const BandField& level, const Index3& index);

struct SurfaceProfiles {
  double step = 0;  // between samples
  int before = 0;   // samples outside x = 0
  int samples = 0;  // of each profile
  // Per place, a voxel that the surface just holds:
  std::vector<Index3> voxel;  // in the order of the box's voxels
  std::vector<Vec3> inwards;
  std::vector<double> zero;  // of x: this far inwards of the voxel's centre
  std::vector<float> grey;   // samples values each
  // The number of places up to the end of each of the box's rows along x.
  Index3 size = Index3::Zero();  // of the box
  std::vector<std::uint32_t> row_end;

  std::size_t count() const { return voxel.size(); }
  // The first place in a row and the one after its last; the row may lie outside the box.
  std::pair<std::size_t, std::size_t> row(int y, int z) const {
    if (y < 0 || z < 0 || y >= size.y() || z >= size.z()) return {0, 0};
    const std::size_t r = static_cast<std::size_t>(z) * static_cast<std::size_t>(size.y()) +
                          static_cast<std::size_t>(y);
    return {r == 0 ? 0 : row_end[r - 1], row_end[r]};
  }
  // work(place) at a voxel and its 26 neighbours, which may lie outside the box.
  template <class Work>
  void for_each_around(const Index3& at, const Work& work) const {
    for (int z = at.z() - 1; z <= at.z() + 1; ++z)
      for (int y = at.y() - 1; y <= at.y() + 1; ++y) {
        const auto [first, end] = row(y, z);
        auto p = static_cast<std::size_t>(
            std::partition_point(voxel.begin() + static_cast<std::ptrdiff_t>(first),
                                 voxel.begin() + static_cast<std::ptrdiff_t>(end),
                                 [&](const Index3& v) { return v.x() < at.x() - 1; }) -
            voxel.begin());
        for (; p < end && voxel[p].x() <= at.x() + 1; ++p) work(p);
      }
  }
  const float* of(std::size_t p) const {
    return grey.data() + p * static_cast<std::size_t>(samples);
  }
  double x(int sample) const { return (sample - before) * step; }
  // The mean grey over x in from .. to.
  double mean(std::size_t p, double from, double to) const;
  // Where it first exceeds a grey.
  std::optional<double> first_above(std::size_t p, double border) const;
};

// The profiles of the scan from 3 `blur` outside to 5 inside, averaged over 1.5 `blur` along the
// surface; where they start is found in `grey`, the scan on the box's lattice. Between the scan's
// voxels greys are cubic (R. Keys, Cubic convolution interpolation, 1981): linear ones would cut the
// peak of a layer as thin as a voxel by a share that depends on where the voxels' centres lie.
SurfaceProfiles surface_profiles(const WorkBox& box, const ImageVolume<float>& scan,
                                 const TrimmedField& grey, const SurfaceDepth& depth,
                                 const BandField& level, double border, double blur);

// Standard deviation of the scan's blur across the surface (a Gaussian, as all that widens an edge
// here: scanner, voxels, resampling): the median over places with one tissue below the surface, from
// the way between a quarter and three quarters of the step (1.349 sigma). Nothing of fewer than 50
// such places.
std::optional<double> edge_sigma(const SurfaceProfiles& profiles, const GreyClasses& classes,
                                 double blur);

}  // namespace toothprep
