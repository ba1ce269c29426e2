#include <signal.h>
#include <sys/resource.h>
#include <zlib.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "../../support/phantom.h"
#include "../../support/scan_files.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/scan_files/image_file.h"
#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {
namespace {

using ImageFile = ScanFiles;

TEST_F(ImageFile, EachFormatKeepsValuesAndPlace) {
  Mat3 exchanged;
  exchanged << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  for (const Mat3& direction : {Mat3(Mat3::Identity()), exchanged, oblique()}) {
    const auto image = some_image(direction);
    for (const char* name : {"a.nrrd", "a.nii", "a.nii.gz", "a.mha"}) {
      SCOPED_TRACE(name);
      write_image(image, path(name));
      expect_same(read_scan(path(name)), image, 2e-6);  // NIfTI holds its matrix as float
    }
    fs::remove_all(folder_ / "series");
    fs::create_directories(folder_ / "series");
    write_dicom_series(image, path("series"));
    expect_same(read_scan(path("series")), image, 1e-6);
  }
}

// ---- The forms of the formats that write_image doesn't write, by hand.

std::string raw_of(const ImageVolume<std::int16_t>& image, std::endian order) {
  std::string bytes;
  for (const std::int16_t value : image.data) {
    const auto v = static_cast<std::uint16_t>(value);
    const char low = static_cast<char>(v & 255), high = static_cast<char>(v >> 8);
    bytes += order == std::endian::little ? low : high;
    bytes += order == std::endian::little ? high : low;
  }
  return bytes;
}

std::string gzipped(const std::string& plain) {
  z_stream stream{};
  deflateInit2(&stream, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&stream, plain.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(plain.data()));
  stream.avail_in = static_cast<uInt>(plain.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

std::string text_of(const Vec3& v, const char* separator) {
  std::ostringstream text;
  text.precision(17);
  text << v.x() << separator << v.y() << separator << v.z();
  return text.str();
}

std::string nrrd_header(const ImageVolume<std::int16_t>& image, const std::string& encoding,
                        const std::string& endian, const std::string& data_file) {
  std::string text =
      "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: " +
      std::to_string(image.size.x()) + " " + std::to_string(image.size.y()) + " " +
      std::to_string(image.size.z()) + "\nspace directions:";
  for (int a = 0; a < 3; ++a)
    text += " (" + text_of(image.direction.col(a) * image.spacing[a], ",") + ")";
  text += "\nspace origin: (" + text_of(image.origin, ",") + ")\nencoding: " + encoding +
          "\nendian: " + endian + "\n";
  if (!data_file.empty()) text += "data file: " + data_file + "\n";
  return text + (data_file.empty() ? "\n" : "");
}

std::string meta_header(const ImageVolume<std::int16_t>& image, bool big, const std::string& data) {
  std::string matrix;  // its rows are the image's axes
  for (int a = 0; a < 3; ++a) matrix += " " + text_of(image.direction.col(a), " ");
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = " +
         std::string(big ? "True" : "False") +
         "\nCompressedData = False\nTransformMatrix =" + matrix +
         "\nOffset = " + text_of(image.origin, " ") +
         "\nElementSpacing = " + text_of(image.spacing, " ") + "\nDimSize = 7 5 6\n" +
         "ElementType = MET_SHORT\nElementDataFile = " + data + "\n";
}

TEST_F(ImageFile, EveryFormOfEveryFormatIsTheSameVolume) {
  const auto image = some_image(oblique());
  const std::string little = raw_of(image, std::endian::little),
                    big = raw_of(image, std::endian::big);
  write("little.raw", little);
  write("big.raw", big);
  write("little.raw.gz", gzipped(little));
  write("attached.nrrd", nrrd_header(image, "raw", "little", "") + little);
  write("big.nrrd", nrrd_header(image, "raw", "big", "") + big);
  write("gzip.nrrd", nrrd_header(image, "gzip", "little", "") + gzipped(little));
  write("biggzip.nrrd", nrrd_header(image, "gzip", "big", "") + gzipped(big));
  write("detached.nhdr", nrrd_header(image, "raw", "little", "little.raw"));
  write("bigdetached.nhdr", nrrd_header(image, "raw", "big", "big.raw"));
  write("gzdetached.nhdr", nrrd_header(image, "gzip", "little", "little.raw.gz"));
  write("local.mha", meta_header(image, false, "LOCAL") + little);
  write("biglocal.mha", meta_header(image, true, "LOCAL") + big);
  write("detached.mhd", meta_header(image, false, "little.raw"));
  write("bigdetached.mhd", meta_header(image, true, "big.raw"));
  write_image(image, path("ours.nii"));
  write_image(image, path("ours.nii.gz"));
  fs::create_directories(folder_ / "series");
  write_dicom_series(image, path("series"));
  for (const char* name :
       {"attached.nrrd", "big.nrrd", "gzip.nrrd", "biggzip.nrrd", "detached.nhdr",
        "bigdetached.nhdr", "gzdetached.nhdr", "local.mha", "biglocal.mha", "detached.mhd",
        "bigdetached.mhd", "ours.nii", "ours.nii.gz", "series"}) {
    SCOPED_TRACE(name);
    expect_same(read_scan(path(name)), image, 2e-6);  // NIfTI holds its matrix as float
  }
  // A detached file's content counts in its hash; a truncated or absent one is refused.
  const std::string before = sha256_of_scan(path("detached.mhd"));
  std::string other = little;
  other[0] = static_cast<char>(other[0] ^ 1);
  write("little.raw", other);
  EXPECT_NE(sha256_of_scan(path("detached.mhd")), before);
  truncate("little.raw", 0.9);
  truncate("little.raw.gz", 0.9);
  EXPECT_THAT(refusal(path("detached.nhdr")), HasSubstr("the header promises"));
  EXPECT_THAT(refusal(path("detached.mhd")), HasSubstr("the header promises"));
  EXPECT_THAT(refusal(path("gzdetached.nhdr")), HasSubstr("the header promises"));
  fs::remove(path("little.raw"));
  EXPECT_THAT(refusal(path("detached.mhd")), HasSubstr("does not exist"));
}

TEST_F(ImageFile, TheSameImageGivesTheSameBytes) {
  const auto image = some_image(oblique());
  for (const char* name : {"a.nrrd", "a.nii.gz", "a.mha"}) {
    write_image(image, path(name));
    const std::string first = bytes_of(path(name));
    fs::remove(path(name));
    write_image(image, path(name));
    EXPECT_EQ(first, bytes_of(path(name))) << name;
  }
  for (const char* series : {"one", "two"}) {
    fs::create_directories(folder_ / series);
    write_dicom_series(image, path(series));
  }
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder_ / "one")) {
    EXPECT_EQ(bytes_of(entry.path().string()),
              bytes_of((folder_ / "two" / entry.path().filename()).string()));
    ++files;
  }
  EXPECT_EQ(files, 6u);
  EXPECT_EQ(sha256_of_scan(path("one")), sha256_of_scan(path("two")));
  // Another image has other UIDs.
  auto other = image;
  other.data[5] ^= 1;
  write_dicom_series(other, path("two"));
  EXPECT_NE(sha256_of_scan(path("one")), sha256_of_scan(path("two")));
}

TEST_F(ImageFile, AFullDiskIsAnErrorInEveryFormat) {
  const auto image = some_image();
  signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  for (const char* name : {"a.nrrd", "a.nii", "a.nii.gz", "a.mha", "series"})
    for (const rlim_t size : {0, 1, 200, 351}) {
      fs::create_directory(path("series"));
      const rlimit limit{size, before.rlim_max};
      setrlimit(RLIMIT_FSIZE, &limit);
      const auto write = [&] {
        name == std::string("series") ? write_dicom_series(image, path(name))
                                      : write_image(image, path(name));
      };
      EXPECT_THROW(write(), Error) << name << " of at most " << size << " bytes";
      setrlimit(RLIMIT_FSIZE, &before);
    }
}

TEST_F(ImageFile, SlicesAreOrderedByPositionWhateverTheirNames) {
  const auto image = some_image();
  write_dicom_series(image, path(""));
  // Turn the order of names around.
  for (int k = 0; k < 6; ++k)
    fs::rename(folder_ / ("slice_000" + std::to_string(k + 1) + ".dcm"),
               folder_ / ("x" + std::to_string(9 - k) + ".dcm"));
  write("notes.txt", "not a slice");
  expect_same(read_scan(path("")), image, 1e-6);
}

TEST_F(ImageFile, SpacingGivenReplacesTheFilesAndScalesItsOrigin) {
  const auto image = some_image(oblique());
  write_image(image, path("a.nrrd"));
  const auto read = read_scan(path("a.nrrd"), {{0.1, 0.3, 0.9}});
  EXPECT_EQ(read.spacing, Vec3(0.1, 0.3, 0.9));
  // The first voxel is as many voxels from the frame's zero as before, along each axis.
  const Vec3 before = (image.direction.transpose() * image.origin).cwiseQuotient(image.spacing);
  const Vec3 after = (read.direction.transpose() * read.origin).cwiseQuotient(read.spacing);
  EXPECT_LT((before - after).norm(), 1e-4);
  // An absurd spacing in the file does not matter then, but it does without.
  auto absurd = image;
  absurd.spacing = Vec3::Constant(34);
  write_image(absurd, path("b.nrrd"));
  EXPECT_THAT(refusal(path("b.nrrd")), HasSubstr("--spacing-mm"));
  EXPECT_EQ(read_scan(path("b.nrrd"), {{0.1, 0.1, 0.1}}).spacing, Vec3::Constant(0.1));
  EXPECT_THAT(refusal(path("b.nrrd"), with_spacing(0.1, 0.1, 9.0)),
              HasSubstr("outside 0.001 .. 5 mm"));
  EXPECT_THAT(refusal(path("b.nrrd"), with_spacing(0.1, 0.1, NAN)),
              HasSubstr("outside 0.001 .. 5 mm"));
}

// ---- NRRD by hand: space, units, encoding.

std::string nrrd(const std::string& fields, int values, const std::string& type = "short") {
  std::string text =
      "NRRD0004\ntype: " + type + "\nencoding: raw\nendian: little\n" + fields + "\n\n";
  if (type == "float") {
    for (int v = 0; v < values; ++v) {
      const auto f = static_cast<float>(v);
      text.append(reinterpret_cast<const char*>(&f), 4);
    }
    return text;
  }
  for (int v = 0; v < values; ++v) {
    text += static_cast<char>(v & 255);
    text += static_cast<char>(v >> 8);
  }
  return text;
}

const std::string k234 = "dimension: 3\nsizes: 2 3 4\n";

TEST_F(ImageFile, OtherSpacesAndUnitsBecomeLpsMillimetres) {
  // RAS: x and y change sign.
  auto read = read_scan(
      write("ras.nrrd", nrrd(k234 + "space: right-anterior-superior\nspace directions: "
                                    "(0.1,0,0) (0,0.2,0) (0,0,0.3)\nspace origin: (1,2,3)",
                             24)));
  EXPECT_LT((read.to_world(Vec3(1, 1, 1)) - Vec3(-1.1, -2.2, 3.3)).norm(), 1e-6);
  read = read_scan(write(
      "um.nrrd", nrrd(k234 + "space: left-posterior-superior\nspace units: \"um\" \"um\" "
                             "\"um\"\nspace directions: (34,0,0) (0,34,0) (0,0,34)\nspace origin: "
                             "(1000,0,0)",
                      24)));
  EXPECT_LT((read.spacing - Vec3::Constant(0.034)).norm(), 1e-9);
  EXPECT_LT((read.origin - Vec3(1, 0, 0)).norm(), 1e-9);
}

TEST_F(ImageFile, RefusesWhatCannotBeAScan) {
  const std::string spacing = "spacings: 0.1 0.1 0.1";
  EXPECT_THAT(refusal(path("absent.nrrd")), HasSubstr("does not exist"));
  EXPECT_THAT(refusal(write("empty.nrrd", "")), HasSubstr("is empty"));
  EXPECT_THAT(refusal(write("scan.txt", "hello")), HasSubstr("not a scan format that is known"));
  EXPECT_THAT(refusal(write("garbage.nrrd", "garbage\n\nmore")),
              HasSubstr("cannot be read as NRRD"));
  EXPECT_THAT(refusal(write("garbage.nii", std::string(400, 'x'))),
              HasSubstr("cannot be read as NIfTI"));
  EXPECT_THAT(refusal(write("garbage.nii.gz", "garbage")), HasSubstr("cannot be read as NIfTI"));
  EXPECT_THAT(refusal(write("garbage.mha", "garbage")), HasSubstr("is no line of such a header"));
  EXPECT_THAT(refusal(write("flat.nrrd", nrrd("dimension: 2\nsizes: 4 6\nspacings: 0.1 0.1", 24))),
              HasSubstr("is not a volume"));
  EXPECT_THAT(refusal(write("thin.nrrd", nrrd("dimension: 3\nsizes: 4 6 1\n" + spacing, 24))),
              HasSubstr("is not a volume"));
  EXPECT_THAT(refusal(write("time.nrrd",
                            nrrd("dimension: 4\nsizes: 2 2 2 3\nspacings: 0.1 0.1 0.1 1", 24))),
              HasSubstr("has four dimensions (3 volumes)"));
  EXPECT_THAT(
      refusal(write("colour.nrrd", nrrd("dimension: 4\nsizes: 3 2 2 2\nkinds: RGB-color domain "
                                        "domain domain\nspacings: nan 0.1 0.1 0.1",
                                        24))),
      HasSubstr("components per voxel"));
  EXPECT_THAT(refusal(write("big.nrrd",
                            nrrd("dimension: 3\nsizes: 1000000 1000000 1000000\n" + spacing, 24))),
              HasSubstr("the header promises"));
  EXPECT_THAT(
      refusal(write("lie.nrrd", nrrd("dimension: 3\nsizes: 1000 1000 1000\n" + spacing, 24))),
      HasSubstr("the header promises"));
  EXPECT_THAT(refusal(write("short.nrrd", nrrd("dimension: 3\nsizes: 2 3 5\n" + spacing, 24))),
              HasSubstr("the header promises 60 bytes, the file holds 48"));
  std::string nan = nrrd(k234 + spacing, 24, "float");
  const float not_a_number = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(nan.data() + nan.size() - 8, &not_a_number, 4);
  EXPECT_THAT(refusal(write("nan.nrrd", nan)), HasSubstr("1 of 24 values are not finite"));
  EXPECT_THAT(refusal(write("unit.nrrd",
                            nrrd(k234 + "space: left-posterior-superior\nspace units: \"ly\" "
                                        "\"ly\" \"ly\"\nspace directions: (1,0,0) (0,1,0) (0,0,1)",
                                 24))),
              HasSubstr("the unit 'ly' is not known"));
  EXPECT_THAT(
      refusal(write("detached.nhdr", "NRRD0004\ntype: short\nencoding: raw\nendian: little\n" +
                                         k234 + spacing + "\ndata file: nowhere.raw\n")),
      HasSubstr("nowhere.raw: does not exist"));
}

TEST_F(ImageFile, OneComponentOrVolumeIsChosenOnDemand) {
  const auto component = [](int c) {
    ScanReadOptions options;
    options.component = c;
    return options;
  };
  // Interleaved: voxel v's component c is 3 v + c.
  const std::string colour =
      write("colour.nrrd", nrrd("dimension: 4\nsizes: 3 2 3 4\nkinds: RGB-color domain domain "
                                "domain\nspace: left-posterior-superior\nspace directions: none "
                                "(0.1,0,0) (0,0.2,0) (0,0,0.3)\nspace origin: (1,2,3)",
                                72));
  EXPECT_THAT(refusal(colour), testing::AllOf(HasSubstr("has 3 components per voxel"),
                                              HasSubstr("--component (1 .. 3)")));
  for (int c = 1; c <= 3; ++c) {
    const auto read = read_scan(colour, component(c));
    ASSERT_EQ(read.size, Index3(2, 3, 4));
    EXPECT_LT((read.spacing - Vec3(0.1, 0.2, 0.3)).norm(), 1e-9);
    EXPECT_LT((read.origin - Vec3(1, 2, 3)).norm(), 1e-9);
    for (std::size_t v = 0; v < 24; ++v) EXPECT_EQ(read.data[v], 3 * static_cast<int>(v) + c - 1);
  }
  EXPECT_THAT(refusal(colour, component(0)), HasSubstr("there is no component 0"));
  EXPECT_THAT(refusal(colour, component(4)), HasSubstr("there is no component 4"));
  truncate("colour.nrrd", 0.9);
  EXPECT_THAT(refusal(colour, component(1)), HasSubstr("the header promises"));

  // Volumes one after the other: value 24 t + v.
  const std::string time =
      write("time.nrrd", nrrd("dimension: 4\nsizes: 2 3 4 3\nspacings: 0.1 0.2 0.3 1", 72));
  EXPECT_THAT(refusal(time), HasSubstr("has four dimensions (3 volumes)"));
  const auto second = read_scan(time, component(2));
  ASSERT_EQ(second.size, Index3(2, 3, 4));
  EXPECT_LT((second.spacing - Vec3(0.1, 0.2, 0.3)).norm(), 1e-9);
  for (std::size_t v = 0; v < 24; ++v) EXPECT_EQ(second.data[v], 24 + static_cast<int>(v));
  EXPECT_EQ(read_label_image(time, component(3)).data[5], 53);

  // A NIfTI file with a fourth dimension: the written header's, changed (dim[0], dim[3], dim[4]).
  write_image(some_image(), path("a.nii"));
  std::string bytes = bytes_of(path("a.nii"));
  bytes[40] = 4, bytes[46] = 3, bytes[48] = 2;
  write("time.nii", bytes);
  EXPECT_THAT(refusal(path("time.nii")), HasSubstr("has four dimensions (2 volumes)"));
  const auto later = read_scan(path("time.nii"), component(2));
  ASSERT_EQ(later.size, Index3(7, 5, 3));
  EXPECT_LT((later.origin - some_image().origin).norm(), 2e-4);
  EXPECT_TRUE(std::equal(later.data.begin(), later.data.end(), some_image().data.begin() + 105));

  const std::string grey = write("grey.nrrd", nrrd(k234 + "spacings: 0.1 0.1 0.1", 24));
  EXPECT_EQ(read_scan(grey, component(1)).data[3], 3);
  EXPECT_THAT(refusal(grey, component(2)), HasSubstr("has one grey value per voxel"));
  ScanReadOptions series;
  series.series = "1";
  EXPECT_THAT(refusal(grey, series), HasSubstr("folder of DICOM files"));
}

TEST_F(ImageFile, RefusesTruncatedFilesOfEveryFormat) {
  ImageVolume<std::int16_t> image;
  image.size = Index3(40, 40, 40);
  image.spacing = Vec3::Constant(0.2);
  std::uint32_t random = 1;
  for (int v = 0; v < 64000; ++v)
    image.data.push_back(
        static_cast<std::int16_t>((random = random * 1664525u + 1013904223u) >> 20));
  // Of names of their own: NIfTI's library takes a.nii for a.nii.gz where both are.
  for (const char* name : {"a.nrrd", "b.nii", "c.nii.gz", "d.mha"})
    for (const double share : {0.99, 0.5, 0.1, 0.003}) {
      write_image(image, path(name));
      ASSERT_EQ(read_scan(path(name)).data.size(), 64000u);
      truncate(name, share);
      EXPECT_NE(refusal(path(name)), "no error") << name << " " << share;
    }
}

TEST_F(ImageFile, RefusesSeriesThatAreNotOneRegularVolume) {
  const auto image = some_image();
  const auto fresh = [&] {
    for (const auto& entry : fs::directory_iterator(folder_)) fs::remove_all(entry.path());
    write_dicom_series(image, path(""));
  };
  EXPECT_THAT(refusal(path("")), HasSubstr("holds no DICOM slices"));

  fresh();
  fs::remove(path("slice_0003.dcm"));
  EXPECT_THAT(refusal(path("")), HasSubstr("slice_0002.dcm and slice_0004.dcm: are 0.9 mm apart"));

  fresh();
  fs::copy_file(path("slice_0003.dcm"), path("again.dcm"));
  EXPECT_THAT(refusal(path("")), HasSubstr("lie at the same position"));

  fresh();
  auto other = image;
  other.data[0] ^= 1;
  fs::create_directories(folder_ / "other");
  write_dicom_series(other, path("other"));
  fs::rename(path("other/slice_0002.dcm"), path("stray.dcm"));
  EXPECT_THAT(refusal(path("")), testing::AllOf(HasSubstr("holds 2 series"),
                                                HasSubstr("(6 slices)"), HasSubstr("(1 slices)")));

  fresh();
  truncate("slice_0004.dcm", 0.95);
  EXPECT_THAT(refusal(path("")), HasSubstr("slice_0004.dcm"));

  fresh();
  for (int k = 2; k <= 6; ++k) fs::remove(path("slice_000" + std::to_string(k) + ".dcm"));
  EXPECT_THAT(refusal(path("")), HasSubstr("is not a volume"));
  EXPECT_THAT(refusal(path("slice_0001.dcm")), HasSubstr("give the folder that holds the series"));
}

TEST_F(ImageFile, LabelsMustBeIntegers) {
  write("half.nrrd", nrrd(k234 + "spacings: 0.1 0.1 0.1", 24));
  EXPECT_EQ(read_label_image(path("half.nrrd")).data[7], 7);
  ImageVolume<std::int16_t> negative = some_image();
  write_image(negative, path("grey.nrrd"));
  try {
    static_cast<void>(read_label_image(path("grey.nrrd")));
    FAIL() << "no error";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("which is no label"));
  }
}

TEST_F(ImageFile, RefusesToWriteOtherFormats) {
  for (const char* name : {"a.png", "a.mhd", "a.nhdr", "a"})
    EXPECT_THROW(write_image(some_image(), path(name)), InputError) << name;
  EXPECT_THROW(write_image(ImageVolume<std::int16_t>(), path("a.nrrd")), Error);
}

TEST_F(ImageFile, TheSameScanInEveryFormatIsTheSameToothInTheSamePlace) {
  phantom::Scanner scanner;
  scanner.noise = 3;
  scanner.direction = oblique();
  const auto scan =
      phantom::scan_of(phantom::peg(), Vec3(-4.5, -4.5, -10.5), Vec3(4.5, 4.5, 5.5), scanner);
  ImageVolume<std::int16_t> image;
  image.size = scan.size;
  image.spacing = scan.spacing;
  image.origin = scan.origin;
  image.direction = scan.direction;
  for (const float v : scan.data) image.data.push_back(static_cast<std::int16_t>(std::lround(v)));
  VoxelizeOptions options;
  options.voxel = 0.2;
  fs::create_directories(folder_ / "series");
  write_dicom_series(image, path("series"));
  std::optional<LayeredTooth> first;
  for (const char* name : {"a.nrrd", "a.nii.gz", "a.mha", "series"}) {
    if (std::string(name) != "series") write_image(image, path(name));
    const LayeredTooth tooth = voxelize_scan(read_scan(path(name)), options);
    if (!first) {
      first = tooth;
      // Where the phantom is: the crown's top at z = 4.2, the root's end at -9.2.
      const Box bounds = bounds_of_solid(tooth);
      EXPECT_NEAR(bounds.max.z(), 4.2, 0.2);
      EXPECT_NEAR(bounds.min.z(), -9.2, 0.2);
      continue;
    }
    // Origins differ in the sixth digit.
    double worst = 0;
    for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
      const Index3 i = tooth.solid.brick_origin(b);
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 j = i + Index3(v >> 6, (v >> 3) & 7, v & 7);
        worst = std::max<double>(worst, std::abs(tooth.solid.value(j.x(), j.y(), j.z()) -
                                                 first->solid.value(j.x(), j.y(), j.z())));
      }
    }
    EXPECT_LT(worst, 0.002) << name;
  }
}

}  // namespace
}  // namespace toothprep
