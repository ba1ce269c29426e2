#include "toothprep/tools/files/h5_writer.h"

#include <fcntl.h>
#include <hdf5.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/h5_checksums.h"
#include "toothprep/tools/files/h5_packing.h"
#include "toothprep/tools/files/h5_safe_driver.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep::h5 {
namespace {

// Chunks of about this many bytes: a viewer reads one quickly, and gzip has enough to work on.
constexpr std::size_t kChunkBytes = 256 * 1024;
constexpr unsigned kGzipLevel = 1;  // as the filter is declared; packed_chunks() packs

hid_t type_of(Storage storage) {
  switch (storage) {
    case Storage::kUint32:
      return H5T_STD_U32LE;
    case Storage::kUint8:
      return H5T_STD_U8LE;
    case Storage::kInt32:
      return H5T_STD_I32LE;
    case Storage::kInt64:
      return H5T_STD_I64LE;
    case Storage::kDouble:
      break;
  }
  return H5T_IEEE_F64LE;
}

static_assert(std::endian::native == std::endian::little, "stored() gives the machine's");

template <class T>
void put(const double* values, std::size_t count, std::vector<char>& bytes) {
  bytes.resize(count * sizeof(T));
  // The largest double that is a T.
  const double least = static_cast<double>(std::numeric_limits<T>::lowest()),
               most = sizeof(T) < 8 ? static_cast<double>(std::numeric_limits<T>::max())
                                    : 9223372036854774784.0;
  for (std::size_t i = 0; i < count; ++i) {
    const T value = static_cast<T>(std::clamp(values[i], least, most));
    std::memcpy(bytes.data() + i * sizeof(T), &value, sizeof(T));
  }
}

// Values as they are stored: whole numbers cut off to what their type holds.
struct Stored {
  const void* data;
  std::size_t size;  // bytes
};

// In `bytes`, but for doubles, which are stored as they are.
Stored stored(const double* values, std::size_t count, Storage storage, std::vector<char>& bytes) {
  switch (storage) {
    case Storage::kUint32:
      put<std::uint32_t>(values, count, bytes);
      break;
    case Storage::kUint8:
      put<std::uint8_t>(values, count, bytes);
      break;
    case Storage::kInt32:
      put<std::int32_t>(values, count, bytes);
      break;
    case Storage::kInt64:
      put<std::int64_t>(values, count, bytes);
      break;
    case Storage::kDouble:
      return {values, count * sizeof(double)};
  }
  return {bytes.data(), bytes.size()};
}

// Strings of variable length: the kind that h5py and MATLAB give back as plain text.
Handle string_type(bool ascii) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), H5T_VARIABLE);
  H5Tset_cset(type.get(), ascii ? H5T_CSET_ASCII : H5T_CSET_UTF8);
  return type;
}

bool is_ascii(const std::string& value) {
  return std::all_of(value.begin(), value.end(),
                     [](char c) { return static_cast<unsigned char>(c) < 128; });
}

Handle scalar() { return {H5Screate(H5S_SCALAR), H5Sclose}; }

std::string path_of(Id object) {
  char path[256] = "/";
  H5Iget_name(object, path, sizeof path);
  return path;
}

std::vector<std::uint64_t> shape_of_rows(std::uint64_t rows, int width) {
  if (width == 1) return {rows};
  return {rows, static_cast<std::uint64_t>(width)};
}

}  // namespace

Writer::Writer(const std::string& path, Checksums checksums)
    : path_(path), shown_(path), checksums_(checksums) {
  errno = 0;
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  file_ = Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.get(), H5P_DEFAULT), H5Fclose);
  check(file_.get());
  group_creation_ = Handle(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(group_creation_.get(), false));
}

Writer::Writer(const std::string& path, const std::string& shown, Growing)
    : path_(path), shown_(shown) {
  errno = 0;
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  // No cache of chunks: rows are in the file when append() returns, before a flush writes that they
  // are there. (HDF5's flush, when it fails to write cached rows, goes on to write so all the
  // same.)
  check(H5Pset_cache(access.get(), 0, 0, 0, 1));
  check(H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110));
  check(use_safe_driver(access.get()));
  file_ = Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.get(), access.get()), H5Fclose);
  check(file_.get());
  group_creation_ = Handle(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(group_creation_.get(), false));
}

void Writer::group(const char* name) {
  const Handle group(H5Gcreate2(file_.get(), name, H5P_DEFAULT, group_creation_.get(), H5P_DEFAULT),
                     H5Gclose);
  check(group.get());
}

Handle Writer::make_dataset(const char* name, Storage storage, Id space, Id creation) {
  Handle set(
      H5Dcreate2(file_.get(), name, type_of(storage), space, H5P_DEFAULT, creation, H5P_DEFAULT),
      H5Dclose);
  check(set.get());
  return set;
}

void Writer::describe(const Handle& set, const char* unit, const std::vector<std::string>& names,
                      const char* of_what) {
  text(set.get(), "units", unit);
  if (!names.empty()) texts(set.get(), of_what, names);
}

void Writer::dataset(const char* name, const char* unit, const std::vector<double>& values,
                     int width, Storage storage, const std::vector<std::string>& names,
                     const char* of_what) {
  const hsize_t rows = values.size() / static_cast<std::size_t>(width);
  const hsize_t size[2] = {rows, static_cast<hsize_t>(width)};
  const int dimensions = width == 1 ? 1 : 2;
  const hsize_t chunk[2] = {
      std::min<hsize_t>(rows, kChunkBytes / (static_cast<std::size_t>(width) * sizeof(double))),
      size[1]};
  const double zero = 0;
  const Handle space(H5Screate_simple(dimensions, size, nullptr), H5Sclose);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  check(H5Pset_chunk(creation.get(), dimensions, chunk));
  check(H5Pset_shuffle(creation.get()));
  check(H5Pset_deflate(creation.get(), kGzipLevel));
  // The last chunk's tail is written too: say what it holds.
  check(H5Pset_fill_value(creation.get(), H5T_NATIVE_DOUBLE, &zero));
  check(H5Pset_fill_time(creation.get(), H5D_FILL_TIME_ALLOC));
  const Handle set = make_dataset(name, storage, space.get(), creation.get());
  std::vector<char> bytes;
  const Stored its = stored(values.data(), values.size(), storage, bytes);
  const std::size_t row_size = its.size / rows;
  hsize_t place[2] = {0, 0};
  for (const std::vector<char>& packed :
       packed_chunks(its.data, its.size, row_size / size[1], chunk[0] * row_size)) {
    errno = 0;
    check(H5Dwrite_chunk(set.get(), H5P_DEFAULT, 0, place, packed.size(), packed.data()));
    place[0] += chunk[0];
  }
  if (checksums_ == Checksums::kYes) {
    Sha256 hash;
    hash.update(its.data, its.size);
    dataset_lines_.insert(
        dataset_line(name, type_of(storage), shape_of_rows(rows, width), hash.hex()));
  }
  describe(set, unit, names, of_what);
}

void Writer::text(const char* name, const std::string& value) { text(file_.get(), name, value); }

void Writer::number(const char* name, double value) {
  attribute(file_.get(), name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value, scalar());
}

void Writer::numbers(const char* name, const std::vector<double>& values) {
  const hsize_t count = values.size();
  attribute(file_.get(), name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values.data(),
            Handle(H5Screate_simple(1, &count, nullptr), H5Sclose));
}

void Writer::integer(const char* name, std::int64_t value) {
  const bool small = value >= std::numeric_limits<std::int32_t>::min() &&
                     value <= std::numeric_limits<std::int32_t>::max();
  attribute(file_.get(), name, small ? H5T_STD_I32LE : H5T_STD_I64LE, H5T_NATIVE_INT64, &value,
            scalar());
}

std::set<std::string> Writer::attribute_lines(const std::set<std::string>& without) const {
  std::set<std::string> lines;
  for (const auto& [object, name] : attributes_) {
    if (object == "/" && without.count(name) != 0) continue;
    const auto line = attribute_line(file_.get(), object, name);
    if (!line) fail();
    lines.insert(*line);
  }
  return lines;
}

void Writer::write_checksums() {
  std::set<std::string> lines = attribute_lines({});
  lines.insert(dataset_lines_.begin(), dataset_lines_.end());
  text(kChecksums, checksum_list(lines));
}

void Writer::close() {
  errno = 0;
  check(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL));
  if (!file_.reset()) fail();
}

void Writer::text(Id object, const char* name, const std::string& value) {
  const Handle type = string_type(is_ascii(value));
  const char* characters = value.c_str();
  attribute(object, name, type.get(), type.get(), &characters, scalar());
}

void Writer::texts(Id object, const char* name, const std::vector<std::string>& values) {
  std::vector<const char*> characters;
  for (const std::string& value : values) characters.push_back(value.c_str());
  const hsize_t count = characters.size();
  const Handle type = string_type(true);
  attribute(object, name, type.get(), type.get(), characters.data(),
            Handle(H5Screate_simple(1, &count, nullptr), H5Sclose));
}

void Writer::attribute(Id object, const char* name, Id stored, Id given, const void* value,
                       const Handle& space) {
  errno = 0;
  const Handle made(H5Acreate2(object, name, stored, space.get(), H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose);
  check(made.get());
  check(H5Awrite(made.get(), given, value));
  attributes_.emplace(path_of(object), name);
}

void Writer::check(Id status) const {
  if (status < 0) fail();
}

// HDF5 leaves errno as the system set it.
void Writer::fail() const {
  throw Error(shown_ + ": cannot be written: " + why_not_written(path_, errno));
}

GrowingWriter::GrowingWriter(const std::string& path, const std::string& shown,
                             std::size_t rows_per_chunk)
    : Writer(path, shown, Growing{}), rows_per_chunk_(rows_per_chunk) {}

GrowingWriter::~GrowingWriter() { columns_.clear(); }

std::size_t GrowingWriter::column(const char* name, const char* unit, int width, Storage storage,
                                  const std::vector<std::string>& names, std::size_t rows_per_chunk,
                                  const char* of_what) {
  const int dimensions = width == 1 ? 1 : 2;
  const hsize_t size[2] = {0, static_cast<hsize_t>(width)};
  const hsize_t most[2] = {H5S_UNLIMITED, size[1]};
  const hsize_t chunk[2] = {rows_per_chunk ? rows_per_chunk : rows_per_chunk_, size[1]};
  const Handle space(H5Screate_simple(dimensions, size, most), H5Sclose);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const double zero = 0;
  check(H5Pset_obj_track_times(creation.get(), false));
  check(H5Pset_chunk(creation.get(), dimensions, chunk));
  check(H5Pset_fletcher32(creation.get()));
  // The last chunk's tail is written, too: say what it holds.
  check(H5Pset_fill_value(creation.get(), H5T_NATIVE_DOUBLE, &zero));
  check(H5Pset_fill_time(creation.get(), H5D_FILL_TIME_ALLOC));
  columns_.push_back({name, make_dataset(name, storage, space.get(), creation.get()), width,
                      storage, 0, std::make_unique<Sha256>()});
  describe(columns_.back().set, unit, names, of_what);
  return columns_.size() - 1;
}

void GrowingWriter::start(const std::set<std::string>& changing) {
  text(kChecksumsOfHead, checksum_list(attribute_lines(changing)));
  text(kChecksums, "");
  check(H5Fstart_swmr_write(file_.get()));
}

void GrowingWriter::append(std::size_t column, const double* values, std::size_t rows) {
  if (rows == 0) return;
  Column& c = columns_[column];
  const auto width = static_cast<hsize_t>(c.width);
  const hsize_t start[2] = {c.rows, 0};
  const hsize_t count[2] = {rows, width};
  const hsize_t size[2] = {start[0] + count[0], width};
  std::vector<char> bytes;
  const Stored its = stored(values, rows * width, c.storage, bytes);
  errno = 0;
  check(H5Dset_extent(c.set.get(), size));
  const Handle space(H5Dget_space(c.set.get()), H5Sclose);
  const Handle memory(H5Screate_simple(c.width == 1 ? 1 : 2, count, nullptr), H5Sclose);
  check(H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start, nullptr, count, nullptr));
  check(
      H5Dwrite(c.set.get(), type_of(c.storage), memory.get(), space.get(), H5P_DEFAULT, its.data));
  c.hash->update(its.data, its.size);
  c.rows = size[0];
}

void GrowingWriter::flush() {
  errno = 0;
  check(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL));
}

void GrowingWriter::set_text(const char* name, const std::string& value) {
  errno = 0;
  const Handle made(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  check(made.get());
  const Handle type(H5Aget_type(made.get()), H5Tclose);
  const char* characters = value.c_str();
  check(H5Awrite(made.get(), type.get(), &characters));
}

void GrowingWriter::set_number(const char* name, double value) { set_numbers(name, {value}); }

void GrowingWriter::set_numbers(const char* name, const std::vector<double>& values) {
  errno = 0;
  const Handle made(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  check(made.get());
  check(H5Awrite(made.get(), H5T_NATIVE_DOUBLE, values.data()));
}

void GrowingWriter::write_checksums(const std::set<std::string>& attributes) {
  std::set<std::string> lines;
  for (const std::string& name : attributes) {
    const auto line = attribute_line(file_.get(), "/", name);
    if (!line) fail();
    lines.insert(*line);
  }
  for (Column& c : columns_)
    if (c.rows > 0)
      lines.insert(
          dataset_line(c.name, type_of(c.storage), shape_of_rows(c.rows, c.width), c.hash->hex()));
  set_text(kChecksums, checksum_list(lines));
}

void GrowingWriter::close() {
  flush();
  for (Column& c : columns_)
    if (!c.set.reset()) fail();
  Writer::close();
}

void GrowingWriter::abandon() noexcept {
  void* descriptor = nullptr;
  if (file_ && H5Fget_vfd_handle(file_.get(), H5P_DEFAULT, &descriptor) >= 0 && descriptor) {
    const int nowhere = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (nowhere >= 0) {
      dup2(nowhere, *static_cast<int*>(descriptor));
      ::close(nowhere);
    }
  }
  for (Column& c : columns_) c.set.reset();
  file_.reset();
}

}  // namespace toothprep::h5
