#include <filesystem>

#include "fuzz_target.h"
#include "toothprep/tools/calibrate/recording.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {
namespace {

// The same bytes as each of what an HDF5 file may be: the name says which.
void read_hdf5(const std::string& path) {
  const std::string name = std::filesystem::path(path).stem().string();
  if (name == "trace" && is_trace_file(path)) static_cast<void>(read_trace(path));
  if (name == "session" && is_session_file(path)) static_cast<void>(read_session(path));
  if (name == "path") static_cast<void>(read_h5_trajectory(path));
  if (name == "rig") read_recording(path);
}

const fuzz::Registered k_hdf5({"hdf5", {"trace.h5", "session.h5", "path.h5", "rig.h5"}, read_hdf5});

}  // namespace
}  // namespace toothprep
