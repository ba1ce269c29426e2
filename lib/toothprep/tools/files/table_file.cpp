#include "toothprep/tools/files/table_file.h"

#include <hdf5.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <limits>
#include <set>

#include "toothprep/tools/files/h5_writer.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

constexpr std::size_t kChunkRows = 4096, kSmallBytes = 8192;
constexpr unsigned kGzipLevel = 1;

h5::Handle stored_type(const TableColumn& column) {
  if (column.type == CellType::kWhole) return {H5Tcopy(H5T_STD_I64LE), H5Tclose};
  if (column.type == CellType::kText) {
    h5::Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type.get(), std::max<std::size_t>(1, column.width));
    H5Tset_strpad(type.get(), H5T_STR_NULLPAD);
    H5Tset_cset(type.get(), H5T_CSET_UTF8);
    return type;
  }
  if (column.type == CellType::kTruth) {  // as h5py stores bool
    h5::Handle type(H5Tenum_create(H5T_STD_I8LE), H5Tclose);
    std::int8_t value = 0;
    H5Tenum_insert(type.get(), "FALSE", &value);
    value = 1;
    H5Tenum_insert(type.get(), "TRUE", &value);
    return type;
  }
  return {H5Tcopy(H5T_IEEE_F64LE), H5Tclose};
}

template <class T>
void put(const T& value, std::vector<char>& bytes) {
  const auto* first = reinterpret_cast<const char*>(&value);
  bytes.insert(bytes.end(), first, first + sizeof value);
}

void put_cell(const std::string& cell, const TableColumn& column, std::vector<char>& bytes) {
  switch (column.type) {
    case CellType::kText: {
      std::string text = TableFile::stored_text(cell);
      text.resize(std::max<std::size_t>(1, column.width), '\0');
      bytes.insert(bytes.end(), text.begin(), text.end());
      break;
    }
    case CellType::kWhole: {
      std::int64_t value = 0;
      std::from_chars(cell.data(), cell.data() + cell.size(), value);
      put(value, bytes);
      break;
    }
    case CellType::kTruth:
      put(static_cast<std::int8_t>(cell == "true"), bytes);
      break;
    case CellType::kTruthOrNone:
      put(cell.empty()     ? std::numeric_limits<double>::quiet_NaN()
          : cell == "true" ? 1.0
                           : 0.0,
          bytes);
      break;
    case CellType::kNumber:
      put(decimal_number(cell).value_or(std::numeric_limits<double>::quiet_NaN()), bytes);
      break;
  }
}

// Names of links have no slash, and no two are the same.
std::string link_name(const std::string& name, std::set<std::string>& used) {
  std::string link = name;
  std::replace(link.begin(), link.end(), '/', '|');
  if (link.empty() || link == ".") link += '_';
  while (!used.insert(link).second) link += '_';
  return link;
}

}  // namespace

// The parts of a file that h5::Writer makes for any.
class TableFile::Writer : public h5::Writer {
 public:
  using h5::Writer::Writer;

  void ordered_group(const std::string& name) {
    const h5::Handle creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(creation.get(), false));
    check(
        H5Pset_link_creation_order(creation.get(), H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED));
    group_ = h5::Handle(
        H5Gcreate2(file_.get(), name.c_str(), H5P_DEFAULT, creation.get(), H5P_DEFAULT), H5Gclose);
    check(group_.get());
  }

  h5::Handle column(const TableColumn& what, const h5::Handle& type, std::size_t rows) {
    const hsize_t size = rows, chunk = std::min<hsize_t>(rows, kChunkRows);
    const h5::Handle space(H5Screate_simple(1, &size, nullptr), H5Sclose);
    const h5::Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    check(H5Pset_obj_track_times(creation.get(), false));
    check(H5Pset_fill_time(creation.get(), H5D_FILL_TIME_ALLOC));  // the last chunk's tail: zeros
    if (rows * H5Tget_size(type.get()) > kSmallBytes) {            // an index of chunks takes 2 kB
      check(H5Pset_chunk(creation.get(), 1, &chunk));
      check(H5Pset_shuffle(creation.get()));
      check(H5Pset_deflate(creation.get(), kGzipLevel));
    }
    const std::string link = link_name(what.name, links_);
    h5::Handle set(H5Dcreate2(group_.get(), link.c_str(), type.get(), space.get(), H5P_DEFAULT,
                              creation.get(), H5P_DEFAULT),
                   H5Dclose);
    check(set.get());
    if (link != what.name) text(set.get(), "name", what.name);
    if (!what.unit.empty()) text(set.get(), "units", what.unit);
    return set;
  }

  void rows(const h5::Handle& set, const h5::Handle& type, std::size_t first, std::size_t count,
            const std::vector<char>& bytes) {
    const hsize_t start = first, size = count;
    const h5::Handle stored(H5Dget_space(set.get()), H5Sclose);
    const h5::Handle memory(H5Screate_simple(1, &size, nullptr), H5Sclose);
    check(H5Sselect_hyperslab(stored.get(), H5S_SELECT_SET, &start, nullptr, &size, nullptr));
    errno = 0;
    check(H5Dwrite(set.get(), type.get(), memory.get(), stored.get(), H5P_DEFAULT, bytes.data()));
  }

  void closed(h5::Handle& object) {
    if (!object.reset()) fail();
  }
  void close_all() {
    closed(group_);
    close();
  }

 private:
  h5::Handle group_;
  std::set<std::string> links_;
};

TableFile::TableFile(const std::string& path, const std::string& group,
                     const std::vector<std::pair<std::string, std::string>>& attributes,
                     std::vector<TableColumn> columns, std::size_t rows)
    : rows_(rows) {
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  file_ = std::make_unique<Writer>(path);
  for (const auto& [name, value] : attributes) file_->text(name.c_str(), value);
  file_->ordered_group(group);
  for (TableColumn& column : columns) {
    h5::Handle type = stored_type(column);
    h5::Handle set = file_->column(column, type, rows);
    columns_.push_back({std::move(column), std::move(type), std::move(set), {}});
  }
}

TableFile::~TableFile() {
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  columns_.clear();
  file_.reset();
}

std::string TableFile::stored_text(const std::string& text) { return terminal_text(text); }

void TableFile::add(const std::vector<std::string>& cells) {
  for (std::size_t k = 0; k < columns_.size(); ++k)
    put_cell(cells[k], columns_[k].what, columns_[k].bytes);
  ++waiting_;
  if (waiting_ == kChunkRows || done_ + waiting_ == rows_) write_chunk();
}

void TableFile::write_chunk() {
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  for (Column& column : columns_) {
    file_->rows(column.set, column.type, done_, waiting_, column.bytes);
    column.bytes.clear();
  }
  done_ += waiting_;
  waiting_ = 0;
}

void TableFile::close() {
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  for (Column& column : columns_) file_->closed(column.set);
  file_->close_all();
}

}  // namespace toothprep
