#include "toothprep/tools/scan_files/dicom_series.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/scan_files/dicom_header.h"
#include "toothprep/tools/scan_files/dicom_pixels.h"
#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep::image {
namespace fs = std::filesystem;
namespace {

constexpr double kLargestGap = 5;    // steps; what is wider is another part of the body, not a loss
constexpr double kSteepestTilt = 1;  // sideways per step along the normal: 45 degrees

// ---- Which series

// A damaged slice must not count as one that is not there.
std::optional<DicomHeader> read_header(const std::string& path, const std::string& file) {
  try {
    return header_of(parse_dicom(file), file);
  } catch (const std::runtime_error& e) {
    throw InputError(path, fs::path(file).filename().string(),
                     std::string("is a damaged DICOM file: ") + e.what(), "copy the file again");
  }
}

struct Found {
  SeriesInfo info;
  std::vector<DicomHeader> files;
};

// By series number, then UID, whatever the files' names.
std::vector<Found> series_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_regular_file(error)) names.push_back(entry.path().string());
  if (error) throw InputError(folder, "", "can't be read: " + error.message());
  std::sort(names.begin(), names.end());
  std::map<std::string, Found> by_uid;
  for (const auto& name : names) {
    if (!is_dicom_file(name)) continue;
    auto header = read_header(folder, name);
    if (!header) continue;
    Found& found = by_uid[header->series_uid];
    if (found.files.empty())
      found.info = {0,
                    header->series_number,
                    header->series_uid,
                    header->series_description,
                    header->modality,
                    0,
                    header->columns,
                    header->rows};
    found.info.slices += std::max(1, header->stated_frames);
    found.files.push_back(std::move(*header));
  }
  if (by_uid.empty())
    throw InputError(folder, "", "holds no DICOM slices",
                     "give the folder with the .dcm files of one series");
  std::vector<Found> all;
  for (auto& [uid, found] : by_uid) all.push_back(std::move(found));
  std::stable_sort(all.begin(), all.end(), [](const Found& a, const Found& b) {
    return a.info.number < b.info.number;  // none before any
  });
  for (std::size_t i = 0; i < all.size(); ++i) all[i].info.place = static_cast<int>(i) + 1;
  return all;
}

std::string list_of(const std::vector<Found>& all) {
  std::string list;
  for (const auto& [info, files] : all) {
    const std::string tail =
        info.uid.size() > 24 ? "..." + info.uid.substr(info.uid.size() - 20) : info.uid;
    list += (list.empty() ? "" : ", ") + std::to_string(info.place) + ": '" + info.description +
            "'" + (info.number ? " number " + std::to_string(*info.number) : "") + " UID " + tail +
            " (" + std::to_string(info.slices) + " slices) of " + std::to_string(info.columns) +
            " x " + std::to_string(info.rows);
  }
  return list;
}

std::size_t chosen_series(const std::string& folder, const std::vector<Found>& all,
                          const std::string& wanted) {
  if (wanted.empty()) {
    if (all.size() == 1) return 0;
    throw InputError(folder, "", "holds " + std::to_string(all.size()) + " series: " + list_of(all),
                     "choose one with --series, or keep each in a folder of its own");
  }
  const auto matching = [&](const std::function<bool(const SeriesInfo&)>& matches) {
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < all.size(); ++i)
      if (matches(all[i].info)) found.push_back(i);
    return found;
  };
  const auto place_is = [](const std::string& text) {
    return [text](const SeriesInfo& s) { return std::to_string(s.place) == text; };
  };
  const std::string low = lower(wanted);
  std::vector<std::size_t> found;
  if (wanted[0] == '#') {
    found = matching(place_is(wanted.substr(1)));
  } else {
    // A place and a series number are the same kind of word: if they mean two series, it's unclear.
    found = matching([&](const SeriesInfo& s) {
      return place_is(wanted)(s) || (s.number && std::to_string(*s.number) == wanted);
    });
    if (found.empty()) found = matching([&](const SeriesInfo& s) { return s.uid == wanted; });
    if (found.empty())
      found = matching([&](const SeriesInfo& s) { return lower(s.description) == low; });
    if (found.empty())
      found = matching([&](const SeriesInfo& s) { return lower(s.description).starts_with(low); });
    if (found.empty())
      found = matching([&](const SeriesInfo& s) {
        return lower(s.description).find(low) != std::string::npos ||
               (wanted.find_first_not_of("0123456789.") == std::string::npos &&
                s.uid.ends_with(wanted));
      });
  }
  if (found.size() == 1) return found.front();
  throw InputError(folder, "series",
                   "'" + wanted + "' fits " +
                       (found.empty() ? "none" : std::to_string(found.size())) + " of " +
                       std::to_string(all.size()) + ": " + list_of(all),
                   "choose by place in this list (#1), number, UID or description");
}

// ---- Slices in order, in one orientation

struct Slice {
  const DicomHeader* header;
  std::size_t frame;
  Vec3 position;
  double along = 0;  // mm, of the position along the slice normal

  std::string name() const {
    const std::string file = fs::path(header->file).filename().string();
    return header->frames.size() > 1 ? file + " frame " + std::to_string(frame + 1) : file;
  }
};

struct Series {
  std::vector<Slice> slices;  // ordered
  Mat3 direction;
  Vec3 spacing = Vec3::Zero();  // of z: the median step between slices
  int columns = 0, rows = 0;
};

std::string between(const Slice& a, const Slice& b) { return a.name() + " and " + b.name(); }

void check_header(const std::string& path, const DicomHeader& header) {
  const std::string name = fs::path(header.file).filename().string();
  if (header.samples != 1)
    throw InputError(path, name, "is a colour image", "a scan has one grey value per voxel");
  if (!header.photometric.empty() && !header.photometric.starts_with("MONOCHROME"))
    throw InputError(path, name, "is an image of kind '" + header.photometric + "'",
                     "a scan has one grey value per voxel");
  if (header.stated_frames < 1 ||
      static_cast<std::size_t>(header.stated_frames) != header.frames.size())
    throw InputError(path, name,
                     "is a multi-frame file that places " +
                         (header.frames.size() <= 1 ? std::string("none")
                                                    : std::to_string(header.frames.size())) +
                         " of its " + std::to_string(header.stated_frames) + " frames",
                     "export the series with one slice a file, or as NRRD or NIfTI");
  if (header.bad_rescale)
    throw InputError(path, name,
                     "turns stored values into greys by a table or a rescale that is no number",
                     "export the series again, or as NRRD or NIfTI");
}

// The slice's place and axes; the option's spacing stands for a pixel spacing that is none.
struct Placed {
  Vec3 position;
  Mat3 direction;
  Vec3 spacing;  // z is not known yet
};
Placed placed(const std::string& path, const Slice& slice, const ScanReadOptions& options) {
  const DicomFrame& frame = slice.header->frames[slice.frame];
  if (frame.position.size() != 3 || frame.orientation.size() != 6)
    throw InputError(path, slice.name(),
                     "lacks a position or orientation (tags 0020,0032 0020,0037)",
                     "export the series again, or as NRRD or NIfTI");
  Placed result;
  result.position = Vec3(frame.position[0], frame.position[1], frame.position[2]);
  const auto& o = frame.orientation;
  const Vec3 x(o[0], o[1], o[2]), y(o[3], o[4], o[5]);
  result.direction << x, y, x.cross(y);
  if (!((result.direction.transpose() * result.direction - Mat3::Identity()).norm() < 1e-3))
    throw InputError(path, slice.name(), "its axes are not orthogonal unit vectors",
                     "export the series again, or as NRRD or NIfTI");
  const auto& spacing = frame.pixel_spacing;
  if (spacing.size() == 2 && spacing[0] > 0 && spacing[1] > 0)
    result.spacing = Vec3(spacing[1], spacing[0], 0);  // stated between rows, between columns
  else if (options.spacing_mm)
    result.spacing = Vec3((*options.spacing_mm)[0], (*options.spacing_mm)[1], 0);
  else
    throw InputError(path, slice.name(),
                     "states '" + frame.pixel_spacing_text +
                         "' as its pixel spacing (tag 0028,0030), which is none",
                     "give the true voxel size with --spacing-mm");
  return result;
}

// What a slice differs in from the first in shape or place; empty if in nothing.
std::string other_shape(const Series& series, const DicomHeader& header, const Placed& slice,
                        bool spacing_counts) {
  if (header.columns != series.columns || header.rows != series.rows)
    return "has " + std::to_string(header.columns) + " x " + std::to_string(header.rows) +
           " pixels, the first slice " + std::to_string(series.columns) + " x " +
           std::to_string(series.rows);
  if (spacing_counts && !((slice.spacing - series.spacing).norm() <= 1e-4 * slice.spacing.norm()))
    return "has pixels of " + number(slice.spacing.x()) + " x " + number(slice.spacing.y()) +
           " mm, the first slice of " + number(series.spacing.x()) + " x " +
           number(series.spacing.y()) + " mm";
  if (!((slice.direction - series.direction).norm() <= 1e-3))
    return "is oriented otherwise than the first slice";
  return {};
}

// In what a slice's stored values mean something else than the first's; empty if in nothing. Each
// frame of a multi-frame file has its own rescale, as has each slice of the kinds of scan whose
// scanners use all of the range in every slice.
std::string other_values(const DicomHeader& first, const DicomHeader& header) {
  struct Compared {
    const char* name;
    double of_first, here;
  };
  std::vector<Compared> compared = {
      {"PixelRepresentation (0 unsigned, 1 signed)", first.is_signed ? 1.0 : 0.0,
       header.is_signed ? 1.0 : 0.0},
      {"BitsAllocated", double(first.bits_allocated), double(header.bits_allocated)},
      {"BitsStored", double(first.bits_stored), double(header.bits_stored)},
      {"HighBit", double(first.high_bit), double(header.high_bit)}};
  const bool own_rescale =
      header.modality == "PT" || header.modality == "NM" || header.modality == "MR";
  if (!own_rescale && first.frames.size() == 1 && header.frames.size() == 1) {
    compared.push_back({"RescaleSlope", first.frames[0].slope, header.frames[0].slope});
    compared.push_back({"RescaleIntercept", first.frames[0].intercept, header.frames[0].intercept});
  }
  for (const auto& [name, of_first, here] : compared)
    if (of_first != here)
      return std::string("has ") + name + " " + number(here) + ", the first slice " +
             number(of_first);
  return {};
}

void sort_by_position(const std::string& path, Series& series) {
  std::stable_sort(series.slices.begin(), series.slices.end(),
                   [](const Slice& a, const Slice& b) { return a.along < b.along; });
  check_size(path, {static_cast<double>(series.columns), static_cast<double>(series.rows),
                    static_cast<double>(series.slices.size())});
  std::vector<double> gaps;
  for (std::size_t i = 1; i < series.slices.size(); ++i)
    gaps.push_back(series.slices[i].along - series.slices[i - 1].along);
  const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>((gaps.size() - 1) / 2);
  std::nth_element(gaps.begin(), middle, gaps.end());
  series.spacing[2] = *middle;
}

Series ordered(const std::string& path, const std::vector<DicomHeader>& files,
               const ScanReadOptions& options, std::vector<std::string>& notes) {
  Series series;
  std::string other;
  for (const auto& header : files) {
    check_header(path, header);
    for (std::size_t f = 0; f < header.frames.size(); ++f) {
      Slice slice{&header, f, Vec3::Zero()};
      const Placed place = placed(path, slice, options);
      if (series.slices.empty()) {
        series.direction = place.direction;
        series.spacing = place.spacing;
        series.columns = header.columns;
        series.rows = header.rows;
      }
      const std::string shape = other_shape(series, header, place, !options.spacing_mm);
      if (!shape.empty())
        throw InputError(path, slice.name(), shape,
                         "keep only the axial slices of the scan in the folder");
      if (f == 0 && other.empty()) {
        other = other_values(files.front(), header);
        if (!other.empty() && !options.allow_irregular)
          throw InputError(path, slice.name(), other,
                           "copy the file again; if the scanner wrote it so, --allow-irregular "
                           "reads each slice by its own header");
        if (!other.empty())
          notes.push_back("slices are stored in different ways (" + slice.name() + " " + other +
                          "); each was read by its own header");
      }
      slice.position = place.position;
      slice.along = series.direction.col(2).dot(slice.position);
      series.slices.push_back(slice);
    }
  }
  sort_by_position(path, series);
  return series;
}

// ---- The rectangular grid

// Where the slices lie on the grid: its plane k is a mixture of two slices, each of which may stand
// shifted in its plane.
struct Grid {
  Index3 size;
  Vec3 origin;
  struct Plane {
    std::size_t below = 0, above = 0;  // slices
    double share = 0;                  // of the one above
  };
  std::vector<Plane> planes;
  std::vector<std::array<double, 2>> shift;  // per slice: voxels along x and y
  double step = 0;                           // mm, between planes
  bool regular() const { return shift.empty(); }
};

// How the slices lie, found between each and the next.
struct Regularity {
  bool even = true, upright = true;
  double widest = 0;  // gap, mm
  double extent = 0;  // along the normal, mm
  Vec3 whole, shear;  // from the first slice to the last, mm; sideways per mm along the normal
};

// Throws InputError for what can't be a rectangular grid, or could only with `allow_irregular`.
Regularity regularity_of(const std::string& path, const Series& series, bool allow_irregular) {
  const auto& slices = series.slices;
  const double step = series.spacing[2], tolerance = std::max(0.02 * step, 2e-3);
  const Vec3 normal = series.direction.col(2);
  Regularity is;
  is.whole = slices.back().position - slices[0].position;
  is.extent = slices.back().along - slices[0].along;
  is.shear = is.extent > 0 ? Vec3((is.whole - normal * is.extent) / is.extent) : Vec3(Vec3::Zero());
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const double gap = slices[i].along - slices[i - 1].along;
    const std::string place = between(slices[i - 1], slices[i]);
    if (!(gap >= 1e-4))
      throw InputError(path, place, "lie at the same position",
                       "keep one of each slice in the folder");
    is.widest = std::max(is.widest, gap);
    if (std::abs(gap - step) > tolerance) {
      is.even = false;
      const std::string what =
          "are " + number(gap) + " mm apart, the other slices " + number(step) + " mm";
      if (!allow_irregular)
        throw InputError(path, place, what,
                         "slices are missing or irregular; resample the series to even spacing "
                         "(--allow-irregular)");
      if (gap > kLargestGap * step + tolerance)
        throw InputError(path, place, what, "that is too much to fill");
    }
    const Vec3 sideways = slices[i].position - slices[i - 1].position - normal * gap;
    if (sideways.norm() > tolerance) {
      is.upright = false;
      if (!allow_irregular)
        throw InputError(path, place, "are shifted sideways (a tilted gantry?)",
                         "resample the series to a rectangular grid (--allow-irregular)");
      if ((sideways - is.shear * gap).norm() > tolerance)
        throw InputError(path, place, "are shifted sideways by another amount than other slices",
                         "a tilted gantry would shift all alike; export the series again");
    }
  }
  if (!is.upright && is.shear.norm() > kSteepestTilt)
    throw InputError(path, "", "its slices are sheared by more than 45 degrees",
                     "export the series again");
  return is;
}

// The grid that the slices are resampled to.
Grid irregular_grid(const std::string& path, const Series& series, const Regularity& is) {
  const auto& slices = series.slices;
  const std::size_t n = slices.size();
  Grid grid;
  grid.origin = slices[0].position;
  const double step = series.spacing[2];
  grid.step = is.even ? is.extent / static_cast<double>(n - 1) : step;
  const double planes = is.even ? static_cast<double>(n) : std::floor(is.extent / step + 1e-3) + 1;
  std::array<double, 3> size{static_cast<double>(series.columns), static_cast<double>(series.rows),
                             planes};
  // Every slice keeps its whole area: the grid grows by what the first and the last are apart.
  for (int a = 0; a < 2 && !is.upright; ++a) {
    const double across = series.direction.col(a).dot(is.whole) / series.spacing[a];
    const double before = std::ceil(std::max(0.0, -across) - 1e-6);  // voxels
    size[a] += before + std::ceil(std::max(0.0, across) - 1e-6);
    grid.origin -= series.direction.col(a) * series.spacing[a] * before;
  }
  check_size(path, size);
  for (int a = 0; a < 3; ++a) grid.size[a] = static_cast<int>(size[a]);
  for (const Slice& slice : slices) {
    std::array<double, 2> shift{};
    for (int a = 0; a < 2 && !is.upright; ++a)
      shift[a] = series.direction.col(a).dot(slice.position - grid.origin) / series.spacing[a];
    grid.shift.push_back(shift);
  }
  for (std::size_t k = 0, i = 0; k < static_cast<std::size_t>(planes); ++k) {
    const double z = slices[0].along + grid.step * static_cast<double>(k);
    while (i + 2 < n && slices[i + 1].along <= z) ++i;
    const double share = (z - slices[i].along) / (slices[i + 1].along - slices[i].along);
    grid.planes.push_back({i, i + 1, std::clamp(share, 0.0, 1.0)});
  }
  return grid;
}

Grid grid_of(const std::string& path, const Series& series, bool allow_irregular,
             std::vector<std::string>& notes) {
  const std::size_t n = series.slices.size();
  const Regularity is = regularity_of(path, series, allow_irregular);
  if (is.even && is.upright) {
    Grid grid;
    grid.size = Index3(series.columns, series.rows, static_cast<int>(n));
    grid.origin = series.slices[0].position;
    grid.step = is.extent / static_cast<double>(n - 1);
    return grid;
  }
  Grid grid = irregular_grid(path, series, is);
  if (!is.even)
    notes.push_back("slices that are missing or irregular (gaps of up to " + number(is.widest) +
                    " mm) were filled by resampling " + std::to_string(n) + " slices to " +
                    std::to_string(grid.size.z()) + " at " + number(grid.step) + " mm");
  if (!is.upright)
    notes.push_back("slices sheared by " + number(std::atan(is.shear.norm()) * 180 / M_PI) +
                    " degrees (a tilted gantry) were resampled to a rectangular grid; its corners "
                    "outside them have the scan's lowest grey value");
  return grid;
}

// ---- Values

// Memory is only taken for what the files can hold.
void check_bytes(const std::string& path, const Series& series) {
  double bytes = 0;
  const DicomHeader* last = nullptr;
  std::map<std::string, bool> counted;
  for (const auto& slice : series.slices) {
    if (slice.header == last || !counted.emplace(slice.header->file, true).second) continue;
    last = slice.header;
    std::error_code error;
    const auto size = fs::file_size(slice.header->file, error);
    if (!error) bytes += static_cast<double>(size);
  }
  if (static_cast<double>(series.columns) * series.rows *
          static_cast<double>(series.slices.size()) >
      bytes * kMaxDeflateRatio)
    throw InputError(path, "voxel data", "the headers promise far more voxels than the files hold",
                     "the files are truncated or their headers are wrong");
}

// The slice's value at column x, row y (voxels of the slice); nothing outside it.
std::optional<float> sample(const float* slice, int columns, int rows, double x, double y,
                            bool nearest) {
  constexpr double kEdge = 1e-6;
  if (!(x >= -kEdge && x <= columns - 1 + kEdge && y >= -kEdge && y <= rows - 1 + kEdge)) return {};
  x = std::clamp(x, 0.0, columns - 1.0);
  y = std::clamp(y, 0.0, rows - 1.0);
  const auto at = [&](int i, int j) {
    return static_cast<double>(slice[static_cast<std::size_t>(j) * columns + i]);
  };
  if (nearest)
    return slice[static_cast<std::size_t>(std::lround(y)) * columns +
                 static_cast<std::size_t>(std::lround(x))];
  const int i = std::min(static_cast<int>(x), columns - 2);
  const int j = std::min(static_cast<int>(y), rows - 2);
  const double u = x - i, v = y - j;
  return static_cast<float>((1 - v) * ((1 - u) * at(i, j) + u * at(i + 1, j)) +
                            v * ((1 - u) * at(i, j + 1) + u * at(i + 1, j + 1)));
}

std::vector<float> resampled(const Grid& grid, int columns, int rows,
                             const std::vector<float>& slices, bool nearest) {
  const float lowest = *std::min_element(slices.begin(), slices.end());
  const std::size_t area = static_cast<std::size_t>(columns) * rows;
  std::vector<float> values;
  values.reserve(static_cast<std::size_t>(voxel_count(grid.size)));
  for (const auto& plane : grid.planes)
    for (int j = 0; j < grid.size.y(); ++j)
      for (int i = 0; i < grid.size.x(); ++i) {
        const auto in = [&](std::size_t s) {
          return sample(slices.data() + s * area, columns, rows, i - grid.shift[s][0],
                        j - grid.shift[s][1], nearest);
        };
        const auto below = in(plane.below), above = in(plane.above);
        float value = lowest;
        if (below && above)
          value = nearest ? (plane.share < 0.5 ? *below : *above)
                          : static_cast<float>((1 - plane.share) * *below + plane.share * *above);
        else if (below && plane.share < 0.5)
          value = *below;
        else if (above && plane.share >= 0.5)
          value = *above;
        values.push_back(value);
      }
  return values;
}

// The frames of the files as slices, in order.
class Slices : public ScanSource {
 public:
  Slices(const std::string& path, const ImageFrame& frame, std::vector<DicomHeader> files,
         Series series, std::vector<std::string> notes)
      : ScanSource(path, frame),
        files_(std::move(files)),
        series_(std::move(series)),
        notes_(std::move(notes)) {}

  void read(int first, int count, float* values) override {
    const std::size_t area = static_cast<std::size_t>(series_.columns) * series_.rows;
    // Of a multi-frame file the pixels stay at hand; slices in files of their own come and go.
    for (int k = first; k < first + count; ++k) {
      const DicomHeader* header = series_.slices[static_cast<std::size_t>(k)].header;
      if (header->frames.size() > 1 && !open_.contains(header)) {
        open_.emplace(header, std::make_unique<DicomPixels>(path(), *header));
        if (open_[header]->lossy()) lossy_ = true;
      }
    }
    tbb::parallel_for(0, count, [&](int k) {
      const Slice& slice = series_.slices[static_cast<std::size_t>(first + k)];
      float* greys = values + static_cast<std::size_t>(k) * area;
      const auto several = open_.find(slice.header);
      if (several != open_.end()) {
        several->second->read(slice.frame, greys);
      } else {
        const DicomPixels pixels(path(), *slice.header);
        pixels.read(0, greys);
        if (pixels.lossy()) lossy_ = true;
      }
    });
  }

  double whole_up_to() const override {
    double most = 0;
    for (const Slice& slice : series_.slices) {
      const DicomFrame& frame = slice.header->frames[slice.frame];
      most = std::max(most, image::whole_up_to(std::exp2(slice.header->bits_stored), frame.slope,
                                               frame.intercept));
    }
    return most;
  }

  std::vector<std::string> notes() const override {
    std::vector<std::string> notes = notes_;
    if (lossy_) notes.push_back("the scan was compressed with loss: greys and edges are not exact");
    if (files_.front().photometric == "MONOCHROME1")
      notes.push_back("the scan is meant to be shown inverted (MONOCHROME1); values are as stored");
    return notes;
  }

 private:
  std::vector<DicomHeader> files_;  // the slices point to them
  Series series_;
  std::vector<std::string> notes_;
  std::map<const DicomHeader*, std::unique_ptr<DicomPixels>> open_;
  std::atomic<bool> lossy_ = false;
};

}  // namespace

std::unique_ptr<ScanSource> open_dicom(const std::string& path, const ScanReadOptions& options) {
  if (options.component && *options.component != 1)
    throw InputError(path, "voxel data",
                     "has one grey value per voxel, so there is no component " +
                         std::to_string(*options.component));
  std::vector<DicomHeader> files;
  std::error_code error;
  if (fs::is_directory(path, error)) {
    std::vector<Found> all = series_in(path);
    files = std::move(all[chosen_series(path, all, options.series)].files);
  } else {
    auto header = read_header(fs::path(path).string(), path);
    if (!header) throw InputError(path, "", "is a DICOM file without an image");
    if (header->stated_frames == 1)
      throw InputError(path, "", "is one DICOM slice", "give the folder that holds the series");
    files.push_back(std::move(*header));
  }
  std::vector<std::string> notes;
  Series series = ordered(path, files, options, notes);
  const Grid grid = grid_of(path, series, options.allow_irregular, notes);
  check_bytes(path, series);

  ImageFrame frame;
  frame.size = Index3(series.columns, series.rows, static_cast<int>(series.slices.size()));
  frame.origin = grid.origin;
  frame.direction = series.direction;
  frame.spacing = Vec3(series.spacing.x(), series.spacing.y(), grid.step);
  const Index3 stored = frame.size;
  if (!grid.regular()) frame.size = grid.size;
  place_volume(path, frame, options.spacing_mm);
  const int columns = series.columns, rows = series.rows;
  ImageFrame as_stored = frame;
  as_stored.size = stored;
  auto slices = std::make_unique<Slices>(path, as_stored, std::move(files), std::move(series),
                                         std::move(notes));
  if (grid.regular()) return slices;
  check_voxels(path, frame.size);
  require_memory(path, "size", 4.0 * static_cast<double>(as_stored.voxels() + frame.voxels()),
                 "resample the series to even slices with another program first");
  const ImageVolume<float> all = read_all(*slices);
  ImageVolume<float> volume;
  static_cast<ImageFrame&>(volume) = frame;
  volume.data = resampled(grid, columns, rows, all.data, options.labels);
  return owning_source(std::move(volume), path, slices->notes());
}

std::vector<std::string> files_of_series(const std::string& folder, const std::string& wanted) {
  std::vector<Found> all = series_in(folder);
  const auto& files = all[chosen_series(folder, all, wanted)].files;
  std::vector<std::string> names, notes;
  ScanReadOptions any;  // the order alone counts here
  any.allow_irregular = true;
  any.spacing_mm = {1, 1, 1};
  for (const auto& slice : ordered(folder, files, any, notes).slices)
    if (std::find(names.begin(), names.end(), slice.header->file) == names.end())
      names.push_back(slice.header->file);
  return names;
}

}  // namespace toothprep::image

namespace toothprep {

std::vector<SeriesInfo> list_series(const std::string& folder) {
  std::vector<SeriesInfo> infos;
  for (const auto& found : image::series_in(folder)) infos.push_back(found.info);
  return infos;
}

}  // namespace toothprep
