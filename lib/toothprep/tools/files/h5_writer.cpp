#include "toothprep/tools/files/h5_writer.h"

#include <fcntl.h>
#include <hdf5.h>
#include <unistd.h>

#include <algorithm>
#include <limits>

#include "toothprep/step/core/errors.h"

namespace toothprep::h5 {
namespace {

// Chunks of about this many bytes: a viewer reads one quickly, and gzip has enough to work on.
constexpr std::size_t kChunkBytes = 256 * 1024;
constexpr unsigned kGzipLevel = 4;

// Rows of a chunk of a growing file: about a second at 1 kHz.
constexpr hsize_t kGrowingChunk = 1024;

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

}  // namespace

Writer::Writer(const std::string& path) : path_(path) {
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  file_ = Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.get(), H5P_DEFAULT), H5Fclose);
  check(file_.get());
  group_creation_ = Handle(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(group_creation_.get(), false));
}

Writer::Writer(const std::string& path, Growing) : path_(path) {
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  // No cache of chunks: rows are in the file when append() returns, before a flush writes that they
  // are there. (HDF5's flush, when it fails to write cached rows, goes on to write so all the
  // same.)
  check(H5Pset_cache(access.get(), 0, 0, 0, 1));
  check(H5Pset_libver_bounds(access.get(), H5F_LIBVER_V110, H5F_LIBVER_V110));
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

void Writer::describe(const Handle& set, const char* unit,
                      const std::vector<std::string>& tissues) {
  text(set.get(), "units", unit);
  if (!tissues.empty()) texts(set.get(), "tissues", tissues);
}

void Writer::dataset(const char* name, const char* unit, const std::vector<double>& values,
                     int width, Storage storage, const std::vector<std::string>& tissues) {
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
  check(H5Dwrite(set.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()));
  describe(set, unit, tissues);
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

void Writer::close() {
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
  const Handle made(H5Acreate2(object, name, stored, space.get(), H5P_DEFAULT, H5P_DEFAULT),
                    H5Aclose);
  check(made.get());
  check(H5Awrite(made.get(), given, value));
}

void Writer::check(Id status) const {
  if (status < 0) fail();
}

void Writer::fail() const { throw Error(path_ + ": cannot be written; is the disk full?"); }

GrowingWriter::GrowingWriter(const std::string& path) : Writer(path, Growing{}) {}

GrowingWriter::~GrowingWriter() { columns_.clear(); }

std::size_t GrowingWriter::column(const char* name, const char* unit, int width, Storage storage,
                                  const std::vector<std::string>& tissues) {
  const int dimensions = width == 1 ? 1 : 2;
  const hsize_t size[2] = {0, static_cast<hsize_t>(width)};
  const hsize_t most[2] = {H5S_UNLIMITED, size[1]};
  const hsize_t chunk[2] = {kGrowingChunk, size[1]};
  const Handle space(H5Screate_simple(dimensions, size, most), H5Sclose);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  check(H5Pset_obj_track_times(creation.get(), false));
  check(H5Pset_chunk(creation.get(), dimensions, chunk));
  check(H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER));  // it would need the cache
  columns_.push_back({make_dataset(name, storage, space.get(), creation.get()), width, 0});
  describe(columns_.back().set, unit, tissues);
  return columns_.size() - 1;
}

void GrowingWriter::start() { check(H5Fstart_swmr_write(file_.get())); }

void GrowingWriter::append(std::size_t column, const std::vector<double>& values) {
  Column& c = columns_[column];
  const auto width = static_cast<hsize_t>(c.width);
  const hsize_t start[2] = {c.rows, 0};
  const hsize_t count[2] = {values.size() / width, width};
  const hsize_t size[2] = {start[0] + count[0], width};
  check(H5Dset_extent(c.set.get(), size));
  const Handle stored(H5Dget_space(c.set.get()), H5Sclose);
  const Handle memory(H5Screate_simple(c.width == 1 ? 1 : 2, count, nullptr), H5Sclose);
  check(H5Sselect_hyperslab(stored.get(), H5S_SELECT_SET, start, nullptr, count, nullptr));
  check(H5Dwrite(c.set.get(), H5T_NATIVE_DOUBLE, memory.get(), stored.get(), H5P_DEFAULT,
                 values.data()));
  c.rows = size[0];
}

void GrowingWriter::flush() { check(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL)); }

void GrowingWriter::set_text(const char* name, const std::string& value) {
  const Handle made(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  check(made.get());
  const Handle type(H5Aget_type(made.get()), H5Tclose);
  const char* characters = value.c_str();
  check(H5Awrite(made.get(), type.get(), &characters));
}

void GrowingWriter::set_number(const char* name, double value) { set_numbers(name, {value}); }

void GrowingWriter::set_numbers(const char* name, const std::vector<double>& values) {
  const Handle made(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
  check(made.get());
  check(H5Awrite(made.get(), H5T_NATIVE_DOUBLE, values.data()));
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
