// The CSV table of a recording: that of a trajectory and what else a rig records.
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/calibrate/recording.h"

namespace toothprep {

MeasuredRecording read_recording_csv(const std::string& path) {
  std::map<std::string, std::vector<double>> further;
  MeasuredRecording r;
  r.motion = read_csv_trajectory(path, {"rotation_rate_rev_s", "torque_mNm", "stalled"}, further);
  r.rotation_rate = std::move(further["rotation_rate_rev_s"]);
  r.torque = std::move(further["torque_mNm"]);  // mN·m = N·mm
  for (const double stalled : further["stalled"]) {
    if (stalled != 0 && stalled != 1)
      throw InputError(path, "line " + std::to_string(r.stalled.size() + 2) + ", column stalled",
                       "must be 0 or 1");
    r.stalled.push_back(stalled > 0);
  }
  return r;
}

}  // namespace toothprep
