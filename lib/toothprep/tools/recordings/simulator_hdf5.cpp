// Recordings of FIVRS (github.com/LCSR-SICKKIDS/volumetric_drilling), as its pages of data formats
// have them.
#include <array>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/h5_reader.h"
#include "toothprep/tools/recordings/recorded_table.h"

namespace toothprep {
namespace {

using h5::Reader;

// Where a stream stands: its times, and its rows of values beside them.
struct Stream {
  std::string time, values;
};

const std::vector<Stream> kDrill = {
    {"/physics_data/continuous_data/high_frequency_poses/drill_pose/time_stamp",
     "/physics_data/continuous_data/high_frequency_poses/drill_pose/pose"},
    {"/high_frequency_poses/drill_pose/time_stamp", "/high_frequency_poses/drill_pose/pose"},
    {"/vision_data/continuous_data/time", "/vision_data/continuous_data/pose_mastoidectomy_drill"},
    {"/data/time", "/data/pose_mastoidectomy_drill"}};
const std::vector<Stream> kAnatomy = {
    {"/physics_data/continuous_data/high_frequency_poses/anatomy_pose/time_stamp",
     "/physics_data/continuous_data/high_frequency_poses/anatomy_pose/pose"},
    {"/high_frequency_poses/anatomy_pose/time_stamp", "/high_frequency_poses/anatomy_pose/pose"},
    {"/vision_data/continuous_data/time", "/vision_data/continuous_data/pose_mastoidectomy_volume"},
    {"/data/time", "/data/pose_mastoidectomy_volume"}};
const std::vector<Stream> kWrench = {
    {"/physics_data/intermittent_data/drill_force_feedback/time_stamp",
     "/physics_data/intermittent_data/drill_force_feedback/wrench"},
    {"/drill_force_feedback/time_stamp", "/drill_force_feedback/wrench"},
    {"/force/time_stamp", "/force/wrench"}};

// Opened by itself: a Reader fixes the number of rows, and the streams have their own.
std::optional<RecordedTable> read_stream(const std::string& path, const std::vector<Stream>& places,
                                         const std::vector<std::string>& names) {
  return h5::read_with_care(
      path, ReadPolicy::kTrial, [&](Reader& in) -> std::optional<RecordedTable> {
        for (const Stream& place : places) {
          if (!in.has(place.time) || !in.has(place.values)) continue;
          RecordedTable table;
          table.names = {"time"};
          table.names.insert(table.names.end(), names.begin(), names.end());
          const auto width = names.size();
          table.columns.resize(width + 1);
          table.columns[0] = in.read(in.open(place.time, "s", 1, false));
          const std::vector<double> values =
              in.read(in.open(place.values, "1", static_cast<int>(width), false));
          for (std::size_t i = 0; i < table.columns[0].size(); ++i)
            for (std::size_t c = 0; c < width; ++c)
              table.columns[c + 1].push_back(values[i * width + c]);
          if (table.rows() < 2) in.refuse(place.values, "holds fewer than two samples");
          table.kind = "HDF5 of FIVRS, " + place.values;
          table.conventions = {1000.0, 1.0, 1.0};
          return table;
        }
        return {};
      });
}

}  // namespace

SimulatorRecording read_simulator_hdf5(const std::string& path) {
  const std::vector<std::string> pose = {"x", "y", "z", "qx", "qy", "qz", "qw"};
  auto motion = read_stream(path, kDrill, pose);
  if (!motion)
    throw InputError(path, "",
                     "holds neither /time and /handle/position nor a drill's pose of FIVRS",
                     "export it as a table, and import that");
  SimulatorRecording recording{std::move(*motion), read_stream(path, kAnatomy, pose),
                               read_stream(path, kWrench, {"fx", "fy", "fz", "tx", "ty", "tz"})};
  recording.motion.notes.push_back("positions in metres, quaternions x, y, z, w");
  return recording;
}

}  // namespace toothprep
