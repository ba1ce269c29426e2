#include "toothprep/tools/scan_files/image_checks.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>

#include "toothprep/step/core/errors.h"

namespace toothprep::image {
namespace {

constexpr double kMaxVoxels = 2147483648.0;            // 2^31
constexpr double kMaxAlongAxis = 1 << 20;              // voxels
constexpr double kMinSpacing = 1e-3, kMaxSpacing = 5;  // mm
const std::string kBlanks(" \t\r\n\0", 5);

}  // namespace

double voxel_count(const Index3& size) { return size.cast<double>().prod(); }

double whole_up_to(double most, double slope, double intercept) {
  constexpr double kExact = 1 << 24;  // up to here single precision has all whole numbers
  const double bound = most * std::abs(slope) + std::abs(intercept);
  const bool whole = std::trunc(slope) == slope && std::trunc(intercept) == intercept;
  return whole && bound <= kExact ? bound : std::numeric_limits<double>::infinity();
}

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

std::string count_text(double count) {
  return std::to_string(static_cast<std::uint64_t>(std::clamp(count, 0.0, 1e18)));
}

std::string size_of(const Index3& size) {
  return std::to_string(size.x()) + " x " + std::to_string(size.y()) + " x " +
         std::to_string(size.z());
}

void check_size(const std::string& path, const std::array<double, 3>& size) {
  const std::string text = number(size[0]) + " x " + number(size[1]) + " x " + number(size[2]);
  for (const double n : size)
    if (!(n >= 2 && n <= kMaxAlongAxis))
      throw InputError(path, "size", text + " voxels is not a volume",
                       "a scan needs three dimensions");
}

void check_voxels(const std::string& path, const Index3& size) {
  if (voxel_count(size) > kMaxVoxels)
    throw InputError(path, "size", size_of(size) + " voxels is more than 2^31",
                     "read a part of the scan with --roi, or coarsen it");
}

void place_volume(const std::string& path, ImageFrame& frame,
                  const std::optional<std::array<double, 3>>& spacing_mm) {
  if (spacing_mm) {
    const Vec3 given((*spacing_mm)[0], (*spacing_mm)[1], (*spacing_mm)[2]);
    // The origin is so many voxels from the frame's zero along the image's axes; that count stays,
    // unless the file's own spacing, which is to be replaced, is none.
    if (frame.spacing.allFinite() && frame.spacing.minCoeff() > 0) {
      const Vec3 voxels = (frame.direction.transpose() * frame.origin).cwiseQuotient(frame.spacing);
      frame.origin = frame.direction * given.cwiseProduct(voxels);
    }
    frame.spacing = given;
  }
  for (int axis = 0; axis < 3; ++axis)
    if (!(frame.spacing[axis] >= kMinSpacing && frame.spacing[axis] <= kMaxSpacing))
      throw InputError(path, "spacing",
                       number(frame.spacing[axis]) + " mm along axis " + std::to_string(axis) +
                           " is outside 0.001 .. 5 mm",
                       "give the voxel size with --spacing-mm");
  if (!frame.origin.allFinite() || !frame.direction.allFinite() ||
      (frame.direction.transpose() * frame.direction - Mat3::Identity()).norm() > 1e-3)
    throw InputError(path, "orientation", "the image axes are not orthogonal unit vectors",
                     "resample the scan to a rectangular grid");
}

}  // namespace toothprep::image
