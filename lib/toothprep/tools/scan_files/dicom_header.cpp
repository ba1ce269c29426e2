#include "toothprep/tools/scan_files/dicom_header.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace toothprep::image {
namespace {

constexpr std::uint32_t kShared = 0x52009229, kPerFrame = 0x52009230, kPixelMeasures = 0x00289110,
                        kPlanePosition = 0x00209113, kPlaneOrientation = 0x00209116,
                        kPixelValues = 0x00289145;

std::optional<int> whole_number(const std::string& text) {
  std::size_t end = 0;
  try {
    const int value = std::stoi(text, &end);
    if (end == text.size()) return value;
  } catch (const std::exception&) {
  }
  return {};
}

// DICOM's backslash-separated decimals; none if one of them is no number.
std::vector<double> numbers(const std::string& text) {
  std::vector<double> values;
  std::istringstream in(text);
  std::string part;
  while (std::getline(in, part, '\\')) {
    try {
      values.push_back(std::stod(part));
    } catch (const std::exception&) {
      return {};
    }
    if (!std::isfinite(values.back())) return {};
  }
  return values;
}

// A macro's value: in the frame's own groups, else the shared ones, else at the file's top.
std::string find(const DicomItems& top, std::size_t frame, std::uint32_t macro, std::uint32_t tag) {
  const auto& own = top.sequence(kPerFrame);
  const auto& shared = top.sequence(kShared);
  for (const DicomItems* groups :
       {frame < own.size() ? &own[frame] : nullptr, shared.empty() ? nullptr : &shared.front()}) {
    if (groups == nullptr || groups->sequence(macro).empty()) continue;
    std::string text = groups->sequence(macro).front().text(tag);
    if (!text.empty()) return text;
  }
  return top.text(tag);
}

}  // namespace

std::optional<DicomHeader> header_of(const DicomFile& dicom, const std::string& file) {
  const DicomItems& top = dicom.top;
  const auto rows = dicom.number(0x00280010), columns = dicom.number(0x00280011);
  if (!rows || !columns) return {};
  DicomHeader header;
  header.file = file;
  header.rows = *rows;
  header.columns = *columns;
  header.samples = dicom.number(0x00280002).value_or(1);
  header.bits_allocated = dicom.number(0x00280100).value_or(16);
  header.bits_stored = dicom.number(0x00280101).value_or(header.bits_allocated);
  header.high_bit = dicom.number(0x00280102).value_or(header.bits_stored - 1);
  header.is_signed = dicom.number(0x00280103).value_or(0) != 0;
  header.series_uid = top.text(0x0020000e);
  header.series_description = top.text(0x0008103e);
  header.series_number = whole_number(top.text(0x00200011));
  header.modality = top.text(0x00080060);
  header.photometric = top.text(0x00280004);
  const std::string frames = top.text(0x00280008);
  header.stated_frames = frames.empty() ? 1 : whole_number(frames).value_or(0);

  // A file that states more frames than it describes has no places for them.
  const std::size_t described = std::max<std::size_t>(top.sequence(kPerFrame).size(), 1);
  header.frames.resize(
      std::min(described, static_cast<std::size_t>(std::max(header.stated_frames, 0))));
  header.bad_rescale = top.elements.contains(0x00283000);  // a look-up table
  for (std::size_t f = 0; f < header.frames.size(); ++f) {
    DicomFrame& frame = header.frames[f];
    frame.position = numbers(find(top, f, kPlanePosition, 0x00200032));
    frame.orientation = numbers(find(top, f, kPlaneOrientation, 0x00200037));
    frame.pixel_spacing_text = find(top, f, kPixelMeasures, 0x00280030);
    frame.pixel_spacing = numbers(frame.pixel_spacing_text);
    const auto scalar = [&](std::uint32_t tag, double& value) {
      const std::string text = find(top, f, kPixelValues, tag);
      if (text.empty()) return;
      const auto values = numbers(text);
      if (values.size() == 1)
        value = values[0];
      else
        header.bad_rescale = true;
    };
    scalar(0x00281053, frame.slope);
    scalar(0x00281052, frame.intercept);
    if (frame.slope == 0) header.bad_rescale = true;
  }
  return header;
}

}  // namespace toothprep::image
