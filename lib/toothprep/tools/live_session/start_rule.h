// No session, and no interval of one, begins with the bur in tissue: what lies inside it would be
// gone at once.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class StartRule {
 public:
  // `laid`: the bur starts at a place that was given, not where the hand is.
  StartRule(const Bur& bur, const Workpiece& workpiece, bool laid,
            std::function<void(const std::string&)> note);

  // False while the bur lies in tissue at `pose` (W), with a note the first time; Error if it was
  // laid there.
  bool may_start(const Pose& pose);

 private:
  SurfaceElements head_;
  const Workpiece& workpiece_;
  bool laid_, noted_ = false;
  std::function<void(const std::string&)> note_;
};

}  // namespace toothprep
