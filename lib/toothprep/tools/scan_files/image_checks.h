// What every volume must satisfy, wherever it came from, and the words to say so.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/io/image_volume.h"

namespace toothprep::image {

constexpr double kMaxDeflateRatio = 1032;  // deflate's own limit; all our formats use it

std::string lower(std::string text);
std::string trimmed(const std::string& text);  // without blanks, line ends and NULs around it
std::string number(double value);
std::string count_text(double count);     // a whole number, all its digits
std::string size_of(const Index3& size);  // "512 x 512 x 300"
double voxel_count(const Index3& size);
// Of whole numbers up to `most`, rescaled: ScanSource::whole_up_to().
double whole_up_to(double most, double slope, double intercept);

// Each of these throws InputError with `path` if it finds something.
void check_size(const std::string& path, const std::array<double, 3>& size);
// Of what is to be read: not more than 2^31 voxels.
void check_voxels(const std::string& path, const Index3& size);
// Puts in the spacing given, if any, and checks spacing and orientation.
void place_volume(const std::string& path, ImageFrame& frame,
                  const std::optional<std::array<double, 3>>& spacing_mm);

}  // namespace toothprep::image
