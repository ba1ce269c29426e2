#include "toothprep/tools/files/session_recovery.h"

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/tools/files/h5_checksums.h"
#include "toothprep/tools/files/h5_reader.h"
#include "toothprep/tools/files/h5_writer.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace_parts.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

using h5::Handle;
using h5::Id;

// What a child process may take to read a damaged file.
constexpr double kSeconds = 5, kSecondsPerByte = 2e-7;  // CPU
constexpr std::size_t kMemory = std::size_t{2} << 30;
constexpr std::int64_t kLongestList = 16;  // numbers or texts of an attribute
constexpr int kWidest = 16;

struct Dataset {
  std::string name;
  Handle handle;
  int width = 1;
  Storage storage = Storage::kDouble;
  std::uint64_t rows = 0;      // that it claims
  std::uint64_t readable = 0;  // the first of them
};

Handle open_source(const std::string& path) {
  if (H5Fis_hdf5(path.c_str()) <= 0)
    throw InputError(path, "", "is not an HDF5 file or cannot be read",
                     "give the recording of a live session (.h5)");
  h5::OpenFile opened = h5::open_to_read(path);
  if (!opened.file)
    throw InputError(path, "", "cannot be opened: its first blocks are damaged, or its end is gone",
                     "take it from a copy");
  return std::move(opened.file);
}

std::vector<std::string> attribute_names(Id object) {
  std::vector<std::string> names;
  H5Aiterate2(
      object, H5_INDEX_NAME, H5_ITER_INC, nullptr,
      [](hid_t, const char* name, const H5A_info_t*, void* all) -> herr_t {
        static_cast<std::vector<std::string>*>(all)->emplace_back(name);
        return 0;
      },
      &names);
  return names;
}

std::optional<Storage> storage_of(Id type) {
  const std::size_t bytes = H5Tget_size(type);
  const H5T_class_t kind = H5Tget_class(type);
  if (kind == H5T_FLOAT && bytes == 8) return Storage::kDouble;
  if (kind != H5T_INTEGER) return {};
  const bool plain = H5Tget_sign(type) == H5T_SGN_NONE;
  if (bytes == 1 && plain) return Storage::kUint8;
  if (bytes == 4) return plain ? Storage::kUint32 : Storage::kInt32;
  return bytes == 8 && !plain ? std::optional(Storage::kInt64) : std::nullopt;
}

std::vector<std::string> texts(Id object, const char* name) {
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  return h5::texts_of(attribute, kLongestList).value_or(std::vector<std::string>());
}

// Rows first .. last of a dataset as doubles; false if they can't be read.
bool read_rows(const Dataset& set, std::uint64_t first, std::uint64_t count, double* values) {
  const Handle stored(H5Dget_space(set.handle.get()), H5Sclose);
  const int dimensions = H5Sget_simple_extent_ndims(stored.get());
  const hsize_t start[2] = {first, 0}, size[2] = {count, static_cast<hsize_t>(set.width)};
  const Handle memory(H5Screate_simple(dimensions, size, nullptr), H5Sclose);
  H5Sselect_hyperslab(stored.get(), H5S_SELECT_SET, start, nullptr, size, nullptr);
  return H5Dread(set.handle.get(), H5T_NATIVE_DOUBLE, memory.get(), stored.get(), H5P_DEFAULT,
                 values) >= 0;
}

// How many rows can be read, chunk by chunk: a chunk's checksum fails as a whole.
std::uint64_t readable_rows(const Dataset& set, std::uint64_t bytes) {
  const Handle creation(H5Dget_create_plist(set.handle.get()), H5Pclose);
  hsize_t chunk[H5S_MAX_RANK] = {};
  if (H5Pget_layout(creation.get()) != H5D_CHUNKED ||
      H5Pget_chunk(creation.get(), H5S_MAX_RANK, chunk) < 1 || chunk[0] == 0)
    chunk[0] = 1024;
  const std::uint64_t within = std::min(set.rows, h5::rows_within(set.handle.get(), bytes));
  const std::uint64_t step = std::min<std::uint64_t>(chunk[0], 1 << 16);
  std::vector<double> values(step * static_cast<std::uint64_t>(set.width));
  std::uint64_t good = 0;
  while (good < within) {
    const std::uint64_t count = std::min(step, within - good);
    if (!read_rows(set, good, count, values.data())) break;
    good += count;
  }
  return good;
}

// The rows of /time that increase.
std::uint64_t increasing_rows(const Dataset& time) {
  std::vector<double> values(time.readable);
  if (!read_rows(time, 0, time.readable, values.data())) return 0;
  std::uint64_t good = 0;
  double last = -std::numeric_limits<double>::infinity();
  while (good < values.size() && std::isfinite(values[good]) && values[good] > last)
    last = values[good++];
  return good;
}

bool is_of_events(const std::string& name) { return name.rfind("/events/", 0) == 0; }

class Salvage {
 public:
  Salvage(const std::string& from, Recovery& result)
      : path_(from), bytes_(regular_file_size(from)), file_(open_source(from)), result_(result) {}

  void find() {
    if (number("live") != 1.0)
      throw InputError(path_, "attribute live",
                       "is missing: this is not the recording of a live session",
                       "recover takes what toothprep live wrote");
    complete_ = number("complete") == 1.0;
    for (const std::string& name : h5::object_names(file_.get())) add(name);
    const auto time = std::find_if(sets_.begin(), sets_.end(),
                                   [](const Dataset& set) { return set.name == "/time"; });
    if (time == sets_.end()) throw InputError(path_, "/time", "cannot be found", "");
    time->readable = increasing_rows(*time);
    rows_ = most_ = time->readable;
    for (const Dataset& set : sets_) {
      if (is_of_events(set.name)) continue;
      rows_ = std::min(rows_, set.readable);
      most_ = std::max(most_, set.rows);
    }
    if (rows_ == 0) throw InputError(path_, "", "holds no rows that can be read", "");
    tell();
    events_ = events_kept();
  }

  void write(const std::string& to) {
    h5::Writer out(to, h5::Checksums::kYes);
    for (const std::string& name : attribute_names(file_.get())) copy_attribute(out, name);
    out.integer("recovered", 1);
    for (const std::string& name : groups_)
      if (events_ > 0 || name != "/events") out.group(name.c_str());
    std::vector<double> values;
    for (const Dataset& set : sets_) {
      const std::uint64_t rows = is_of_events(set.name) ? events_ : rows_;
      if (rows == 0) continue;
      values.resize(rows * static_cast<std::uint64_t>(set.width));
      if (!read_rows(set, 0, rows, values.data()))
        throw InputError(path_, set.name, "cannot be read", "");
      const std::vector<std::string> unit = texts(set.handle.get(), "units");
      out.dataset(set.name.c_str(), unit.empty() ? "" : unit[0].c_str(), values, set.width,
                  set.storage, texts(set.handle.get(), "tissues"));
      if (set.name == "/time") result_.duration = values.back() - values.front();
    }
    out.write_checksums();
    out.close();
    result_.rows = static_cast<std::int64_t>(rows_);
  }

 private:
  std::optional<double> number(const char* name) const {
    const Handle attribute(H5Aopen(file_.get(), name, H5P_DEFAULT), H5Aclose);
    double value = 0;
    if (!attribute || count_of(attribute) != 1 ||
        H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, &value) < 0)
      return {};
    return value;
  }

  static std::int64_t count_of(const Handle& attribute) {
    const Handle space(H5Aget_space(attribute.get()), H5Sclose);
    return H5Sget_simple_extent_npoints(space.get());
  }

  // What happened up to the last row that is kept.
  std::uint64_t events_kept() const {
    const auto named = [this](const std::string& name) {
      return std::find_if(sets_.begin(), sets_.end(),
                          [&](const Dataset& set) { return set.name == name; });
    };
    double last = 0;
    std::uint64_t kept = std::numeric_limits<std::uint64_t>::max();
    for (const EventColumn& column : kEventColumns) {
      const auto set = named(column.dataset);
      if (set == sets_.end()) return 0;
      kept = std::min(kept, set->readable);
    }
    std::vector<double> times(kept);
    if (!read_rows(*named("/time"), rows_ - 1, 1, &last) ||
        !read_rows(*named(kEventColumns[0].dataset), 0, kept, times.data()))
      return 0;
    return static_cast<std::uint64_t>(std::upper_bound(times.begin(), times.end(), last) -
                                      times.begin());
  }

  void lose(const std::string& line, bool was_there) {
    result_.lost.push_back(line);
    result_.gives_up = result_.gives_up || was_there;
  }

  void add(const std::string& name) {
    Dataset set;
    set.name = name;
    set.handle = Handle(H5Oopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Oclose);
    if (!set.handle) return lose(name + " cannot be opened", true);
    if (H5Iget_type(set.handle.get()) == H5I_GROUP) return groups_.push_back(name);
    const Handle type(H5Dget_type(set.handle.get()), H5Tclose);
    const Handle space(H5Dget_space(set.handle.get()), H5Sclose);
    const auto storage = storage_of(type.get());
    const int dimensions = H5Sget_simple_extent_ndims(space.get());
    hsize_t size[H5S_MAX_RANK] = {0, 1};
    if (storage && (dimensions == 1 || dimensions == 2))
      H5Sget_simple_extent_dims(space.get(), size, nullptr);
    if (size[0] == 0 && is_of_events(name)) return;
    if (size[0] == 0 || size[0] > static_cast<std::uint64_t>(kMostSamples) || size[1] < 1 ||
        size[1] > kWidest)
      return lose(name + " is empty or no table of numbers", size[0] != 0);
    set.storage = *storage;
    set.width = static_cast<int>(size[1]);
    set.rows = size[0];
    set.readable = readable_rows(set, bytes_);
    sets_.push_back(std::move(set));
  }

  // What the new file lacks.
  void tell() {
    if (!complete_)
      lose(
          "what came after the last flush, and what is written at the end: energy audit, dropped "
          "ticks, reason of the end, checksum of the whole",
          false);
    for (const Dataset& set : sets_)
      if (set.readable < set.rows)
        lose(set.name + " ends at row " + std::to_string(set.readable) + " of " +
                 std::to_string(set.rows) + ": the rest was cut off or is damaged",
             true);
    for (const char* list : {h5::kChecksumsOfHead, h5::kChecksums}) {
      const std::vector<std::string> lines = texts(file_.get(), list);
      if (lines.empty() || lines[0].empty() || (list == h5::kChecksums && !complete_)) continue;
      for (const std::string& place : h5::differing(file_.get(), lines[0], [](std::size_t) {}))
        lose(place + " is not what was written: its checksum differs", true);
    }
  }

  void copy_attribute(h5::Writer& out, const std::string& name) {
    if (name == h5::kChecksums || name == h5::kChecksumsOfHead || name == "recovered") return;
    if (name == "schema_version" && events_ == 0) return out.integer(name.c_str(), 1);
    if (name == "complete") return out.integer("complete", complete_ && rows_ == most_);
    const Handle attribute(H5Aopen(file_.get(), name.c_str(), H5P_DEFAULT), H5Aclose);
    const Handle type(H5Aget_type(attribute.get()), H5Tclose);
    const std::int64_t count = attribute ? count_of(attribute) : 0;
    const H5T_class_t kind = attribute ? H5Tget_class(type.get()) : H5T_NO_CLASS;
    if (kind == H5T_STRING && count == 1) {
      const std::vector<std::string> text = texts(file_.get(), name.c_str());
      if (!text.empty()) return out.text(name.c_str(), text[0]);
    } else if (kind == H5T_INTEGER && count == 1) {
      std::int64_t value = 0;
      if (H5Aread(attribute.get(), H5T_NATIVE_INT64, &value) >= 0)
        return out.integer(name.c_str(), value);
    } else if (kind == H5T_FLOAT && count >= 1 && count <= kLongestList) {
      std::vector<double> values(static_cast<std::size_t>(count));
      if (H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, values.data()) >= 0)
        return count == 1 ? out.number(name.c_str(), values[0]) : out.numbers(name.c_str(), values);
    }
    lose("attribute " + name + " cannot be read", true);
  }

  std::string path_;
  std::uint64_t bytes_;
  Handle file_;
  Recovery& result_;
  std::vector<std::string> groups_;
  std::vector<Dataset> sets_;
  std::uint64_t rows_ = 0, most_ = 0, events_ = 0;
  bool complete_ = false;
};

// A Recovery on its way from the child.
struct Report {
  std::int64_t rows;
  double duration;
  bool gives_up;
  std::array<char, 60000> lost;  // lines
};

void put(const Recovery& result, Report& report) {
  report.rows = result.rows;
  report.duration = result.duration;
  report.gives_up = result.gives_up;
  std::string all;
  for (const std::string& line : result.lost) all += line + '\n';
  all.resize(std::min(all.size(), report.lost.size() - 1));
  std::memcpy(report.lost.data(), all.c_str(), all.size() + 1);
}

Recovery take(const Report& report) {
  Recovery result{report.rows, report.duration, report.gives_up, {}};
  std::string line;
  for (const char* c = report.lost.data(); *c; ++c) {
    if (*c != '\n') {
      line += *c;
      continue;
    }
    result.lost.push_back(line);
    line.clear();
  }
  return result;
}

bool is_whole(const std::string& path) {
  try {
    const SessionRecording recording = read_session(path);
    return recording.complete || recording.recovered;
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace

std::optional<Recovery> recover_session(const std::string& from, const std::string& to) {
  if (is_whole(from)) return {};
  const SharedMemory memory(sizeof(Report));
  auto* report = reinterpret_cast<Report*>(memory.data());
  const double seconds = kSeconds + kSecondsPerByte * static_cast<double>(regular_file_size(from));
  const auto work = [&] {
    limit_trial(seconds, kMemory);
    Recovery result;
    Salvage salvage(from, result);
    salvage.find();
    salvage.write(to);
    put(result, *report);
  };
  {
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    if (const auto failure =
            failure_in_trial(work, static_cast<unsigned>(60 + 10 * seconds), kMemory)) {
      if (failure->input) throw *failure->input;
      if (!failure->text.empty()) throw Error(failure->text);
      throw InputError(from, "", "is too damaged to be recovered", "take it from a copy");
    }
  }
  if (report->rows == 0) throw Error(to + ": cannot be written: no process could be made");
  static_cast<void>(read_session(to));
  return take(*report);
}

}  // namespace toothprep
