#include "fuzz_target.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/render/ply_values.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

// What is read can be judged and repaired; what a .ply says about its vertices fits them.
void read_judge_and_repair(const std::string& path) {
  Shell shell = read_shell(path);
  TriangleMesh mesh;
  for (const Vec3& point : shell.points) mesh.vertices.push_back(point.cast<float>());
  const auto tissue = vertex_property(path, mesh, "tissue");
  fuzz::require(!tissue || tissue->size() == shell.points.size());
  if (shell.triangles.size() > 64) return;  // CGAL takes its time
  static_cast<void>(shell_faults(shell));
  static_cast<void>(repair_shell(shell));
  static_cast<void>(shell_faults(shell));
}

const fuzz::Registered k_shells({"shells",
                                 {"shell.stl", "shell.ply", "shell.obj", "shell.off"},
                                 read_judge_and_repair});

}  // namespace
}  // namespace toothprep
