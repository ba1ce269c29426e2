#include "toothprep/tools/files/trajectory_file.h"

#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/framed_trajectory_file.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {

Trajectory read_trajectory(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  if (extension == ".toml") return read_script(path);
  if (extension == ".csv") return read_csv_trajectory(path);
  if (extension == ".h5" || extension == ".hdf5") return read_h5_trajectory(path);
  throw InputError(path, "", "not a trajectory by its name", "use .toml, .csv or .h5");
}

Trajectory read_trajectory(const std::string& path, PathFrame& frame) {
  frame = PathFrame::kFile;
  if (std::filesystem::path(path).extension() == ".toml") return read_script(path, frame);
  return read_trajectory(path);
}

}  // namespace toothprep
