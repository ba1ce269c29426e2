// CSV, a row at a time.
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {

// Text on its way to a file, in pieces of about a megabyte. Throws Error if it can't be written;
// call close() to know.
class CsvWriter {
 public:
  explicit CsvWriter(const std::string& path) : path_(path), file_(std::fopen(path.c_str(), "wb")) {
    if (!file_) fail();
    buffer_.reserve(kFull + 4096);
  }
  void text(const std::string& value) {
    separate();
    buffer_ += csv_cell(value);
  }
  // The shortest decimal that reads back as the same double.
  void number(double value) {
    separate();
    buffer_ += shortest_text(value);
  }
  void end_row() {
    buffer_ += '\n';
    row_begins_ = true;
    if (buffer_.size() > kFull) flush();
  }
  void close() {
    flush();
    if (std::fclose(file_.release()) != 0) fail();
  }

 private:
  static constexpr std::size_t kFull = 1 << 20;

  void separate() {
    if (!row_begins_) buffer_ += ',';
    row_begins_ = false;
  }
  void flush() {
    if (std::fwrite(buffer_.data(), 1, buffer_.size(), file_.get()) != buffer_.size()) fail();
    buffer_.clear();
  }
  [[noreturn]] void fail() const {
    throw Error(path_ + ": cannot be written: " + std::strerror(errno));
  }

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, buffer_;
  std::unique_ptr<std::FILE, Close> file_;
  bool row_begins_ = true;
};

}  // namespace toothprep
