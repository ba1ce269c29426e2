// Writing HDF5 files: whole ones, and ones that grow by rows while other programs read them.
// A failed call throws Error: the file can't be written, as a rule because the disk is full.
// Callers hold lock_hdf5().
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "toothprep/tools/files/hdf5_handle.h"
#include "toothprep/tools/files/trace_columns.h"

namespace toothprep::h5 {

// Same calls, same bytes: no object times, fixed fill values.
class Writer {
 public:
  explicit Writer(const std::string& path);  // replaces a file

  void group(const char* name);

  // Rows of `width` values each, as a one-dimensional dataset where the width is 1. Chunked,
  // shuffled, gzip 4.
  void dataset(const char* name, const char* unit, const std::vector<double>& values, int width,
               Storage storage, const std::vector<std::string>& tissues = {});

  // Attributes of the root.
  void text(const char* name, const std::string& value);
  void number(const char* name, double value);
  void numbers(const char* name, const std::vector<double>& values);
  void integer(const char* name, std::int64_t value);  // 32 bits where they do

  void close();

 protected:
  struct Growing {};
  Writer(const std::string& path, Growing);

  Handle make_dataset(const char* name, Storage storage, Id space, Id creation);
  void describe(const Handle& set, const char* unit, const std::vector<std::string>& tissues);
  void text(Id object, const char* name, const std::string& value);
  void check(Id status) const;
  [[noreturn]] void fail() const;

  std::string path_;
  Handle file_, group_creation_;

 private:
  void texts(Id object, const char* name, const std::vector<std::string>& values);
  void attribute(Id object, const char* name, Id stored, Id given, const void* value,
                 const Handle& space);
};

// A file whose datasets grow: first its groups, columns and attributes, then start(), then
// append() and flush() as often as one likes. From start() on others may read it
// (h5py.File(f, "r", swmr=True), Reader), and see the rows up to the last flush; so they do after
// the program was killed. Needs HDF5 1.10 to be read. Rows are stored as they are, uncompressed:
// a chunk can then be filled in place.
class GrowingWriter : public Writer {
 public:
  explicit GrowingWriter(const std::string& path);  // replaces a file
  ~GrowingWriter();                                 // close() or abandon() was not called: closes

  std::size_t column(const char* name, const char* unit, int width, Storage storage,
                     const std::vector<std::string>& tissues = {});
  void start();

  // Whole rows of a column; after a flush() all columns should have as many.
  void append(std::size_t column, const std::vector<double>& values);
  void flush();

  // Attributes that are there already: nothing can be added after start().
  void set_text(const char* name, const std::string& value);
  void set_number(const char* name, double value);
  void set_numbers(const char* name, const std::vector<double>& values);

  void close();

  // After a failure: leaves the file as it is now. What HDF5 still wants to write (and it would
  // mark the file as properly closed) goes nowhere.
  void abandon() noexcept;

 private:
  struct Column {
    Handle set;
    int width = 0;
    std::uint64_t rows = 0;
  };
  std::vector<Column> columns_;
};

}  // namespace toothprep::h5
