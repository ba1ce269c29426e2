// DICOM in the forms that scanners and viewers write, made here with GDCM's writer.
#include <Eigen/Dense>

// All of Eigen stands before ITK, whose directories GDCM's headers come from.
#include <gdcmImageChangeTransferSyntax.h>
#include <gdcmImageReader.h>
#include <gdcmImageWriter.h>
#include <gdcmSequenceOfItems.h>
#include <gdcmWriter.h>

#include <cmath>
#include <cstring>
#include <functional>

#include "../../support/scan_files.h"

namespace toothprep {
namespace {

using gdcm::Tag;
using gdcm::VR;

class Dicom : public ScanFiles {
 protected:
  void fresh() const {
    for (const auto& entry : fs::directory_iterator(folder_)) fs::remove_all(entry.path());
  }
  std::string slice(int k) const { return path("slice_000" + std::to_string(k) + ".dcm"); }
};

void put(gdcm::DataSet& data, const Tag& tag, VR::VRType vr, std::string value) {
  if (value.size() % 2 != 0) value += vr == VR::UI ? '\0' : ' ';
  gdcm::DataElement element(tag);
  element.SetVR(vr);
  element.SetByteValue(value.data(), static_cast<std::uint32_t>(value.size()));
  data.Replace(element);
}

void put(gdcm::DataSet& data, const Tag& tag, int value) {
  put(data, tag, VR::US, {static_cast<char>(value & 255), static_cast<char>(value >> 8)});
}

void put(gdcm::DataSet& data, const Tag& tag, const std::vector<gdcm::DataSet>& items) {
  const auto sequence = gdcm::SmartPointer<gdcm::SequenceOfItems>(new gdcm::SequenceOfItems);
  sequence->SetLengthToUndefined();
  for (const auto& nested : items) {
    gdcm::Item item;
    item.SetVLToUndefined();
    item.SetNestedDataSet(nested);
    sequence->AddItem(item);
  }
  gdcm::DataElement element(tag);
  element.SetVR(VR::SQ);
  element.SetValue(*sequence);
  element.SetVLToUndefined();
  data.Replace(element);
}

gdcm::DataSet with(const Tag& tag, VR::VRType vr, const std::string& value) {
  gdcm::DataSet data;
  put(data, tag, vr, value);
  return data;
}

std::string decimals(std::initializer_list<double> values) {
  std::string text;
  for (const double v : values) {
    char one[32];
    std::snprintf(one, sizeof one, "%.12g", v);
    text += (text.empty() ? "" : "\\") + std::string(one);
  }
  return text;
}

// JPEG 2000 as GDCM writes it halves an image five times, so it needs some size.
ImageVolume<std::int16_t> larger_image() {
  ImageVolume<std::int16_t> image = some_image();
  image.size = Index3(72, 66, 6);
  image.data.clear();
  for (int v = 0; v < 72 * 66 * 6; ++v)
    image.data.push_back(static_cast<std::int16_t>(37 * v % 4001 - 1024));
  return image;
}

struct MultiFrame {
  std::string sop_class = "1.2.840.10008.5.1.4.1.1.2.1";  // Enhanced CT
  std::vector<int> order = {0, 1, 2, 3, 4, 5};            // slice of each frame
  bool placed = true;
  double skew = 0;                 // mm, of the fourth frame along the normal
  bool rescale_per_frame = false;  // frame f: intercept -1000 - 10 f
};

// some_image as one file of frames; the stored values are the image's minus -1024, halved slope.
void write_multi_frame(const ImageVolume<std::int16_t>& image, const std::string& file,
                       const MultiFrame& how) {
  gdcm::Writer writer;
  gdcm::DataSet& data = writer.GetFile().GetDataSet();
  const int frames = static_cast<int>(how.order.size());
  put(data, Tag(0x0008, 0x0016), VR::UI, how.sop_class);
  put(data, Tag(0x0008, 0x0018), VR::UI, "2.25.1001");
  put(data, Tag(0x0008, 0x0060), VR::CS, "CT");
  put(data, Tag(0x0020, 0x000d), VR::UI, "2.25.1002");
  put(data, Tag(0x0020, 0x000e), VR::UI, "2.25.1003");
  put(data, Tag(0x0028, 0x0002), 1);
  put(data, Tag(0x0028, 0x0004), VR::CS, "MONOCHROME2");
  put(data, Tag(0x0028, 0x0008), VR::IS, std::to_string(frames));
  put(data, Tag(0x0028, 0x0010), image.size.y());
  put(data, Tag(0x0028, 0x0011), image.size.x());
  put(data, Tag(0x0028, 0x0100), 16);
  put(data, Tag(0x0028, 0x0101), 16);
  put(data, Tag(0x0028, 0x0102), 15);
  put(data, Tag(0x0028, 0x0103), 1);

  gdcm::DataSet shared;
  put(shared, Tag(0x0028, 0x9110),
      {with(Tag(0x0028, 0x0030), VR::DS, decimals({image.spacing.y(), image.spacing.x()}))});
  const Vec3 x = image.direction.col(0), y = image.direction.col(1);
  put(shared, Tag(0x0020, 0x9116),
      {with(Tag(0x0020, 0x0037), VR::DS, decimals({x.x(), x.y(), x.z(), y.x(), y.y(), y.z()}))});
  const auto rescale = [](double slope, double intercept) {
    auto values = with(Tag(0x0028, 0x1052), VR::DS, decimals({intercept}));
    put(values, Tag(0x0028, 0x1053), VR::DS, decimals({slope}));
    put(values, Tag(0x0028, 0x1054), VR::LO, "US");
    return values;
  };
  if (!how.rescale_per_frame) put(shared, Tag(0x0028, 0x9145), {rescale(0.5, -100)});
  put(data, Tag(0x5200, 0x9229), {shared});
  std::vector<gdcm::DataSet> own;
  std::string pixels;
  for (int f = 0; f < frames; ++f) {
    const int k = how.order[static_cast<std::size_t>(f)];
    Vec3 p = image.to_world(Vec3(0, 0, k));
    if (f == 3) p += how.skew * image.direction.col(2);
    gdcm::DataSet groups;
    if (how.placed)
      put(groups, Tag(0x0020, 0x9113),
          {with(Tag(0x0020, 0x0032), VR::DS, decimals({p.x(), p.y(), p.z()}))});
    if (how.rescale_per_frame) put(groups, Tag(0x0028, 0x9145), {rescale(1, -1000 - 10 * f)});
    own.push_back(groups);
    const std::size_t area = static_cast<std::size_t>(image.size.x()) * image.size.y();
    pixels.append(reinterpret_cast<const char*>(image.data.data() + area * k), 2 * area);
  }
  put(data, Tag(0x5200, 0x9230), own);
  put(data, Tag(0x7fe0, 0x0010), VR::OW, pixels);
  auto& meta = writer.GetFile().GetHeader();
  meta.SetDataSetTransferSyntax(gdcm::TransferSyntax::ExplicitVRLittleEndian);
  writer.SetFileName(file.c_str());
  ASSERT_TRUE(writer.Write());
}

// Rewrites a file's tags.
void edit(const std::string& file, const std::function<void(gdcm::DataSet&)>& change) {
  gdcm::Reader reader;
  reader.SetFileName(file.c_str());
  ASSERT_TRUE(reader.Read());
  change(reader.GetFile().GetDataSet());
  gdcm::Writer writer;
  writer.SetFile(reader.GetFile());
  writer.CheckFileMetaInformationOff();
  writer.SetFileName((file + ".new").c_str());
  ASSERT_TRUE(writer.Write());
  fs::rename(file + ".new", file);
}

bool compress(const std::string& file, gdcm::TransferSyntax::TSType syntax) {
  gdcm::ImageReader reader;
  reader.SetFileName(file.c_str());
  if (!reader.Read()) return false;
  gdcm::ImageChangeTransferSyntax change;
  change.SetTransferSyntax(syntax);
  change.SetInput(reader.GetImage());
  if (!change.Change()) return false;
  gdcm::ImageWriter writer;
  writer.SetFile(reader.GetFile());
  writer.SetImage(change.GetOutput());
  writer.SetFileName((file + ".new").c_str());
  if (!writer.Write()) return false;
  fs::rename(file + ".new", file);
  return true;
}

ScanReadOptions series(const std::string& wanted) {
  ScanReadOptions options;
  options.series = wanted;
  return options;
}

ScanReadOptions irregular() {
  ScanReadOptions options;
  options.allow_irregular = true;
  return options;
}

TEST_F(Dicom, OneOfSeveralSeriesIsChosenByPlaceNumberUidOrDescription) {
  // Three series: numbers 2, 5 and none; different images.
  std::vector<ImageVolume<std::int16_t>> images(3, some_image());
  const std::array<std::string, 3> names = {"Bone 0.2", "Bone 0.2 sharp", "scout"};
  for (int s = 0; s < 3; ++s) {
    images[s].data[0] = static_cast<std::int16_t>(s);
    fs::create_directories(folder_ / "one");
    write_dicom_series(images[s], path("one"));
    for (const auto& entry : fs::directory_iterator(folder_ / "one")) {
      edit(entry.path().string(), [&](gdcm::DataSet& data) {
        put(data, Tag(0x0008, 0x103e), VR::LO, names[s]);
        put(data, Tag(0x0020, 0x0011), VR::IS, s == 0 ? "2" : s == 1 ? "5" : "");
      });
      fs::rename(entry.path(), folder_ / (std::to_string(s) + entry.path().filename().string()));
    }
    fs::remove_all(folder_ / "one");
  }
  const auto list = list_series(path(""));
  ASSERT_EQ(list.size(), 3u);
  EXPECT_EQ(list[0].description, "scout");  // no number comes first
  EXPECT_EQ(list[1].number, 2);
  EXPECT_EQ(list[2].number, 5);
  EXPECT_EQ(list[2].place, 3);
  EXPECT_EQ(list[1].slices, 6);
  EXPECT_EQ(list[1].columns, 7);
  EXPECT_EQ(list[1].rows, 5);
  EXPECT_EQ(list[1].modality, "CT");
  EXPECT_EQ(list, list_series(path("")));

  EXPECT_THAT(refusal(path("")),
              testing::AllOf(HasSubstr("holds 3 series"), HasSubstr("3: 'Bone 0.2 sharp' number 5"),
                             HasSubstr("(6 slices) of 7 x 5"), HasSubstr("--series")));
  const auto first_voxel = [&](const std::string& wanted) {
    return read_scan(path(""), series(wanted)).data[0];
  };
  EXPECT_EQ(first_voxel("#1"), 2);
  EXPECT_EQ(first_voxel("1"), 2);
  EXPECT_EQ(first_voxel("#2"), 0);
  EXPECT_EQ(first_voxel("2"), 0);  // second place and number 2 are the same series
  EXPECT_EQ(first_voxel("3"), 1);
  EXPECT_EQ(first_voxel("5"), 1);
  EXPECT_EQ(first_voxel(list[2].uid), 1);
  EXPECT_EQ(first_voxel(list[2].uid.substr(list[2].uid.size() - 12)), 1);
  EXPECT_EQ(first_voxel("bone 0.2"), 0);  // whole, though it begins another as well
  EXPECT_EQ(first_voxel("SHARP"), 1);
  EXPECT_EQ(first_voxel("sc"), 2);
  EXPECT_THAT(refusal(path(""), series("bone")), HasSubstr("'bone' fits 2 of 3"));
  EXPECT_THAT(refusal(path(""), series("soft")), HasSubstr("'soft' fits none of 3"));
  EXPECT_THAT(refusal(path(""), series("#4")), HasSubstr("fits none"));
  EXPECT_NE(sha256_of_scan(path(""), "#1"), sha256_of_scan(path(""), "#2"));

  // A number that is the place of one series and the number of another.
  for (int k = 1; k <= 6; ++k)
    edit(path("1slice_000" + std::to_string(k) + ".dcm"),
         [](gdcm::DataSet& data) { put(data, Tag(0x0020, 0x0011), VR::IS, "1"); });
  EXPECT_THAT(refusal(path(""), series("1")), HasSubstr("fits 2 of 3"));
  EXPECT_EQ(first_voxel("#1"), 2);
}

TEST_F(Dicom, AMultiFrameFileIsOrderedByPositionAndRescaled) {
  const auto image = some_image(oblique());
  for (const char* sop : {"1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.7.3",
                          "1.2.840.10008.5.1.4.1.1.13.1.2"}) {  // + secondary capture, dental CBCT
    SCOPED_TRACE(sop);
    MultiFrame how;
    how.sop_class = sop;
    how.order = {4, 0, 5, 2, 1, 3};
    write_multi_frame(image, path("volume.dcm"), how);
    for (const std::string& from : {path("volume.dcm"), path("")}) {
      const auto read = read_scan(from);
      ASSERT_EQ(read.size, image.size);
      EXPECT_LT((read.spacing - image.spacing).norm(), 1e-9);
      EXPECT_LT((read.origin - image.origin).norm(), 1e-9);
      EXPECT_LT((read.direction - image.direction).norm(), 1e-9);
      for (std::size_t v = 0; v < image.data.size(); ++v)
        ASSERT_EQ(read.data[v], 0.5f * image.data[v] - 100);
    }
  }
  EXPECT_EQ(list_series(path("")).front().slices, 6);
  EXPECT_EQ(sha256_of_scan(path("volume.dcm")).size(), 64u);

  MultiFrame how;
  how.rescale_per_frame = true;
  how.order = {5, 4, 3, 2, 1, 0};
  write_multi_frame(image, path("volume.dcm"), how);
  const auto read = read_scan(path("volume.dcm"));
  for (int k = 0; k < 6; ++k)  // slice k is frame 5 - k
    EXPECT_EQ(read.at(3, 2, k), image.at(3, 2, k) - 1000 - 10 * (5 - k));

  for (const auto syntax :
       {gdcm::TransferSyntax::RLELossless, gdcm::TransferSyntax::JPEG2000Lossless}) {
    SCOPED_TRACE(gdcm::TransferSyntax::GetTSString(syntax));
    const auto larger = larger_image();
    write_multi_frame(larger, path("volume.dcm"), {});
    ASSERT_TRUE(compress(path("volume.dcm"), syntax));
    const auto unpacked = read_scan(path("volume.dcm"));
    ASSERT_EQ(unpacked.size, larger.size);
    for (std::size_t v = 0; v < larger.data.size(); ++v)
      ASSERT_EQ(unpacked.data[v], 0.5f * larger.data[v] - 100);
  }
}

TEST_F(Dicom, RefusesMultiFrameFilesWithoutARegularPlace) {
  const auto image = some_image();
  MultiFrame how;
  how.skew = 0.1;
  write_multi_frame(image, path("volume.dcm"), how);
  EXPECT_THAT(refusal(path("volume.dcm")),
              HasSubstr("frame 3 and volume.dcm frame 4: are 0.55 mm"));
  how = {};
  how.order = {0, 1, 2, 3, 3, 4};
  write_multi_frame(image, path("volume.dcm"), how);
  EXPECT_THAT(refusal(path("volume.dcm")), HasSubstr("frame 4 and volume.dcm frame 5: lie at the"));
  how = {};
  how.placed = false;
  write_multi_frame(image, path("volume.dcm"), how);
  EXPECT_THAT(refusal(path("volume.dcm")), HasSubstr("frame 1: lacks a position"));
  write_multi_frame(image, path("volume.dcm"), {});
  edit(path("volume.dcm"), [](gdcm::DataSet& data) { data.Remove(Tag(0x5200, 0x9230)); });
  EXPECT_THAT(refusal(path("volume.dcm")), HasSubstr("places none of its 6 frames"));
  write_multi_frame(image, path("volume.dcm"), {});
  edit(path("volume.dcm"),
       [](gdcm::DataSet& data) { put(data, Tag(0x0028, 0x0008), VR::IS, "2000000000"); });
  EXPECT_THAT(refusal(path("volume.dcm")), HasSubstr("places 6 of its 2000000000 frames"));
  for (const double share : {0.99, 0.7, 0.3, 0.1}) {
    write_multi_frame(image, path("volume.dcm"), {});
    truncate("volume.dcm", share);
    EXPECT_NE(refusal(path("volume.dcm")), "no error") << share;
  }
}

// A volume linear in space, which linear resampling reproduces.
ImageVolume<std::int16_t> ramp(int slices) {
  ImageVolume<std::int16_t> image;
  image.size = Index3(12, 10, slices);
  image.spacing = Vec3(0.25, 0.25, 0.5);
  image.direction = oblique();
  for (int k = 0; k < slices; ++k)
    for (int j = 0; j < 10; ++j)
      for (int i = 0; i < 12; ++i)
        image.data.push_back(static_cast<std::int16_t>(8 * i + 20 * j + 100 * k));
  return image;
}

TEST_F(Dicom, MissingSlicesAreFilledLinearlyOnDemand) {
  const auto image = ramp(9);
  write_dicom_series(image, path(""));
  fs::remove(slice(3));
  fs::remove(slice(6));
  fs::remove(slice(7));
  EXPECT_THAT(refusal(path("")), testing::AllOf(HasSubstr("slice_0002.dcm and slice_0004.dcm"),
                                                HasSubstr("--allow-irregular")));
  std::vector<std::string> notes;
  expect_same(read_scan(path(""), irregular(), &notes), image, 1e-6);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0], HasSubstr("gaps of up to 1.5 mm"));
  EXPECT_EQ(sha256_of_scan(path("")).size(), 64u);

  // Labels take the nearest slice: nothing in between.
  for (const std::uint16_t v : read_label_image(path(""), irregular()).data) EXPECT_EQ(v % 4, 0);

  fresh();
  write_dicom_series(image, path(""));
  notes.clear();
  expect_same(read_scan(path(""), irregular(), &notes), image, 1e-6);
  EXPECT_TRUE(notes.empty());
  fs::copy_file(slice(2), path("again.dcm"));
  EXPECT_THAT(refusal(path(""), irregular()), HasSubstr("lie at the same position"));

  fresh();
  write_dicom_series(ramp(9), path(""));
  edit(slice(9), [](gdcm::DataSet& data) {
    const Vec3 p = ramp(9).to_world(Vec3(0, 0, 1e5));
    put(data, Tag(0x0020, 0x0032), VR::DS, decimals({p.x(), p.y(), p.z()}));
  });
  EXPECT_THAT(refusal(path(""), irregular()), HasSubstr("too much to fill"));
}

TEST_F(Dicom, ATiltedGantryIsShearedBackOnDemand) {
  // Slices that follow a table through a gantry tilted by 20 degrees: each stands tan(20) of its
  // height further along -y of its plane. What was scanned is the ramp 8 i + 20 j + 100 k of the
  // upright grid, so that a slice that starts s voxels earlier holds 20 (j - s) instead.
  const auto image = ramp(9);
  const double per_slice = std::tan(20 * M_PI / 180) * 0.5 / 0.25;  // voxels
  auto stored = image;
  for (int k = 0; k < 9; ++k)
    for (int j = 0; j < 10; ++j)
      for (int i = 0; i < 12; ++i)
        stored.at(i, j, k) =
            static_cast<std::int16_t>(std::lround(10 * (image.at(i, j, k) - 20 * per_slice * k)));
  write_dicom_series(stored, path(""));
  for (int k = 0; k < 9; ++k)
    edit(slice(k + 1), [&](gdcm::DataSet& data) {
      const Vec3 p = image.to_world(Vec3(0, -per_slice * k, k));
      put(data, Tag(0x0020, 0x0032), VR::DS, decimals({p.x(), p.y(), p.z()}));
      put(data, Tag(0x0028, 0x1053), VR::DS, "0.1");
    });
  EXPECT_THAT(refusal(path("")), HasSubstr("are shifted sideways (a tilted gantry?)"));
  std::vector<std::string> notes;
  const auto read = read_scan(path(""), irregular(), &notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0], HasSubstr("sheared by 20 degrees"));
  // Rows were added before the first slice: 8 * per_slice = 5.82, so 6.
  ASSERT_EQ(read.size, Index3(12, 16, 9));
  EXPECT_LT((read.origin - image.to_world(Vec3(0, -6, 0))).norm(), 1e-6);
  EXPECT_LT((read.spacing - image.spacing).norm(), 1e-6);
  int inside = 0;
  for (int k = 0; k < 9; ++k)
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 12; ++i) {
        const double row = j - 6 + per_slice * k;  // in the slice
        if (row < 0 || row > 9) continue;
        ++inside;
        // Stored values were rounded to 0.1.
        EXPECT_NEAR(read.at(i, j, k), 8 * i + 20 * (j - 6) + 100 * k, 0.051);
      }
  EXPECT_GT(inside, 9 * 12 * 9);

  // Together with a missing slice: in between, the ramp is still itself where both neighbours are.
  fs::remove(slice(5));
  const auto filled = read_scan(path(""), irregular());
  ASSERT_EQ(filled.size, read.size);
  for (int j = 6; j < 10; ++j) EXPECT_NEAR(filled.at(4, j, 4), 32 + 20 * (j - 6) + 400, 0.051);

  // One slice shifted by itself is no tilt.
  fresh();
  write_dicom_series(image, path(""));
  edit(slice(4), [&](gdcm::DataSet& data) {
    const Vec3 p = image.to_world(Vec3(0, 2, 3));
    put(data, Tag(0x0020, 0x0032), VR::DS, decimals({p.x(), p.y(), p.z()}));
  });
  EXPECT_THAT(refusal(path(""), irregular()), HasSubstr("shifted sideways by another amount"));
}

TEST_F(Dicom, CompressedSlicesAreReadBitForBit) {
  const auto image = larger_image();
  for (const auto syntax :
       {gdcm::TransferSyntax::RLELossless, gdcm::TransferSyntax::JPEGLosslessProcess14_1,
        gdcm::TransferSyntax::JPEGLosslessProcess14, gdcm::TransferSyntax::JPEGLSLossless,
        gdcm::TransferSyntax::JPEG2000Lossless, gdcm::TransferSyntax::ImplicitVRLittleEndian,
        gdcm::TransferSyntax::ExplicitVRBigEndian,
        gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian}) {
    SCOPED_TRACE(gdcm::TransferSyntax::GetTSString(syntax));
    fresh();
    write_dicom_series(image, path(""));
    for (int k = 1; k <= 6; ++k) ASSERT_TRUE(compress(slice(k), syntax));
    std::vector<std::string> notes;
    expect_same(read_scan(path(""), ScanReadOptions(), &notes), image, 1e-6);
    EXPECT_TRUE(notes.empty());
    for (const double share : {0.98, 0.9, 0.5}) {
      const std::string whole = bytes_of(slice(4));
      truncate("slice_0004.dcm", share);
      EXPECT_THAT(refusal(path("")), testing::Not(HasSubstr("no error"))) << share;
      write("slice_0004.dcm", whole);
    }
  }
}

TEST_F(Dicom, SignBitsAndRescaleOfStoredValues) {
  const auto image = some_image();
  // Unsigned: the same bits are other numbers.
  write_dicom_series(image, path(""));
  for (int k = 1; k <= 6; ++k)
    edit(slice(k), [](gdcm::DataSet& data) {
      put(data, Tag(0x0028, 0x0103), 0);
      put(data, Tag(0x0028, 0x1052), VR::DS, "-1024");
      put(data, Tag(0x0028, 0x1053), VR::DS, "0.25");
    });
  auto read = read_scan(path(""));
  for (std::size_t v = 0; v < image.data.size(); ++v)
    ASSERT_EQ(read.data[v], 0.25f * static_cast<std::uint16_t>(image.data[v]) - 1024);

  // 12 bits stored of 16, signed: what stands above them does not count.
  fresh();
  auto twelve = image;
  for (auto& v : twelve.data) v = static_cast<std::int16_t>((v & 0x0fff) | 0x3000);
  write_dicom_series(twelve, path(""));
  for (int k = 1; k <= 6; ++k)
    edit(slice(k), [](gdcm::DataSet& data) {
      put(data, Tag(0x0028, 0x0101), 12);
      put(data, Tag(0x0028, 0x0102), 11);
    });
  read = read_scan(path(""));
  for (std::size_t v = 0; v < image.data.size(); ++v) {
    const int low = image.data[v] & 0x0fff;
    ASSERT_EQ(read.data[v], low >= 0x800 ? low - 0x1000 : low);
  }

  edit(slice(2), [](gdcm::DataSet& data) { put(data, Tag(0x0028, 0x1053), VR::DS, "none"); });
  EXPECT_THAT(refusal(path("")), HasSubstr("slice_0002.dcm: turns stored values into greys"));
}

TEST_F(Dicom, ASliceStoredOtherwiseThanTheFirstIsRefusedNamingBothValues) {
  const auto image = some_image();
  struct Case {
    const char *name, *here, *first;
    std::function<void(gdcm::DataSet&)> edit;
  };
  const Case cases[] = {{"PixelRepresentation", "0", "1",
                         [](gdcm::DataSet& data) { put(data, Tag(0x0028, 0x0103), 0); }},
                        {"BitsStored", "12", "16",
                         [](gdcm::DataSet& data) {
                           put(data, Tag(0x0028, 0x0101), 12);
                           put(data, Tag(0x0028, 0x0102), 11);
                         }},
                        {"RescaleSlope", "9", "1",
                         [](gdcm::DataSet& data) { put(data, Tag(0x0028, 0x1053), VR::DS, "9"); }},
                        {"RescaleIntercept", "-1024", "0", [](gdcm::DataSet& data) {
                           put(data, Tag(0x0028, 0x1052), VR::DS, "-1024");
                         }}};
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    fresh();
    write_dicom_series(image, path(""));
    edit(slice(4), c.edit);
    EXPECT_THAT(
        refusal(path("")),
        testing::AllOf(HasSubstr("slice_0004.dcm: has " + std::string(c.name)),
                       HasSubstr(std::string(" ") + c.here + ", the first slice " + c.first),
                       HasSubstr("--allow-irregular")));
    ScanReadOptions any;
    any.allow_irregular = true;
    std::vector<std::string> notes;
    const auto read = read_scan(path(""), any, &notes);
    EXPECT_EQ(read.at(3, 2, 1), image.at(3, 2, 1));
    ASSERT_EQ(notes.size(), 1u);
    EXPECT_THAT(notes[0], HasSubstr("each was read by its own header"));
  }
}

TEST_F(Dicom, APixelSpacingThatIsNoneIsRefusedUnlessTheOptionReplacesIt) {
  const auto image = some_image();
  for (const char* value : {"0\\0.2", "0.3\\none", "nan\\0.2", "-0.3\\0.2"}) {
    SCOPED_TRACE(value);
    fresh();
    write_dicom_series(image, path(""));
    for (int k = 1; k <= 6; ++k)
      edit(slice(k), [&](gdcm::DataSet& data) { put(data, Tag(0x0028, 0x0030), VR::DS, value); });
    EXPECT_THAT(refusal(path("")), testing::AllOf(HasSubstr(value), HasSubstr("--spacing-mm")));
    EXPECT_EQ(read_scan(path(""), with_spacing(0.2, 0.3, 0.45)).spacing, Vec3(0.2, 0.3, 0.45));
  }
}

TEST_F(Dicom, CellsOfOneAndFourBytesAndLossyCompression) {
  // The same bytes as other cells: twice as many columns of 8 bits, half as many of 32.
  const auto image = larger_image();
  const auto cells = [&](int bits, int columns, int is_signed) {
    fresh();
    write_dicom_series(image, path(""));
    for (int k = 1; k <= 6; ++k)
      edit(slice(k), [&](gdcm::DataSet& data) {
        put(data, Tag(0x0028, 0x0011), columns);
        put(data, Tag(0x0028, 0x0100), bits);
        put(data, Tag(0x0028, 0x0101), bits);
        put(data, Tag(0x0028, 0x0102), bits - 1);
        put(data, Tag(0x0028, 0x0103), is_signed);
      });
  };
  cells(8, 144, 0);
  auto read = read_scan(path(""));
  ASSERT_EQ(read.size, Index3(144, 66, 6));
  for (std::size_t v = 0; v < image.data.size(); ++v) {
    const auto both = static_cast<std::uint16_t>(image.data[v]);
    ASSERT_EQ(read.data[2 * v], both & 255);
    ASSERT_EQ(read.data[2 * v + 1], both >> 8);
  }
  for (int k = 1; k <= 6; ++k)
    ASSERT_TRUE(compress(slice(k), gdcm::TransferSyntax::JPEGBaselineProcess1));
  std::vector<std::string> notes;
  EXPECT_EQ(read_scan(path(""), ScanReadOptions(), &notes).size, Index3(144, 66, 6));
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_THAT(notes[0], HasSubstr("compressed with loss"));

  cells(32, 36, 1);
  read = read_scan(path(""));
  ASSERT_EQ(read.size, Index3(36, 66, 6));
  for (std::size_t v = 0; v < read.data.size(); ++v) {
    std::int32_t value = 0;
    std::memcpy(&value, &image.data[2 * v], 4);
    ASSERT_EQ(read.data[v], static_cast<float>(value));
  }
}

TEST_F(Dicom, RefusesWhatIsNoGreyVolume) {
  const auto image = some_image();
  const auto refused_with = [&](const std::function<void(gdcm::DataSet&)>& change) {
    fresh();
    write_dicom_series(image, path(""));
    edit(slice(3), change);
    return refusal(path(""));
  };
  EXPECT_THAT(refused_with([](auto& d) { put(d, Tag(0x0028, 0x0002), 3); }), HasSubstr("colour"));
  EXPECT_THAT(refused_with([](auto& d) { put(d, Tag(0x0028, 0x0004), VR::CS, "PALETTE COLOR"); }),
              HasSubstr("PALETTE COLOR"));
  EXPECT_THAT(refused_with([](auto& d) { d.Remove(Tag(0x0020, 0x0032)); }),
              HasSubstr("slice_0003.dcm: lacks a position"));
  EXPECT_THAT(refused_with([](auto& d) { put(d, Tag(0x0020, 0x0032), VR::DS, "nan\\0\\0"); }),
              HasSubstr("lacks a position"));
  EXPECT_THAT(refused_with([](auto& d) { d.Remove(Tag(0x7fe0, 0x0010)); }),
              HasSubstr("slice_0003.dcm: its pixel data is not complete"));
  EXPECT_THAT(refused_with([](auto& d) { put(d, Tag(0x0028, 0x0010), 6); }),
              HasSubstr("has 7 x 6 pixels, the first slice 7 x 5"));
  fresh();
  write_dicom_series(image, path(""));
  for (int k = 1; k <= 6; ++k)  // more rows than there are pixels
    edit(slice(k), [](auto& d) { put(d, Tag(0x0028, 0x0010), 50); });
  EXPECT_NE(refusal(path("")), "no error");
  EXPECT_THAT(refusal(slice(1)), HasSubstr("give the folder that holds the series"));
  ScanReadOptions second;
  second.component = 2;
  EXPECT_THAT(refusal(path(""), second), HasSubstr("no component 2"));
}

TEST_F(Dicom, DamagedBytesNeverCrash) {
  write_dicom_series(some_image(), path(""));
  fs::create_directories(folder_ / "multi");
  MultiFrame how;
  write_multi_frame(some_image(), path("multi/volume.dcm"), how);
  std::uint32_t random = 7;
  const auto next = [&] { return (random = random * 1664525u + 1013904223u) >> 8; };
  for (const std::string& file : {std::string("slice_0003.dcm"), std::string("multi/volume.dcm")}) {
    const std::string whole = bytes_of(path(file));
    for (int round = 0; round < 150; ++round) {
      std::string damaged = whole;
      for (int n = 0; n < 4; ++n) damaged[next() % damaged.size()] = static_cast<char>(next());
      write(file, damaged);
      try {
        static_cast<void>(read_scan(fs::path(path(file)).parent_path().string(), irregular()));
      } catch (const InputError&) {
      }
    }
    write(file, whole);
  }
  for (const auto syntax :
       {gdcm::TransferSyntax::RLELossless, gdcm::TransferSyntax::JPEGLosslessProcess14_1,
        gdcm::TransferSyntax::JPEGLSLossless, gdcm::TransferSyntax::JPEG2000Lossless}) {
    write_multi_frame(larger_image(), path("multi/volume.dcm"), how);
    ASSERT_TRUE(compress(path("multi/volume.dcm"), syntax));
    const std::string whole = bytes_of(path("multi/volume.dcm"));
    for (int round = 0; round < 25; ++round) {
      std::string damaged = whole;
      for (int n = 0; n < 4; ++n)  // most of the file is compressed pixels
        damaged[1000 + next() % (damaged.size() - 1000)] = static_cast<char>(next());
      write("multi/volume.dcm", damaged);
      try {
        static_cast<void>(read_scan(path("multi/volume.dcm"), irregular()));
      } catch (const InputError&) {
      }
    }
  }
}

}  // namespace
}  // namespace toothprep
