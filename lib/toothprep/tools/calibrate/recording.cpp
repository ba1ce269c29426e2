#include "toothprep/tools/calibrate/recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/files/h5_reader.h"

namespace toothprep {
namespace {

constexpr double kMostNewtons = 25;    // see check_recording()
constexpr double kMostShare = 0.05;    // of the samples above it: more than outliers make
constexpr std::size_t kStuckRun = 8;   // samples in a row at a limit
constexpr double kStuckShare = 0.002;  // of the samples, from which a sensor counts as saturated

std::string number(double x) { return fmt::format("{:.4g}", x); }

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
  const double large = quantile(std::move(size), 1 - kMostShare);
  if (large <= kMostNewtons) return;
  throw InputError(r.name, "force",
                   "exceeds " + number(large) + " N in 5 % of the samples, more than a bur is " +
                       "pressed with: it looks like grams (then " + number(large * 0.00980665) +
                       " N) or millinewtons (then " + number(large * 1e-3) + " N)",
                   "say the unit with --force-unit gf, mN or N");
}

}  // namespace

namespace {

constexpr double kStandsStill = 0.02;  // of the median speed

// A spindle whose speed is gone while its motor is on has stalled, whether the file says so or not.
void mark_stalls(MeasuredRecording& r) {
  if (r.rotation_rate.empty()) return;
  std::vector<double> turning;
  for (const double n : r.rotation_rate)
    if (n > 0) turning.push_back(n);
  if (turning.empty())
    throw InputError(r.name, "rotation_rate", "is never above zero",
                     "leave it out if it wasn't recorded");
  const double stands_still = kStandsStill * median(std::move(turning));
  if (r.stalled.empty()) r.stalled.assign(r.rotation_rate.size(), 0);
  // The first row of a trace is a state before any step: at rest.
  for (std::size_t i = 1; i < r.stalled.size(); ++i)
    if ((r.motion.samples[i].buttons & kPedalButton) && r.rotation_rate[i] < stands_still)
      r.stalled[i] = 1;
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
  mark_stalls(r);
  r.usable.assign(force.size(), 1);
  if (!reading.range) return check_saturation(r);
  for (std::size_t i = 0; i < force.size(); ++i)
    r.usable[i] = force[i].cwiseAbs().maxCoeff() < *reading.range * (1 - 1e-9);
}

namespace {

MeasuredRecording parse_recording(h5::Reader& in, RecordedPose pose) {
  MeasuredRecording r;
  r.tooth_sha256 = in.text("tooth_sha256").value_or("");
  r.bur = in.text("bur").value_or("");
  r.parameters_toml = in.text("parameters").value_or("");
  in.cut_to_shortest({"/time", "/handle/position", "/handle/orientation", "/handle/buttons",
                      "/bur/position", "/bur/orientation", "/force/measured", "/rotation_rate",
                      "/torque", "/stalled", "/reading_rejected"});
  const std::vector<double> time = in.read_time();
  if (time.size() < 2) in.refuse("/time", "holds fewer than two samples", "record a motion");
  const std::string owner =
      pose == RecordedPose::kBurOrHandle && in.has("/bur/position") ? "/bur" : "/handle";
  if (in.number("schema_version").value_or(0) == 2)
    in.refuse("/events", "the session was paused, taken back or went on with another bur",
              "calibrate by a recording of one bur on one tooth");
  if (in.number("rows_every").value_or(1) > 1)
    in.refuse("attribute rows_every",
              "is " + h5::printable(fmt::format("{:g}", *in.number("rows_every"))) +
                  ": the steps in between, and what the bur cut in them, are missing",
              "calibrate by a trace of all steps");
  if (!in.has(owner + "/position"))
    in.refuse(owner + "/position", "is missing",
              pose == RecordedPose::kHandle
                  ? "a coupled recording needs the handle's motion; for the bur's, --drive direct"
                  : "record the bur's motion as /bur/position, or the handle's");
  const std::vector<double> position = in.read(in.open(owner + "/position", "mm", 3, true));
  r.motion.samples.resize(time.size());
  for (std::size_t i = 0; i < time.size(); ++i) {
    r.motion.samples[i].time = time[i];
    r.motion.samples[i].pose.position = Eigen::Map<const Vec3>(position.data() + 3 * i);
  }
  for (const std::string& orientation :
       {owner + "/orientation", std::string("/handle/orientation")})
    if (in.has(orientation)) {
      const std::vector<double> q = in.read(in.open(orientation, "1", 4, false));
      for (std::size_t i = 0; i < time.size(); ++i)
        r.motion.samples[i].pose.orientation = in.quaternion(orientation, i, q.data() + 4 * i);
      break;
    }
  if (const std::string name = "/handle/buttons"; in.has(name)) {
    const std::vector<double> b = in.read(in.open(name, "1", 1, false));
    for (std::size_t i = 0; i < time.size(); ++i)
      r.motion.samples[i].buttons =
          static_cast<std::uint32_t>(in.whole_number(name, i, b[i], 0, 4294967295.0));
  }
  if (const std::string name = "/reading_rejected"; owner == "/handle" && in.has(name)) {
    const std::vector<double> rejected = in.read(in.open(name, "1", 1, false));
    for (std::size_t i = 1; i < time.size(); ++i)  // the handle was somewhere near where it was
      if (in.whole_number(name, i, rejected[i], 0, 1) != 0)
        r.motion.samples[i].pose = r.motion.samples[i - 1].pose;
  }
  if (in.has("/force/measured")) {
    const std::vector<double> f = in.read(in.open("/force/measured", "N", 3, true));
    r.motion.measured_force.resize(time.size());
    for (std::size_t i = 0; i < time.size(); ++i)
      r.motion.measured_force[i] = Eigen::Map<const Vec3>(f.data() + 3 * i);
  }
  if (in.has("/rotation_rate"))
    r.rotation_rate = in.read(in.open("/rotation_rate", "rev/s", 1, false));
  if (in.has("/torque")) r.torque = in.read(in.open("/torque", "mN*m", 1, false));
  if (in.has("/stalled")) {
    const std::vector<double> s = in.read(in.open("/stalled", "1", 1, false));
    r.stalled.resize(time.size());
    for (std::size_t i = 0; i < time.size(); ++i)
      r.stalled[i] = in.whole_number("/stalled", i, s[i], 0, 1) > 0;
  }
  return r;
}

// Where `time` lies among the samples: the one before (or at) it, and how far on towards the next.
struct Place {
  std::size_t before = 0;
  double part = 0;
};

}  // namespace

MeasuredRecording read_recording(const std::string& path, const ForceReading& reading,
                                 RecordedPose pose) {
  MeasuredRecording r;
  const std::string extension = std::filesystem::path(path).extension().string();
  if (extension == ".csv")
    r = read_recording_csv(path);
  else if (extension == ".h5" || extension == ".hdf5")
    r = h5::read_with_care(path, ReadPolicy::kTrial,
                           [pose](h5::Reader& in) { return parse_recording(in, pose); });
  else
    throw InputError(path, "", "not a recording by its name", "use .h5 or .csv");
  r.name = path;
  const double factor = (reading.on_tooth ? -1 : 1) * reading.newton_per_unit;
  for (Vec3& f : r.motion.measured_force) f *= factor;
  check_recording(r, reading);
  return r;
}

RecordedMotion motion_of(const MeasuredRecording& r, double time_step, bool allow_gaps,
                         bool speed) {
  RecordedMotion motion;
  motion.path = resample(r.motion, time_step, allow_gaps, r.name);
  const auto& samples = r.motion.samples;
  speed = speed && !r.rotation_rate.empty();
  if (speed) motion.spindle.rate.resize(motion.path.size());
  if (!r.stalled.empty()) motion.spindle.stalled.resize(motion.path.size());
  Place at;
  for (std::size_t i = 0; i < motion.path.size(); ++i) {
    const double time = motion.path[i].time;
    while (at.before + 1 < samples.size() && samples[at.before + 1].time <= time + 1e-9)
      ++at.before;
    const std::size_t next = std::min(at.before + 1, samples.size() - 1);
    const double span = samples[next].time - samples[at.before].time;
    at.part = span > 0 ? std::clamp((time - samples[at.before].time) / span, 0.0, 1.0) : 0;
    if (at.part < 1e-6) at.part = 0;
    if (speed)
      motion.spindle.rate[i] =
          (1 - at.part) * r.rotation_rate[at.before] + at.part * r.rotation_rate[next];
    if (!r.stalled.empty())
      motion.spindle.stalled[i] = r.stalled[at.before] || (at.part > 0 && r.stalled[next]);
  }
  return motion;
}

namespace {

// The order of u/N that measured forces have: the cutting experiments on teeth that the paper
// builds on (1.8 to 4 N·s/mm of resistance) and its own values agree in some 3e-3 J·s/mm³ for
// enamel and a third for dentin. Real tissues and burs scatter by a factor of a few; a unit is off
// by a hundred.
constexpr double kPlausibleEnamel = 3.0, kPlausibleOther = 1.0;  // u/N, N·s/mm²
constexpr double kPlausibleAlpha = 0.3;
constexpr double kTooMuch = 30;  // between ten (tissue) and a hundred (grams)

}  // namespace

double force_by_plausible(const MeasuredRecording& recording, const ForceBasis& basis) {
  PerTissue<GrindingProperties> tissue;
  for (int k = 0; k < kTissueCount; ++k)
    tissue[k] = {(k == 0 ? kPlausibleEnamel : kPlausibleOther) * basis.rotation_rate,
                 kPlausibleAlpha};
  // The sensor's bias: what it reads while nothing is touched, else its median.
  const auto& samples = recording.motion.samples;
  const auto index = [&](std::size_t j) {
    const double place = (samples[j].time - basis.start) / basis.step + 0.5;
    return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(basis.size - 1)));
  };
  Vec3 bias = Vec3::Zero();
  for (int a = 0; a < 3; ++a) {
    std::vector<double> quiet, all;
    for (std::size_t j = 0; j < samples.size(); ++j) {
      all.push_back(recording.motion.measured_force[j][a]);
      if (!(basis.removal[index(j)] > 0)) quiet.push_back(all.back());
    }
    bias[a] = median(std::move(quiet.size() > 100 ? quiet : all));
  }
  double measured = 0, plausible = 0;
  for (std::size_t j = 0; j < samples.size(); ++j) {
    const std::size_t i = index(j);
    if (!(basis.removal[i] > 0)) continue;
    measured += (recording.motion.measured_force[j] - bias).squaredNorm();
    plausible += force_at(basis, i, tissue).squaredNorm();
  }
  return plausible > 0 ? std::sqrt(measured / plausible) : std::nan("");
}

void check_unit_by_model(const MeasuredRecording& recording, const ForceBasis& basis,
                         const ForceReading& reading) {
  const double ratio = force_by_plausible(recording, basis);
  if (reading.unit_stated || !(ratio > kTooMuch)) return;
  const bool grams = ratio < 101.97 * std::sqrt(1000 / 101.97);
  throw InputError(recording.name, "force",
                   "is " + number(ratio) +
                       " times what tissue of a published u/N makes along this " +
                       "motion: it looks like " + (grams ? "grams" : "millinewtons"),
                   std::string("say the unit with --force-unit ") +
                       (grams ? "gf (or N if it is)" : "mN (or N if it is)"));
}

void check_same_tooth(const MeasuredRecording& recording, const std::string& tooth_sha256,
                      const std::string& tooth_path) {
  if (recording.tooth_sha256.empty() || recording.tooth_sha256 == tooth_sha256) return;
  throw InputError(recording.name, "tooth_sha256",
                   "was recorded with another tooth than " + tooth_path,
                   "give the tooth as it was before the recording");
}

}  // namespace toothprep
