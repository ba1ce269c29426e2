// The occlusal surface as heights over a plane, and what a cavity follows on it.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "toothprep/tools/placement/tooth_grid.h"

namespace toothprep {

using Vec2 = Eigen::Vector2d;  // x, y of the tooth's frame, mm

// Heights (z of the grid's frame, mm) of the tooth's surface and of the border of enamel and dentin
// over each column; -infinity where there is none.
struct CrownMap {
  double x0 = 0, y0 = 0, step = 0;      // mm: middle of the first column, distance of columns
  int nx = 0, ny = 0;                   // columns
  std::vector<double> surface, dentin;  // at(x, y)

  // The index of a column.
  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y) * nx + x; }
  // The middle of a column, mm.
  Vec2 place(int x, int y) const { return {x0 + step * x, y0 + step * y}; }
  // Between the middles of four columns; -infinity where one of them has none.
  [[nodiscard]] double height(const std::vector<double>& map, const Vec2& p) const;
  [[nodiscard]] double height(const Vec2& p) const { return height(surface, p); }
};
// Seen along z.
[[nodiscard]] CrownMap crown_map(const ToothGrid& grid);

// The mean over a Gaussian of sigma mm, where there is a height.
[[nodiscard]] std::vector<double> smoothed(const CrownMap& map, const std::vector<double>& heights,
                                           double sigma);

// Per column the distance to the tooth's outer outline in the plane z, mm; 0 outside of it.
[[nodiscard]] std::vector<double> distance_to_outline(const ToothGrid& grid, const CrownMap& map,
                                                      double z);

// The main fissure: the lowest way from the mesial to the distal side through the central fossa.
struct Fissure {
  std::vector<Vec2> points;        // about 0.1 mm apart, smooth, from -direction to +direction
  Vec2 direction = Vec2::UnitX();  // unit
  double fossa = 0;                // mm, height of its lowest place
  double relief = 0;               // mm, of the cusps over that
};
struct FissureSearch {         // what is known of it
  std::optional<Vec2> middle;  // the central fossa; else the lowest place in the middle third
  std::optional<Vec2> along;   // mesial or distal, to 30°; else the direction in which it runs on
                               // lowest
  double from_outline = 2.3;   // mm: its ends keep so far from the outline
  double longest = 5;          // mm
};
// Throws Error where no direction is clear, or it would be shorter than 1.5 mm.
[[nodiscard]] Fissure find_fissure(const ToothGrid& grid, const CrownMap& map,
                                   const FissureSearch& search);

[[nodiscard]] double length_of(const std::vector<Vec2>& line);  // mm

// Moved sideways by `offset` mm (positive: to the left of the direction of travel).
[[nodiscard]] std::vector<Vec2> shifted(const std::vector<Vec2>& line, double offset);

}  // namespace toothprep
