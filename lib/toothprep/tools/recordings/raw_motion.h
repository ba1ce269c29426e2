// A recording's rows on their way to a trajectory, in seconds, millimetres, newtons.
#pragma once

#include <cstddef>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/recordings/column_roles.h"
#include "toothprep/tools/recordings/import_recording.h"

namespace toothprep {

struct RawMotion {
  std::vector<double> time;
  std::vector<Vec3> position;
  std::vector<Quat> orientation;                                // empty: not recorded
  std::vector<Vec3> force;                                      // empty: not in this file
  std::vector<double> buttons, rotation_rate, torque, stalled;  // empty, or a value per row

  std::size_t size() const { return time.size(); }
  // Keeps the rows for which keep[i] is not 0.
  void select(const std::vector<char>& keep);
};

// Units of the recording, found or asked for; each says in `report` what it took.
double second_per_unit(const RecordedTable& table, const ColumnRoles& roles,
                       const std::string& path, ImportedRecording& report);
double mm_per_unit(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                   const std::string& path, ImportedRecording& report);
double newton_per_unit(const RecordedTable& table, const ColumnRoles& roles,
                       const ImportSettings& s, const std::string& path, ImportedRecording& report);

// The table's rows, without those that lack a time, a position or an orientation.
RawMotion raw_motion(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                     const std::string& path, ImportedRecording& report);

// A force by itself: times and forces only.
struct RawForce {
  std::vector<double> time;
  std::vector<Vec3> force;
};
RawForce raw_force(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                   const std::string& path, ImportedRecording& report);

// Repeated poses of a tracker that is slower than the log, positions that jump away and back, and
// the step to which positions are rounded: counted in report.figures, and mended as `s` says.
void clean(RawMotion& motion, const ImportSettings& s, ImportedRecording& report);

// How far the clock of `force` is behind that of `motion`, by the cross-correlation of velocity and
// force, of both what changes within 0.3 s: the lag at which the 3 x 3 matrix of their products has the largest norm, whatever the
// sensor's frame is. Standard deviation by leaving out an eighth of the recording in turn, and by
// the samples' spacing.
struct ClockOffset {
  double delay = 0, std = 0;  // s
  double prominence = 0;      // the peak over the median of all lags
};
ClockOffset clock_offset(const RawMotion& motion, const RawForce& force);

// Forces at the motion's times: means over a sample's time where the force is denser, else linear.
// Rows of the motion beyond the force's times are left out.
void attach_force(RawMotion& motion, const RawForce& force, double delay,
                  ImportedRecording& report);

}  // namespace toothprep
