#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <optional>

#include "toothprep/core/errors.h"
#include "toothprep/trace/hdf5_handle.h"
#include "toothprep/trace/trace.h"
#include "toothprep/trace/trace_columns.h"
#include "toothprep/core/trial.h"

namespace toothprep {
namespace {

using h5::Handle;

constexpr const char* kSchema = "toothprep-trace";
constexpr int kSchemaVersion = 1;
constexpr const char* kMeasured = "/force/measured";

// ---- Writing
// --------------------------------------------------------------------------------------

// Chunks of about this many bytes: a viewer reads one quickly, and gzip has enough to work on.
constexpr std::size_t kChunkBytes = 256 * 1024;
constexpr unsigned kGzipLevel = 4;

// A failed call means that the file can't be written: a full disk, as a rule.
class Writer {
 public:
  explicit Writer(const std::string& path) : path_(path) {
    const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(creation.get(), false));
    file_ = Handle(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.get(), H5P_DEFAULT), H5Fclose);
    check(file_.get());
    group_creation_ = Handle(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(group_creation_.get(), false));
  }

  void group(const char* name) {
    const Handle group(
        H5Gcreate2(file_.get(), name, H5P_DEFAULT, group_creation_.get(), H5P_DEFAULT), H5Gclose);
    check(group.get());
  }

  // Rows of `width` values each, as a one-dimensional dataset where the width is 1.
  void dataset(const char* name, const char* unit, const std::vector<double>& values, int width,
               Storage storage, const std::vector<std::string>& tissues = {}) {
    const hsize_t rows = values.size() / static_cast<std::size_t>(width);
    const hsize_t size[2] = {rows, static_cast<hsize_t>(width)};
    const int dimensions = width == 1 ? 1 : 2;
    const hid_t type = storage == Storage::kUint32  ? H5T_STD_U32LE
                       : storage == Storage::kUint8 ? H5T_STD_U8LE
                                                    : H5T_IEEE_F64LE;
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
    const Handle set(
        H5Dcreate2(file_.get(), name, type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
        H5Dclose);
    check(set.get());
    check(H5Dwrite(set.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()));
    text(set.get(), "units", unit);
    if (!tissues.empty()) texts(set.get(), "tissues", tissues);
  }

  void text(const char* name, const std::string& value) { text(file_.get(), name, value); }
  void number(const char* name, double value) {
    attribute(file_.get(), name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value);
  }
  void integer(const char* name, int value) {
    attribute(file_.get(), name, H5T_STD_I32LE, H5T_NATIVE_INT, &value);
  }
  void close() {
    check(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL));
    if (!file_.reset()) fail();
  }

 private:
  // Strings of variable length: the kind that h5py and MATLAB give back as plain text.
  static Handle string_type(bool ascii) {
    Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.get(), H5T_VARIABLE);
    H5Tset_cset(type.get(), ascii ? H5T_CSET_ASCII : H5T_CSET_UTF8);
    return type;
  }
  void text(hid_t object, const char* name, const std::string& value) {
    const bool ascii = std::all_of(value.begin(), value.end(),
                                   [](char c) { return static_cast<unsigned char>(c) < 128; });
    const Handle type = string_type(ascii);
    const char* characters = value.c_str();
    attribute(object, name, type.get(), type.get(), &characters);
  }
  void texts(hid_t object, const char* name, const std::vector<std::string>& values) {
    std::vector<const char*> characters;
    for (const std::string& value : values) characters.push_back(value.c_str());
    const hsize_t count = characters.size();
    const Handle type = string_type(true);
    const Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
    attribute(object, name, type.get(), type.get(), characters.data(), space);
  }
  void attribute(hid_t object, const char* name, hid_t stored, hid_t given, const void* value,
                 const Handle& space = Handle(H5Screate(H5S_SCALAR), H5Sclose)) {
    const Handle made(H5Acreate2(object, name, stored, space.get(), H5P_DEFAULT, H5P_DEFAULT),
                      H5Aclose);
    check(made.get());
    check(H5Awrite(made.get(), given, value));
  }
  void check(hid_t status) const {
    if (status < 0) fail();
  }
  [[noreturn]] void fail() const { throw Error(path_ + ": cannot be written; is the disk full?"); }

  std::string path_;
  Handle file_, group_creation_;
};

// What the reader would refuse must not be written.
void check_finite(const std::vector<double>& values, const char* dataset, int width) {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isfinite(values[i]))
      throw Error(std::string("the trace to be written holds a value that is not finite in ") +
                  dataset + ", row " + std::to_string(i / static_cast<std::size_t>(width)));
}

// ---- Reading
// --------------------------------------------------------------------------------------

constexpr hsize_t kLargestChunk = 256u << 20;  // bytes, which HDF5 allocates to read one

// Of a damaged file's text, what can be shown in a line.
std::string printable(std::string text) {
  text = text.substr(0, 60);
  for (char& c : text)
    if (c < ' ' || c > '~') c = '?';
  return text;
}

std::string shape_text(const std::vector<hsize_t>& size) {
  std::string text;
  for (const hsize_t n : size) text += (text.empty() ? "" : " x ") + std::to_string(n);
  return text.empty() ? "a single value" : text;
}

class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path) {
    std::error_code error;
    if (!std::filesystem::exists(path, error))
      throw InputError(path, "", "does not exist", "check the file's name");
    if (std::filesystem::is_directory(path, error))
      throw InputError(path, "", "is a folder", "give an HDF5 file (.h5)");
    if (H5Fis_hdf5(path.c_str()) <= 0)
      throw InputError(path, "", "is not an HDF5 file or cannot be read",
                       "give a trace or a trajectory (.h5)");
    file_ = Handle(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    if (!file_)
      throw InputError(path, "", "is truncated, damaged or being written", "record it again");
  }

  [[noreturn]] void refuse(const std::string& place, const std::string& condition,
                           const std::string& remedy = {}) const {
    throw InputError(path_, place, condition, remedy);
  }

  // Also false for a link that leads nowhere.
  bool has(const std::string& name) const {
    for (std::size_t slash = 1; slash != 0;) {
      slash = name.find('/', slash);
      const std::string part = name.substr(0, slash);
      if (H5Lexists(file_.get(), part.c_str(), H5P_DEFAULT) <= 0 ||
          H5Oexists_by_name(file_.get(), part.c_str(), H5P_DEFAULT) <= 0)
        return false;
      slash = slash == std::string::npos ? 0 : slash + 1;
    }
    return true;
  }

  // The rows of `name`, whose other extent must be `width`; checks everything that can be checked
  // before a byte is allocated. Fixes the number of rows at the first call. `order`, if given,
  // receives the tissue of each column.
  struct Set {
    Handle handle;
    std::string name;
    int width = 0;
    std::vector<int> tissues;  // of each column, where there are any
  };
  Set open(const std::string& name, const char* unit, int width, bool unit_required,
           bool per_tissue = false) {
    Set set{Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose), name, width, {}};
    if (!set.handle || H5Iget_type(set.handle.get()) != H5I_DATASET)
      refuse(name, "is not a dataset");
    check_type(set);
    const std::vector<hsize_t> size = extent(set);
    const hsize_t rows = check_shape(set, size, per_tissue);
    if (rows > kMostSamples)
      refuse(name,
             "claims " + std::to_string(rows) + " rows, more than " + std::to_string(kMostSamples),
             "cut the recording into pieces");
    if (!rows_) rows_ = static_cast<std::size_t>(rows);
    if (rows != *rows_)
      refuse(name,
             "has " + std::to_string(rows) + " rows where /time has " + std::to_string(*rows_));
    check_storage(set);
    check_unit(set, unit, unit_required);
    return set;
  }

  // All values, finite.
  std::vector<double> read(const Set& set) const {
    std::vector<double> values(*rows_ * static_cast<std::size_t>(set.width));
    if (H5Dread(set.handle.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) <
        0)
      refuse(set.name, "cannot be read: the file is damaged", "record it again");
    for (std::size_t i = 0; i < values.size(); ++i)
      if (!std::isfinite(values[i]))
        refuse(set.name + ", row " + std::to_string(i / static_cast<std::size_t>(set.width)),
               "is not finite");
    return values;
  }

  // /time: read first, since a file can't claim rows that it doesn't hold and have them increase.
  std::vector<double> read_time() {
    if (!has("/time")) refuse("/time", "is missing");
    const std::vector<double> time = read(open("/time", "s", 1, true));
    for (std::size_t i = 1; i < time.size(); ++i)
      if (!(time[i] > time[i - 1]))
        refuse("/time, row " + std::to_string(i), "time does not increase");
    return time;
  }

  std::optional<std::string> text(const char* name) const { return text(file_.get(), name, "/"); }
  std::string require_text(const char* name) const {
    const auto value = text(name);
    if (!value) refuse(std::string("attribute ") + name, "is missing");
    return *value;
  }
  std::optional<double> number(const char* name) const {
    if (H5Aexists(file_.get(), name) <= 0) return {};
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
  double require_number(const char* name) const {
    const auto value = number(name);
    if (!value) refuse(std::string("attribute ") + name, "is missing");
    return *value;
  }

  void check_schema(bool required) const {
    const auto schema = text("schema");
    if (!schema && !required) return;
    if (!schema) refuse("attribute schema", "is missing: this is not a toothprep trace");
    if (*schema != kSchema) {
      if (!required) return;  // someone else's schema: /time and /handle/position decide
      refuse("attribute schema",
             "is '" + printable(*schema) + "', not '" + std::string(kSchema) + "'",
             "this is not a toothprep trace");
    }
    const double version = require_number("schema_version");
    if (version != kSchemaVersion)
      refuse("attribute schema_version",
             "is " + printable(std::to_string(version)) + ", this toothprep reads " +
                 std::to_string(kSchemaVersion),
             "use a newer toothprep");
  }

 private:
  void check_type(const Set& set) const {
    const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
    const H5T_class_t kind = H5Tget_class(type.get());  // booleans are stored as enumerations
    if ((kind != H5T_FLOAT && kind != H5T_INTEGER && kind != H5T_ENUM) ||
        H5Tget_size(type.get()) > 16)
      refuse(set.name, "must hold numbers");
  }
  std::vector<hsize_t> extent(const Set& set) const {
    const Handle space(H5Dget_space(set.handle.get()), H5Sclose);
    if (H5Sget_simple_extent_type(space.get()) == H5S_NULL) refuse(set.name, "is empty");
    const int dimensions = H5Sget_simple_extent_ndims(space.get());
    if (dimensions < 0 || dimensions > H5S_MAX_RANK) refuse(set.name, "has no readable shape");
    std::vector<hsize_t> size(static_cast<std::size_t>(dimensions));
    if (dimensions > 0) H5Sget_simple_extent_dims(space.get(), size.data(), nullptr);
    return size;
  }
  hsize_t check_shape(Set& set, const std::vector<hsize_t>& size, bool per_tissue) const {
    if (per_tissue) {
      set.tissues = tissues_of(set);
      set.width = static_cast<int>(set.tissues.size());
    }
    hsize_t rows = 0;
    const auto width = static_cast<hsize_t>(set.width);
    if (size.size() == 1 && width == 1 && !per_tissue)
      rows = size[0];
    else if (size.size() == 2 && size[1] == width)
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
  void check_storage(const Set& set) const {
    const Handle creation(H5Dget_create_plist(set.handle.get()), H5Pclose);
    if (H5Pget_layout(creation.get()) == H5D_CHUNKED) {
      hsize_t chunk[H5S_MAX_RANK] = {};
      const int dimensions = H5Pget_chunk(creation.get(), H5S_MAX_RANK, chunk);
      const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
      double bytes = static_cast<double>(H5Tget_size(type.get()));
      for (int i = 0; i < dimensions; ++i) bytes *= static_cast<double>(chunk[i]);
      if (!(bytes <= static_cast<double>(kLargestChunk)))
        refuse(set.name, "is stored in chunks of more than 256 MB", "store it in smaller chunks");
    }
    if (H5Dget_storage_size(set.handle.get()) == 0 &&
        H5Pget_layout(creation.get()) != H5D_VIRTUAL && H5Pget_external_count(creation.get()) <= 0)
      refuse(set.name, "holds no data", "was the recording cut off?");
  }
  void check_unit(const Set& set, const char* unit, bool required) const {
    const auto given = text(set.handle.get(), "units", set.name);
    if (!given && required)
      refuse(set.name, "has no attribute `units`", std::string("it must be \"") + unit + "\"");
    if (given && *given != unit)
      refuse(set.name, "is in \"" + printable(*given) + "\", must be in \"" + unit + "\"",
             "convert it");
  }
  std::vector<int> tissues_of(const Set& set) const {
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
  std::optional<std::string> text(hid_t object, const char* name, const std::string& owner) const {
    if (H5Aexists(object, name) <= 0) return {};
    const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
    return strings(attribute, owner + ", attribute " + name, 1).front();
  }
  // 1 .. `most` strings, of fixed or variable length.
  std::vector<std::string> strings(const Handle& attribute, const std::string& place,
                                   hssize_t most) const {
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
      const Handle memory(H5Tcopy(H5T_C_S1), H5Tclose);
      H5Tset_size(memory.get(), H5T_VARIABLE);
      H5Tset_cset(memory.get(), H5Tget_cset(type.get()));
      std::vector<char*> texts(static_cast<std::size_t>(count), nullptr);
      const bool ok = H5Aread(attribute.get(), memory.get(), texts.data()) >= 0;
      for (char* t : texts) {
        result.emplace_back(ok && t ? t : "");
        if (ok && t) H5free_memory(t);
      }
      if (!ok) refuse(place, "cannot be read: the file is damaged");
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

  std::string path_;
  Handle file_;
  std::optional<std::size_t> rows_;
};

// Keeps other threads out of HDF5, which lets in one at a time anyway, and must be free when a
// process is copied.
std::unique_lock<std::mutex> lock_hdf5() {
  static std::mutex mutex;
  return std::unique_lock(mutex);
}

// parse(Reader&) for a file that may be damaged. HDF5 (1.10 at least) follows some damaged
// references blindly: it crashes, loops or takes gigabytes. So a child process parses the file
// first, and only what came through there is parsed here. This doubles the time: 0.3 s more for
// 240,000 rows.
template <class Parse>
auto read_with_care(const std::string& path, Parse parse) {
  const auto lock = lock_hdf5();
  const h5::Quiet quiet;
  std::error_code error;
  std::uintmax_t known =
      std::filesystem::file_size(path, error);  // bytes, as far as they count here
  known = error ? 0 : std::min(known, std::uintmax_t{1} << 32);
  const auto failure = failure_in_trial(
      [&] {
        Reader in(path);
        parse(in);
      },
      static_cast<unsigned>(20 + (known >> 20)),  // s: a slow disk reads 1 MB/s
      (std::size_t{1} << 30) + 1000 * known);     // bytes: gzip makes a constant 1000 times smaller
  const std::string own = path + ": ";            // the first part of an InputError's text
  if (failure && failure->rfind(own, 0) == 0)
    throw InputError(path, "", failure->substr(own.size()));
  if (failure) throw InputError(path, "", "is damaged", "record it again");
  Reader in(path);
  return parse(in);
}

bool is_quantity_that_needs_its_unit(const std::string& dataset) {
  return dataset == "/time" || dataset.find("position") != std::string::npos ||
         dataset.find("/force/") == 0;
}

Quat quaternion_of(const Reader& reader, const std::string& dataset, std::size_t row,
                   const double* v) {
  Quat orientation;
  if (!accept_quaternion(Quat(v[3], v[0], v[1], v[2]), orientation))
    reader.refuse(dataset + ", row " + std::to_string(row),
                  "is not a unit quaternion (x, y, z, w)");
  return orientation;
}

std::uint32_t buttons_of(const Reader& reader, const std::string& dataset, std::size_t row,
                         double value) {
  if (!(value >= 0 && value <= 4294967295.0 && value == std::floor(value)))
    reader.refuse(dataset + ", row " + std::to_string(row), "must be a whole number of 0 or more");
  return static_cast<std::uint32_t>(value);
}

std::vector<Vec3> measured_force(Reader& reader) {
  std::vector<Vec3> force;
  if (!reader.has(kMeasured)) return force;
  const std::vector<double> values = reader.read(reader.open(kMeasured, "N", 3, true));
  force.reserve(values.size() / 3);
  for (std::size_t i = 0; i < values.size(); i += 3)
    force.emplace_back(values[i], values[i + 1], values[i + 2]);
  return force;
}

Trace parse_trace(Reader& in) {
  in.check_schema(true);
  Trace trace;
  trace.toothprep_version = in.require_text("toothprep_version");
  trace.parameters_toml = in.require_text("parameters");
  trace.tooth_sha256 = in.require_text("tooth_sha256");
  trace.audit.torque_work_mj = in.require_number("torque_work_mJ");
  trace.audit.removed_energy_mj = in.require_number("removed_energy_mJ");
  trace.audit.energy_ratio = in.require_number("energy_ratio");
  trace.bur = in.text("bur").value_or("");
  trace.drive = in.text("drive").value_or("");
  trace.engine = in.text("engine").value_or("");
  trace.initial_overlap_mm3 = in.number("initial_overlap_mm3").value_or(0.0);

  // Shapes, types and units of all before the rows are allocated.
  const std::vector<double> time = in.read_time();
  std::vector<std::pair<const TraceColumn*, Reader::Set>> sets;
  for (const TraceColumn& column : trace_columns()) {
    if (!in.has(column.dataset)) {
      if (column.required) in.refuse(column.dataset, "is missing");
      continue;
    }
    sets.emplace_back(&column,
                      in.open(column.dataset, column.unit, column.width,
                              is_quantity_that_needs_its_unit(column.dataset), column.per_tissue));
  }
  trace.rows.resize(time.size());
  for (const auto& [column, set] : sets) {
    const std::vector<double> values = in.read(set);
    const auto width = static_cast<std::size_t>(set.width);
    for (std::size_t i = 0; i < trace.rows.size(); ++i) {
      const double* v = values.data() + i * width;
      std::array<double, 4> row{};
      for (std::size_t c = 0; c < width; ++c)
        row[column->per_tissue ? static_cast<std::size_t>(set.tissues[c]) : c] = v[c];
      if (column->width == 4 && !column->per_tissue) {
        const Quat q = quaternion_of(in, set.name, i, v);
        for (int c = 0; c < 4; ++c) row[static_cast<std::size_t>(c)] = q.coeffs()[c];
      }
      if (column->storage == Storage::kUint32) buttons_of(in, set.name, i, v[0]);
      if (column->storage == Storage::kUint8 && v[0] != 0 && v[0] != 1)
        in.refuse(set.name + ", row " + std::to_string(i), "must be 0 or 1");
      column->set(trace.rows[i], row.data());
    }
  }
  trace.measured_force = measured_force(in);
  return trace;
}

Trajectory parse_trajectory(Reader& in) {
  in.check_schema(false);
  const std::vector<double> time = in.read_time();
  if (time.size() < 2) in.refuse("/time", "holds fewer than two samples", "record a motion");
  if (!in.has("/handle/position")) in.refuse("/handle/position", "is missing");
  const std::vector<double> position = in.read(in.open("/handle/position", "mm", 3, true));
  Trajectory trajectory;
  trajectory.samples.resize(time.size());
  for (std::size_t i = 0; i < time.size(); ++i) {
    trajectory.samples[i].time = time[i];
    trajectory.samples[i].pose.position = Eigen::Map<const Vec3>(position.data() + 3 * i);
  }
  const std::string orientation = "/handle/orientation", buttons = "/handle/buttons";
  if (in.has(orientation)) {
    const std::vector<double> q = in.read(in.open(orientation, "1", 4, false));
    for (std::size_t i = 0; i < time.size(); ++i)
      trajectory.samples[i].pose.orientation = quaternion_of(in, orientation, i, q.data() + 4 * i);
  }
  if (in.has(buttons)) {
    const std::vector<double> b = in.read(in.open(buttons, "1", 1, false));
    for (std::size_t i = 0; i < time.size(); ++i)
      trajectory.samples[i].buttons = buttons_of(in, buttons, i, b[i]);
  }
  trajectory.measured_force = measured_force(in);
  return trajectory;
}

}  // namespace

void write_trace(const Trace& trace, const std::string& path) {
  if (trace.rows.empty()) throw Error(path + ": a trace without rows cannot be written");
  if (!trace.measured_force.empty() && trace.measured_force.size() != trace.rows.size())
    throw Error(path + ": the trace has not as many measured forces as rows");
  const auto lock = lock_hdf5();
  const h5::Quiet quiet;
  Writer out(path);
  out.text("schema", kSchema);
  out.integer("schema_version", kSchemaVersion);
  out.text("toothprep_version", trace.toothprep_version);
  out.text("parameters", trace.parameters_toml);
  out.text("tooth_sha256", trace.tooth_sha256);
  out.text("bur", trace.bur);
  out.text("drive", trace.drive);
  out.text("engine", trace.engine);
  out.number("initial_overlap_mm3", trace.initial_overlap_mm3);
  out.number("torque_work_mJ", trace.audit.torque_work_mj);
  out.number("removed_energy_mJ", trace.audit.removed_energy_mj);
  out.number("energy_ratio", trace.audit.energy_ratio);

  for (const char* group : {"/handle", "/bur", "/force", "/contact", "/removed"}) out.group(group);
  const std::vector<std::string> tissues(kTissueNames.begin(), kTissueNames.end());
  std::vector<double> values;
  for (const TraceColumn& column : trace_columns()) {
    const auto width = static_cast<std::size_t>(column.width);
    values.resize(trace.rows.size() * width);
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      column.get(trace.rows[i], values.data() + i * width);
    check_finite(values, column.dataset, column.width);
    out.dataset(column.dataset, column.unit, values, column.width, column.storage,
                column.per_tissue ? tissues : std::vector<std::string>{});
  }
  if (!trace.measured_force.empty()) {
    values.resize(trace.rows.size() * 3);
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      Eigen::Map<Vec3>(values.data() + 3 * i, 3) = trace.measured_force[i];
    check_finite(values, kMeasured, 3);
    out.dataset(kMeasured, "N", values, 3, Storage::kDouble);
  }
  out.close();
}

Trace read_trace(const std::string& path) { return read_with_care(path, parse_trace); }

bool is_trace_file(const std::string& path) {
  return read_with_care(path, [](Reader& in) { return in.text("schema") == kSchema; });
}

Trajectory read_h5_trajectory(const std::string& path) {
  return read_with_care(path, parse_trajectory);
}

}  // namespace toothprep
