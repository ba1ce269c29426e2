// SHA-256 (by OpenSSL), as lower-case hexadecimal digits.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>

namespace toothprep {

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  void update(const void* data, std::size_t bytes);
  std::string hex();  // finishes; call once

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Regular files only; throws InputError if unreadable. Once `stop` is set it comes back soon, with no
// hash of anything.
std::string sha256_of_file(const std::string& path, const std::atomic<bool>* stop = nullptr);

}  // namespace toothprep
