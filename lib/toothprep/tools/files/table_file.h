// A table of any columns as an HDF5 file: a group with a dataset for each column, all of them with
// a value for each row. Written once, a row at a time.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/tools/files/hdf5_handle.h"

namespace toothprep {

// How a column's cells are stored: UTF-8 of the longest cell's length, padded with zeros; int64;
// float64, NaN where there is no cell; what h5py takes for bool; float64 with 1, 0 and NaN.
enum class CellType { kText, kWhole, kNumber, kTruth, kTruthOrNone };

struct TableColumn {
  std::string name;
  std::string unit;  // the attribute `units`; empty: not known
  CellType type = CellType::kText;
  std::size_t width = 1;  // of texts: bytes of the longest
};

// Same rows, same bytes. Rows are kept only until a chunk of them is full. A failed call throws
// Error.
class TableFile {
 public:
  // Replaces a file. `attributes` of its root. The group lists its columns in their order.
  TableFile(const std::string& path, const std::string& group,
            const std::vector<std::pair<std::string, std::string>>& attributes,
            std::vector<TableColumn> columns, std::size_t rows);
  ~TableFile();
  TableFile(const TableFile&) = delete;
  TableFile& operator=(const TableFile&) = delete;

  // The next row, a text per column: a number in digits, "true" or "false", empty for none. Bytes
  // that are no UTF-8, and control characters, are stored as \x1b and the like.
  void add(const std::vector<std::string>& cells);
  void close();  // after the last row

  // The text as it is stored.
  static std::string stored_text(const std::string& text);

 private:
  class Writer;
  struct Column {
    TableColumn what;
    h5::Handle type, set;
    std::vector<char> bytes;  // of the chunk's rows
  };
  void write_chunk();

  std::unique_ptr<Writer> file_;
  std::vector<Column> columns_;
  std::size_t rows_, done_ = 0, waiting_ = 0;
};

}  // namespace toothprep
