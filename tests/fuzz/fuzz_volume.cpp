#include <filesystem>

#include "fuzz_target.h"
#include "toothprep/tools/scan_files/image_file.h"

namespace toothprep {
namespace {

// More voxels than the bytes could hold must have been refused; deflate holds 1032 for one.
void read_volume(const std::string& path) {
  const auto source = open_scan(path);
  const double bytes = static_cast<double>(std::filesystem::file_size(path));
  fuzz::require(source->frame().size.cast<double>().prod() <= 1032.0 * (bytes + 4096) + 4096);
  static_cast<void>(read_all(*source));
  sha256_of_scan(path);
}

const fuzz::Registered k_volume({"volume",
                                 {"scan.nrrd", "scan.nhdr", "scan.nii", "scan.nii.gz", "scan.mha",
                                  "scan.mhd"},
                                 read_volume});

}  // namespace
}  // namespace toothprep
