#include "toothprep/tools/compare/deviation_file.h"

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/diverging_colour.h"

namespace toothprep {
namespace {

constexpr Rgb kOutside = {168, 168, 168};

}  // namespace

Rgb deviation_colour(double deviation_mm, double limit_mm) {
  if (std::isnan(deviation_mm)) return kOutside;
  const std::array<float, 3> srgb = diverging_srgb(static_cast<float>(deviation_mm / limit_mm));
  Rgb colour;
  for (std::size_t k = 0; k < 3; ++k) colour[k] = static_cast<std::uint8_t>(std::lround(srgb[k]));
  return colour;
}

void write_deviation(const TriangleMesh& prepared, const std::vector<float>& deviation_mm,
                     const std::string& path, double limit_mm) {
  const auto ends_in = [&](const char* extension) {
    return path.size() > 4 && path.compare(path.size() - 4, 4, extension) == 0;
  };
  const bool ply = ends_in(".ply");
  if (!ply && !ends_in(".vtk")) throw Error(path + ": a deviation map is written as .ply or .vtk");
  VertexAttributes attributes;
  attributes.scalars.push_back({"deviation_mm", deviation_mm});
  if (ply) {
    attributes.scalars.push_back({"quality", deviation_mm});
    for (float& value : attributes.scalars.back().values)
      if (std::isnan(value)) value = 0;
    attributes.colours.reserve(deviation_mm.size());
    for (const float d : deviation_mm) attributes.colours.push_back(deviation_colour(d, limit_mm));
  }
  write_mesh(prepared, path, attributes);
}

}  // namespace toothprep
