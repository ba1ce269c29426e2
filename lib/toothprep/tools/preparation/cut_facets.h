// The cut surface as facets with their neighbours: what floors and walls are distinguished on.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

struct Facet {
  Vec3 centroid = Vec3::Zero();  // mm, W
  Vec3 normal = Vec3::UnitZ();   // unit, out of the solid; the mean over the facets around it
  double area = 0;               // mm²
  std::uint32_t triangle = 0;    // of the mesh
  bool rim = false;              // touches the surface that wasn't cut
  bool crease = false;           // within two facets of a line angle: the normal is of neither side
};

struct FinishSegment {  // a piece of the line where the cut meets the original surface
  Vec3 middle = Vec3::Zero();
  double length = 0;
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  // its ends
};

class CutFacets {
 public:
  // Triangles whose corners are all deeper than `tolerance` in the original. depth: per vertex, mm.
  CutFacets(const TriangleMesh& surface, const std::vector<float>& depth, double tolerance);

  const std::vector<Facet>& all() const { return facets_; }
  const Facet& operator[](std::size_t i) const { return facets_[i]; }
  std::size_t size() const { return facets_.size(); }
  const std::vector<FinishSegment>& finish_line() const { return finish_; }
  // Facets that share a vertex with facet i, itself not among them; in ascending order.
  std::span<const std::uint32_t> around(std::size_t i) const {
    return {neighbours_.data() + first_[i], first_[i + 1] - first_[i]};
  }
  // Index of the facet of a triangle of the mesh, or -1 if it isn't cut.
  std::int32_t facet_of(std::uint32_t triangle) const { return facet_of_[triangle]; }

  // Connected pieces of the facets of which member(i) holds, the largest area first.
  std::vector<std::vector<std::uint32_t>> pieces(
      const std::function<bool(std::size_t)>& member) const;
  double area(const std::vector<std::uint32_t>& piece) const;

 private:
  std::vector<Facet> facets_;
  std::vector<FinishSegment> finish_;
  std::vector<std::uint32_t> first_, neighbours_;
  std::vector<std::int32_t> facet_of_;
};

}  // namespace toothprep
