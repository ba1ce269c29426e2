// Writing HDF5 files: whole ones, and ones that grow by rows while other programs read them.
// A failed call throws Error, which says why the file can't be written.
// Callers hold lock_hdf5().
#pragma once

#include <cstddef>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/step/core/hash.h"
#include "toothprep/tools/files/hdf5_handle.h"
#include "toothprep/tools/files/trace_columns.h"

namespace toothprep::h5 {

// Whether a whole file's datasets are hashed for write_checksums().
enum class Checksums { kNo, kYes };

// Same calls, same bytes: no object times, fixed fill values.
class Writer {
 public:
  explicit Writer(const std::string& path,
                  Checksums checksums = Checksums::kNo);  // replaces a file

  void group(const char* name);

  // Rows of `width` values each, as a one-dimensional dataset where the width is 1. Chunked,
  // shuffled, gzip (h5_packing.h).
  void dataset(const char* name, const char* unit, const std::vector<double>& values, int width,
               Storage storage, const std::vector<std::string>& names = {},
               const char* of_what = "tissues");

  // Attributes of the root.
  void text(const char* name, const std::string& value);
  void number(const char* name, double value);
  void numbers(const char* name, const std::vector<double>& values);
  void integer(const char* name, std::int64_t value);  // 32 bits where they do

  // The attribute `checksums` of all that was written so far (h5_checksums.h); Checksums::kYes.
  void write_checksums();

  void close();

 protected:
  struct Growing {};
  Writer(const std::string& path, const std::string& shown, Growing);

  Handle make_dataset(const char* name, Storage storage, Id space, Id creation);
  void describe(const Handle& set, const char* unit, const std::vector<std::string>& names,
                const char* of_what);
  void text(Id object, const char* name, const std::string& value);
  void check(Id status) const;
  [[noreturn]] void fail() const;
  // The lines of the attributes that were written, but those of the root that are named.
  std::set<std::string> attribute_lines(const std::set<std::string>& without) const;

  std::string path_, shown_;  // where it is; what messages call it
  Checksums checksums_ = Checksums::kNo;
  Handle file_, group_creation_;
  std::set<std::string> dataset_lines_;

 private:
  void texts(Id object, const char* name, const std::vector<std::string>& values);
  void attribute(Id object, const char* name, Id stored, Id given, const void* value,
                 const Handle& space);

  std::set<std::pair<std::string, std::string>> attributes_;  // that were written: object, name
};

// A file whose datasets grow: first its groups, columns and attributes, then start(), then
// append() and flush() as often as one likes. From start() on others may read it
// (h5py.File(f, "r", swmr=True), Reader), and see the rows up to the last flush; so they do after
// the program was killed. Needs HDF5 1.10 to be read.
//
// Rows are stored in chunks of a fixed number of them, each with a Fletcher-32 checksum. A chunk with
// a checksum is written as a whole, so appending part of one and going on later would write it
// anew, and a kill in between would damage rows that were safe. Append whole chunks, but at the end.
class GrowingWriter : public Writer {
 public:
  // Replaces a file; `shown`: what messages call it.
  GrowingWriter(const std::string& path, const std::string& shown, std::size_t rows_per_chunk);
  ~GrowingWriter();  // close() or abandon() was not called: closes

  // `rows_per_chunk`: 0 for the file's.
  std::size_t column(const char* name, const char* unit, int width, Storage storage,
                     const std::vector<std::string>& names = {}, std::size_t rows_per_chunk = 0,
                     const char* of_what = "tissues");
  // Writes the checksums of all attributes but of these, of the root, which will change.
  void start(const std::set<std::string>& changing);

  // So many rows of a column; after a flush() all columns of a table should have as many.
  void append(std::size_t column, const double* values, std::size_t rows);
  void flush();

  // Attributes that are there already: nothing can be added after start().
  void set_text(const char* name, const std::string& value);
  void set_number(const char* name, double value);
  void set_numbers(const char* name, const std::vector<double>& values);

  // The checksums of the rows and of these attributes of the root, as they are now.
  void write_checksums(const std::set<std::string>& attributes);

  void close();

  // After a failure: leaves the file as it is now. What HDF5 still wants to write (and it would
  // mark the file as properly closed) goes nowhere.
  void abandon() noexcept;

 private:
  struct Column {
    std::string name;
    Handle set;
    int width = 0;
    Storage storage = Storage::kDouble;
    std::uint64_t rows = 0;
    std::unique_ptr<Sha256> hash;  // of the rows
  };
  std::vector<Column> columns_;
  std::size_t rows_per_chunk_;
};

}  // namespace toothprep::h5
