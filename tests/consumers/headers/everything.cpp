// A function of each component, so that its libraries and what they need are linked. Never run.
#include <toothprep/proof/specimen/block.h>
#include <toothprep/step/session/replay.h>
#include <toothprep/tools/calibrate/calibration.h>
#include <toothprep/tools/files/tooth_file.h>
#include <toothprep/tools/live_session/live_session.h>
#include <toothprep/tools/mesh/surface.h>
#include <toothprep/tools/render/renderer.h>
#include <toothprep/tools/score/assess.h>
#include <toothprep/tools/segmentation/voxelize_file.h>
#include <toothprep/tools/shells/shells.h>

#include <cstdio>

template <class... F>
void use(F... functions) {
  (std::printf("%d", functions != nullptr), ...);
}

int main() {
  using namespace toothprep;
  use(&make_block, &replay, &calibrate, &read_tooth, &run_live_session, &extract_surface, &assess,
      &voxelize_file, &voxelize_shells);
  Renderer renderer({});
}
