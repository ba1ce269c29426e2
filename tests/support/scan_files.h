// A folder for one test's files, and a volume that shows every mistake of order, sign and place.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/scan_files/image_file.h"

namespace toothprep {

namespace fs = std::filesystem;
using testing::HasSubstr;

class ScanFiles : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("toothprep_scan_files_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path(name), std::ios::binary) << bytes;
    return path(name);
  }
  static std::string bytes_of(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void truncate(const std::string& name, double share) const {
    fs::resize_file(path(name), static_cast<std::uintmax_t>(
                                    share * static_cast<double>(fs::file_size(path(name)))));
  }
  fs::path folder_;
};

// Every voxel different, negative values too, axes oblique or exchanged.
inline ImageVolume<std::int16_t> some_image(const Mat3& direction = Mat3::Identity()) {
  ImageVolume<std::int16_t> image;
  image.size = Index3(7, 5, 6);
  image.spacing = Vec3(0.2, 0.3, 0.45);
  image.origin = Vec3(-12.5, 7.25, 100.125);
  image.direction = direction;
  for (int v = 0; v < 210; ++v)
    image.data.push_back(static_cast<std::int16_t>(37 * v % 4001 - 1024));
  return image;
}

inline Mat3 oblique() {
  return Eigen::AngleAxisd(0.4, Vec3(1, -2, 0.5).normalized()).toRotationMatrix();
}

inline void expect_same(const ImageVolume<float>& read, const ImageVolume<std::int16_t>& image,
                        double tolerance) {
  ASSERT_EQ(read.size, image.size);
  EXPECT_LT((read.spacing - image.spacing).norm(), tolerance);
  EXPECT_LT((read.origin - image.origin).norm(), 100 * tolerance);
  EXPECT_LT((read.direction - image.direction).norm(), tolerance);
  EXPECT_TRUE(std::equal(read.data.begin(), read.data.end(), image.data.begin()));
}

// The error's text, which must be one line that names the file.
inline std::string refusal(const std::string& path, const ScanReadOptions& options = {}) {
  try {
    static_cast<void>(read_scan(path, options));
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::StartsWith(path));
    EXPECT_THAT(e.what(), testing::Not(HasSubstr("\n")));
    return e.what();
  }
  return "no error";
}

inline ScanReadOptions with_spacing(double x, double y, double z) {
  ScanReadOptions options;
  options.spacing_mm = {x, y, z};
  return options;
}

}  // namespace toothprep
