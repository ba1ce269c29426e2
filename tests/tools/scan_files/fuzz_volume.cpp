// A libFuzzer target: NRRD, NIfTI and MetaImage on any bytes give a volume or an error, never more.
// The first byte chooses the format. ITK is in the same process, not instrumented: what it does to
// the heap is seen, what it leaks is not. Built and run by scripts/fuzz.
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/scan_files/scan_source.h"
#include "toothprep/tools/scan_files/volume_file.h"

namespace {

bool write(const std::string& path, const std::uint8_t* data, std::size_t size) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) return false;
  std::fwrite(data, 1, size, file);
  std::fclose(file);
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::array<const char*, 6> kExtensions = {".nrrd",   ".nhdr", ".nii",
                                                      ".nii.gz", ".mha",  ".mhd"};
  // Detached headers name "fuzz-volume.raw".
  static const bool beside = [] {
    const std::vector<std::uint8_t> voxels(4096, 7);
    return write("/dev/shm/fuzz-volume.raw", voxels.data(), voxels.size());
  }();
  if (!beside || size < 1) return 0;
  const std::string path = "/dev/shm/fuzz-volume-" + std::to_string(getpid()) +
                           kExtensions[data[0] % kExtensions.size()];
  if (!write(path, data + 1, size - 1)) return 0;
  try {
    const auto source = toothprep::image::open_volume_file(path, {}, {});
    // More voxels than bytes could hold must have been refused; deflate holds 1032 for one.
    const double voxels = source->frame().size.cast<double>().prod();
    if (voxels > 1032.0 * (static_cast<double>(size) + 4096) + 4096) __builtin_trap();
    toothprep::read_all(*source);
    toothprep::image::detached_data_of(path);
  } catch (const toothprep::InputError&) {
  }
  std::remove(path.c_str());
  return 0;
}
