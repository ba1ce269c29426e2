// What the page gets first, as JSON: what there is to show.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/session_event.h"
#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/render/view.h"
#include "toothprep/tools/view/tissue_volume.h"

namespace toothprep {

enum class SceneKind { kSurfaces, kReplay, kLive };

struct SceneFacts {
  SceneKind kind = SceneKind::kSurfaces;
  std::string version;              // of the program
  std::vector<std::string> layers;  // names; the last one is seen, the one before it is "before"
  Box bounds;                       // of all layers
  std::map<std::string, std::string> provenance;  // of the tooth, for its axes
  std::optional<ToothAxes> axes;                  // in place of the provenance's
  const Bur* bur = nullptr;                       // with a session
  const Parameters* parameters = nullptr;
  std::size_t rows = 0;                  // of the recording as the page gets it
  std::size_t other_rows = 0;            // of one that is laid over it; 0: there is none
  std::size_t stride = 1;                // steps from one of them to the next
  bool session = false;                  // flags and faults of a device are known
  const TissueVolume* volume = nullptr;  // for sections
  std::vector<const Bur*> burs;          // that the session could change to; the first is `bur`
  std::vector<SessionEvent> events;      // of a recording
  bool mirror = false;                   // rows have a second device's pose
  bool deviation = false;                // of the last layer is known per vertex
  bool control = false;                  // the page may do something to the session
};

[[nodiscard]] std::string scene_json(const SceneFacts& facts);

}  // namespace toothprep
