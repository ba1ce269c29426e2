#include "drawn.h"

#include "command.h"
#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep::app {

Drawn read_drawn(const std::string& path, bool strict) {
  Drawn drawn;
  if (has_extension(path, ".vdb")) {
    drawn.tooth = std::make_unique<LayeredTooth>(load_tooth(path, strict));
    drawn.part.mesh = sharpest_surface(*drawn.tooth);
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
  if (const auto tissue = vertex_property(path, mesh, "tissue"))
    for (const float label : *tissue)
      mesh.tissue.push_back(label >= 0 && label <= kTissueCount ? static_cast<std::uint8_t>(label)
                                                                : 0);
  return drawn;
}

}  // namespace toothprep::app
