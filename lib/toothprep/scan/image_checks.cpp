#include "toothprep/scan/image_checks.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "toothprep/core/errors.h"

namespace toothprep::image {
namespace {

constexpr double kMaxVoxels = 2147483648.0;            // 2^31
constexpr double kMinSpacing = 1e-3, kMaxSpacing = 5;  // mm
const std::string kBlanks(" \t\r\n\0", 5);

}  // namespace

double voxel_count(const Index3& size) { return size.cast<double>().prod(); }

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(kBlanks);
  if (first == std::string::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

std::string number(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

void check_size(const std::string& path, const std::array<double, 3>& size) {
  const std::string text = number(size[0]) + " x " + number(size[1]) + " x " + number(size[2]);
  for (const double n : size)
    if (!(n >= 2))
      throw InputError(path, "size", text + " voxels is not a volume",
                       "a scan needs three dimensions");
  if (size[0] * size[1] * size[2] > kMaxVoxels)
    throw InputError(path, "size", text + " voxels is more than 2^31", "crop or coarsen the scan");
}

void place_volume(const std::string& path, ImageVolume<float>& volume,
                  const std::optional<std::array<double, 3>>& spacing_mm) {
  if (spacing_mm) {
    const Vec3 given((*spacing_mm)[0], (*spacing_mm)[1], (*spacing_mm)[2]);
    // The origin is so many voxels from the frame's zero along the image's axes; that count stays.
    const Vec3 voxels =
        (volume.direction.transpose() * volume.origin).cwiseQuotient(volume.spacing);
    volume.origin = volume.direction * given.cwiseProduct(voxels);
    volume.spacing = given;
  }
  for (int axis = 0; axis < 3; ++axis)
    if (!(volume.spacing[axis] >= kMinSpacing && volume.spacing[axis] <= kMaxSpacing))
      throw InputError(path, "spacing",
                       number(volume.spacing[axis]) + " mm along axis " + std::to_string(axis) +
                           " is outside 0.001 .. 5 mm",
                       "give the voxel size with --spacing-mm");
  if (!volume.origin.allFinite() || !volume.direction.allFinite() ||
      (volume.direction.transpose() * volume.direction - Mat3::Identity()).norm() > 1e-3)
    throw InputError(path, "orientation", "the image axes are not orthogonal unit vectors",
                     "resample the scan to a rectangular grid");
}

void check_values(const std::string& path, const std::vector<float>& values) {
  const auto bad =
      std::count_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); });
  if (bad > 0)
    throw InputError(path, "voxel data",
                     std::to_string(bad) + " of " + std::to_string(values.size()) +
                         " values are not finite numbers",
                     "replace them by the grey value of the surroundings");
}

bool inflates_to(const std::string& file, double offset, double promised) {
  std::ifstream in(file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(offset));
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 32) != Z_OK) return false;  // zlib or gzip, by its header
  std::vector<char> packed(1 << 16), plain(1 << 18);
  double total = 0;
  int status = Z_OK;
  const auto fill = [&] {
    in.read(packed.data(), static_cast<std::streamsize>(packed.size()));
    stream.next_in = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_in = static_cast<uInt>(in.gcount());
    return stream.avail_in > 0;
  };
  while (total < promised && (stream.avail_in > 0 || fill())) {
    stream.next_out = reinterpret_cast<Bytef*>(plain.data());
    stream.avail_out = static_cast<uInt>(plain.size());
    status = inflate(&stream, Z_NO_FLUSH);
    total += static_cast<double>(plain.size() - stream.avail_out);
    if (status == Z_STREAM_END)
      inflateReset(&stream);  // gzip files may have several members
    else if (status != Z_OK)
      break;
  }
  inflateEnd(&stream);
  return total >= promised;
}

}  // namespace toothprep::image
