// Scans read in pieces: the same values whatever the pieces, and damage reported when it is met.
#include <zlib.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "../../support/scan_files.h"
#include "toothprep/tools/scan_files/byte_stream.h"
#include "toothprep/tools/segmentation/block_means.h"
#include "toothprep/tools/segmentation/scan_survey.h"

namespace toothprep {
namespace {

class ScanSources : public ScanFiles {};

// Larger than one piece of any buffer along the way would hold at once.
ImageVolume<std::int16_t> long_image() {
  ImageVolume<std::int16_t> image = some_image();
  image.size = Index3(40, 30, 200);
  image.data.clear();
  for (int v = 0; v < 240000; ++v)
    image.data.push_back(static_cast<std::int16_t>(7919LL * v * v % 4001 - 1024));
  return image;
}

TEST_F(ScanSources, GiveTheSameSlicesInAnyOrderFromEveryFormat) {
  const auto image = long_image();
  fs::create_directories(path("series"));
  write_dicom_series(image, path("series"));
  for (const char* name : {"a.nrrd", "a.mha", "a.nii", "a.nii.gz"}) write_image(image, path(name));
  for (const char* name : {"a.nrrd", "a.mha", "a.nii", "a.nii.gz", "series"}) {
    const auto source = open_scan(path(name));
    ASSERT_EQ(source->frame().size, image.size) << name;
    std::vector<float> slices(1200 * 7);
    for (const int first : {0, 7, 150, 193, 3, 3, 120}) {  // upwards, skipping, and back
      source->read(first, 7, slices.data());
      EXPECT_TRUE(std::equal(slices.begin(), slices.end(), image.data.begin() + 1200 * first))
          << name << " from slice " << first;
    }
  }
}

TEST_F(ScanSources, GiveThePartThatIsAskedFor) {
  const auto image = long_image();
  fs::create_directories(path("series"));
  write_dicom_series(image, path("series"));
  for (const char* name : {"a.nrrd", "a.mha", "a.nii", "a.nii.gz"}) write_image(image, path(name));
  const VoxelRange part{Index3(3, 5, 20), Index3(33, 28, 24)};
  for (const char* name : {"a.nrrd", "a.mha", "a.nii", "a.nii.gz", "series"}) {
    const auto source = open_scan(path(name));
    EXPECT_LE(source->whole_up_to(), 65536) << name;
    std::vector<float> values(static_cast<std::size_t>(part.size().prod()));
    source->read_part(part, values.data());
    std::size_t v = 0;
    for (int k = part.first.z(); k <= part.last.z(); ++k)
      for (int j = part.first.y(); j <= part.last.y(); ++j)
        for (int i = part.first.x(); i <= part.last.x(); ++i)
          ASSERT_EQ(values[v++], image.at(i, j, k)) << name;
  }
}

TEST_F(ScanSources, RescaledNiftiHasItsSlopeAndIntercept) {
  const auto image = some_image();
  write_image(image, path("a.nii"));
  std::string bytes = bytes_of(path("a.nii"));
  const float slope = 0.5f, intercept = -100.25f;
  std::memcpy(bytes.data() + 112, &slope, 4);
  std::memcpy(bytes.data() + 116, &intercept, 4);
  EXPECT_FALSE(std::isfinite(open_scan(write("b.nii", bytes))->whole_up_to()));
  const auto read = read_scan(path("b.nii"));
  for (std::size_t v = 0; v < read.data.size(); ++v)
    ASSERT_EQ(read.data[v], 0.5f * static_cast<float>(image.data[v]) - 100.25f);
}

std::string deflated(const std::string& plain, int window) {
  z_stream z{};
  deflateInit2(&z, 6, Z_DEFLATED, window, 8, Z_DEFAULT_STRATEGY);
  std::string packed(plain.size() + 1000, '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(plain.data()));
  z.avail_in = static_cast<uInt>(plain.size());
  z.next_out = reinterpret_cast<Bytef*>(packed.data());
  z.avail_out = static_cast<uInt>(packed.size());
  deflate(&z, Z_FINISH);
  packed.resize(z.total_out);
  deflateEnd(&z);
  return packed;
}

std::string numbers() {
  std::string plain;
  for (int v = 0; v < 300000; ++v) plain += static_cast<char>(v * 31 % 251);
  return plain;
}

TEST_F(ScanSources, BytesAreTheSamePackedByZlibByGzipAndInSeveralMembers) {
  const std::string plain = numbers();
  constexpr int kZlib = 15, kGzip = 31;
  const std::string files[] = {write("plain", "head" + plain),
                               write("zlib", "head" + deflated(plain, kZlib)),
                               write("gzip", "head" + deflated(plain, kGzip)),
                               write("two", "head" + deflated(plain.substr(0, 1000), kGzip) +
                                                deflated(plain.substr(1000), kGzip))};
  for (const auto& file : files) {
    image::ByteStream stream(file, 4, file != files[0]);
    std::string part(5000, '\0');
    for (const std::size_t at : {0u, 999u, 200000u, 10u, 295000u}) {
      ASSERT_TRUE(stream.read(at, part.size(), part.data())) << file;
      EXPECT_EQ(part, plain.substr(at, part.size())) << file << " at " << at;
    }
    using State = image::ByteStream::State;
    EXPECT_EQ(stream.read_to_end(plain.size()), State::kWhole);
    if (stream.deflated()) {
      EXPECT_EQ(stream.read_to_end(plain.size() - 1), State::kTooLong);
      EXPECT_EQ(stream.read_to_end(plain.size() + 1), State::kTooShort);
    }
    EXPECT_FALSE(stream.read(295001, part.size(), part.data())) << "beyond the end of " << file;
  }
}

TEST_F(ScanSources, AChecksumThatFailsIsFound) {
  std::string packed = deflated(numbers(), 31);
  packed[packed.size() - 6] ^= 1;  // of the checksum itself: all bytes are there and right
  std::string part(300000, '\0');
  image::ByteStream stream(write("gzip", packed), 0, true);
  EXPECT_TRUE(stream.read(0, part.size(), part.data()));
  EXPECT_EQ(stream.read_to_end(part.size()), image::ByteStream::State::kDamaged);
}

TEST_F(ScanSources, AChecksumThatIsCutOffIsMissed) {
  const std::string packed = deflated(numbers(), 31);
  image::ByteStream stream(write("gzip", packed.substr(0, packed.size() - 8)), 0, true);
  EXPECT_EQ(stream.read_to_end(300000), image::ByteStream::State::kTooShort);
}

TEST_F(ScanSources, DamagedCompressedVoxelsAreAnErrorAndNotOtherVoxels) {
  write_image(long_image(), path("a.nii.gz"));
  std::string bytes = bytes_of(path("a.nii.gz"));
  bytes[bytes.size() / 2] ^= 4;
  EXPECT_THAT(refusal(write("b.nii.gz", bytes)),
              testing::AnyOf(HasSubstr("damaged"), HasSubstr("truncated")));
}

TEST(BlockMeans, AreMeansInPlaceHoweverSlicesComeGrouped) {
  ImageVolume<float> scan;
  scan.size = Index3(11, 9, 13);
  scan.spacing = Vec3(0.1, 0.2, 0.3);
  scan.origin = Vec3(5, -6, 7);
  scan.direction = oblique();
  // Linear in place, so that a block's mean is the value at its centre.
  for (int k = 0; k < 13; ++k)
    for (int j = 0; j < 9; ++j)
      for (int i = 0; i < 11; ++i)
        scan.data.push_back(static_cast<float>(scan.to_world(Vec3(i, j, k)).dot(Vec3(1, 2, -1))));
  const VoxelRange part{Index3(1, 2, 3), Index3(9, 8, 11)};
  ImageVolume<float> first;
  for (const int group : {1, 4, 13}) {
    BlockMeans means(scan, part, Index3(2, 3, 4), std::numeric_limits<double>::infinity());
    const auto source = source_of(scan);
    for (int k = part.first.z(); k <= part.last.z(); k += group) {
      VoxelRange slices = part;
      slices.first.z() = k;
      slices.last.z() = std::min(k + group - 1, part.last.z());
      std::vector<float> values(static_cast<std::size_t>(slices.size().prod()));
      source->read_part(slices, values.data());
      means.add(k, slices.size().z(), values.data());
    }
    const ImageVolume<float> coarse = means.take();
    ASSERT_EQ(coarse.size, Index3(4, 2, 2));
    for (int k = 0; k < 2; ++k)
      for (int j = 0; j < 2; ++j)
        for (int i = 0; i < 4; ++i)
          EXPECT_NEAR(coarse.at(i, j, k), coarse.to_world(Vec3(i, j, k)).dot(Vec3(1, 2, -1)), 1e-5);
    if (group == 1) first = coarse;
    EXPECT_EQ(coarse.data, first.data);
  }
}

// Sums of whole numbers below 2^24 don't depend on their order.
TEST(BlockMeans, OfWholeNumbersAreTheSameInWhicheverOrder) {
  ImageVolume<float> scan;
  scan.size = Index3(23, 17, 12);
  for (std::size_t v = 0; v < scan.voxels(); ++v)
    scan.data.push_back(static_cast<float>(v * 7919 % 65536) - 32768);
  for (const Index3& block : {Index3(2, 2, 2), Index3(1, 3, 2), Index3(6, 6, 6)}) {
    std::array<std::vector<float>, 2> means;
    for (std::size_t n = 0; n < 2; ++n) {
      BlockMeans of(scan, whole_of(scan), block,
                    n == 0 ? 32768 : std::numeric_limits<double>::infinity());
      of.add(0, scan.size.z(), scan.data.data());
      means[n] = of.take().data;
    }
    EXPECT_EQ(means[0], means[1]);
  }
}

TEST(ScanSurvey, ASecondPassOverAPartGivesTheSameGreys) {
  ImageVolume<float> scan;
  scan.size = Index3(30, 20, 25);
  scan.spacing = Vec3(0.04, 0.05, 0.1);
  for (int v = 0; v < 15000; ++v) scan.data.push_back(static_cast<float>(v * 37 % 1009));
  const auto source = source_of(scan);
  const auto seen = survey(*source, 0.1, {});
  ASSERT_TRUE(seen.greys);
  EXPECT_EQ(seen.greys->size, Index3(15, 20, 25));  // two voxels of 0.04 mm fit into 0.1 mm
  EXPECT_EQ(seen.highest, 1008);
  const VoxelRange part{Index3(4, 3, 2), Index3(23, 17, 20)};
  const auto again = greys_of(*source, 0.1, part, {});
  ASSERT_EQ(again.size, Index3(10, 15, 19));
  for (int k = 0; k < 19; ++k)
    for (int j = 0; j < 15; ++j)
      for (int i = 0; i < 10; ++i)
        EXPECT_EQ(again.at(i, j, k), seen.greys->at(i + 2, j + 3, k + 2));
  EXPECT_LT((again.origin - seen.greys->to_world(Vec3(2, 3, 2))).norm(), 1e-12);
}

}  // namespace
}  // namespace toothprep
