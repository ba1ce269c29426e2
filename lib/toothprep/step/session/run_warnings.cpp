#include "toothprep/step/session/run_warnings.h"

#include <fmt/format.h>

#include <numeric>

namespace toothprep {

std::vector<std::string> run_warnings(const SessionTotals& totals, Drive drive) {
  std::vector<std::string> warnings;
  if (drive == Drive::kDirect && totals.stalled_steps > 0)
    warnings.push_back(
        fmt::format("direct drive needed more than the stall torque in {} steps: nothing was "
                    "removed there, force and torque are scaled to the limit",
                    totals.stalled_steps));
  if (totals.split_steps_cut_short > 0)
    warnings.push_back(fmt::format(
        "the bur was so fast in {} steps that they went in fewer parts than a third of a voxel "
        "each: work and removal may disagree there; move the handle more slowly",
        totals.split_steps_cut_short));
  if (totals.shank_contact_steps > 0)
    warnings.push_back(
        fmt::format("the shank touched the tooth in {} steps; it neither grinds nor removes",
                    totals.shank_contact_steps));
  const double overlap =
      std::accumulate(totals.initial_overlap.begin(), totals.initial_overlap.end(), 0.0);
  if (overlap > 0)
    warnings.push_back(fmt::format(
        "{:.3f} mm^3 of tissue lay inside the bur at the first sample and were removed first",
        overlap));
  return warnings;
}

}  // namespace toothprep
