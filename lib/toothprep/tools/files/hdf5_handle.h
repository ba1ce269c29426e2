// HDF5's ids as values that close themselves, its error stack kept quiet, and one thread at a time.
// No header of this module shows hdf5.h, so no other module sees it.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace toothprep::h5 {

using Id = std::int64_t;  // hid_t

// Owns one id; `close` is the H5?close of its kind.
class Handle {
 public:
  Handle() = default;
  Handle(Id id, int (*close)(Id)) : id_(id), close_(close) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, kNone)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() { reset(); }

  Id get() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }
  bool reset() {  // false if closing failed: what was to be written is not
    const Id id = std::exchange(id_, kNone);
    return id < 0 || close_(id) >= 0;
  }

 private:
  static constexpr Id kNone = -1;
  Id id_ = kNone;
  int (*close_)(Id) = nullptr;
};

// The 1 .. `most` texts of variable length that an attribute holds; nothing if it doesn't, or if it
// can't be read.
std::optional<std::vector<std::string>> texts_of(const Handle& attribute, std::int64_t most);

// While it lives, HDF5 prints nothing on stderr (from this thread). Nor at exit: the first one also
// switches off HDF5's own clean-up, which complains about objects of damaged files (every Handle
// has closed its own by then).
class Quiet {
 public:
  Quiet();
  ~Quiet();
  Quiet(const Quiet&) = delete;
  Quiet& operator=(const Quiet&) = delete;

 private:
  int (*function_)(Id, void*) = nullptr;
  void* data_ = nullptr;
};

// Keeps other threads out of HDF5, which lets in one at a time anyway, and must be free when a
// process is copied (read_with_care). Whoever calls HDF5 holds it.
std::unique_lock<std::mutex> lock_hdf5();

}  // namespace toothprep::h5
