#include "toothprep/calibrate/recording.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "toothprep/core/errors.h"
#include "toothprep/trace/trace.h"

namespace toothprep {
namespace {

constexpr double kMostNewtons = 25;    // see check_recording()
constexpr double kMostShare = 0.05;    // of the samples above it: more than outliers make
constexpr std::size_t kStuckRun = 8;   // samples in a row at a limit
constexpr double kStuckShare = 0.002;  // of the samples, from which a sensor counts as saturated

std::string number(double x) {
  std::ostringstream text;
  text.precision(4);
  text << x;
  return text.str();
}

// Samples that lie in runs at exactly `limit`.
std::size_t stuck_at(const std::vector<Vec3>& force, int axis, double limit, std::size_t& first) {
  std::size_t stuck = 0, run = 0;
  for (std::size_t i = 0; i <= force.size(); ++i) {
    if (i < force.size() && force[i][axis] == limit) {
      ++run;
      continue;
    }
    if (run >= kStuckRun) {
      if (stuck == 0) first = i - run;
      stuck += run;
    }
    run = 0;
  }
  return stuck;
}

// A value that several samples in a row share bit for bit, and none exceeds, is a limit: noise and
// tissue don't repeat themselves. Zero is where an axis without noise rests.
void check_saturation(const MeasuredRecording& r) {
  const std::vector<Vec3>& force = r.motion.measured_force;
  for (int axis = 0; axis < 3; ++axis) {
    double low = force[0][axis], high = low;
    for (const Vec3& f : force) low = std::min(low, f[axis]), high = std::max(high, f[axis]);
    if (high == low) continue;
    for (const double limit : {low, high}) {
      std::size_t first = 0;
      if (limit == 0) continue;
      const std::size_t stuck = stuck_at(force, axis, limit, first);
      if (static_cast<double>(stuck) < kStuckShare * static_cast<double>(force.size()) ||
          stuck < 2 * kStuckRun)
        continue;
      throw InputError(r.name, std::string("force ") + "xyz"[axis],
                       "stands at " + number(limit) + " N in " + std::to_string(stuck) +
                           " samples, first at " + number(r.motion.samples[first].time) +
                           " s: the sensor is saturated",
                       "leave those samples out with --range-n " + number(std::abs(limit)));
    }
  }
}

void check_magnitude(const MeasuredRecording& r) {
  std::vector<double> size;
  size.reserve(r.motion.measured_force.size());
  for (const Vec3& f : r.motion.measured_force) size.push_back(f.norm());
  const auto place = size.begin() + static_cast<std::ptrdiff_t>(
                                        static_cast<double>(size.size() - 1) * (1 - kMostShare));
  std::nth_element(size.begin(), place, size.end());
  if (*place <= kMostNewtons) return;
  throw InputError(r.name, "force",
                   "exceeds " + number(*place) + " N in 5 % of the samples, more than a bur is " +
                       "pressed with: it looks like grams (then " + number(*place * 0.00980665) +
                       " N) or millinewtons (then " + number(*place * 1e-3) + " N)",
                   "say the unit with --force-unit gf, mN or N");
}

}  // namespace

void check_recording(MeasuredRecording& r, const ForceReading& reading) {
  const std::vector<Vec3>& force = r.motion.measured_force;
  if (force.empty())
    throw InputError(r.name, "/force/measured", "is missing: there is nothing to calibrate with",
                     "record the force beside the motion (CSV: columns fx_N, fy_N, fz_N)");
  if (force.size() != r.motion.samples.size())
    throw InputError(r.name, "/force/measured",
                     "has " + std::to_string(force.size()) + " samples for " +
                         std::to_string(r.motion.samples.size()) + " of the motion",
                     "resample one of them");
  for (std::size_t i = 0; i < force.size(); ++i)
    if (!force[i].allFinite() || !r.motion.samples[i].pose.position.allFinite())
      throw InputError(r.name, "sample " + std::to_string(i), "is not finite");
  const auto flat = [&](const Vec3& f) { return f == force.front(); };
  if (std::all_of(force.begin(), force.end(), flat))
    throw InputError(r.name, "/force/measured", "never changes", "is the sensor connected?");
  if (!reading.unit_stated) check_magnitude(r);
  r.usable.assign(force.size(), 1);
  if (!reading.range) return check_saturation(r);
  for (std::size_t i = 0; i < force.size(); ++i)
    r.usable[i] = force[i].cwiseAbs().maxCoeff() < *reading.range * (1 - 1e-9);
}

MeasuredRecording read_recording(const std::string& path, const ForceReading& reading) {
  MeasuredRecording r;
  r.name = path;
  const std::string extension = std::filesystem::path(path).extension().string();
  if (extension == ".csv") {
    r.motion = read_csv_trajectory(path);
  } else if (extension == ".h5" || extension == ".hdf5") {
    if (is_trace_file(path)) {
      Trace trace = read_trace(path);
      r.tooth_sha256 = trace.tooth_sha256;
      r.bur = trace.bur;
      r.motion.samples.reserve(trace.rows.size());
      for (const StepRecord& row : trace.rows)
        r.motion.samples.push_back({row.handle.time, row.bur, row.handle.buttons});
      r.motion.measured_force = std::move(trace.measured_force);
    } else {
      r.motion = read_h5_trajectory(path);
    }
  } else {
    throw InputError(path, "", "not a recording by its name", "use .h5 or .csv");
  }
  const double factor = (reading.on_tooth ? -1 : 1) * reading.newton_per_unit;
  for (Vec3& f : r.motion.measured_force) f *= factor;
  check_recording(r, reading);
  return r;
}

void check_same_tooth(const MeasuredRecording& recording, const std::string& tooth_sha256,
                      const std::string& tooth_path) {
  if (recording.tooth_sha256.empty() || recording.tooth_sha256 == tooth_sha256) return;
  throw InputError(recording.name, "tooth_sha256",
                   "was recorded with another tooth than " + tooth_path,
                   "give the tooth as it was before the recording");
}

}  // namespace toothprep
