// SHA-256 (by OpenSSL), as lower-case hexadecimal digits.
#pragma once

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

std::string sha256_of_file(const std::string& path);  // regular files only; throws InputError

}  // namespace toothprep
