#include "drawn.h"

#include <optional>

#include "command.h"
#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/tissue_division.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep::app {

Drawn read_drawn(const std::string& path, bool strict) {
  Drawn drawn;
  if (has_extension(path, ".vdb")) {
    drawn.tooth = std::make_unique<LayeredTooth>(load_tooth(path, strict));
    drawn.part.mesh = surface_by_tissue(*drawn.tooth).mesh;
    if (drawn.part.mesh.triangles.empty())
      throw InputError(path, "grid 'solid'", "nothing remains, so there is nothing to draw");
    drawn.part.tooth = drawn.tooth.get();
    return drawn;
  }
  const Shell shell = read_shell(path);
  TriangleMesh& mesh = drawn.part.mesh;
  mesh.vertices.reserve(shell.points.size());
  for (const Vec3& x : shell.points) mesh.vertices.push_back(x.cast<float>());
  mesh.triangles = shell.triangles;
  const auto labels_of = [](const std::optional<std::vector<float>>& values) {
    std::vector<std::uint8_t> labels;
    if (values)
      for (const float label : *values)
        labels.push_back(label >= 0 && label <= kTissueCount ? static_cast<std::uint8_t>(label)
                                                             : 0);
    return labels;
  };
  mesh.tissue = labels_of(vertex_property(path, mesh, "tissue"));
  mesh.triangle_tissue = labels_of(triangle_property(path, shell.face, "tissue"));
  return drawn;
}

}  // namespace toothprep::app
