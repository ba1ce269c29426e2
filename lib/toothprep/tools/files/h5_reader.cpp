#include "toothprep/tools/files/h5_reader.h"

#include <hdf5.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "toothprep/step/core/regular_file.h"
#include "toothprep/step/core/tissue.h"
#include "toothprep/tools/files/h5_checksums.h"
#include "toothprep/tools/files/h5_safe_driver.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep::h5 {
namespace {

// What a trial may take before any row was read.
constexpr double kTrialSeconds = 0.5;  // CPU
constexpr std::size_t kTrialMemory = std::size_t{1} << 30;

constexpr double kSecondsPerValue = 1e-6;      // CPU, to read one and to put it where it belongs
constexpr std::size_t kBytesPerRow = 2000;     // of a recording, with what reading it takes
constexpr unsigned kReadAttempts = 22;         // of a block of a growing file: some 4 ms
constexpr hsize_t kLargestChunk = 256u << 20;  // bytes, which HDF5 allocates to read one

// More than a packed chunk of so many bytes ever takes.
constexpr hsize_t most_packed(hsize_t bytes) { return 2 * bytes + 1024; }

// Nothing that a file names is fetched from elsewhere: links to other files lead nowhere, and no
// filter is loaded as a plug-in.
void stay_in_the_file() {
  H5Lunregister(H5L_TYPE_EXTERNAL);
  H5PLset_loading_state(0);
}

// Whether values of `width` bytes are stored in chunks that went through shuffle and deflate.
bool packed_as_here(hid_t creation, std::size_t width) {
  if (H5Pget_layout(creation) != H5D_CHUNKED || H5Pget_nfilters(creation) != 2) return false;
  const auto filter = [&](unsigned i, unsigned& setting) {
    unsigned flags = 0, settings = 0;
    std::size_t values = 1;
    return H5Pget_filter(creation, i, &flags, &values, &setting, 0, nullptr, &settings);
  };
  unsigned shuffled = 0, level = 0;
  return filter(0, shuffled) == H5Z_FILTER_SHUFFLE && shuffled == width &&
         filter(1, level) == H5Z_FILTER_DEFLATE;
}

// The descriptor of a file that HDF5 reads byte by byte as it lies on the disk; -1 of another.
int descriptor_of(hid_t file) {
  const Handle access(H5Fget_access_plist(file), H5Pclose);
  const Handle creation(H5Fget_create_plist(file), H5Pclose);
  hsize_t before = 0;  // bytes of someone else, which addresses don't count
  void* descriptor = nullptr;
  if (H5Pget_driver(access.get()) != H5FD_SEC2 || H5Pget_userblock(creation.get(), &before) < 0 ||
      before != 0 || H5Fget_vfd_handle(file, access.get(), &descriptor) < 0 || !descriptor)
    return -1;
  return *static_cast<int*>(descriptor);
}

std::string shape_text(const std::vector<std::uint64_t>& size) {
  std::string text;
  for (const std::uint64_t n : size) text += (text.empty() ? "" : " x ") + std::to_string(n);
  return text.empty() ? "a single value" : text;
}

}  // namespace

void try_parsing(const std::string& path, Unpacking unpacking,
                 const std::function<void(Reader&)>& parse) {
  std::error_code error;
  std::uintmax_t known =
      std::filesystem::file_size(path, error);  // bytes, as far as they count here
  known = error ? 0 : std::min(known, std::uintmax_t{1} << 32);
  const auto failure = failure_in_trial(
      [&] {
        limit_trial(kTrialSeconds, kTrialMemory);
        Reader in(path, unpacking, true);
        parse(in);
      },
      static_cast<unsigned>(20 + (known >> 20)),  // s: a slow disk reads 1 MB/s
      kTrialMemory);
  if (!failure) return;
  if (failure->input) throw *failure->input;
  throw InputError(path, "", "is damaged", "record it again");
}

std::string printable(std::string text) {
  text = text.substr(0, 60);
  for (char& c : text)
    if (c < ' ' || c > '~') c = '?';
  return text;
}

std::vector<std::string> object_names(Id file) {
  std::vector<std::string> names;
  H5Lvisit(
      file, H5_INDEX_NAME, H5_ITER_INC,
      [](hid_t, const char* name, const H5L_info_t* link, void* all) -> herr_t {
        if (link->type == H5L_TYPE_HARD)
          static_cast<std::vector<std::string>*>(all)->push_back(std::string("/") + name);
        return 0;
      },
      &names);
  return names;
}

// Chunks are appended one after the other, so those within are the first ones, but for a few that
// found a gap.
std::uint64_t rows_within(Id dataset, std::uint64_t bytes) {
  constexpr std::uint64_t kOutOfOrder = 8;
  const Handle space(H5Dget_space(dataset), H5Sclose);
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  hsize_t size[H5S_MAX_RANK] = {}, chunk[H5S_MAX_RANK] = {};
  H5Sget_simple_extent_dims(space.get(), size, nullptr);
  if (H5Pget_layout(creation.get()) != H5D_CHUNKED ||
      H5Pget_chunk(creation.get(), H5S_MAX_RANK, chunk) < 1 || chunk[0] == 0)
    return size[0];
  const auto is_within = [&](std::uint64_t index) {
    const hsize_t first[H5S_MAX_RANK] = {index * chunk[0]};
    unsigned filters = 0;
    haddr_t at = 0;
    hsize_t length = 0;
    return H5Dget_chunk_info_by_coord(dataset, first, &filters, &at, &length) >= 0 &&
           at != HADDR_UNDEF && at + length <= bytes;
  };
  std::uint64_t within = 0, beyond = (size[0] + chunk[0] - 1) / chunk[0];
  while (within < beyond) {
    const std::uint64_t middle = within + (beyond - within) / 2;
    (is_within(middle) ? within : beyond) = is_within(middle) ? middle + 1 : middle;
  }
  for (std::uint64_t back = 1; back <= std::min(kOutOfOrder, beyond); ++back)
    if (!is_within(beyond - back)) within = beyond - back;
  return std::min<std::uint64_t>(within * chunk[0], size[0]);
}

OpenFile open_to_read(const std::string& path) {
  OpenFile opened;
  opened.file = Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (opened.file) return opened;
  // A checksum that doesn't hold may be a block that is being written: HDF5 waits and reads again,
  // twice as long each time; a hundred times by itself, which takes 10 s of a damaged file.
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_metadata_read_attempts(access.get(), kReadAttempts);
  use_safe_driver(access.get());
  opened.file =
      Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, access.get()), H5Fclose);
  opened.shared = true;
  return opened;
}

Reader::Reader(const std::string& path, Unpacking unpacking, bool trial)
    : path_(path), unpacking_(unpacking), trial_(trial) {
  regular_file_size(path);
  stay_in_the_file();
  if (H5Fis_hdf5(path.c_str()) <= 0)
    throw InputError(path, "", "is not an HDF5 file or cannot be read",
                     "give a trace or a trajectory (.h5)");
  OpenFile opened = open_to_read(path);
  file_ = std::move(opened.file);
  growing_ = shared_ = opened.shared;
  if (!file_)
    throw InputError(path, "", "is truncated, damaged or being written", "record it again");
  // A recorder that was stopped early closes its file, and says that it isn't complete. Asked first:
  // what is written at the end of a session is there if it is, and may be half written if not.
  complete_ = number("complete") == 1.0;
  if (!shared_) descriptor_ = descriptor_of(file_.get());
  growing_ = growing_ || (number("live").value_or(0) == 1 && number("complete") == 0.0);
}

bool Reader::has(const std::string& name) const {
  for (std::size_t slash = 1; slash != 0;) {
    slash = name.find('/', slash);
    const std::string part = name.substr(0, slash);
    const htri_t there = H5Lexists(file_.get(), part.c_str(), H5P_DEFAULT);
    if (there < 0) refuse(part, "cannot be looked for: the file is damaged");
    if (there == 0) return false;
    H5L_info_t link;
    if (H5Lget_info(file_.get(), part.c_str(), &link, H5P_DEFAULT) >= 0 &&
        link.type != H5L_TYPE_HARD && link.type != H5L_TYPE_SOFT)
      refuse(part, "is a link to another file or of an unknown kind, which is not followed",
             "store the dataset in the file itself");
    if (H5Oexists_by_name(file_.get(), part.c_str(), H5P_DEFAULT) <= 0) return false;
    slash = slash == std::string::npos ? 0 : slash + 1;
  }
  return true;
}

void Reader::refuse(const std::string& place, const std::string& condition,
                    const std::string& remedy) const {
  throw InputError(path_, place, condition, remedy);
}

void Reader::cut_to_shortest(const std::vector<std::string>& names) {
  if (!growing_) return;
  for (const std::string& name : names) {
    if (!has(name)) continue;
    const Set set{
        Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose), name, 0, 0, {}};
    if (!set.handle || H5Iget_type(set.handle.get()) != H5I_DATASET) continue;  // open() refuses it
    const std::vector<std::uint64_t> size = extent(set);
    if (size.empty()) continue;
    if (size[0] == 0)
      refuse(name, "holds no rows", "the recording has just begun, or was cut off at once");
    rows_ = std::min<std::uint64_t>(size[0], rows_.value_or(kMostSamples));
  }
  check_end();
}

void Reader::check_end() const {
  haddr_t end = 0;
  const std::uint64_t bytes = regular_file_size(path_);
  if (!shared_ || H5Fget_eoa(file_.get(), &end) < 0 || end <= bytes) return;
  for (const std::string& name : object_names(file_.get())) {
    const Set set{
        Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose), name, 0, 0, {}};
    if (!set.handle) refuse(name, "cannot be read: the file is damaged or was cut off", remedy());
    if (H5Iget_type(set.handle.get()) != H5I_DATASET) continue;
    const std::vector<std::uint64_t> size = extent(set);
    if (size.empty()) continue;
    const std::uint64_t within = rows_within(set.handle.get(), bytes);
    if (within < size[0])
      refuse(name,
             "has " + std::to_string(size[0]) + " rows, of which the file holds " +
                 std::to_string(within) + ": it was cut off",
             "copy it again; " + remedy());
  }
}

// What can't be looked up is no lack.
bool Reader::has_attribute(const char* name) const {
  const htri_t there = H5Aexists(file_.get(), name);
  if (there < 0)
    refuse(std::string("attribute ") + name, "cannot be looked for: the file is damaged");
  return there > 0;
}

std::string Reader::remedy() const {
  if (number("live").value_or(0) != 1) return "make it again";
  return "toothprep recover keeps what can be read";
}

void Reader::verify_checksums() const {
  const bool open_end =
      number("live").value_or(0) == 1 && !complete_ && number("recovered").value_or(0) != 1;
  for (const char* list : {kChecksumsOfHead, kChecksums}) {
    if (open_end && list == kChecksums) continue;  // may be half written
    const std::string lines = text(list).value_or("");
    if (lines.empty()) continue;
    const auto allow = [this](std::size_t values) {
      limit_trial(kTrialSeconds + kSecondsPerValue * static_cast<double>(values),
                  kTrialMemory + kBytesPerRow * proven_rows_);
    };
    const std::vector<std::string> different = differing(file_.get(), lines, allow);
    if (!different.empty())
      refuse(different.front(),
             "is not what was written: its checksum differs, so the file was " +
                 std::string("damaged or changed"),
             "copy it again from where it was made; " + remedy());
  }
}

Reader::Set Reader::open(const std::string& name, const char* unit, int width, bool unit_required,
                         bool per_tissue) {
  Set set{Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose), name, width, 0, {}};
  if (!set.handle || H5Iget_type(set.handle.get()) != H5I_DATASET) refuse(name, "is not a dataset");
  check_type(set);
  const std::vector<std::uint64_t> size = extent(set);
  const std::uint64_t rows = check_shape(set, size, per_tissue);
  if (rows > kMostSamples)
    refuse(name,
           "claims " + std::to_string(rows) + " rows, more than " + std::to_string(kMostSamples),
           "cut the recording into pieces");
  set.rows = static_cast<std::size_t>(rows);
  if (!rows_) rows_ = set.rows;
  if (growing_ ? rows < *rows_ : rows != *rows_)
    refuse(name, "has " + std::to_string(rows) + " rows where /time has " + std::to_string(*rows_));
  check_storage(set);
  check_unit(set, unit, unit_required);
  return set;
}

std::vector<double> Reader::values_of(const Set& set) const {
  const std::size_t total = *rows_ * static_cast<std::size_t>(set.width);
  // Rows count once /time was read: its values increase, so they are there.
  limit_trial(kTrialSeconds + kSecondsPerValue * static_cast<double>(total),
              kTrialMemory + kBytesPerRow * proven_rows_);
  if (const auto chunks = chunk_places(set)) {
    // A child has none of TBB's threads.
    if (auto values = unpacked_values(descriptor_, *chunks, total, trial_))
      return *std::move(values);
    if (!trial_) throw CannotUnpack();
  }
  std::vector<double> values(total);
  Handle stored, memory;  // neither: all
  if (set.rows != *rows_) {
    std::vector<hsize_t> count;
    for (const std::uint64_t n : extent(set)) count.push_back(n == set.rows ? *rows_ : n);
    const std::vector<hsize_t> start(count.size(), 0);
    const hsize_t all = values.size();
    stored = Handle(H5Dget_space(set.handle.get()), H5Sclose);
    memory = Handle(H5Screate_simple(1, &all, nullptr), H5Sclose);
    H5Sselect_hyperslab(stored.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
  }
  if (H5Dread(set.handle.get(), H5T_NATIVE_DOUBLE, memory ? memory.get() : H5S_ALL,
              stored ? stored.get() : H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    refuse(set.name, "cannot be read: the file is damaged", remedy());
  return values;
}

// Nothing unless all rows are stored as Writer stores them.
std::optional<ChunkPlaces> Reader::chunk_places(const Set& set) const {
  if (unpacking_ == Unpacking::kByHdf5 || descriptor_ < 0 || set.rows != *rows_) return {};
  const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
  ChunkPlaces chunks;
  for (const hid_t known : {H5T_IEEE_F64LE, H5T_STD_U32LE, H5T_STD_U8LE})
    if (H5Tequal(type.get(), known) > 0) chunks.width = H5Tget_size(known);
  const Handle creation(H5Dget_create_plist(set.handle.get()), H5Pclose);
  if (chunks.width == 0 || !packed_as_here(creation.get(), chunks.width)) return {};
  const std::vector<std::uint64_t> size = extent(set);
  hsize_t chunk[H5S_MAX_RANK] = {};
  if (H5Pget_chunk(creation.get(), H5S_MAX_RANK, chunk) != static_cast<int>(size.size()) ||
      (size.size() > 1 && chunk[1] != size[1]))
    return {};
  chunks.chunk_size = chunks.width * chunk[0] * (size.size() > 1 ? chunk[1] : 1);
  const std::uint64_t end = regular_file_size(path_);
  hsize_t first[H5S_MAX_RANK] = {};
  for (; first[0] < size[0]; first[0] += chunk[0]) {
    unsigned filters = 0;
    haddr_t at = 0;
    hsize_t length = 0;
    if (H5Dget_chunk_info_by_coord(set.handle.get(), first, &filters, &at, &length) < 0 ||
        filters != 0 || at > end || length == 0 || length > end - at ||
        length > most_packed(chunks.chunk_size))
      return {};
    chunks.places.push_back({at, length});
  }
  return chunks;
}

std::vector<double> Reader::read_unless_trial(const Set& set) const {
  if (trial_ && chunk_places(set)) return {};
  return read(set);
}

std::vector<double> Reader::read(const Set& set) const {
  std::vector<double> values = values_of(set);
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isfinite(values[i]))
      refuse(set.name + ", row " + std::to_string(i / static_cast<std::size_t>(set.width)),
             "is not finite");
  return values;
}

std::vector<double> Reader::read_table(const std::string& name, const char* unit, int width) {
  if (!has(name)) refuse(name, "is missing");
  {
    const Set set{
        Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose), name, 0, 0, {}};
    if (set.handle && H5Iget_type(set.handle.get()) == H5I_DATASET)
      if (const auto size = extent(set); !size.empty() && size[0] == 0) return {};
  }
  const auto rows = std::exchange(rows_, std::nullopt);
  std::vector<double> values = read(open(name, unit, width, true));
  rows_ = rows;
  return values;
}

std::vector<double> Reader::read_time() {
  if (!has("/time")) refuse("/time", "is missing");
  const Set set = open("/time", "s", 1, true);
  if (growing_) {  // after a power failure the last rows may never have been written
    const std::vector<double> time = values_of(set);
    std::size_t good = 1;
    while (good < time.size() && time[good] > time[good - 1] && std::isfinite(time[good])) ++good;
    rows_ = good;
  }
  std::vector<double> time = read(set);
  for (std::size_t i = 1; i < time.size(); ++i)
    if (!(time[i] > time[i - 1]))
      refuse("/time, row " + std::to_string(i), "time does not increase");
  proven_rows_ = time.size();
  return time;
}

std::optional<std::string> Reader::text(const char* name) const {
  if (!has_attribute(name)) return {};
  return text(file_.get(), name, "/");
}

std::string Reader::require_text(const char* name) const {
  const auto value = text(name);
  if (!value) refuse(std::string("attribute ") + name, "is missing");
  return *value;
}

std::optional<double> Reader::number(const char* name) const {
  if (!has_attribute(name)) return {};
  const Handle attribute(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  double value = 0;
  const H5T_class_t kind = H5Tget_class(type.get());
  if ((kind != H5T_FLOAT && kind != H5T_INTEGER) ||
      H5Sget_simple_extent_npoints(space.get()) != 1 ||
      H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, &value) < 0)
    refuse(std::string("attribute ") + name, "must be one number");
  return value;
}

double Reader::require_number(const char* name) const {
  const auto value = number(name);
  if (!value) refuse(std::string("attribute ") + name, "is missing");
  return *value;
}

std::optional<std::vector<double>> Reader::numbers(const char* name, std::size_t count) const {
  if (!has_attribute(name)) return {};
  const Handle attribute(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  std::vector<double> values(count);
  const H5T_class_t kind = H5Tget_class(type.get());
  if ((kind != H5T_FLOAT && kind != H5T_INTEGER) ||
      H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(count) ||
      H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, values.data()) < 0)
    refuse(std::string("attribute ") + name, "must be " + std::to_string(count) + " numbers");
  return values;
}

Quat Reader::quaternion(const std::string& dataset, std::size_t row, const double* v) const {
  Quat orientation;
  if (!accept_quaternion(Quat(v[3], v[0], v[1], v[2]), orientation))
    refuse(dataset + ", row " + std::to_string(row), "is not a unit quaternion (x, y, z, w)");
  return orientation;
}

double Reader::whole_number(const std::string& dataset, std::size_t row, double value, double least,
                            double most) const {
  if (!(value >= least && value <= most && value == std::floor(value)))
    refuse(dataset + ", row " + std::to_string(row),
           least == 0 ? "must be a whole number of 0 or more" : "must be a whole number");
  return value;
}

void Reader::check_type(const Set& set) const {
  const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
  const H5T_class_t kind = H5Tget_class(type.get());  // booleans are stored as enumerations
  if ((kind != H5T_FLOAT && kind != H5T_INTEGER && kind != H5T_ENUM) ||
      H5Tget_size(type.get()) > 16)
    refuse(set.name, "must hold numbers");
}

std::vector<std::uint64_t> Reader::extent(const Set& set) const {
  const Handle space(H5Dget_space(set.handle.get()), H5Sclose);
  if (H5Sget_simple_extent_type(space.get()) == H5S_NULL) refuse(set.name, "is empty");
  const int dimensions = H5Sget_simple_extent_ndims(space.get());
  if (dimensions < 0 || dimensions > H5S_MAX_RANK) refuse(set.name, "has no readable shape");
  hsize_t size[H5S_MAX_RANK] = {};
  if (dimensions > 0) H5Sget_simple_extent_dims(space.get(), size, nullptr);
  return {size, size + dimensions};
}

std::uint64_t Reader::check_shape(Set& set, const std::vector<std::uint64_t>& size,
                                  bool per_tissue) const {
  if (per_tissue) {
    set.tissues = tissues_of(set);
    set.width = static_cast<int>(set.tissues.size());
  }
  std::uint64_t rows = 0;
  const auto width = static_cast<std::uint64_t>(set.width);
  const bool a_list = size.size() == 1 && width == 1 && !per_tissue;
  if (a_list || (size.size() == 2 && size[1] == width))
    rows = size[0];
  else if (size.size() == 2 && width == 1 && size[0] == 1)
    rows = size[1];  // how MATLAB stores a column
  else
    refuse(set.name, "is " + shape_text(size) + ", must be T x " + std::to_string(width),
           size.size() == 2 && size[0] == width ? "it is transposed: MATLAB writes its arrays so"
                                                : "T is the number of samples");
  if (rows == 0) refuse(set.name, "holds no rows");
  return rows;
}

void Reader::check_storage(const Set& set) const {
  const Handle creation(H5Dget_create_plist(set.handle.get()), H5Pclose);
  if (H5Pget_layout(creation.get()) == H5D_VIRTUAL || H5Pget_external_count(creation.get()) != 0)
    refuse(set.name, "is stored in other files (external or virtual), which are not opened",
           "store it in the file itself");
  const int filters = H5Pget_nfilters(creation.get());
  for (int i = 0; i < filters; ++i) {
    unsigned flags = 0, settings = 0;
    std::size_t values = 0;
    const H5Z_filter_t filter = H5Pget_filter(creation.get(), static_cast<unsigned>(i), &flags,
                                              &values, nullptr, 0, nullptr, &settings);
    if (filter < 0 || filter >= H5Z_FILTER_RESERVED)
      refuse(
          set.name,
          "is packed by the filter " + std::to_string(filter) + ", which is not one of HDF5's own",
          "store it unpacked or with gzip");
  }
  if (H5Pget_layout(creation.get()) == H5D_CHUNKED) {
    hsize_t chunk[H5S_MAX_RANK] = {};
    const int dimensions = H5Pget_chunk(creation.get(), H5S_MAX_RANK, chunk);
    const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
    double bytes = static_cast<double>(H5Tget_size(type.get()));
    for (int i = 0; i < dimensions; ++i) bytes *= static_cast<double>(chunk[i]);
    if (!(bytes <= static_cast<double>(kLargestChunk)))
      refuse(set.name, "is stored in chunks of more than 256 MB", "store it in smaller chunks");
  }
  if (H5Dget_storage_size(set.handle.get()) == 0)
    refuse(set.name, "holds no data", "was the recording cut off?");
}

void Reader::check_unit(const Set& set, const char* unit, bool required) const {
  const auto given = text(set.handle.get(), "units", set.name);
  if (!given && required)
    refuse(set.name, "has no attribute `units`", std::string("it must be \"") + unit + "\"");
  if (given && *given != unit)
    refuse(set.name, "is in \"" + printable(*given) + "\", must be in \"" + unit + "\"",
           "convert it");
}

std::vector<int> Reader::tissues_of(const Set& set) const {
  const std::string place = set.name + ", attribute tissues";
  if (H5Aexists(set.handle.get(), "tissues") <= 0) refuse(place, "is missing");
  const Handle attribute(H5Aopen(set.handle.get(), "tissues", H5P_DEFAULT), H5Aclose);
  std::vector<int> order;
  for (const std::string& name : strings(attribute, place, kTissueCount)) {
    const auto tissue = tissue_named(name);
    if (!tissue) refuse(place, "names an unknown tissue '" + printable(name) + "'");
    if (std::find(order.begin(), order.end(), tissue_index(*tissue)) != order.end())
      refuse(place, "names '" + name + "' twice");
    order.push_back(tissue_index(*tissue));
  }
  return order;
}

std::optional<std::string> Reader::text(Id object, const char* name,
                                        const std::string& owner) const {
  if (H5Aexists(object, name) <= 0) return {};
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  return strings(attribute, owner + ", attribute " + name, 1).front();
}

// 1 .. `most` strings, of fixed or variable length.
std::vector<std::string> Reader::strings(const Handle& attribute, const std::string& place,
                                         std::int64_t most) const {
  constexpr std::size_t kLongestText = 1 << 20;
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  if (H5Tget_class(type.get()) != H5T_STRING) refuse(place, "must be text");
  if (count < 1 || count > most)
    refuse(place, "must hold " + (most == 1 ? std::string("one text")
                                            : "1 to " + std::to_string(most) + " texts"));
  std::vector<std::string> result;
  if (H5Tis_variable_str(type.get()) > 0) {
    auto texts = texts_of(attribute, most);
    if (!texts) refuse(place, "cannot be read: the file is damaged");
    result = std::move(*texts);
  } else {
    const std::size_t size = H5Tget_size(type.get());
    if (size > kLongestText) refuse(place, "is longer than 1 MB");
    std::vector<char> characters(size * static_cast<std::size_t>(count));
    if (H5Aread(attribute.get(), type.get(), characters.data()) < 0)
      refuse(place, "cannot be read: the file is damaged");
    for (hssize_t i = 0; i < count; ++i) {
      std::string t(characters.data() + static_cast<std::size_t>(i) * size, size);
      t = t.substr(0, t.find('\0'));
      if (H5Tget_strpad(type.get()) == H5T_STR_SPACEPAD) t.erase(t.find_last_not_of(' ') + 1);
      result.push_back(t);
    }
  }
  return result;
}

}  // namespace toothprep::h5
