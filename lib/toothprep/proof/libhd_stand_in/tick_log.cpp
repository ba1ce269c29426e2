#include "tick_log.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "toothprep/step/core/errors.h"

namespace toothprep::stand_in {

struct TickLog::Head {
  char name[16];                    // "toothprep-ticks"
  double rate;                      // Hz
  std::uint64_t most;               // rows that the file has place for
  std::atomic<std::uint64_t> rows;  // that came
  char rest[88];
};

TickLog::TickLog(const std::string& path, double rate, std::size_t most_rows)
    : most_(most_rows), size_(sizeof(Head) + most_rows * sizeof(TickRow)) {
  static_assert(sizeof(Head) == sizeof(TickRow));
  const int file = open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  void* place = MAP_FAILED;
  if (file >= 0 && posix_fallocate(file, 0, static_cast<off_t>(size_)) == 0)
    place = mmap(nullptr, size_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file, 0);
  const int error = errno;
  if (file >= 0) close(file);
  if (place == MAP_FAILED) throw Error(path + ": cannot be written: " + std::strerror(error));
  head_ = new (place) Head{"toothprep-ticks", rate, most_rows, {}, {}};
  rows_ = reinterpret_cast<TickRow*>(head_ + 1);
}

TickLog::~TickLog() { munmap(head_, size_); }

void TickLog::add(const TickRow& row) noexcept {
  const std::uint64_t n = head_->rows.load(std::memory_order_relaxed);
  if (n < most_) rows_[n] = row;
  head_->rows.store(n + 1, std::memory_order_release);
}

}  // namespace toothprep::stand_in
