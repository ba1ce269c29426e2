// Floors of a preparation: how deep, how flat, how tilted.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/mesh/triangle_tree.h"
#include "toothprep/tools/preparation/cut_facets.h"
#include "toothprep/tools/preparation/preparation.h"

namespace toothprep {

// height = level + slope · (along_u - centre.x, along_v - centre.y), fitted by least squares over
// area.
struct FloorPlane {
  Vec2 centre = Vec2::Zero();  // of the area, mm
  double level = 0;            // height of the plane there, mm
  Vec2 slope = Vec2::Zero();   // 1

  double height_at(double along_u, double along_v) const {
    return level + slope.dot(Vec2(along_u, along_v) - centre);
  }
  double tilt_deg() const;                           // between the plane's normal and d
  Vec3 normal(const PreparationFrame& frame) const;  // unit, W, upward
};

struct Floor {
  std::vector<std::uint32_t> facets, core;  // all; those away from line angles and the rim
  double area = 0;                          // mm², of all
  FloorPlane plane;                         // of the core
  double flatness = 0;                      // RMS distance of the core from its plane, mm
};

// Connected pieces of facets whose normals are within 45° of d, of at least `smallest` mm², the
// largest first.
std::vector<Floor> find_floors(const CutFacets& facets, const PreparationFrame& frame,
                               double smallest);

// The area-weighted distribution of a length: q in 0..1.
class Weighted {
 public:
  void add(double value, double weight) { values_.push_back({value, weight}); }
  bool empty() const { return values_.empty(); }
  double quantile(double q) const;  // NaN if empty
  double mean() const;
  double weight() const;  // in all

 private:
  std::vector<WeightedValue> values_;
};

// Distances from facets along d to the original surface, mm.
Weighted depths_below(const std::vector<std::uint32_t>& of_floor, const CutFacets& facets,
                      const PreparationFrame& frame, const TriangleTree& original);

}  // namespace toothprep
