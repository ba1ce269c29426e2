#include "toothprep/tools/recordings/import_recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/recordings/device_log.h"
#include "toothprep/tools/recordings/raw_motion.h"
#include "toothprep/tools/trajectory/smoothing.h"

namespace toothprep {
namespace {

constexpr double kGap = 0.1;            // s, as resample() has it
constexpr double kLeastProminence = 3;  // of the correlation's peak over its median
constexpr double kMostClockStd = 0.05;  // s

bool is_hdf5(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  return extension == ".h5" || extension == ".hdf5";
}

void add_notes(const RecordedTable& table, const ColumnRoles& roles, ImportedRecording& report) {
  report.notes.insert(report.notes.end(), table.notes.begin(), table.notes.end());
  report.notes.insert(report.notes.end(), roles.notes.begin(), roles.notes.end());
}

// The columns that nothing was made of.
void note_unused(const RecordedTable& table, ImportedRecording& report) {
  std::string names;
  for (const std::string& name : table.names) {
    const bool used = std::any_of(report.columns.begin(), report.columns.end(),
                                  [&](const ColumnUse& use) { return use.column == name; });
    if (!used) names += (names.empty() ? "" : ", ") + name;
  }
  if (!names.empty()) report.notes.push_back("columns not used: " + names);
}

RawMotion from_table(const RecordedTable& table, const ImportSettings& s, const std::string& path,
                     ImportedRecording& report) {
  ColumnRoles roles = s.columns.empty() ? recognise_columns(table, path) : ColumnRoles();
  if (!s.columns.empty()) {
    try {
      roles = recognise_columns(table, path);
    } catch (const InputError&) {  // what is ambiguous is named by the user
      roles = {};
    }
    set_columns(s.columns, table, roles);
  }
  report.kind = table.kind;
  add_notes(table, roles, report);
  RawMotion motion = raw_motion(table, roles, s, path, report);
  note_unused(table, report);
  return motion;
}

// Poses relative to a moving body: x = A^-1 D, with A interpolated at the times of D.
void make_relative(RawMotion& motion, const RawMotion& body, double offset) {
  std::size_t j = 0;
  std::vector<char> keep(motion.size(), 0);
  for (std::size_t i = 0; i < motion.size(); ++i) {
    const double t = motion.time[i] + offset;
    while (j + 2 < body.size() && body.time[j + 1] <= t) ++j;
    const double part = (t - body.time[j]) / (body.time[j + 1] - body.time[j]);
    if (part < -10 || part > 10) continue;  // it stands still as a rule
    const double p = std::clamp(part, 0.0, 1.0);
    const Pose a{(1 - p) * body.position[j] + p * body.position[j + 1],
                 body.orientation[j].slerp(p, body.orientation[j + 1])};
    motion.position[i] = a.to_local(motion.position[i]);
    motion.orientation[i] = (a.orientation.conjugate() * motion.orientation[i]).normalized();
    if (!motion.force.empty()) motion.force[i] = a.orientation.conjugate() * motion.force[i];
    keep[i] = 1;
  }
  motion.select(keep);
}

RawMotion from_simulator(const std::string& path, const ImportSettings& s,
                         ImportedRecording& report) {
  const SimulatorRecording recording = read_simulator_hdf5(path);
  RawMotion motion = from_table(recording.motion, s, path, report);
  ImportedRecording aside;
  ImportSettings plain;
  if (recording.force) {
    const RawForce force =
        raw_force(*recording.force, recognise_columns(*recording.force, path), s, path, aside);
    attach_force(motion, force, report.first_time_s, report);
    report.notes.push_back("force: the wrench of the haptic device, by the same clock");
  }
  if (recording.anatomy && !s.in_world) {
    const RawMotion anatomy = raw_motion(
        *recording.anatomy, recognise_columns(*recording.anatomy, path), plain, path, aside);
    make_relative(motion, anatomy, report.first_time_s - aside.first_time_s);
    report.notes.push_back("poses relative to the anatomy (--in-world leaves them)");
  }
  return motion;
}

RawMotion from_own(const std::string& path, ImportedRecording& report) {
  const Trajectory trajectory = without_rejected(read_h5_trajectory(path));
  RawMotion motion;
  report.kind = "HDF5 with /time and /handle/position";
  report.first_time_s = trajectory.samples.front().time;
  report.figures.rows = trajectory.samples.size();
  for (const HandleSample& sample : trajectory.samples) {
    motion.time.push_back(sample.time - report.first_time_s);
    motion.position.push_back(sample.pose.position);
    motion.orientation.push_back(sample.pose.orientation);
    motion.buttons.push_back(sample.buttons);
  }
  motion.force = trajectory.measured_force;
  return motion;
}

void add_force_file(RawMotion& motion, const ImportSettings& s, ImportedRecording& report) {
  const RecordedTable table = read_text_table(s.force_file);
  ImportSettings plain = s;
  plain.rate_hz.reset();
  const RawForce force =
      raw_force(table, recognise_columns(table, s.force_file), plain, s.force_file, report);
  ClockOffset offset;
  if (s.force_delay_s) {
    offset.delay = *s.force_delay_s + report.first_time_s;
  } else {
    offset = clock_offset(motion, force);
    if (!(offset.prominence > kLeastProminence) || !(offset.std < kMostClockStd))
      throw InputError(
          s.force_file, "force",
          fmt::format("can't be laid beside the motion: the correlation's peak is {:.2g} "
                      "times its median, its place known to {:.2g} s",
                      offset.prominence, offset.std),
          "give the delay of its clock with --force-delay-ms");
    report.figures.force_delay_std_s = offset.std;
    report.notes.push_back(
        fmt::format("force's clock: {:.4f} +- {:.4f} s behind the motion's, by "
                    "cross-correlation with the velocity",
                    offset.delay - report.first_time_s, offset.std));
  }
  report.figures.force_delay_s = offset.delay - report.first_time_s;
  attach_force(motion, force, offset.delay, report);
}

// Gaps in the force of single rows: linear from neighbour to neighbour.
void fill_forces(RawMotion& motion, ImportedRecording& report) {
  std::size_t filled = 0, last = motion.size();
  for (std::size_t i = 0; i < motion.force.size(); ++i) {
    if (!motion.force[i].allFinite()) continue;
    const std::size_t first = last < i ? last + 1 : (last == motion.size() ? 0 : i);
    for (std::size_t j = first; j < i; ++j, ++filled) {
      const double part =
          last < i ? (motion.time[j] - motion.time[last]) / (motion.time[i] - motion.time[last])
                   : 1;
      motion.force[j] = last < i ? Vec3((1 - part) * motion.force[last] + part * motion.force[i])
                                 : motion.force[i];
    }
    last = i;
  }
  if (motion.force.empty()) return;
  if (last == motion.size()) {
    motion.force.clear();
    report.warnings.push_back("the columns of the force hold no number");
    return;
  }
  for (std::size_t j = last + 1; j < motion.size(); ++j, ++filled)
    motion.force[j] = motion.force[last];
  if (filled > 0)
    report.warnings.push_back(
        fmt::format("{} samples have no force, which is interpolated", filled));
}

// Bur and frame: x_W = t + R (x + q b).
void place(RawMotion& motion, const ImportSettings& s) {
  for (std::size_t i = 0; i < motion.size(); ++i) {
    Pose pose{motion.position[i],
              motion.orientation.empty() ? Quat::Identity() : motion.orientation[i]};
    pose = {pose.to_world(s.tracked_to_bur.position),
            pose.orientation * s.tracked_to_bur.orientation};
    motion.position[i] = s.to_world.to_world(pose.position);
    if (!motion.orientation.empty() || s.tracked_to_bur.orientation.w() != 1 ||
        s.to_world.orientation.w() != 1) {
      if (motion.orientation.empty()) motion.orientation.assign(motion.size(), Quat::Identity());
      motion.orientation[i] = (s.to_world.orientation * pose.orientation).normalized();
    }
    if (!motion.force.empty()) motion.force[i] = s.to_world.orientation * motion.force[i];
  }
}

// Whole numbers of bits; a recording's true or false is the pedal.
std::uint32_t buttons_of(const RawMotion& motion, std::size_t i, const std::string& path) {
  if (motion.buttons.empty()) return kPedalButton;
  const double b = motion.buttons[i];
  if (std::isnan(b)) return 0;
  if (!(b >= 0 && b <= 4294967295.0 && b == std::floor(b)))
    throw InputError(path, "buttons", fmt::format("{:g} is not a whole number of 0 or more", b),
                     "bit 0: motor on");
  return static_cast<std::uint32_t>(b);
}

// What a rig records beside the motion, if every sample has a value.
std::vector<double> complete_column(std::vector<double>& values, const char* name,
                                    ImportedRecording& report) {
  if (std::none_of(values.begin(), values.end(), [](double v) { return std::isnan(v); }))
    return std::move(values);
  report.warnings.push_back(std::string("the column of the ") + name +
                            " has empty fields, and is left out");
  return {};
}

void smooth(Trajectory& motion, double window, ImportedRecording& report) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < motion.samples.size(); ++i)
    steps.push_back(motion.samples[i].time - motion.samples[i - 1].time);
  const double step = median(steps);
  const auto [least, most] = std::minmax_element(steps.begin(), steps.end());
  if (*most > 1.5 * step || *least < 0.5 * step)
    throw InputError("--smooth-motion-ms", "", "needs evenly spaced samples",
                     "smooth in calibrate, which spaces them evenly");
  motion.samples = smoothed(motion.samples, window);
  report.notes.push_back(
      fmt::format("motion smoothed by a local quadratic over {:g} ms", window * 1e3));
}

void measure(const Trajectory& motion, ImportFigures& f) {
  f.samples = motion.samples.size();
  f.duration_s = motion.samples.back().time - motion.samples.front().time;
  f.low = f.high = motion.samples.front().pose.position;
  std::vector<double> steps, speeds;
  for (std::size_t i = 1; i < motion.samples.size(); ++i) {
    const HandleSample &a = motion.samples[i - 1], &b = motion.samples[i];
    const double dt = b.time - a.time, way = (b.pose.position - a.pose.position).norm();
    steps.push_back(dt);
    f.largest_gap_s = std::max(f.largest_gap_s, dt);
    f.gaps += dt > kGap;
    f.path_mm += way;
    f.largest_speed_mm_s = std::max(f.largest_speed_mm_s, way / dt);
    if (way > 0) speeds.push_back(way / dt);
    f.low = f.low.cwiseMin(b.pose.position);
    f.high = f.high.cwiseMax(b.pose.position);
  }
  f.rate_hz = 1 / median(std::move(steps));
  if (!speeds.empty()) f.median_speed_mm_s = median(std::move(speeds));
  for (const Vec3& force : motion.measured_force)
    f.largest_force_n = std::max(f.largest_force_n.value_or(0), force.norm());
}

void note_figures(const ImportFigures& f, ImportedRecording& report) {
  if (f.missing > 0)
    report.warnings.push_back(
        fmt::format("{} of {} rows have no pose, and are left out", f.missing, f.rows));
  if (f.repeated_times > 0)
    report.warnings.push_back(
        fmt::format("{} rows repeat the time before them, and are left out", f.repeated_times));
  if (f.gaps > 0)
    report.warnings.push_back(
        fmt::format("{} gaps above 0.1 s, the largest {:.3g} s: replay needs --allow-gaps "
                    "and goes straight through them",
                    f.gaps, f.largest_gap_s));
}

}  // namespace

ImportedRecording import_recording(const std::string& path, const ImportSettings& settings) {
  ImportedRecording r;
  RawMotion motion;
  if (!is_hdf5(path)) {
    motion = from_table(
        is_binary_device_log(path) ? read_binary_device_log(path) : read_text_table(path), settings,
        path, r);
  } else if (holds_trajectory(path)) {
    motion = from_own(path, r);
  } else {
    motion = from_simulator(path, settings, r);
  }
  if (!settings.force_file.empty()) add_force_file(motion, settings, r);
  fill_forces(motion, r);
  clean(motion, settings, r);
  place(motion, settings);
  if (motion.size() < 2)
    throw InputError(path, "", "fewer than two samples are left", "record a motion");

  for (std::size_t i = 0; i < motion.size(); ++i) {
    HandleSample sample;
    sample.time = motion.time[i];
    sample.pose.position = motion.position[i];
    if (!motion.orientation.empty()) sample.pose.orientation = motion.orientation[i];
    sample.buttons = buttons_of(motion, i, path);
    r.motion.samples.push_back(sample);
  }
  r.motion.measured_force = std::move(motion.force);
  if (settings.smooth_s > 0) smooth(r.motion, settings.smooth_s, r);
  r.rotation_rate = complete_column(motion.rotation_rate, "rotation rate", r);
  r.torque = complete_column(motion.torque, "torque", r);
  r.stalled = complete_column(motion.stalled, "stall", r);
  measure(r.motion, r.figures);
  note_figures(r.figures, r);
  return r;
}

}  // namespace toothprep
