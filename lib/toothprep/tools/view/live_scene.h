// A session that runs, for the page: its newest tick and the tooth's surface as it is now.
//
//   servo thread      take() ──newest──▶ feeds, 60 Hz at most   (no lock, no wait, no allocation)
//   display's worker  blocks  ─────────▶ feeds, 30 Hz at most
//   session control   ◀── commands of a page ── feeds ──▶ its state
//
// A page says, as JSON: {"do": "pause"}, "resume", "undo", "end"; {"do": "bur", "bur": 3} (place in
// the list); {"do": "move", "shift_mm": [x, y, z], "turn_deg": a}: the handle against the hand, in W,
// turned about the tooth's occlusal direction. It is answered by the state of the session's control,
// or by why not.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/live/session_control.h"
#include "toothprep/tools/view/page_server.h"

namespace toothprep {

class LiveScene final : public PageSource {
 public:
  // Keeps references to bur, tooth and parameters. `name` is the tooth's, `version` the program's.
  // With `control` the page may do something to the session; `burs`: that it can change to.
  LiveScene(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
            const std::string& name, const std::string& version, SessionControl* control = nullptr,
            const std::vector<const Bur*>& burs = {});
  ~LiveScene() override;

  void begin(const DisplaySurface& display);  // there is a surface, until end() has returned
  void take(const LiveTick& tick) noexcept;   // the servo's thread: every tick
  void end() noexcept;

  std::optional<PageAnswer> get(std::string_view path, std::string_view query) override;
  std::unique_ptr<PageFeed> feed() override;

 private:
  struct Work;
  class Feed;
  std::unique_ptr<Work> work_;
};

}  // namespace toothprep
