#include "toothprep/tools/scan_files/dicom_pixels.h"

#include <gdcmPixmapReader.h>

#include <cstdint>
#include <cstring>
#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/scan_files/itk_io.h"

namespace toothprep::image {
namespace {

namespace fs = std::filesystem;

constexpr unsigned kDecodeSeconds = 300;  // a decoder that hangs is ended
constexpr std::size_t kDecodeMemory = std::size_t{1} << 30;

enum Decoded { kDone = 0, kDoneWithLoss = 1, kOtherSize = 2, kNotDecoded = 3 };

Decoded decode(const DicomHeader& header, std::size_t bytes, char* out) {
  gdcm::PixmapReader reader;
  reader.SetFileName(header.file.c_str());
  if (!reader.Read()) return kNotDecoded;
  const gdcm::Pixmap& image = reader.GetPixmap();
  const unsigned frames = image.GetNumberOfDimensions() > 2 ? image.GetDimension(2) : 1;
  const gdcm::PixelFormat& format = image.GetPixelFormat();
  if (image.GetDimension(0) != static_cast<unsigned>(header.columns) ||
      image.GetDimension(1) != static_cast<unsigned>(header.rows) ||
      frames != header.frames.size() || format.GetSamplesPerPixel() != 1 ||
      format.GetBitsAllocated() != header.bits_allocated || image.GetBufferLength() != bytes)
    return kOtherSize;
  if (!image.GetBuffer(out)) return kNotDecoded;
  return image.IsLossy() ? kDoneWithLoss : kDone;
}

// GDCM and its decoders end the program by assertions if a stream is damaged; here they end a
// child.
Decoded decode_apart(const DicomHeader& header, std::size_t bytes, char* out) {
  const SharedMemory result(sizeof(Decoded));
  Decoded decoded = kNotDecoded;
  std::memcpy(result.data(), &decoded, sizeof decoded);
  const auto failure = failure_in_trial(
      [&] {
        silence_libraries();
        const Decoded done = decode(header, bytes, out);
        std::memcpy(result.data(), &done, sizeof done);
      },
      kDecodeSeconds, 2 * bytes + kDecodeMemory);
  std::memcpy(&decoded, result.data(), sizeof decoded);
  return failure ? kNotDecoded : decoded;
}

// Stored bits to greys: of each cell, `bits_stored` bits up to `high_bit`.
template <class Cell>
void rescale(const char* bytes, bool big_endian, const DicomHeader& header, const DicomFrame& frame,
             float* greys) {
  const std::size_t area = static_cast<std::size_t>(header.columns) * header.rows;
  const int shift = header.high_bit + 1 - header.bits_stored;
  const std::uint64_t one = 1, mask = (one << header.bits_stored) - 1,
                      sign = header.is_signed ? one << (header.bits_stored - 1) : 0;
  const double slope = frame.slope, intercept = frame.intercept;
  for (std::size_t i = 0; i < area; ++i) {
    Cell cell = 0;
    for (std::size_t b = 0; b < sizeof(Cell); ++b) {
      const std::size_t at = i * sizeof(Cell) + (big_endian ? sizeof(Cell) - 1 - b : b);
      cell = static_cast<Cell>(cell | static_cast<Cell>(static_cast<unsigned char>(bytes[at]))
                                          << (8 * b));
    }
    const std::uint64_t stored = (cell >> shift) & mask;
    auto value = static_cast<std::int64_t>(stored);
    if ((stored & sign) != 0) value -= static_cast<std::int64_t>(mask) + 1;
    greys[i] = static_cast<float>(slope * static_cast<double>(value) + intercept);
  }
}

}  // namespace

// Memory that a child process can write for its parent.
DicomPixels::DicomPixels(const std::string& path, const DicomHeader& header) : header_(header) {
  const std::string name = fs::path(header.file).filename().string();
  const int bits = header.bits_allocated;
  if ((bits != 8 && bits != 16 && bits != 32) || header.bits_stored < 1 ||
      header.bits_stored > bits || header.high_bit >= bits ||
      header.high_bit + 1 < header.bits_stored)
    throw InputError(path, name,
                     "holds pixels of " + std::to_string(header.bits_stored) + " in " +
                         std::to_string(bits) + " bits, which isn't read",
                     "export the series again, or as NRRD or NIfTI");
  file_ = parse_dicom(header.file);  // well-formed: the header came from it
  if (!file_.pixels_complete)
    throw InputError(path, name, "its pixel data is not complete", "copy the file again");
  const std::size_t count =
      static_cast<std::size_t>(header.columns) * header.rows * header.frames.size();
  const std::size_t bytes = count * static_cast<std::size_t>(bits / 8);
  const InputError other_size(path, name, "does not hold slices of the size that it states",
                              "export the series again");
  if (!file_.compressed) {
    if (file_.pixels.size() < bytes || file_.pixels.size() > bytes + 1) throw other_size;
    return;
  }
  decoded_ = std::make_unique<SharedMemory>(bytes);
  const Decoded result = decode_apart(header, bytes, decoded_->data());
  if (result == kOtherSize) throw other_size;
  if (result == kNotDecoded)
    throw InputError(path, name, "its compressed pixel data cannot be decoded",
                     "copy the file again, or export the series uncompressed");
  lossy_ = result == kDoneWithLoss;
}

DicomPixels::~DicomPixels() = default;

void DicomPixels::read(std::size_t frame, float* greys) const {
  const std::size_t bytes = static_cast<std::size_t>(header_.columns) * header_.rows *
                            static_cast<std::size_t>(header_.bits_allocated / 8);
  const char* pixels = (decoded_ ? decoded_->data() : file_.pixels.data()) + frame * bytes;
  const bool big_endian = !decoded_ && file_.big_endian;
  const DicomFrame& of = header_.frames[frame];
  if (header_.bits_allocated == 8) rescale<std::uint8_t>(pixels, big_endian, header_, of, greys);
  if (header_.bits_allocated == 16) rescale<std::uint16_t>(pixels, big_endian, header_, of, greys);
  if (header_.bits_allocated == 32) rescale<std::uint32_t>(pixels, big_endian, header_, of, greys);
  if (!decoded_) file_.file.release({pixels, bytes});
}

}  // namespace toothprep::image
