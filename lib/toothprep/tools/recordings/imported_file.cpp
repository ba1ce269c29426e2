#include <algorithm>
#include <cmath>

#include "toothprep/tools/files/h5_writer.h"
#include "toothprep/tools/recordings/import_recording.h"

namespace toothprep {
namespace {

template <class Value>
std::vector<double> flat(std::size_t count, int width, Value value) {
  std::vector<double> values;
  values.reserve(count * static_cast<std::size_t>(width));
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < width; ++c) values.push_back(value(i, c));
  return values;
}

}  // namespace

void write_imported(const ImportedRecording& r, const ImportSource& source,
                    const std::string& path) {
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  h5::Writer out(path);
  const auto& samples = r.motion.samples;
  const std::size_t n = samples.size();
  out.text("schema", "toothprep-recording");
  out.integer("schema_version", 1);
  out.text("toothprep_version", source.toothprep_version);
  out.text("source", source.name);
  out.text("source_sha256", source.sha256);
  out.number("source_first_time_s", r.first_time_s);
  out.group("/handle");
  out.dataset("/time", "s", flat(n, 1, [&](std::size_t i, int) { return samples[i].time; }), 1,
              Storage::kDouble);
  out.dataset("/handle/position", "mm",
              flat(n, 3, [&](std::size_t i, int c) { return samples[i].pose.position[c]; }), 3,
              Storage::kDouble);
  out.dataset(
      "/handle/orientation", "1",
      flat(n, 4, [&](std::size_t i, int c) { return samples[i].pose.orientation.coeffs()[c]; }), 4,
      Storage::kDouble);
  out.dataset("/handle/buttons", "1",
              flat(n, 1, [&](std::size_t i, int) { return samples[i].buttons; }), 1,
              Storage::kUint32);
  if (!r.motion.measured_force.empty()) {
    out.group("/force");
    out.dataset("/force/measured", "N",
                flat(n, 3, [&](std::size_t i, int c) { return r.motion.measured_force[i][c]; }), 3,
                Storage::kDouble);
  }
  if (!r.rotation_rate.empty())
    out.dataset("/rotation_rate", "rev/s", r.rotation_rate, 1, Storage::kDouble);
  if (!r.torque.empty()) out.dataset("/torque", "mN*m", r.torque, 1, Storage::kDouble);
  if (!r.stalled.empty()) out.dataset("/stalled", "1", r.stalled, 1, Storage::kUint8);
  out.close();
}

}  // namespace toothprep
