#include <array>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <memory>

#include "toothprep/core/errors.h"
#include "toothprep/trace/trace.h"
#include "toothprep/trace/trace_columns.h"

namespace toothprep {
namespace {

// Text on its way to a file, in pieces of about a megabyte.
class CsvWriter {
 public:
  explicit CsvWriter(const std::string& path) : path_(path), file_(std::fopen(path.c_str(), "wb")) {
    if (!file_) fail();
    buffer_.reserve(kFull + 4096);
  }
  void text(const std::string& value) {
    separate();
    buffer_ += value;
  }
  // The shortest decimal that reads back as the same double.
  void number(double value) {
    separate();
    std::array<char, 32> digits;
    const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
    buffer_.append(digits.data(), end);
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

}  // namespace

void write_trace_csv(const Trace& trace, const std::string& path) {
  const bool measured = !trace.measured_force.empty();
  if (measured && trace.measured_force.size() != trace.rows.size())
    throw Error(path + ": the trace has not as many measured forces as rows");
  CsvWriter out(path);
  for (const TraceColumn& column : trace_columns())
    for (const std::string& name : column.csv) out.text(name);
  if (measured)
    for (const char* axis : {"x", "y", "z"}) out.text(std::string("force_measured_") + axis + "_N");
  out.end_row();
  std::array<double, 4> values{};
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    for (const TraceColumn& column : trace_columns()) {
      column.get(trace.rows[i], values.data());
      for (int c = 0; c < column.width; ++c) out.number(values[static_cast<std::size_t>(c)]);
    }
    if (measured)
      for (int c = 0; c < 3; ++c) out.number(trace.measured_force[i][c]);
    out.end_row();
  }
  out.close();
}

}  // namespace toothprep
