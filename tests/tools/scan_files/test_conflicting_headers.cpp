// Headers that contradict the file or themselves: read as they stand, each of them gives another
// tooth without a word.
#include <sys/resource.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

#include "../../support/cpu_time.h"
#include "../../support/scan_files.h"
#include "toothprep/tools/segmentation/crop.h"

namespace toothprep {
namespace {

using testing::AllOf;

class ConflictingHeaders : public ScanFiles {
 protected:
  // As `bytes` of the file with a value written at a place.
  template <class T>
  static std::string with(std::string bytes, std::size_t at, T value) {
    std::memcpy(bytes.data() + at, &value, sizeof value);
    return bytes;
  }
  std::string nifti(const ImageVolume<std::int16_t>& image) const {
    write_image(image, path("sound.nii"));
    return bytes_of(path("sound.nii"));
  }
};

std::string raw_of(const ImageVolume<std::int16_t>& image) {
  return {reinterpret_cast<const char*>(image.data.data()), 2 * image.data.size()};
}

std::string nrrd(const std::string& fields, const std::string& sizes = "7 5 6") {
  return "NRRD0004\ntype: short\ndimension: 3\nsizes: " + sizes +
         "\nencoding: raw\nendian: little\n" + fields + "\n\n";
}

std::string meta(const std::string& spacing) {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
         "CompressedData = False\nElementSpacing = " +
         spacing + "\nDimSize = 7 5 6\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
}

std::string zipped(const std::string& plain) {
  z_stream z{};
  deflateInit2(&z, 6, Z_DEFLATED, 31, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&z, plain.size()), '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(plain.data()));
  z.avail_in = static_cast<uInt>(plain.size());
  z.next_out = reinterpret_cast<Bytef*>(packed.data());
  z.avail_out = static_cast<uInt>(packed.size());
  deflate(&z, Z_FINISH);
  packed.resize(z.total_out);
  deflateEnd(&z);
  return packed;
}

// ---- Spacing

TEST_F(ConflictingHeaders, ASpacingThatIsNoneIsRefusedAndNamedWhateverTheAxis) {
  const auto image = some_image();
  for (int axis = 0; axis < 3; ++axis)
    for (const std::string value : {"nan", "0", "-0.3", "inf", "-inf", "1e300", "none", "x"}) {
      SCOPED_TRACE(value + " along axis " + std::to_string(axis));
      std::string list, vectors;
      for (int a = 0; a < 3; ++a) {
        list += (a ? " " : "") + (a == axis ? value : "0.3");
        std::string vector = "(0,0,0)";
        vector[1 + 2 * static_cast<std::size_t>(a)] = '1';
        if (a == axis) vector = value == "none" ? "none" : "(" + value + "," + value + ",0)";
        vectors += (a ? " " : "") + vector;
      }
      const std::string raw = raw_of(image);
      const bool replaceable = value == "nan" || value == "-0.3" || value == "1e300";
      const auto named = HasSubstr(value == "1e300" ? "1e+300" : value);
      EXPECT_THAT(refusal(write("a.nrrd", nrrd("spacings: " + list) + raw)),
                  AllOf(named, HasSubstr(replaceable ? "--spacing-mm" : "correct that line")));
      if (value != "-0.3") {  // a direction may be negative
        EXPECT_THAT(refusal(write("b.nrrd", nrrd("space: left-posterior-superior\n"
                                                 "space directions: " +
                                                 vectors) +
                                                raw)),
                    HasSubstr(value));
      }
      const bool number = value == "0" || value == "-0.3" || value == "1e300";
      EXPECT_THAT(refusal(write("a.mha", meta(list) + raw)),
                  AllOf(named, HasSubstr(number ? "--spacing-mm" : "correct that line")));
    }
}

TEST_F(ConflictingHeaders, ALineWithAControlCharacterOrWithoutAKeyIsRefused) {
  const std::string raw = raw_of(some_image());
  const std::string sound = meta("0.3 0.3 0.3");
  for (const std::string& line : {std::string("TransformMa\0\0 = 1 0 0", 20), std::string("no key"),
                                  std::string("CenterOfRotation = 0 0 0\0", 25)}) {
    const std::size_t first = sound.find('\n') + 1;
    EXPECT_THAT(refusal(write("a.mha", std::string(sound).insert(first, line + "\n") + raw)),
                HasSubstr("line 2: is no line of such a header"));
  }
  EXPECT_THAT(refusal(write("a.nrrd", nrrd(std::string("spac\0ngs: 0.3 0.3 0.3", 21)) + raw)),
              HasSubstr("is no line of such a header"));
}

TEST_F(ConflictingHeaders, APlaceThatIsNoNumberIsRefused) {
  const std::string raw = raw_of(some_image());
  EXPECT_THAT(refusal(write("a.nrrd", nrrd("space: left-posterior-superior\n"
                                           "space directions: (1,0,0) (0,1,0) (0,0,1)\n"
                                           "space origin: (0,-1*5,2)") +
                                          raw)),
              HasSubstr("space origin: holds '-1*5' where a number has to be"));
  const std::string sound = meta("0.3 0.3 0.3");
  const std::string offset = "Offset = 0 1x 2\n";
  EXPECT_THAT(
      refusal(write("a.mha", std::string(sound).insert(sound.find('\n') + 1, offset) + raw)),
      HasSubstr("Offset: holds '1x'"));
}

TEST_F(ConflictingHeaders, ASpacingOfNiftiThatIsNoneIsRefused) {
  const std::string sound = nifti(some_image());
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const float value : {0.0f, -0.3f, std::nanf(""), INFINITY, -INFINITY}) {
      SCOPED_TRACE(std::to_string(value) + " along axis " + std::to_string(axis));
      const std::string file = write("a.nii", with(sound, 80 + 4 * axis, value));
      EXPECT_THAT(refusal(file), AllOf(HasSubstr("pixdim[" + std::to_string(axis + 1) + "]"),
                                       HasSubstr("--spacing-mm")));
      const auto read = read_scan(file, std::array<double, 3>{0.2, 0.3, 0.45});
      EXPECT_EQ(read.spacing, Vec3(0.2, 0.3, 0.45));
    }
}

TEST_F(ConflictingHeaders, TheOptionStandsForASpacingThatIsNone) {
  const auto image = some_image();
  for (const std::string value : {"0", "-0.3"}) {
    const std::string file = write("a.mha", meta("0.2 0.3 " + value) + raw_of(image));
    EXPECT_EQ(read_scan(file, std::array<double, 3>{0.2, 0.3, 0.45}).spacing, Vec3(0.2, 0.3, 0.45))
        << value;
  }
}

TEST_F(ConflictingHeaders, PixdimAgainstSformIsRefusedNamingBoth) {
  const std::string sound = nifti(some_image());
  ASSERT_GT(sound[254], 0) << "the writer sets an sform";
  EXPECT_NO_THROW(static_cast<void>(read_scan(write("same.nii", sound))));
  const std::string file = write("a.nii", with(sound, 80, 0.22f));  // 10 % more than the sform's
  EXPECT_THAT(refusal(file),
              AllOf(HasSubstr("0.22"), HasSubstr("0.2 long"), HasSubstr("--spacing-mm")));
  EXPECT_EQ(read_scan(file, std::array<double, 3>{0.2, 0.3, 0.45}).spacing, Vec3(0.2, 0.3, 0.45));
  EXPECT_NO_THROW(static_cast<void>(read_scan(write("rounded.nii", with(sound, 80, 0.2005f)))));
}

// ---- Lengths and checksums

TEST_F(ConflictingHeaders, AHeaderThatPromisesLessThanTheFileHoldsIsRefused) {
  const auto image = some_image();
  const std::string raw = raw_of(image), spacing = "spacings: 0.2 0.3 0.45";
  const auto both = AllOf(HasSubstr("350"), HasSubstr("420"));
  EXPECT_THAT(refusal(write("a.nrrd", nrrd(spacing, "7 5 5") + raw)), both);
  std::string short_meta = meta("0.2 0.3 0.45");
  short_meta.replace(short_meta.find("7 5 6"), 5, "7 5 5");
  EXPECT_THAT(refusal(write("a.mha", short_meta + raw)), both);
  const std::string sound = nifti(image);
  EXPECT_THAT(refusal(write("a.nii", with(sound, 46, std::int16_t{5}))), both);
  // Compressed, what is too much shows when the stream is read to its end.
  EXPECT_THAT(refusal(write("a.nii.gz", zipped(with(sound, 46, std::int16_t{5})))),
              AllOf(HasSubstr("350"), HasSubstr("more")));
  EXPECT_NO_THROW(static_cast<void>(read_scan(write("b.nii.gz", zipped(sound)))));
}

TEST_F(ConflictingHeaders, APartOfACompressedScanIsCheckedToTheStreamsEnd) {
  ImageVolume<std::int16_t> image = some_image();
  image.size = Index3(40, 40, 80);
  image.data.clear();
  for (int v = 0; v < 40 * 40 * 80; ++v)
    image.data.push_back(static_cast<std::int16_t>((v * 7919) % 4001 - 1024));
  std::string packed = zipped(nifti(image));
  packed[packed.size() - 6] ^= 1;  // of the checksum
  const std::string file = write("a.nii.gz", packed);
  const Box low{image.to_world(Vec3(5, 5, 5)), image.to_world(Vec3(20, 20, 10))};
  try {
    const auto part = crop(open_scan(file), low);
    static_cast<void>(read_all(*part));
    FAIL() << "the damage went unnoticed";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("compressed data is damaged"));
  }
}

// ---- Sizes

// 2000 x 2000 x 1500 voxels in a file of holes, with a block of other values in it.
TEST_F(ConflictingHeaders, OfAScanBeyondTheLimitAPartCanBeRead) {
  const std::string file = write("huge.nrrd",
                                 "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2000 2000 1500\n"
                                 "encoding: raw\nspacings: 0.01 0.01 0.01\n\n");
  const auto header = fs::file_size(file);
  fs::resize_file(file, header + 2000ull * 2000 * 1500);
  {
    std::fstream out(file, std::ios::in | std::ios::out | std::ios::binary);
    out.seekp(static_cast<std::streamoff>(header + (1000ull * 2000 + 700) * 2000 + 300));
    out.put('\x07');
  }
  EXPECT_THAT(refusal(file), AllOf(HasSubstr("2000 x 2000 x 1500"), HasSubstr("--roi")));
  auto whole = open_scan(file);
  const Box box{Vec3(2.9, 6.9, 9.9), Vec3(3.1, 7.1, 10.1)};
  const auto part = crop(std::move(whole), box);
  const auto read = read_all(*part);
  float sum = 0;
  for (const float v : read.data) sum += v;
  EXPECT_EQ(sum, 7);
  const Index3 at =
      (read.to_index() * (Vec3(3.0, 7.0, 10.0) - read.origin)).array().round().cast<int>();
  EXPECT_EQ(read.at(at.x(), at.y(), at.z()), 7);
}

TEST_F(ConflictingHeaders, GigabytesOfZerosAreRefusedAtOnceAndInLittleMemory) {
  rusage before{};
  getrusage(RUSAGE_SELF, &before);
  for (const char* name : {"a.nrrd", "a.nhdr", "a.nii", "a.nii.gz", "a.mha", "a.mhd", "a.dcm"}) {
    SCOPED_TRACE(name);
    write(name, "");
    fs::resize_file(path(name), 3ull << 30);
    const double start = cpu_seconds();
    EXPECT_NE(refusal(path(name)), "no error");
    EXPECT_LT(cpu_seconds() - start, 1);
    fs::remove(path(name));
  }
  rusage after{};
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 100'000);  // kB
}

TEST_F(ConflictingHeaders, AVolumeForWhichThereIsNoMemoryIsRefusedBeforeItIsTaken) {
#if defined(TOOTHPREP_SANITIZED)
  GTEST_SKIP() << "the sanitizer's own address space is beyond any limit";
#endif
  const std::string file = write("large.nrrd",
                                 "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1000 1000 1000\n"
                                 "encoding: raw\nspacings: 0.01 0.01 0.01\n\n");
  fs::resize_file(file, fs::file_size(file) + 1000ull * 1000 * 1000);
  rlimit old{};
  ASSERT_EQ(getrlimit(RLIMIT_AS, &old), 0);
  const rlimit small{std::uint64_t{3} << 30, old.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_AS, &small), 0);
  const std::string said = refusal(file);
  ASSERT_EQ(setrlimit(RLIMIT_AS, &old), 0);
  EXPECT_THAT(said, AllOf(HasSubstr("4.0 GB of memory"), HasSubstr("available")));
}

}  // namespace
}  // namespace toothprep
