#include "toothprep/tools/live_session/start_rule.h"

#include <fmt/format.h>

#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/contact.h"

namespace toothprep {
namespace {

constexpr double kHeadElementSize = 0.2;  // mm

}  // namespace

StartRule::StartRule(const Bur& bur, const Workpiece& workpiece, bool laid,
                     std::function<void(const std::string&)> note)
    : head_(bur.elements(kHeadElementSize)),
      workpiece_(workpiece),
      laid_(laid),
      note_(std::move(note)) {}

bool StartRule::may_start(const Pose& pose) {
  if (area_in_tissue(head_, workpiece_, pose) == 0) return true;
  if (laid_)
    throw Error(
        fmt::format("the start, {:.2f} {:.2f} {:.2f} mm, puts the bur into the tooth; "
                    "give a start that is clear of it (--start-mm)",
                    pose.position.x(), pose.position.y(), pose.position.z()));
  if (!noted_ && note_)
    note_(
        "the bur is in the tooth: move the hand until it is clear; there is no force, and the "
        "session begins then");
  noted_ = true;
  return false;
}

}  // namespace toothprep
