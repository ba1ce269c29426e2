// The same scan in every format is the same tooth in the same place, bit by bit where the format
// can hold the scan's place.
#include <cmath>
#include <sstream>

#include "../../support/phantom.h"
#include "../../support/scan_files.h"
#include "toothprep/tools/segmentation/voxelize.h"
#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

using SameScan = ScanFiles;

ImageVolume<std::int16_t> peg_scan(const Vec3& spacing, const Vec3& origin, const Mat3& direction) {
  // phantom::scan_of has one spacing for all axes; the peg is scanned here in the image's own.
  ImageVolume<std::int16_t> image;
  image.spacing = spacing;
  image.direction = direction;
  image.size = (Vec3(9, 9, 16).cwiseQuotient(spacing)).array().ceil().cast<int>() + 1;
  image.origin = origin;
  const Vec3 middle =
      0.5 * image.spacing.cwiseProduct((image.size - Index3::Ones()).cast<double>());
  const auto peg = phantom::peg();
  const phantom::Grey g;
  const auto step = [](double d) { return 0.5 * std::erfc(d / (0.2 * std::sqrt(2.0))); };
  for (int k = 0; k < image.size.z(); ++k)
    for (int j = 0; j < image.size.y(); ++j)
      for (int i = 0; i < image.size.x(); ++i) {
        const auto d = peg(image.spacing.cwiseProduct(Vec3(i, j, k)) - middle - Vec3(0, 0, 2.5));
        image.data.push_back(static_cast<std::int16_t>(
            std::lround(g.surroundings + (g.enamel - g.surroundings) * step(d.tooth) +
                        (g.dentin - g.enamel) * step(std::max(d.core, d.tooth)) +
                        (g.pulp - g.dentin) * step(std::max(d.pulp, d.tooth)))));
      }
  return image;
}

std::string text_of(const Vec3& v) {
  std::ostringstream text;
  text.precision(17);
  text << v.x() << " " << v.y() << " " << v.z();
  return text.str();
}

// The same in each of these; returns their names.
std::vector<std::string> write_all(const ImageVolume<std::int16_t>& image, const fs::path& folder) {
  const auto path = [&](const std::string& name) { return (folder / name).string(); };
  const std::string raw(reinterpret_cast<const char*>(image.data.data()), 2 * image.data.size());
  const auto write = [&](const std::string& name, const std::string& bytes) {
    std::ofstream(path(name), std::ios::binary) << bytes;
  };
  std::string axes, matrix;
  for (int a = 0; a < 3; ++a) {
    std::string axis = text_of(image.direction.col(a) * image.spacing[a]);
    for (char& c : axis)
      if (c == ' ') c = ',';
    axes += " (" + axis + ")";
    matrix += " " + text_of(image.direction.col(a));
  }
  std::string origin = text_of(image.origin);
  for (char& c : origin)
    if (c == ' ') c = ',';
  std::ostringstream size;
  size << image.size.x() << " " << image.size.y() << " " << image.size.z();
  write("voxels.raw", raw);
  write("raw.nrrd", "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: " +
                        size.str() + "\nspace directions:" + axes + "\nspace origin: (" + origin +
                        ")\nencoding: raw\nendian: little\n\n" + raw);
  write("beside.mhd",
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        "CompressedData = False\nTransformMatrix =" +
            matrix + "\nOffset = " + text_of(image.origin) +
            "\nElementSpacing = " + text_of(image.spacing) + "\nDimSize = " + size.str() +
            "\nElementType = MET_SHORT\nElementDataFile = voxels.raw\n");
  for (const char* name : {"gzip.nrrd", "zlib.mha", "plain.nii", "gzip.nii.gz"})
    write_image(image, path(name));
  fs::create_directories(folder / "series");
  write_dicom_series(image, path("series"));
  return {"raw.nrrd", "gzip.nrrd", "beside.mhd", "zlib.mha", "plain.nii", "gzip.nii.gz", "series"};
}

LayeredTooth tooth_of(const std::string& path) {
  VoxelizeOptions options;
  options.voxel = 0.25;
  return voxelize_scan(read_scan(path), options);
}

TEST_F(SameScan, IsTheSameToothBitByBit) {
  // Spacing and origin in binary fractions, axes along the frame's (two of them exchanged, one
  // turned): every format holds them exactly, NIfTI in single precision and DICOM in decimals too.
  Mat3 exchanged;
  exchanged << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const auto image = peg_scan({0.25, 0.3125, 0.375}, {-4.5, 10.25, -30.75}, exchanged);
  std::optional<std::string> first;
  for (const auto& name : write_all(image, folder_)) {
    const auto read = read_scan(path(name));
    EXPECT_EQ(read.origin, image.origin) << name;
    EXPECT_EQ(read.spacing, image.spacing) << name;
    EXPECT_LT((read.direction - image.direction).norm(), 1e-12) << name;
    const LayeredTooth tooth = tooth_of(path(name));
    const std::string hash = tooth_sha256(tooth);
    if (!first) {
      first = hash;
      // The peg: a cylinder of radius 3.2 mm and 7 mm between two half balls. A surface of voxels
      // of 0.25 mm under a blur of 0.2 mm loses or gains less than 2 %.
      const double peg = M_PI * 3.2 * 3.2 * 7 + 4.0 / 3 * M_PI * std::pow(3.2, 3);
      EXPECT_NEAR(volume_mm3(tooth.solid, 0.25), peg, 0.02 * peg);
    }
    EXPECT_EQ(hash, *first) << name;
  }
}

TEST(WideVectors, GiveTheSameToothBitByBit) {
  const auto scan = phantom::scan_of(phantom::peg(), Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5),
                                     phantom::Scanner());
  VoxelizeOptions options;
  options.voxel = 0.14;
  const std::string wide = tooth_sha256(voxelize_scan(scan, options));
  wide_vectors_allowed = false;
  const std::string narrow = tooth_sha256(voxelize_scan(scan, options));
  wide_vectors_allowed = true;
  EXPECT_EQ(wide, narrow);
}

TEST_F(SameScan, ObliqueAndAnisotropicIsTheSameToothWithinTheFormatsPrecision) {
  const auto image = peg_scan({0.21, 0.3, 0.37}, {-4.1, 10.7, -33.3}, oblique());
  std::optional<LayeredTooth> first;
  std::optional<std::string> first_hash;
  for (const auto& name : write_all(image, folder_)) {
    SCOPED_TRACE(name);
    const LayeredTooth tooth = tooth_of(path(name));
    if (!first) {
      first = tooth;
      first_hash = tooth_sha256(tooth);
      continue;
    }
    // NRRD's and MetaImage's text by hand is exact to the last bit; what ITK writes is so only to
    // about 1e-6 (the direction is divided by the spacing and multiplied again), and NIfTI's matrix
    // is single precision: 33 mm * 6e-8 = 2e-6 mm for the origin, and the axes' 6e-8 over 16 mm.
    // A surface shifts by no more than the sum.
    double worst = 0;
    std::size_t values = 0, other_tissue = 0;
    ASSERT_EQ(tooth.solid.table_size(), first->solid.table_size());
    for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
      const Index3 i = tooth.solid.brick_origin(b);
      for (int v = 0; v < kBrickVoxels; ++v, ++values) {
        const Index3 j = i + Index3(v >> 6, (v >> 3) & 7, v & 7);
        worst = std::max<double>(worst, std::abs(tooth.solid.value(j.x(), j.y(), j.z()) -
                                                 first->solid.value(j.x(), j.y(), j.z())));
        other_tissue +=
            tooth.tissue.value(j.x(), j.y(), j.z()) != first->tissue.value(j.x(), j.y(), j.z()) ? 1
                                                                                                : 0;
      }
    }
    RecordProperty(name + "_worst_mm", std::to_string(worst));
    EXPECT_LT(worst, 1e-4);
    EXPECT_LT(static_cast<double>(other_tissue), 1e-4 * static_cast<double>(values));
    const auto volumes = remaining_volumes_mm3(tooth), expected = remaining_volumes_mm3(*first);
    for (std::size_t t = 0; t < volumes.size(); ++t)
      EXPECT_NEAR(volumes[t], expected[t], 1e-3 * (expected[t] + 1));
    const Box bounds = bounds_of_solid(tooth), there = bounds_of_solid(*first);
    EXPECT_LT((bounds.min - there.min).norm(), 1e-4);
    EXPECT_LT((bounds.max - there.max).norm(), 1e-4);
    if (tooth_sha256(tooth) != *first_hash) RecordProperty(name + "_bits", "differ");
  }
}

}  // namespace
}  // namespace toothprep
