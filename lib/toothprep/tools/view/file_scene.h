// What files hold, for the page: teeth and meshes, the tooth of a recording at every moment.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/view/page_server.h"
#include "toothprep/tools/view/rerun.h"

namespace toothprep {

struct ViewLayer {  // a surface: as it is, or that of a tooth
  std::string name;
  std::unique_ptr<LayeredTooth> tooth;  // that a section shows the inside of; or null
  TriangleMesh mesh;                    // no triangles: the tooth's surface
  std::vector<float> deviation;         // mm, of the mesh per vertex, NaN: not known; or empty
};

// Layers are shown one at a time, the last one first. With a recording the last one is the tooth on
// which it was made; `other`, or null, is laid over it. `version` is the program's. Throws Error if there is nothing to be seen.
[[nodiscard]] std::unique_ptr<PageSource> file_scene(std::vector<ViewLayer> layers,
                                                     std::unique_ptr<Recording> recording,
                                                     std::unique_ptr<Recording> other,
                                                     const std::string& version);

}  // namespace toothprep
