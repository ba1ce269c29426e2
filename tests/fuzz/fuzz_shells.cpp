#include "fuzz_target.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/shells/closing.h"

namespace toothprep {
namespace {

// What is read can be judged and closed, or is refused; what a .ply says about its vertices fits them.
void read_judge_and_close(const std::string& path) {
  Shell shell = read_shell(path);
  TriangleMesh mesh;
  for (const Vec3& point : shell.points) mesh.vertices.push_back(point.cast<float>());
  const auto tissue = vertex_property(path, mesh, "tissue");
  fuzz::require(!tissue || tissue->size() == shell.points.size());
  if (shell.triangles.size() > 64) return;  // CGAL takes its time
  static_cast<void>(shell_faults(shell));
  static_cast<void>(survey_shell(shell));
  fuzz::require(shell_faults(close_shell(shell).shell).empty());
}

const fuzz::Registered k_shells({"shells",
                                 {"shell.stl", "shell.ply", "shell.obj", "shell.off"},
                                 read_judge_and_close});

}  // namespace
}  // namespace toothprep
